/* Texture of a disc: two colors on either side of a curve, and a gradient that is common to both.
 *
 * A texture has TEXTURE_VALUES numbers: the color at the disc's center (3), its change along the axes s (3) and t
 * (3) of tangent_basis(), half the difference between the two colors (3), and the coefficients of 1, s, t, s^2, s
 * t, t^2 in the curve's function, which is positive on the side where that half is added, negative where it is
 * subtracted. s and t are in units of the disc's radius. */

#pragma once

#include "common/lanes.h"
#include "common/vec3.h"
#include "surfels/disc_projection.h"

#define TEXTURE_COLORS 3
#define CURVE_VALUES 6
#define TEXTURE_VALUES (4 * TEXTURE_COLORS + CURVE_VALUES)
#define EDGE_HALF_WIDTH 1.0f /* half the width of the ramp between the two colors, in samples */
#define MIN_CURVE_SLOPE 1e-9f /* of a curve's function per sample: flatter ones are taken for this steep */

/* The texture of a projected disc, by the distance in samples from its center along x and y. */
typedef struct {
    float base[TEXTURE_COLORS], dx[TEXTURE_COLORS], dy[TEXTURE_COLORS], half[TEXTURE_COLORS];
    float curve[CURVE_VALUES]; /* coefficients of 1, x, y, x^2, x y, y^2; the ramp ends at -1 and 1 */
} ScreenTexture;

/* A texture in one row of samples, by x, the distance from the center. */
typedef struct {
    float base[TEXTURE_COLORS], dx[TEXTURE_COLORS], half[TEXTURE_COLORS], curve, curve_dx, curve_dx2;
} TextureRow;

/* The texture of a disc with normal n, as the camera sees it. */
INLINE ScreenTexture project_texture(const Disc *disc, const float *n, const float *texture, const Viewport *view) {
    int flat = view->orthographic;
    float s[3], t[3], scale = 1 / disc->radius;
    float step_x = (flat ? 1 : disc->depth) / view->focal_x, step_y = (flat ? 1 : disc->depth) / view->focal_y;
    float ray_x = flat ? 0 : (disc->x - view->center_x) / view->focal_x;
    float ray_y = flat ? 0 : (disc->y - view->center_y) / view->focal_y;
    float u[3] = {step_x + ray_x * disc->depth_dx, ray_y * disc->depth_dx, disc->depth_dx};
    float v[3] = {ray_x * disc->depth_dy, step_y + ray_y * disc->depth_dy, disc->depth_dy};
    tangent_basis(n, s, t);
    float s_dx = dot(s, u) * scale, s_dy = dot(s, v) * scale, t_dx = dot(t, u) * scale, t_dy = dot(t, v) * scale;
    const float *along_s = texture + TEXTURE_COLORS, *along_t = along_s + TEXTURE_COLORS;
    const float *half = along_t + TEXTURE_COLORS, *f = half + TEXTURE_COLORS;
    ScreenTexture screen;
    for (int c = 0; c < TEXTURE_COLORS; c++) {
        screen.base[c] = texture[c], screen.half[c] = half[c];
        screen.dx[c] = along_s[c] * s_dx + along_t[c] * t_dx;
        screen.dy[c] = along_s[c] * s_dy + along_t[c] * t_dy;
    }
    float *curve = screen.curve;
    curve[0] = f[0], curve[1] = f[1] * s_dx + f[2] * t_dx, curve[2] = f[1] * s_dy + f[2] * t_dy;
    curve[3] = f[3] * s_dx * s_dx + f[4] * s_dx * t_dx + f[5] * t_dx * t_dx;
    curve[4] = 2 * (f[3] * s_dx * s_dy + f[5] * t_dx * t_dy) + f[4] * (s_dx * t_dy + s_dy * t_dx);
    curve[5] = f[3] * s_dy * s_dy + f[4] * s_dy * t_dy + f[5] * t_dy * t_dy;
    float bend = curve[3] * curve[3] / disc->xx + curve[5] * curve[5] / disc->yy; /* half way to the rim */
    float slope = larger(sqrtf(curve[1] * curve[1] + curve[2] * curve[2] + bend), MIN_CURVE_SLOPE);
    for (int i = 0; i < CURVE_VALUES; i++) curve[i] *= 1 / (EDGE_HALF_WIDTH * slope);
    return screen;
}

INLINE TextureRow texture_row(const ScreenTexture *texture, float y) {
    TextureRow row;
    for (int c = 0; c < TEXTURE_COLORS; c++) {
        row.base[c] = texture->base[c] + texture->dy[c] * y;
        row.dx[c] = texture->dx[c], row.half[c] = texture->half[c];
    }
    const float *curve = texture->curve;
    row.curve = curve[0] + y * (curve[2] + y * curve[5]);
    row.curve_dx = curve[1] + y * curve[4], row.curve_dx2 = curve[3];
    return row;
}

/* On which side of the curve samples lie, -1 to 1. */
INLINE Lanes texture_side(const TextureRow *row, Lanes x) {
    Lanes side = row->curve + x * (row->curve_dx + x * row->curve_dx2), one = (Lanes){0} + 1;
    Masks above = side > 1, below = side < -1;
    return where(~(above | below), side) + where(above, one) - where(below, one);
}

/* The texture's color c at samples on these sides. */
INLINE Lanes texture_color(const TextureRow *row, int c, Lanes x, Lanes side) {
    return row->base[c] + x * row->dx[c] + row->half[c] * side;
}
