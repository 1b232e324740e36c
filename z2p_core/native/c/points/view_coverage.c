/* How much of a cloud is seen from around it, on coarse pictures. */

#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "common/simd.h"

/* Marks the cells (side + 2, side + 2) of a picture where points (count, 3) of the unit sphere fall that a turn with
 * this sine and cosine brings before a camera from afar, and says how broad they lie. */
INLINE float mark_view(const float *restrict points, int count, float cosine, float sine, const float *tilt, int side,
                       uint8_t *restrict picture) {
    float half = 0.5f * (float)side - 0.5f, low = INFINITY, high = -INFINITY;
    for (int i = 0; i < count; i++) {
        const float *p = points + 3 * i;
        float across = cosine * p[0] - sine * p[1], back = sine * p[0] + cosine * p[1];
        float upwards = back * tilt[0] + p[2] * tilt[1];
        low = across < low ? across : low;
        high = across > high ? across : high;
        picture[((int)((across + 1) * half) + 1) * (side + 2) + (int)((upwards + 1) * half) + 1] = 1;
    }
    return high - low;
}

/* How many cells, but for the border, have a marked one among themselves and their eight neighbours. */
INLINE int count_covered(const uint8_t *restrict picture, int side, uint8_t *restrict wide) {
    int covered = 0, row = side + 2;
    for (int i = row; i < row * (side + 1); i++) wide[i] = picture[i - row] | picture[i] | picture[i + row];
    for (int y = 1; y <= side; y++)
        for (int x = 1; x <= side; x++) {
            const uint8_t *at = wide + y * row + x;
            covered += at[-1] | at[0] | at[1];
        }
    return covered;
}

/* covered (views) and breadth (views): of points (count, 3) within the unit sphere, the cells of a picture (side, side)
 * that dots of 3 x 3 cells cover in each view, and how broad the points lie there. A view has a turn about Z, (views, 2)
 * as cosine and sine; `tilt` is the sine and cosine of the camera's elevation. */
FAST int z2p_showing(const float *points, int count, const float *turns, int views, const float *tilt, int side,
                     int32_t *covered, float *breadth) {
    size_t cells = (size_t)(side + 2) * (side + 2);
    uint8_t *picture = malloc(2 * cells);
    if (!picture) return 0;
    for (int v = 0; v < views; v++) {
        memset(picture, 0, cells);
        breadth[v] = mark_view(points, count, turns[2 * v], turns[2 * v + 1], tilt, side, picture);
        covered[v] = count_covered(picture, side, picture + cells);
    }
    free(picture);
    return 1;
}
