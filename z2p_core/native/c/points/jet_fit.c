/* Curved patches through the neighborhoods of points: jets of second order (Cazals and Pouget, Estimating Differential
 * Quantities using Polynomial Fitting of Osculating Jets, 2005), by weighted least squares.
 *
 * Input: points, their neighbors and previous normals. Output: unit normals of the patches, and how far the points lie
 * above them. */

#include <math.h>

#include "common/vec3.h"
#include "common/simd.h"
#include "points/neighbor_grid.h"

#define BATCH 16               /* neighbors that are weighted at a time, and points whose patches are solved for */
#define TERMS 6                /* of the polynomial: 1, x, y, x^2, x y, y^2 */
#define SUMS (TERMS * (TERMS + 1) / 2 + TERMS)
#define WINDOW_SCALES 1.2f     /* standard deviation of the Gaussian window on the distance, in `scale` */
#define NORMAL_TOLERANCE 0.2f  /* 1 - |cosine| between normals at which a neighbor's weight falls to a quarter */
#define MIN_WEIGHT 1e-4f       /* of any neighbor, so that the system can be solved */
#define FLATNESS_WEIGHT 0.03f  /* of the regularization towards a flat patch, against the neighbors' weights */
#define MAX_SLOPE 1.0f         /* of a patch against the previous normal, along either axis */

/* Sum of the lanes, by halves, so that no addition waits for the one before. */
INLINE float sum_lanes(float *products) {
    for (int j = 0; j < BATCH / 2; j++) products[j] += products[j + BATCH / 2];
    for (int j = 0; j < BATCH / 4; j++) products[j] += products[j + BATCH / 4];
    return (products[0] + products[2]) + (products[1] + products[3]);
}

/* Accumulates the weighted normal equations over a row of neighbors: products of the terms with each other and with the
 * height, into one lane of `sums`. */
INLINE void accumulate_normal_equations(const float *points, const float *normals_before, int point, const int *row,
                                        int neighbor_count, const float *u, const float *v, float tolerance,
                                        float scale, int lane, float (*sums)[BATCH]) {
    const float *p = points + 3 * (size_t)point, *n = normals_before + 3 * (size_t)point;
    float products[SUMS][BATCH] = {{0}}, unit = 1 / scale, inverse_tolerance = scale / tolerance;
    for (int first = 0; first < neighbor_count; first += BATCH) {
        float d[3][BATCH], m[3][BATCH], term[TERMS + 1][BATCH], weight[BATCH];
        for (int j = 0; j < BATCH; j++) {
            size_t other = 3 * (size_t)row[first + j < neighbor_count ? first + j : neighbor_count - 1];
            for (int a = 0; a < 3; a++) {
                d[a][j] = (points[other + a] - p[a]) * unit;
                m[a][j] = normals_before[other + a];
            }
        }
        for (int j = 0; j < BATCH; j++) {
            float x = d[0][j] * u[0] + d[1][j] * u[1] + d[2][j] * u[2];
            float y = d[0][j] * v[0] + d[1][j] * v[1] + d[2][j] * v[2];
            float z = d[0][j] * n[0] + d[1][j] * n[1] + d[2][j] * n[2], away = z * inverse_tolerance;
            float cosine = m[0][j] * n[0] + m[1][j] * n[1] + m[2][j] * n[2];
            float misfit = (1 + away * away) * (1 + (1 - fabsf(cosine)) * (1 / NORMAL_TOLERANCE));
            float window = exp_fast((x * x + y * y) * (-0.5f / (WINDOW_SCALES * WINDOW_SCALES)));
            weight[j] = first + j < neighbor_count ? (1 / (misfit * misfit) + MIN_WEIGHT) * window : 0;
            term[0][j] = 1;
            term[1][j] = x;
            term[2][j] = y;
            term[3][j] = x * x;
            term[4][j] = x * y;
            term[5][j] = y * y;
            term[TERMS][j] = z;
        }
        for (int b = 0, at = 0; b <= TERMS; b++) {
            int count = b < TERMS ? b + 1 : TERMS; /* each term with those up to itself; the height with all */
            for (int a = 0; a < count; a++, at++)
                for (int j = 0; j < BATCH; j++) products[at][j] += weight[j] * term[b][j] * term[a][j];
        }
    }
    for (int s = 0; s < SUMS; s++) sums[s][lane] = sum_lanes(products[s]);
}

/* Solves symmetric systems by Cholesky decomposition, one in each lane; `sums` holds lower rows, then right sides. */
INLINE void solve_cholesky(float (*sums)[BATCH], float (*term)[BATCH]) {
    float(*l[TERMS])[BATCH], (*right)[BATCH] = sums + SUMS - TERMS;
    for (int a = 0, at = 0; a < TERMS; at += ++a) l[a] = sums + at;
    for (int a = 0; a < TERMS; a++) {
        for (int b = 0; b <= a; b++) {
            float *to = l[a][b];
            for (int k = 0; k < b; k++)
                for (int i = 0; i < BATCH; i++) to[i] -= l[a][k][i] * l[b][k][i];
            if (b < a)
                for (int i = 0; i < BATCH; i++) to[i] /= l[b][b][i];
            else
                for (int i = 0; i < BATCH; i++) to[i] = sqrtf(larger(to[i], 1e-8f));
        }
        for (int k = 0; k < a; k++)
            for (int i = 0; i < BATCH; i++) right[a][i] -= l[a][k][i] * right[k][i];
        for (int i = 0; i < BATCH; i++) right[a][i] /= l[a][a][i];
    }
    for (int a = TERMS - 1; a >= 0; a--) {
        for (int i = 0; i < BATCH; i++) term[a][i] = right[a][i];
        for (int k = a + 1; k < TERMS; k++)
            for (int i = 0; i < BATCH; i++) term[a][i] -= l[k][a][i] * term[k][i];
        for (int i = 0; i < BATCH; i++) term[a][i] /= l[a][a][i];
    }
}

/* normals (count, 3) and heights (count) of the points with `query_indices` (count) above patches through their
 * neighbors (count, neighbor_count). A neighbor weighs less the farther it lies off the plane by the point's normal in
 * `normals_before` (all points, 3), relative to `tolerance` (count), the more its own normal differs, and the farther
 * away it lies, relative to `scale` (count). */
FAST int z2p_fit_jets(const float *points, const float *normals_before, const int *query_indices, const int *neighbors,
                      int count, int neighbor_count, const float *tolerance, const float *scale, float *normals,
                      float *heights) {
    for (int first = 0; first < count; first += BATCH) {
        int batch_size = count - first < BATCH ? count - first : BATCH;
        float sums[SUMS][BATCH] = {{0}}, term[TERMS][BATCH], u[BATCH][3], v[BATCH][3];
        for (int i = 0; i < batch_size; i++) {
            int at = first + i;
            tangent_basis(normals_before + 3 * (size_t)query_indices[at], u[i], v[i]);
            accumulate_normal_equations(points, normals_before, query_indices[at],
                                        neighbors + (size_t)at * neighbor_count, neighbor_count, u[i], v[i],
                                        tolerance[at] + 1e-9f, larger(scale[at], 1e-9f), i, sums);
        }
        for (int a = 0, at = 0; a < TERMS; at += ++a)
            for (int i = 0; i < BATCH; i++) sums[at + a][i] += a < 3 ? MIN_WEIGHT : FLATNESS_WEIGHT;
        solve_cholesky(sums, term);
        for (int i = 0; i < batch_size; i++) {
            const float *n = normals_before + 3 * (size_t)query_indices[first + i];
            float slope[2], length = 1, *normal = normals + 3 * (size_t)(first + i);
            for (int a = 0; a < 2; a++) {
                slope[a] = smaller(larger(term[1 + a][i], -MAX_SLOPE), MAX_SLOPE);
                length += slope[a] * slope[a];
            }
            length = 1 / sqrtf(length);
            for (int a = 0; a < 3; a++) normal[a] = (n[a] - slope[0] * u[i][a] - slope[1] * v[i][a]) * length;
            heights[first + i] = -term[0][i] * larger(scale[first + i], 1e-9f) * length;
        }
    }
    return 1;
}
