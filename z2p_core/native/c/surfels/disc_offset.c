/* Where flat discs lie for a bent surface: through its points they would all stand out of it. */

#include <math.h>
#include <stddef.h>

#include "common/simd.h"

#define AROUND 8       /* neighbours that tell how the surface bends */
#define CREASE 0.3f    /* radii: what lies farther from a disc's plane is bent no smoother, but belongs to a crease */
#define WIDER 3.0f     /* a disc whose square is so much that of its neighbours' distance is not moved farther */

/* centres (count, 3), from row `begin` to `end`, of discs about points with unit normals and radii, whose neighbours
 * found (count, most) are known, nearest first, the point itself before them. A surface z = k r^2 / 2 is on average as
 * high as k R^2 / 4 over a disc of radius R, half of what it is at that distance. */
FAST int z2p_centres(const float *points, const float *normals, const float *radii, const int *found, int begin, int end,
                     int most, float *centres) {
    int last = most < AROUND + 1 ? most : AROUND + 1;
    for (int i = begin; i < end; i++) {
        const float *p = points + 3 * (size_t)i, *n = normals + 3 * (size_t)i;
        const int *row = found + (size_t)i * most;
        float height = 0, square = 0, bound = CREASE * radii[i];
        for (int j = 1; j < last; j++) {
            const float *q = points + 3 * (size_t)row[j];
            float step[3] = {q[0] - p[0], q[1] - p[1], q[2] - p[2]};
            height += larger(-bound, smaller(dot(step, n), bound));
            square += dot(step, step);
        }
        float count = (float)(last > 1 ? last - 1 : 1);
        float wide = square > 0 ? smaller(radii[i] * radii[i] * count / square, WIDER) : 0;
        for (int a = 0; a < 3; a++) centres[3 * (size_t)i + a] = p[a] + 0.5f * wide * height / count * n[a];
    }
    return 1;
}
