/* Projection of a disc, in perspective or orthographic: its ellipse on the screen, and which samples of a row it covers,
 * at what depth.
 *
 * Discs are in camera axes: x right, y down, z forward; screen positions are in samples, several per pixel.
 * Perspective within a disc is neglected: the local affine approximation of Zwicker et al., "Surface Splatting",
 * 2001. */

#pragma once

#include <math.h>
#include <stdint.h>

#include "surfels/disc_clipping.h"
#include "common/vec3.h"
#include "common/lanes.h"

#define MIN_COS_TO_VIEWER 0.02f /* discs seen at a smaller cosine are edge-on and not drawn */

/* A projected disc, relative to its center: the ellipse xx x^2 + 2 xy x y + yy y^2 < 1, with depth and the signed
 * distances from the clip planes linear in x and y. */
typedef struct {
    float x, y, depth, depth_dx, depth_dy; /* center, depth there, and the depth's change from sample to sample */
    float xx, xy, yy, determinant;         /* determinant: xx yy - xy^2 */
    float radius, blend_depth;             /* blend_depth: how far behind the nearest surface it is still blended */
    float clip_distance[MAX_CLIP_PLANES][3]; /* from each plane: at the center, and the change along x and y */
    int top, bottom, point, plane_count;   /* rows [top, bottom); index of its point; number of clip planes */
} Disc;

/* A rectangle of samples; right and bottom are exclusive. */
typedef struct {
    int left, top, right, bottom;
} Box;

/* The image and the rows [first, last) of it that are drawn; all in samples: focal lengths and principal point as well.
 * Orthographic: the focal lengths are samples per world unit. Discs nearer than near_plane, in world units, are not
 * drawn in perspective. */
typedef struct {
    float focal_x, focal_y, center_x, center_y, near_plane;
    int orthographic, width, height, first, last;
} Viewport;

static int clamp_to_int(float value, int low, int high) {
    return value < (float)low ? low : value > (float)high ? high : (int)value;
}

/* Projects the disc at p with normal n, which faces the camera, and clip planes (MAX_CLIP_PLANES, 4). Fills `disc`,
 * except for `point`, `radius` and `blend_depth`, and the box of samples that it may cover; returns 0 if it covers
 * none. */
INLINE int project_disc(Disc *disc, const float *p, const float *n, float radius, const float *planes,
                        const Viewport *view, Box *bounds) {
    int flat = view->orthographic;
    float x = flat ? 0 : p[0] / p[2], y = flat ? 0 : p[1] / p[2], n_dot_ray = n[0] * x + n[1] * y + n[2];
    if (!((flat || p[2] >= view->near_plane) && n_dot_ray <= -MIN_COS_TO_VIEWER)) return 0;
    float nearest = flat ? 1 : larger(p[2] - radius, view->near_plane);
    float max_extent = radius * view->focal_y * (1 + y * y) / nearest;
    disc->y = (flat ? p[1] : y) * view->focal_y + view->center_y;
    if (disc->y + max_extent < (float)view->first || disc->y - max_extent >= (float)view->last) return 0;
    disc->x = (flat ? p[0] : x) * view->focal_x + view->center_x;
    float step_x = (flat ? 1 : p[2]) / view->focal_x, step_y = (flat ? 1 : p[2]) / view->focal_y;
    float depth_dx = -step_x * n[0] / n_dot_ray, depth_dy = -step_y * n[1] / n_dot_ray;
    /* movement on the disc's plane for a step of one sample along x and along y */
    float u[3] = {step_x + x * depth_dx, y * depth_dx, depth_dx};
    float v[3] = {x * depth_dy, step_y + y * depth_dy, depth_dy};
    float scale = 1 / (radius * radius);
    disc->depth = p[2], disc->depth_dx = depth_dx, disc->depth_dy = depth_dy;
    disc->xx = dot(u, u) * scale, disc->xy = dot(u, v) * scale, disc->yy = dot(v, v) * scale;
    disc->determinant = disc->xx * disc->yy - disc->xy * disc->xy;
    float half_width = sqrtf(disc->yy / disc->determinant), half_height = sqrtf(disc->xx / disc->determinant);
    if (disc->x + half_width < 0 || disc->x - half_width >= (float)view->width) return 0;
    disc->top = clamp_to_int(ceilf(disc->y - half_height - 0.5f), view->first, view->last);
    disc->bottom = clamp_to_int(floorf(disc->y + half_height + 0.5f), view->first, view->last);
    if (disc->top >= disc->bottom) return 0;
    for (disc->plane_count = 0; disc->plane_count < MAX_CLIP_PLANES && planes[4 * disc->plane_count + 3] < INFINITY;
         disc->plane_count++) {
        const float *plane = planes + 4 * disc->plane_count;
        float *distance = disc->clip_distance[disc->plane_count];
        distance[0] = dot(plane, p) - plane[3], distance[1] = dot(plane, u), distance[2] = dot(plane, v);
    }
    int right = view->width - 1;
    bounds->left = clamp_to_int(disc->x - half_width, 0, right);
    bounds->right = clamp_to_int(disc->x + half_width, 0, right) + 1;
    bounds->top = disc->top, bounds->bottom = disc->bottom;
    return 1;
}

/* The samples [left, right] (inclusive) of a row that a disc covers, and what varies along it with x, the distance from
 * the center: inside + x (inside_dx + x inside_dx2) is 1 - (distance from the center / radius)^2; depth and the
 * distances from the clip planes are linear. */
typedef struct {
    int left, right;
    float x, inside, inside_dx, inside_dx2, depth, depth_dx; /* x: of the first sample */
    float clip_distance[MAX_CLIP_PLANES], clip_dx[MAX_CLIP_PLANES];
} Row;

/* Fills the row of samples that a disc covers at height y; returns 0 if there are none. */
INLINE int intersect_row(const Disc *disc, int y, const Viewport *view, Row *row) {
    float dy = (float)y + 0.5f - disc->y, discriminant = disc->xx - disc->determinant * dy * dy;
    if (discriminant < 0) return 0;
    float inverse = 1 / disc->xx, middle = disc->x - 0.5f - disc->xy * dy * inverse;
    float half = sqrtf(discriminant) * inverse;
    if (middle + half < 0 || middle - half > (float)(view->width - 1)) return 0;
    row->left = (int)ceilf(larger(middle - half, 0));
    row->right = (int)smaller(middle + half, (float)(view->width - 1));
    row->x = (float)row->left + 0.5f - disc->x;
    row->inside = 1 - disc->yy * dy * dy;
    row->inside_dx = -2 * disc->xy * dy;
    row->inside_dx2 = -disc->xx;
    row->depth = disc->depth + disc->depth_dy * dy;
    row->depth_dx = disc->depth_dx;
    for (int k = 0; k < disc->plane_count; k++) {
        row->clip_distance[k] = disc->clip_distance[k][0] + disc->clip_distance[k][2] * dy;
        row->clip_dx[k] = disc->clip_distance[k][1];
    }
    return row->left <= row->right;
}

/* Evaluates a row at LANES samples at a time, x from the center: returns which of them lie within the disc's rim, and
 * writes their depths, how far inside the rim they lie (1 at the center, 0 at the rim) and whether a plane clips
 * them. */
INLINE Masks evaluate_row(const Row *row, int plane_count, Lanes x, Lanes *depth, Lanes *inside, Masks *clipped) {
    *inside = row->inside + x * (row->inside_dx + x * row->inside_dx2);
    *depth = row->depth + x * row->depth_dx;
    *clipped = (Masks){0};
    for (int k = 0; k < plane_count; k++) *clipped |= row->clip_distance[k] + x * row->clip_dx[k] > 0;
    return *inside > 0;
}

/* x of the row's first LANES samples. */
INLINE Lanes first_lanes(const Row *row) {
    Lanes x;
    for (int i = 0; i < LANES; i++) x[i] = row->x + (float)i;
    return x;
}
