/* A camera's image as a screen of cells, pixels or others, and the projection of points onto it. */

#pragma once

#include <math.h>
#include <stdint.h>

#include "common/vec3.h"

#define BLOCK 512 /* points projected at a time, before what belongs to them is scattered */

/* Size, focal lengths and principal point in cells (of an orthographic camera, cells per world unit); rotation, world to
 * camera, position, and the depth behind which points show. Mirrored by z2p_core/native/screen_view.py. */
typedef struct {
    int width, height, orthographic;
    float rotation[9], position[3], focal[2], center[2], near_depth;
} ScreenView;

/* Projects `count` <= BLOCK points to cells and depths; points outside get cell width * height. The screen is larger by
 * a margin, in cells on each side. Without a branch, so that the loop becomes vector code. */
INLINE void project_block(const float *restrict points, int count, const ScreenView *view, int margin,
                          int32_t *restrict cell, float *restrict depth) {
    const float *r = view->rotation, *c = view->position;
    int columns = view->width + 2 * margin, rows = view->height + 2 * margin;
    int32_t outside = columns * rows;
    int parallel = view->orthographic;
    float focal = view->focal[0], aspect = view->focal[1] / view->focal[0], near_depth = view->near_depth;
    float center_x = view->center[0], center_y = view->center[1];
    for (int i = 0; i < count; i++) {
        float x = points[3 * i] - c[0], y = points[3 * i + 1] - c[1], z = points[3 * i + 2] - c[2];
        float forward = r[6] * x + r[7] * y + r[8] * z, scale = focal / (parallel ? 1 : forward);
        float column = floorf((r[0] * x + r[1] * y + r[2] * z) * scale + center_x) + (float)margin;
        float row = floorf((r[3] * x + r[4] * y + r[5] * z) * (scale * aspect) + center_y) + (float)margin;
        int inside = (forward > near_depth) & (column >= 0) & (row >= 0) & (column < (float)columns) &
                     (row < (float)rows);
        /* NaN fails every comparison, and must not be converted to an integer either */
        int32_t u = (int32_t)(inside ? column : 0.0f), v = (int32_t)(inside ? row : 0.0f);
        cell[i] = inside ? v * columns + u : outside;
        depth[i] = forward;
    }
}

/* A cell at some depth is cell_width_constant + cell_width_slope * depth wide, in world units: cells of a pinhole camera
 * grow with the depth, those of an orthographic one do not. */
INLINE float cell_width_slope(const ScreenView *view) {
    return view->orthographic ? 0 : 1 / sqrtf(view->focal[0] * view->focal[1]);
}
INLINE float cell_width_constant(const ScreenView *view) {
    return view->orthographic ? 1 / sqrtf(view->focal[0] * view->focal[1]) : 0;
}

/* A point's place on the screen, in cells. Returns the cells per world unit along x at its depth. */
INLINE float find_place(const float *p, const ScreenView *view, float *x, float *y) {
    float offset[3] = {p[0] - view->position[0], p[1] - view->position[1], p[2] - view->position[2]};
    float divisor = view->orthographic ? 1 : larger(dot(view->rotation + 6, offset), 1e-6f);
    *x = dot(view->rotation, offset) * (view->focal[0] / divisor) + view->center[0];
    *y = dot(view->rotation + 3, offset) * (view->focal[1] / divisor) + view->center[1];
    return view->focal[0] / divisor;
}
