/* Which way a bare cloud faces: planes through the neighbours of its points. */

#include <math.h>
#include <stdlib.h>

#include "common/simd.h"
#include "points/neighbor_grid.h"

#define LANES 16      /* points whose planes are found at a time */
#define SHARED 12     /* nearest points that tell how large a patch of surface is a point's share */

/* One Jacobi rotation of symmetric matrices, a lane each: takes away pq, turns pr and qr, and the vectors p and q. */
INLINE void rotate(float *pp, float *qq, float *pq, float *pr, float *qr, float (*p)[LANES], float (*q)[LANES]) {
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
    return *handle && build_grid(*handle, points, count, sorted);
}

int z2p_grid_free(Grid *grid) {
    if (grid) {
        free(grid->start);
        free(grid->splits);
        free(grid->x);
    }
    free(grid);
    return 1;
}

/* For each of the points `asked` (count), found (count, most): its nearest points, itself among them, the last of them
 * again and again where there are fewer; and the spacing there, the side of the patch of surface that is its share. */
int z2p_neighbours(const Grid *grid, const float *points, const int *asked, int count, int most, int *found,
                   float *spacing) {
    for (int i = 0; i < count; i++, found += most) {
        Near near = {.most = most};
        find_nearest(grid, points, asked[i], &near);
        int shared = near.count < SHARED ? near.count : SHARED;
        spacing[i] = shared > 1 ? sqrtf(3.14159265f * near.distance[shared - 1] / (float)shared) : 0;
        for (int j = 0; j < most; j++) found[j] = near.found[j < near.count ? j : near.count - 1];
    }
    return 1;
}

/* Covariance xx xy xz yy yz zz of the points (n) in a row. */
INLINE void covariance(const float *points, const int *row, int n, float *m) {
    float q[MOST_NEIGHBOURS][3], mean[3] = {0};
    for (int j = 0; j < n; j++)
        for (int a = 0; a < 3; a++) {
            q[j][a] = points[3 * (size_t)row[j] + a];
            mean[a] += q[j][a] / (float)n;
        }
    for (int i = 0; i < 6; i++) m[i] = 0;
    for (int j = 0; j < n; j++) {
        float x = q[j][0] - mean[0], y = q[j][1] - mean[1], z = q[j][2] - mean[2], w = 1 / (float)n;
        m[0] += w * x * x; m[1] += w * x * y; m[2] += w * x * z;
        m[3] += w * y * y; m[4] += w * y * z; m[5] += w * z * z;
    }
}

/* Planes through neighbours found (count, most): unit normals (count, 3), either way; and the spread (count) of the
 * neighbours off each, a standard deviation. */
FAST int z2p_planes(const float *points, const int *found, int count, int most, float *normals, float *spread) {
    for (int first = 0; first < count; first += LANES) {
        int lanes = count - first < LANES ? count - first : LANES;
        float m[6][LANES] = {{0}}, axes[3][LANES], kept[6][LANES];
        for (int i = 0; i < lanes; i++) {
            float own[6];
            covariance(points, found + (size_t)(first + i) * most, most, own);
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
