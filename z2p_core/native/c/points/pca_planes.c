/* Tangent planes by principal component analysis (Hoppe et al., Surface Reconstruction from Unorganized Points, 1992).
 *
 * Input: points and their neighbors. Output: a unit normal of either sign, the eigenvector of the neighbors' covariance
 * with the smallest eigenvalue, and the standard deviation of the neighbors off the plane. */

#include <math.h>
#include <stddef.h>

#include "common/simd.h"
#include "points/neighbor_grid.h"

#define BATCH 16 /* points whose planes are fitted at a time, one in each lane */

/* One Jacobi rotation of symmetric matrices, one in each lane: zeroes pq and rotates pr, qr and the vectors p and q. */
INLINE void jacobi_rotate(float *pp, float *qq, float *pq, float *pr, float *qr, float (*p)[BATCH], float (*q)[BATCH]) {
    for (int i = 0; i < BATCH; i++) {
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
FAST void smallest_eigenvectors(float (*m)[BATCH], float (*axes)[BATCH]) {
    float x[3][BATCH], y[3][BATCH], z[3][BATCH];
    for (int axis = 0; axis < 3; axis++)
        for (int i = 0; i < BATCH; i++) {
            x[axis][i] = axis == 0;
            y[axis][i] = axis == 1;
            z[axis][i] = axis == 2;
        }
    for (int sweep = 0; sweep < 6; sweep++) {
        jacobi_rotate(m[0], m[3], m[1], m[2], m[4], x, y);
        jacobi_rotate(m[0], m[5], m[2], m[1], m[4], x, z);
        jacobi_rotate(m[3], m[5], m[4], m[1], m[2], y, z);
    }
    for (int i = 0; i < BATCH; i++) {
        int first = m[0][i] <= m[3][i] && m[0][i] <= m[5][i], second = m[3][i] <= m[5][i];
        for (int axis = 0; axis < 3; axis++) axes[axis][i] = first ? x[axis][i] : second ? y[axis][i] : z[axis][i];
    }
}

/* Covariance xx xy xz yy yz zz of the points in a row of n indices. */
INLINE void covariance(const float *points, const int *row, int n, float *m) {
    float q[MAX_NEIGHBORS][3], mean[3] = {0};
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

/* normals (count, 3) and spread (count) of planes through neighbors (count, neighbor_count) of `points`. */
FAST int z2p_fit_planes(const float *points, const int *neighbors, int count, int neighbor_count, float *normals,
                        float *spread) {
    for (int first = 0; first < count; first += BATCH) {
        int batch_size = count - first < BATCH ? count - first : BATCH;
        float m[6][BATCH] = {{0}}, axes[3][BATCH], covariances[6][BATCH];
        for (int i = 0; i < batch_size; i++) {
            float own[6];
            covariance(points, neighbors + (size_t)(first + i) * neighbor_count, neighbor_count, own);
            for (int j = 0; j < 6; j++) m[j][i] = covariances[j][i] = own[j];
        }
        smallest_eigenvectors(m, axes);
        for (int i = 0; i < batch_size; i++) {
            float x = axes[0][i], y = axes[1][i], z = axes[2][i], *normal = normals + 3 * (size_t)(first + i);
            float square = covariances[0][i] * x * x + covariances[3][i] * y * y + covariances[5][i] * z * z
                         + 2 * (covariances[1][i] * x * y + covariances[2][i] * x * z + covariances[4][i] * y * z);
            normal[0] = x; normal[1] = y; normal[2] = z;
            spread[first + i] = sqrtf(square > 0 ? square : 0);
        }
    }
    return 1;
}
