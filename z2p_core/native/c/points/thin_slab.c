/* How thin a slab some of a point's neighbours fit into: what tells noise from a second sheet close by, which those in
 * the slab leave out (after Rousseeuw, Least Median of Squares Regression, 1984). */

#include <math.h>
#include <stddef.h>

#include "common/simd.h"

#define NEAREST 6    /* neighbours that span the slabs that are tried, with the point itself, two at a time */
#define LANES 16     /* slabs that are tried at a time: all pairs of those are 15 */
#define MOST 16      /* neighbours */
#define SLANTED 0.15f /* sine of the angle between two neighbours that span a plane */

/* Steps q (most, 3) from a point to its neighbours, unit normals of planes through the point and two of the nearest of
 * these, a lane each, and heights over them; heights far apart where two span no plane. */
INLINE void heights_over(const float *points, const float *p, const int *row, int most, float (*q)[3],
                         float (*normal)[LANES], float (*height)[LANES]) {
    for (int j = 0; j < most; j++)
        for (int a = 0; a < 3; a++) q[j][a] = points[3 * (size_t)row[j] + a] - p[a];
    int pair = 0, spans[LANES] = {0};
    for (int l = 0; l < LANES; l++) normal[0][l] = normal[1][l] = normal[2][l] = 0;
    for (int i = 1; i <= NEAREST; i++)
        for (int j = i + 1; j <= NEAREST; j++, pair++) {
            const float *u = q[i], *v = q[j];
            float n[3] = {u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]};
            float square = dot(n, n), inverse = 1 / sqrtf(larger(square, 1e-30f));
            spans[pair] = square > SLANTED * SLANTED * dot(u, u) * dot(v, v) && square > 1e-30f;
            for (int a = 0; a < 3; a++) normal[a][pair] = n[a] * inverse;
        }
    for (int j = 0; j < most; j++)
        for (int l = 0; l < LANES; l++) {
            float over = q[j][0] * normal[0][l] + q[j][1] * normal[1][l] + q[j][2] * normal[2][l];
            height[j][l] = spans[l] ? over : (float)j * 1e30f;
        }
}

/* Puts the lower one of each two numbers first. */
INLINE void order(float *restrict first, float *restrict second) {
    for (int l = 0; l < LANES; l++) {
        float one = first[l], other = second[l], low = one < other ? one : other, high = one < other ? other : one;
        first[l] = low;
        second[l] = high;
    }
}

/* Share of steps (most, 3) that lead rather along a normal, lane l of those, than along its plane. */
INLINE float steep_share(float (*q)[3], int most, float (*normal)[LANES], int l) {
    int steep = 0;
    for (int j = 0; j < most; j++) {
        float over = q[j][0] * normal[0][l] + q[j][1] * normal[1][l] + q[j][2] * normal[2][l];
        steep += 2 * over * over > dot(q[j], q[j]);
    }
    return (float)steep / (float)most;
}

/* widths (count): half the width of the thinnest slab that holds `held` of the neighbours found (count, most <= 16) of
 * the points asked for; 0 where they lie on a line. steep (count): the share of those above or below the point rather
 * than beside it, as it lies in that slab. */
FAST int z2p_slabs(const float *points, const int *asked, const int *found, int count, int most, int held,
                   float *widths, float *steep) {
    for (int i = 0; i < count; i++) {
        float q[MOST][3], normal[3][LANES], height[MOST][LANES], best[LANES], least = INFINITY;
        int thinnest = 0;
        heights_over(points, points + 3 * (size_t)asked[i], found + (size_t)i * most, most, q, normal, height);
        for (int round = 0; round < most; round++) /* sorts all lanes at once, neighbours changing places */
            for (int j = round % 2; j + 1 < most; j += 2) order(height[j], height[j + 1]);
        for (int l = 0; l < LANES; l++) best[l] = INFINITY;
        for (int j = 0; j + held <= most; j++)
            for (int l = 0; l < LANES; l++) {
                float width = height[j + held - 1][l] - height[j][l];
                best[l] = width < best[l] ? width : best[l];
            }
        for (int l = 0; l < LANES; l++) {
            thinnest = best[l] < least ? l : thinnest;
            least = best[l] < least ? best[l] : least;
        }
        widths[i] = least < 1e29f ? 0.5f * least : 0;
        steep[i] = steep_share(q, most, normal, thinnest);
    }
    return 1;
}
