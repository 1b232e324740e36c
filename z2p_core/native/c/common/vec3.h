/* Axes of the plane across a normal. */

#pragma once

#include <math.h>

#include "common/simd.h"

/* Two unit axes across a unit normal. */
INLINE void axes_across(const float *n, float *u, float *v) {
    int axis = fabsf(n[0]) < 0.9f ? 0 : 1;
    float e[3] = {axis == 0, axis == 1, 0};
    u[0] = n[1] * e[2] - n[2] * e[1];
    u[1] = n[2] * e[0] - n[0] * e[2];
    u[2] = n[0] * e[1] - n[1] * e[0];
    float length = sqrtf(u[0] * u[0] + u[1] * u[1] + u[2] * u[2]);
    for (int a = 0; a < 3; a++) u[a] /= length;
    v[0] = n[1] * u[2] - n[2] * u[1];
    v[1] = n[2] * u[0] - n[0] * u[2];
    v[2] = n[0] * u[1] - n[1] * u[0];
}
