/* Half width of the thinnest slab that holds a given number of a point's neighbors: a robust measure of noise, which
 * leaves out a second sheet of surface close by (after Rousseeuw, Least Median of Squares Regression, 1984).
 *
 * Input: points, their neighbors, and how many the slab must hold. Output: its half width, and the share of neighbors
 * that lie above or below the point rather than beside it. */

#include <math.h>
#include <stddef.h>

#include "common/vec3.h"

#define SPANNING_NEIGHBORS 6 /* nearest neighbors, two of which span a slab with the point */
#define BATCH 16             /* slabs that are tried at a time: there are 15 such pairs */
#define MAX_SLAB_NEIGHBORS 16
#define MIN_SPAN_SINE 0.15f  /* least sine of the angle between two neighbors that span a slab */

/* Offsets q (neighbor_count, 3) of the neighbors; unit normals of the planes through p and two of the nearest, one in
 * each lane; and heights of the neighbors over them, far apart where two neighbors span no plane. */
INLINE void slab_heights(const float *points, const float *p, const int *row, int neighbor_count, float (*q)[3],
                         float (*normal)[BATCH], float (*height)[BATCH]) {
    for (int j = 0; j < neighbor_count; j++)
        for (int a = 0; a < 3; a++) q[j][a] = points[3 * (size_t)row[j] + a] - p[a];
    int pair = 0, spans[BATCH] = {0};
    for (int l = 0; l < BATCH; l++) normal[0][l] = normal[1][l] = normal[2][l] = 0;
    for (int i = 1; i <= SPANNING_NEIGHBORS; i++)
        for (int j = i + 1; j <= SPANNING_NEIGHBORS; j++, pair++) {
            const float *u = q[i], *v = q[j];
            float n[3];
            cross(u, v, n);
            float square = dot(n, n), inverse = 1 / sqrtf(larger(square, 1e-30f));
            spans[pair] = square > MIN_SPAN_SINE * MIN_SPAN_SINE * dot(u, u) * dot(v, v) && square > 1e-30f;
            for (int a = 0; a < 3; a++) normal[a][pair] = n[a] * inverse;
        }
    for (int j = 0; j < neighbor_count; j++)
        for (int l = 0; l < BATCH; l++) {
            float over = q[j][0] * normal[0][l] + q[j][1] * normal[1][l] + q[j][2] * normal[2][l];
            height[j][l] = spans[l] ? over : (float)j * 1e30f;
        }
}

/* Sorts each lane's two numbers. */
INLINE void sort_pair(float *restrict first, float *restrict second) {
    for (int l = 0; l < BATCH; l++) {
        float one = first[l], other = second[l], low = one < other ? one : other, high = one < other ? other : one;
        first[l] = low;
        second[l] = high;
    }
}

/* Share of the offsets (neighbor_count, 3) that are steeper than 45 degrees against the plane of lane l. */
INLINE float steep_share(float (*q)[3], int neighbor_count, float (*normal)[BATCH], int l) {
    int steep = 0;
    for (int j = 0; j < neighbor_count; j++) {
        float over = q[j][0] * normal[0][l] + q[j][1] * normal[1][l] + q[j][2] * normal[2][l];
        steep += 2 * over * over > dot(q[j], q[j]);
    }
    return (float)steep / (float)neighbor_count;
}

/* widths (count): half the width of the thinnest slab that holds `held` of the neighbors (count, neighbor_count <= 16),
 * 0 if they lie on a line; steep (count): share of neighbors steeper than 45 degrees against that slab. The points with
 * `query_indices` (count) are the first of their own neighbors. */
FAST int z2p_fit_thin_slabs(const float *points, const int *query_indices, const int *neighbors, int count,
                            int neighbor_count, int held, float *widths, float *steep) {
    for (int i = 0; i < count; i++) {
        float q[MAX_SLAB_NEIGHBORS][3], normal[3][BATCH], height[MAX_SLAB_NEIGHBORS][BATCH], best[BATCH];
        float least_width = INFINITY;
        int thinnest = 0;
        slab_heights(points, points + 3 * (size_t)query_indices[i], neighbors + (size_t)i * neighbor_count,
                     neighbor_count, q, normal, height);
        for (int round = 0; round < neighbor_count; round++) /* odd-even transposition sort of all lanes at once */
            for (int j = round % 2; j + 1 < neighbor_count; j += 2) sort_pair(height[j], height[j + 1]);
        for (int l = 0; l < BATCH; l++) best[l] = INFINITY;
        for (int j = 0; j + held <= neighbor_count; j++)
            for (int l = 0; l < BATCH; l++) {
                float width = height[j + held - 1][l] - height[j][l];
                best[l] = width < best[l] ? width : best[l];
            }
        for (int l = 0; l < BATCH; l++) {
            thinnest = best[l] < least_width ? l : thinnest;
            least_width = best[l] < least_width ? best[l] : least_width;
        }
        widths[i] = least_width < 1e29f ? 0.5f * least_width : 0;
        steep[i] = steep_share(q, neighbor_count, normal, thinnest);
    }
    return 1;
}
