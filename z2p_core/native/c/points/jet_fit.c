/* Curved patches through the neighbours of points: jets of the second order (Cazals and Pouget, Estimating Differential
 * Quantities using Polynomial Fitting of Osculating Jets, 2005). */

#include <math.h>

#include "common/vec3.h"
#include "common/simd.h"
#include "points/neighbor_grid.h"

#define LANES 16      /* neighbours that are weighed at a time, and points whose patches are solved for */
#define TERMS 6       /* 1, x, y, x^2, x y, y^2 */
#define SUMS (TERMS * (TERMS + 1) / 2 + TERMS)
#define WINDOW 1.2f   /* of the Gaussian that nearer neighbours count by, in `scale` */
#define AGREE 0.2f    /* 1 - cosine at which a neighbour that faces elsewhere counts a quarter */
#define LEAST 1e-4f   /* weight of any neighbour, so that there always is a patch */
#define STIFF 0.03f   /* weight of a flat patch, against that of the neighbours */
#define STEEPEST 1.0f /* slope by which a patch may turn a normal, along either axis */

/* Sum of the lanes, by halves, so that no addition waits for the one before. */
INLINE float sum_of(float *lanes) {
    for (int j = 0; j < LANES / 2; j++) lanes[j] += lanes[j + LANES / 2];
    for (int j = 0; j < LANES / 4; j++) lanes[j] += lanes[j + LANES / 4];
    return (lanes[0] + lanes[2]) + (lanes[1] + lanes[3]);
}

/* Adds up, over the neighbours in `row` (most), the weighted products of the terms and of the height with them, into a
 * lane of `sums`. */
INLINE void add_up(const float *points, const float *before, int point, const int *row, int most,
                   const float *u, const float *v, float tolerance, float scale, int lane,
                   float (*sums)[LANES]) {
    const float *p = points + 3 * (size_t)point, *n = before + 3 * (size_t)point;
    float lanes[SUMS][LANES] = {{0}}, unit = 1 / scale, narrow = scale / tolerance;
    for (int first = 0; first < most; first += LANES) {
        float d[3][LANES], m[3][LANES], term[TERMS + 1][LANES], weight[LANES];
        for (int j = 0; j < LANES; j++) {
            size_t other = 3 * (size_t)row[first + j < most ? first + j : most - 1];
            for (int a = 0; a < 3; a++) {
                d[a][j] = (points[other + a] - p[a]) * unit;
                m[a][j] = before[other + a];
            }
        }
        for (int j = 0; j < LANES; j++) {
            float x = d[0][j] * u[0] + d[1][j] * u[1] + d[2][j] * u[2];
            float y = d[0][j] * v[0] + d[1][j] * v[1] + d[2][j] * v[2];
            float z = d[0][j] * n[0] + d[1][j] * n[1] + d[2][j] * n[2], away = z * narrow;
            float along = m[0][j] * n[0] + m[1][j] * n[1] + m[2][j] * n[2];
            float doubt = (1 + away * away) * (1 + (1 - fabsf(along)) * (1 / AGREE));
            float near = exp_fast((x * x + y * y) * (-0.5f / (WINDOW * WINDOW)));
            weight[j] = first + j < most ? (1 / (doubt * doubt) + LEAST) * near : 0;
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
                for (int j = 0; j < LANES; j++) lanes[at][j] += weight[j] * term[b][j] * term[a][j];
        }
    }
    for (int s = 0; s < SUMS; s++) sums[s][lane] = sum_of(lanes[s]);
}

/* Solves symmetric systems by Cholesky's method, one in each lane: their lower rows and right sides come in `sums`. */
INLINE void solve(float (*sums)[LANES], float (*term)[LANES]) {
    float(*l[TERMS])[LANES], (*right)[LANES] = sums + SUMS - TERMS;
    for (int a = 0, at = 0; a < TERMS; at += ++a) l[a] = sums + at;
    for (int a = 0; a < TERMS; a++) {
        for (int b = 0; b <= a; b++) {
            float *to = l[a][b];
            for (int k = 0; k < b; k++)
                for (int i = 0; i < LANES; i++) to[i] -= l[a][k][i] * l[b][k][i];
            if (b < a)
                for (int i = 0; i < LANES; i++) to[i] /= l[b][b][i];
            else
                for (int i = 0; i < LANES; i++) to[i] = sqrtf(larger(to[i], 1e-8f));
        }
        for (int k = 0; k < a; k++)
            for (int i = 0; i < LANES; i++) right[a][i] -= l[a][k][i] * right[k][i];
        for (int i = 0; i < LANES; i++) right[a][i] /= l[a][a][i];
    }
    for (int a = TERMS - 1; a >= 0; a--) {
        for (int i = 0; i < LANES; i++) term[a][i] = right[a][i];
        for (int k = a + 1; k < TERMS; k++)
            for (int i = 0; i < LANES; i++) term[a][i] -= l[k][a][i] * term[k][i];
        for (int i = 0; i < LANES; i++) term[a][i] /= l[a][a][i];
    }
}

/* Patches through neighbours found (count, most) of the points asked for: unit normals (count, 3) at these, and how far
 * each point lies above its patch, along that normal. Those neighbours count most that lie near the plane through the
 * point whose normal is in `before` (of all points), within `tolerance` (count), that agree with it, and that are near,
 * as measured in `scale` (count). */
FAST int z2p_jets(const float *points, const float *before, const int *asked, const int *found, int count, int most,
                  const float *tolerance, const float *scale, float *normals, float *heights) {
    for (int first = 0; first < count; first += LANES) {
        int points_here = count - first < LANES ? count - first : LANES;
        float sums[SUMS][LANES] = {{0}}, term[TERMS][LANES], u[LANES][3], v[LANES][3];
        for (int i = 0; i < points_here; i++) {
            int at = first + i;
            axes_across(before + 3 * (size_t)asked[at], u[i], v[i]);
            add_up(points, before, asked[at], found + (size_t)at * most, most, u[i], v[i], tolerance[at] + 1e-9f,
                   larger(scale[at], 1e-9f), i, sums);
        }
        for (int a = 0, at = 0; a < TERMS; at += ++a)
            for (int i = 0; i < LANES; i++) sums[at + a][i] += a < 3 ? LEAST : STIFF;
        solve(sums, term);
        for (int i = 0; i < points_here; i++) {
            const float *n = before + 3 * (size_t)asked[first + i];
            float slope[2], length = 1, *normal = normals + 3 * (size_t)(first + i);
            for (int a = 0; a < 2; a++) {
                slope[a] = smaller(larger(term[1 + a][i], -STEEPEST), STEEPEST);
                length += slope[a] * slope[a];
            }
            length = 1 / sqrtf(length);
            for (int a = 0; a < 3; a++) normal[a] = (n[a] - slope[0] * u[i][a] - slope[1] * v[i][a]) * length;
            heights[first + i] = -term[0][i] * larger(scale[first + i], 1e-9f) * length;
        }
    }
    return 1;
}
