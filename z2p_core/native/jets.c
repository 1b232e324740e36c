/* Curved patches through the neighbours of points: jets of the second order (Cazals and Pouget, Estimating Differential
 * Quantities using Polynomial Fitting of Osculating Jets, 2005). */

#include <math.h>
#include <stdint.h>

#include "axes.h"
#include "fast.h"
#include "grid.h"

#define LANES 16      /* neighbours that are weighed at a time */
#define TERMS 6       /* 1, x, y, x^2, x y, y^2 */
#define SUMS (TERMS * (TERMS + 1) / 2 + TERMS)
#define WINDOW 1.2f   /* of the Gaussian that nearer neighbours count by, in `scale` */
#define AGREE 0.2f    /* 1 - cosine at which a neighbour that faces elsewhere counts a quarter */
#define LEAST 1e-4f   /* weight of any neighbour, so that there always is a patch */
#define STIFF 0.03f   /* weight of a flat patch, against that of the neighbours */
#define STEEPEST 1.0f /* slope by which a patch may turn a normal, along either axis */

/* Adds up, over the neighbours in `row` (most), the weighted products of the terms and of the height with them. */
INLINE void add_up(const float *points, const float *before, int point, const int *row, int most,
                   const float *u, const float *v, float tolerance, float scale, float *sums) {
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
    for (int s = 0; s < SUMS; s++) {
        sums[s] = 0;
        for (int j = 0; j < LANES; j++) sums[s] += lanes[s][j];
    }
}

/* Solves a symmetric system by Cholesky's method: its lower rows and its right side come in `sums`. */
INLINE void solve(float *sums, float *term) {
    float *l[TERMS], *right = sums + SUMS - TERMS;
    for (int a = 0, at = 0; a < TERMS; at += ++a) l[a] = sums + at;
    for (int a = 0; a < TERMS; a++) {
        l[a][a] += a < 3 ? LEAST : STIFF;
        for (int b = 0; b <= a; b++) {
            float sum = l[a][b];
            for (int k = 0; k < b; k++) sum -= l[a][k] * l[b][k];
            l[a][b] = b < a ? sum / l[b][b] : sqrtf(fmaxf(sum, 1e-8f));
        }
        float sum = right[a];
        for (int k = 0; k < a; k++) sum -= l[a][k] * right[k];
        right[a] = sum / l[a][a];
    }
    for (int a = TERMS - 1; a >= 0; a--) {
        float sum = right[a];
        for (int k = a + 1; k < TERMS; k++) sum -= l[k][a] * term[k];
        term[a] = sum / l[a][a];
    }
}

/* Patches through neighbours found (count, most) of the points asked for: unit normals (count, 3) at these, and how far
 * each point lies above its patch, along that normal. Those neighbours count most that lie near the plane through the
 * point whose normal is in `before` (of all points), within `tolerance` (count), that agree with it, and that are near,
 * as measured in `scale` (count). */
FAST int z2p_jets(const float *points, const float *before, const int *asked, const int *found, int count, int most,
                  const float *tolerance, const float *scale, float *normals, float *heights) {
    for (int i = 0; i < count; i++) {
        const float *n = before + 3 * (size_t)asked[i];
        float u[3], v[3], sums[SUMS], term[TERMS], unit = fmaxf(scale[i], 1e-9f), slope[2], length = 1;
        axes_across(n, u, v);
        add_up(points, before, asked[i], found + (size_t)i * most, most, u, v, tolerance[i] + 1e-9f, unit, sums);
        solve(sums, term);
        for (int a = 0; a < 2; a++) {
            slope[a] = fminf(fmaxf(term[1 + a], -STEEPEST), STEEPEST);
            length += slope[a] * slope[a];
        }
        length = 1 / sqrtf(length);
        for (int a = 0; a < 3; a++) normals[3 * (size_t)i + a] = (n[a] - slope[0] * u[a] - slope[1] * v[a]) * length;
        heights[i] = -term[0] * unit * length;
    }
    return 1;
}
