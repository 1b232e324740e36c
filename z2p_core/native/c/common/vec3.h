/* Vectors of three floats. */

#pragma once

#include <math.h>

#include "common/simd.h"

#define PI 3.14159265f

INLINE float dot(const float *a, const float *b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

INLINE void cross(const float *a, const float *b, float *out) {
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

/* Divides a vector by its length, which must not be 0. */
INLINE void normalize(float *a) {
    float length = sqrtf(a[0] * a[0] + a[1] * a[1] + a[2] * a[2]);
    for (int i = 0; i < 3; i++) a[i] /= length;
}

/* Two unit vectors u and v that form an orthonormal basis with the unit normal n. */
INLINE void tangent_basis(const float *n, float *u, float *v) {
    int axis = fabsf(n[0]) < 0.9f ? 0 : 1;
    float e[3] = {axis == 0, axis == 1, 0};
    cross(n, e, u);
    normalize(u);
    cross(n, u, v);
}
