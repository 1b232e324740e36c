/* Which way a bare cloud faces: planes through the neighbours of its points. */

#include <math.h>
#include <stdint.h>
#include <stdlib.h>

#include "fast.h"
#include "grid.h"

#define LANES 16      /* points whose planes are found at a time */
#define SHARED 12     /* nearest points that tell how large a patch of surface is a point's share */
#define AGREE 0.2f    /* 1 - cosine at which a neighbour that faces elsewhere counts a quarter */
#define LEAST 1e-4f   /* weight of any neighbour, so that there always is a plane */

/* One Jacobi rotation of symmetric matrices, a lane each: takes away pq, turns pr and qr, and the vectors p and q. */
static inline void rotate(float *pp, float *qq, float *pq, float *pr, float *qr, float (*p)[LANES], float (*q)[LANES]) {
    for (int i = 0; i < LANES; i++) {
        int none = fabsf(pq[i]) < 1e-20f;
        float theta = (qq[i] - pp[i]) / (none ? 1.0f : 2 * pq[i]);
        float t = (theta >= 0 ? 1.0f : -1.0f) / (fabsf(theta) + sqrtf(theta * theta + 1));
        if (none) t = 0;
        float c = 1 / sqrtf(t * t + 1), s = t * c, r = pr[i];
        pp[i] -= t * pq[i];
        qq[i] += t * pq[i];
        pq[i] = none ? pq[i] : 0;
        pr[i] = c * r - s * qr[i];
        qr[i] = s * r + c * qr[i];
        for (int axis = 0; axis < 3; axis++) {
            float x = p[axis][i], y = q[axis][i];
            p[axis][i] = c * x - s * y;
            q[axis][i] = s * x + c * y;
        }
    }
}

/* Unit eigenvectors of the smallest eigenvalues of symmetric matrices xx xy xz yy yz zz, which are overwritten. */
FAST void z2p_smallest_axes(float (*m)[LANES], float (*axes)[LANES]) {
    float x[3][LANES], y[3][LANES], z[3][LANES];
    for (int axis = 0; axis < 3; axis++)
        for (int i = 0; i < LANES; i++) {
            x[axis][i] = axis == 0;
            y[axis][i] = axis == 1;
            z[axis][i] = axis == 2;
        }
    for (int sweep = 0; sweep < 6; sweep++) {
        rotate(m[0], m[3], m[1], m[2], m[4], x, y);
        rotate(m[0], m[5], m[2], m[1], m[4], x, z);
        rotate(m[3], m[5], m[4], m[1], m[2], y, z);
    }
    for (int i = 0; i < LANES; i++) {
        int first = m[0][i] <= m[3][i] && m[0][i] <= m[5][i], second = m[3][i] <= m[5][i];
        for (int axis = 0; axis < 3; axis++) axes[axis][i] = first ? x[axis][i] : second ? y[axis][i] : z[axis][i];
    }
}

/* The grid of a cloud (count, 3), its points in the grid's order in `sorted`, behind `handle`. */
int z2p_grid(const float *points, int count, float *sorted, Grid **handle) {
    *handle = calloc(1, sizeof(Grid));
    return *handle && z2p_grid_build(*handle, points, count, sorted);
}

int z2p_grid_free(Grid *grid) {
    if (grid) free(grid->start);
    free(grid);
    return 1;
}

/* For each of the points `asked` (count), found (count, most): its nearest points, itself among them, the last of them
 * again and again where there are fewer; and the spacing there, the side of the patch of surface that is its share. */
int z2p_neighbours(const Grid *grid, const float *points, const int *asked, int count, int most, int *found,
                   float *spacing) {
    for (int i = 0; i < count; i++, found += most) {
        Near near = {.most = most};
        z2p_grid_nearest(grid, points, asked[i], &near);
        int shared = near.count < SHARED ? near.count : SHARED;
        spacing[i] = shared > 1 ? sqrtf(3.14159265f * near.distance[shared - 1] / (float)shared) : 0;
        for (int j = 0; j < most; j++) found[j] = near.found[j < near.count ? j : near.count - 1];
    }
    return 1;
}

/* Weights of the neighbours q (n, 3) of p whose normals are `facing` (n, 3): those near the plane through p with that
 * normal, and facing the same way or the opposite one, count most. */
static inline void weigh(const float *p, const float *normal, int n, const float (*q)[3], const float (*facing)[3],
                         float tolerance, float *weight) {
    float narrow = 1 / (tolerance + 1e-9f);
    for (int j = 0; j < n; j++) {
        float away = 0, along = 0;
        for (int a = 0; a < 3; a++) {
            away += (q[j][a] - p[a]) * normal[a];
            along += facing[j][a] * normal[a];
        }
        away *= narrow;
        float doubt = (1 + away * away) * (1 + (1 - fabsf(along)) * (1 / AGREE));
        weight[j] = 1 / (doubt * doubt) + LEAST;
    }
}

/* Weighted mean (3) and covariance xx xy xz yy yz zz of points q (n, 3). */
static inline void moments(int n, const float (*q)[3], const float *weight, float *mean, float *m) {
    float sum = 0;
    mean[0] = mean[1] = mean[2] = 0;
    for (int j = 0; j < n; j++) {
        sum += weight[j];
        for (int a = 0; a < 3; a++) mean[a] += weight[j] * q[j][a];
    }
    for (int a = 0; a < 3; a++) mean[a] /= sum;
    for (int i = 0; i < 6; i++) m[i] = 0;
    for (int j = 0; j < n; j++) {
        float w = weight[j] / sum, x = q[j][0] - mean[0], y = q[j][1] - mean[1], z = q[j][2] - mean[2];
        m[0] += w * x * x; m[1] += w * x * y; m[2] += w * x * z;
        m[3] += w * y * y; m[4] += w * y * z; m[5] += w * z * z;
    }
}

/* Planes through neighbours found (count, most): unit normals (count, 3), either way; middles (count, 3) on them; and
 * the spread (count) of the neighbours off each, a standard deviation. All neighbours count alike, or, where `before`
 * (of all points) has normals, those count most that lie near the plane through the point, within `tolerance` (count),
 * and agree with it. */
FAST int z2p_planes(const float *points, const int *asked, const int *found, int count, int most, const float *before,
                    const float *tolerance, float *normals, float *middles, float *spread) {
    for (int first = 0; first < count; first += LANES) {
        int lanes = count - first < LANES ? count - first : LANES;
        float m[6][LANES] = {{0}}, axes[3][LANES], kept[6][LANES];
        for (int i = 0; i < lanes; i++) {
            const int at = first + i, *row = found + (size_t)at * most;
            float q[MOST_NEIGHBOURS][3], facing[MOST_NEIGHBOURS][3], weight[MOST_NEIGHBOURS], own[6];
            for (int j = 0; j < most; j++)
                for (int a = 0; a < 3; a++) {
                    q[j][a] = points[3 * (size_t)row[j] + a];
                    if (before) facing[j][a] = before[3 * (size_t)row[j] + a];
                    else weight[j] = 1;
                }
            if (before)
                weigh(points + 3 * (size_t)asked[at], before + 3 * (size_t)asked[at], most, q, facing, tolerance[at],
                      weight);
            moments(most, q, weight, middles + 3 * (size_t)at, own);
            for (int j = 0; j < 6; j++) m[j][i] = kept[j][i] = own[j];
        }
        z2p_smallest_axes(m, axes);
        for (int i = 0; i < lanes; i++) {
            float x = axes[0][i], y = axes[1][i], z = axes[2][i], *normal = normals + 3 * (size_t)(first + i);
            float square = kept[0][i] * x * x + kept[3][i] * y * y + kept[5][i] * z * z
                         + 2 * (kept[1][i] * x * y + kept[2][i] * x * z + kept[4][i] * y * z);
            normal[0] = x; normal[1] = y; normal[2] = z;
            spread[first + i] = sqrtf(square > 0 ? square : 0);
        }
    }
    return 1;
}
