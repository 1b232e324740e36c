/* A disc as it is drawn: where it lies in the picture, and what its rows show. */

#pragma once

#include <math.h>
#include <stdint.h>

#include "surfels/disc_clipping.h"
#include "common/simd.h"
#include "common/lanes.h"

#define NEAREST_PLANE 0.1f
#define EDGE 0.02f /* cosine of the angle to the ray from which on a disc shows nothing but its edge */

/* A disc as it is drawn, in samples from its middle: an ellipse xx x^2 + 2 xy x y + yy y^2 < 1, whose depth changes
 * evenly, as do the heights over the planes that end it. Perspective within a disc is left out, the local
 * affine approximation of Zwicker et al., "Surface Splatting", 2001. */
typedef struct {
    float x, y, depth, across, down; /* depth at its middle, and its change from sample to sample */
    float xx, xy, yy, area;          /* area: xx yy - xy^2 */
    float radius, behind;            /* behind: the nearest, at most, where it counts */
    float over[CLIPS][3];            /* heights at its middle, and their change */
    int top, bottom, point, ends;
} Disc;

typedef struct {
    int left, top, right, bottom; /* the samples that discs reach, those of the last two excluded */
} Box;

typedef struct {
    float focal;
    int width, height, first, last; /* of the picture, and the rows that are drawn, in samples */
} View;

static int clamp_sample(float value, int low, int high) {
    return value < (float)low ? low : value > (float)high ? high : (int)value;
}

/* Fills in what is drawn of a disc, and what of the picture it reaches; 0 when it shows nothing. */
static int place_disc(Disc *disc, const float *p, const float *n, float radius, const float *clips, const View *view,
                      Box *reach) {
    float focal = view->focal, x = p[0] / p[2], y = p[1] / p[2], slant = n[0] * x + n[1] * y + n[2];
    if (!(p[2] >= NEAREST_PLANE && slant <= -EDGE)) return 0; /* normals face the camera */
    float far = radius * focal * (1 + y * y) / larger(p[2] - radius, NEAREST_PLANE);
    disc->y = y * focal + 0.5f * (float)view->height;
    if (disc->y + far < (float)view->first || disc->y - far >= (float)view->last) return 0;
    disc->x = x * focal + 0.5f * (float)view->width;
    float step = p[2] / focal, across = -step * n[0] / slant, down = -step * n[1] / slant;
    float u[3] = {step + x * across, y * across, across}, v[3] = {x * down, step + y * down, down};
    float scale = 1 / (radius * radius);
    disc->depth = p[2], disc->across = across, disc->down = down;
    disc->xx = dot(u, u) * scale, disc->xy = dot(u, v) * scale, disc->yy = dot(v, v) * scale;
    disc->area = disc->xx * disc->yy - disc->xy * disc->xy;
    float wide = sqrtf(disc->yy / disc->area), high = sqrtf(disc->xx / disc->area);
    if (disc->x + wide < 0 || disc->x - wide >= (float)view->width) return 0;
    disc->top = clamp_sample(ceilf(disc->y - high - 0.5f), view->first, view->last);
    disc->bottom = clamp_sample(floorf(disc->y + high + 0.5f), view->first, view->last);
    if (disc->top >= disc->bottom) return 0;
    for (disc->ends = 0; disc->ends < CLIPS && clips[4 * disc->ends + 3] < INFINITY; disc->ends++) {
        const float *clip = clips + 4 * disc->ends;
        float *over = disc->over[disc->ends];
        over[0] = dot(clip, p) - clip[3], over[1] = dot(clip, u), over[2] = dot(clip, v);
    }
    int right = view->width - 1;
    reach->left = clamp_sample(disc->x - wide, 0, right), reach->right = clamp_sample(disc->x + wide, 0, right) + 1;
    reach->top = disc->top, reach->bottom = disc->bottom;
    return 1;
}

/* A row of a disc: its samples from `left` to `right`; how far the first is from its middle; and what changes along it:
 * 1 - (distance from the middle / radius)^2, depth, and heights over the planes that end the disc. */
typedef struct {
    int left, right;
    float x, inside, slope, curve, depth, across, over[CLIPS], aside[CLIPS];
} Row;

/* Fills in what a row of samples shows of a disc; 0 when that is nothing. */
INLINE int cut_row(const Disc *disc, int y, const View *view, Row *row) {
    float down = (float)y + 0.5f - disc->y, rest = disc->xx - disc->area * down * down;
    if (rest < 0) return 0;
    float inverse = 1 / disc->xx, middle = disc->x - 0.5f - disc->xy * down * inverse, half = sqrtf(rest) * inverse;
    if (middle + half < 0 || middle - half > (float)(view->width - 1)) return 0;
    row->left = (int)ceilf(larger(middle - half, 0));
    row->right = (int)smaller(middle + half, (float)(view->width - 1));
    row->x = (float)row->left + 0.5f - disc->x;
    row->inside = 1 - disc->yy * down * down;
    row->slope = -2 * disc->xy * down;
    row->curve = -disc->xx;
    row->depth = disc->depth + disc->down * down;
    row->across = disc->across;
    for (int e = 0; e < disc->ends; e++) {
        row->over[e] = disc->over[e][0] + disc->over[e][2] * down;
        row->aside[e] = disc->over[e][1];
    }
    return row->left <= row->right;
}

/* Which of LANES samples, `x` from its middle, a disc is met at; and how far inside, at what depth, and whether over a
 * plane that ends it. So many are met at a time, beyond the disc's rim too. */
INLINE Masks meet(const Row *row, int ends, Lanes x, Lanes *depth, Lanes *inside, Masks *over) {
    *inside = row->inside + x * (row->slope + x * row->curve);
    *depth = row->depth + x * row->across;
    *over = (Masks){0};
    for (int e = 0; e < ends; e++) *over |= row->over[e] + x * row->aside[e] > 0;
    return *inside > 0;
}

INLINE Lanes first_lanes(const Row *row) {
    Lanes x;
    for (int i = 0; i < LANES; i++) x[i] = row->x + (float)i;
    return x;
}
