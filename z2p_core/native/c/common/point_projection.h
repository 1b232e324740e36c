/* Projection of points into an image's pixels, a block at a time. */

#pragma once

#include <math.h>
#include <stdint.h>

#include "common/simd.h"

#define BLOCK 512 /* points projected at a time, before what belongs to them is scattered */

/* Projects `count` <= BLOCK points: pixel indices and depths; points outside get index width * height. Without a
 * branch, so that the loop becomes vector code. */
INLINE void project_block(const float *restrict points, int count, const float *restrict camera, float focal,
                          float center_x, float center_y, int width, int height, int margin,
                          int32_t *restrict pixel, float *restrict depth) {
    const float *r = camera, *c = camera + 9;
    int32_t outside = width * height;
    for (int i = 0; i < count; i++) {
        float x = points[3 * i] - c[0], y = points[3 * i + 1] - c[1], z = points[3 * i + 2] - c[2];
        float forward = r[6] * x + r[7] * y + r[8] * z, scale = focal / forward;
        float column = floorf((r[0] * x + r[1] * y + r[2] * z) * scale + center_x) + (float)margin;
        float row = floorf((r[3] * x + r[4] * y + r[5] * z) * scale + center_y) + (float)margin;
        int inside = (forward > 0) & (column >= 0) & (row >= 0) & (column < (float)width) & (row < (float)height);
        /* NaN fails every comparison, and must not be converted to an integer either */
        int32_t u = (int32_t)(inside ? column : 0.0f), v = (int32_t)(inside ? row : 0.0f);
        pixel[i] = inside ? v * width + u : outside;
        depth[i] = forward;
    }
}
