/* Projected extent of a cloud for candidate views, on coarse masks.
 *
 * Input: points in the unit sphere, azimuths and one elevation. Output, for each view: cells covered by the points'
 * dots, and the width of the orthographic projection. */

#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "common/simd.h"

/* Marks the cells of a mask (side + 2, side + 2) that points (count, 3) of the unit sphere fall into, turned by an
 * azimuth of this cosine and sine. Returns the width of the projection. */
INLINE float project_points(const float *restrict points, int count, float cosine, float sine, const float *tilt,
                            int side, uint8_t *restrict mask) {
    float half = 0.5f * (float)side - 0.5f, low = INFINITY, high = -INFINITY;
    for (int i = 0; i < count; i++) {
        const float *p = points + 3 * i;
        float across = cosine * p[0] - sine * p[1], back = sine * p[0] + cosine * p[1];
        float upwards = back * tilt[0] + p[2] * tilt[1];
        low = across < low ? across : low;
        high = across > high ? across : high;
        mask[((int)((across + 1) * half) + 1) * (side + 2) + (int)((upwards + 1) * half) + 1] = 1;
    }
    return high - low;
}

/* Number of inner cells that are marked or have a marked neighbor among the eight around them. */
INLINE int count_covered_cells(const uint8_t *restrict mask, int side, uint8_t *restrict rows_dilated) {
    int covered = 0, row = side + 2;
    for (int i = row; i < row * (side + 1); i++) rows_dilated[i] = mask[i - row] | mask[i] | mask[i + row];
    for (int y = 1; y <= side; y++)
        for (int x = 1; x <= side; x++) {
            const uint8_t *at = rows_dilated + y * row + x;
            covered += at[-1] | at[0] | at[1];
        }
    return covered;
}

/* covered (views): cells of a mask (side, side) that the points, as dots of 3 x 3 cells, cover; breadth (views): width
 * of the projection. turns (views, 2): cosine and sine of the azimuth; tilt (2): sine and cosine of the elevation. */
FAST int z2p_projected_coverage(const float *points, int count, const float *turns, int views, const float *tilt,
                                int side, int32_t *covered, float *breadth) {
    size_t cells = (size_t)(side + 2) * (side + 2);
    uint8_t *mask = malloc(2 * cells);
    if (!mask) return 0;
    for (int v = 0; v < views; v++) {
        memset(mask, 0, cells);
        breadth[v] = project_points(points, count, turns[2 * v], turns[2 * v + 1], tilt, side, mask);
        covered[v] = count_covered_cells(mask, side, mask + cells);
    }
    free(mask);
    return 1;
}
