/* Surfels: each point as a small disc in its tangent plane, drawn where the nearest ones are seen and blended there. */

#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "clips.h"
#include "fast.h"

#define NEAREST_PLANE 0.1f
#define PIXEL 8 /* sums for each pixel, in as many lines a row: weight, depth and six features */
#define ROW 64  /* pixels that are resolved at a time */
#define DOUBT 0.01f /* weight beyond a disc's end: it hides nothing there, but shows where nothing else does */
#define LANES 8 /* pixels of a row are met so many at a time, beyond the disc's end too */

typedef struct {
    float at[3], normal[3]; /* in the camera's axes */
    float radius, plane;    /* plane: normal . at */
    int left, right, top, bottom, point, ends; /* `ends` planes end it before its rim */
    const float *clips;
} Disc;

typedef struct {
    int left, top, wide, high; /* the part of the picture that discs reach */
} Box;

static int clamp_pixel(float value, int high) { return value < 0 ? 0 : value > (float)high ? high : (int)value; }

/* Fills in the rectangle of pixels, in rows from `first` to `last` - 1, that may show the disc; 0 when none does. */
static int place_disc(Disc *disc, float focal, int width, int height, int first, int last) {
    const float *p = disc->at;
    if (p[2] < NEAREST_PLANE) return 0;
    float reach = disc->radius * focal / fmaxf(p[2] - disc->radius, NEAREST_PLANE);
    float x = p[0] / p[2] * focal + 0.5f * (float)width, y = p[1] / p[2] * focal + 0.5f * (float)height;
    if (x + reach < 0 || y + reach < 0 || x - reach >= (float)width || y - reach >= (float)height) return 0;
    disc->left = clamp_pixel(x - reach, width - 1);
    disc->right = clamp_pixel(x + reach, width - 1);
    disc->top = clamp_pixel(y - reach, height - 1);
    disc->bottom = clamp_pixel(y + reach, height - 1);
    if (disc->top < first) disc->top = first;
    if (disc->bottom >= last) disc->bottom = last - 1;
    if (disc->top > disc->bottom) return 0;
    disc->plane = disc->normal[0] * p[0] + disc->normal[1] * p[1] + disc->normal[2] * p[2];
    return 1;
}

/* The discs that the picture may show, how many they are, and the box that holds them all. */
static int place_all(const float *points, const float *normals, const float *radii, const float *clips, int count,
                     float focal, int width, int height, int first, int last, Disc *discs, Box *box) {
    int placed = 0, left = width, right = -1, top = height, bottom = -1;
    for (int i = 0; i < count; i++) {
        Disc *disc = discs + placed;
        memcpy(disc->at, points + 3 * (size_t)i, sizeof disc->at);
        memcpy(disc->normal, normals + 3 * (size_t)i, sizeof disc->normal);
        disc->radius = radii[i];
        disc->point = i;
        disc->clips = clips + 4 * CLIPS * (size_t)i;
        for (disc->ends = 0; disc->ends < CLIPS && disc->clips[4 * disc->ends + 3] < INFINITY;) disc->ends++;
        if (!place_disc(disc, focal, width, height, first, last)) continue;
        placed++;
        if (disc->left < left) left = disc->left;
        if (disc->right > right) right = disc->right;
        if (disc->top < top) top = disc->top;
        if (disc->bottom > bottom) bottom = disc->bottom;
    }
    *box = (Box){left, top, right - left + 1, bottom - top + 1};
    return placed;
}

/* Along a row of pixels from disc->left to disc->right, and on to whole LANES: depth of the disc on each ray, and
 * weight, 0 for a miss, negative beyond a plane that ends the disc. */
INLINE void meet_row(const Disc *disc, float focal, float middle, float ry, float *restrict depth,
                     float *restrict weight) {
    float inverse = 1 / (disc->radius * disc->radius), step = 1 / focal;
    float first = ((float)disc->left + 0.5f - middle) * step, across = disc->normal[0];
    float rest = disc->normal[1] * ry + disc->normal[2];
    int wide = disc->right - disc->left + 1, whole = (wide + LANES - 1) / LANES * LANES;
    for (int i = 0; i < whole; i++) {
        float rx = first + (float)i * step, slant = across * rx + rest;
        /* normals face the camera; a disc seen from its very edge is a miss */
        float z = disc->plane / (slant < -0.02f ? slant : -0.02f);
        float dx = rx * z - disc->at[0], dy = ry * z - disc->at[1], dz = z - disc->at[2];
        float inside = 1 - (dx * dx + dy * dy + dz * dz) * inverse;
        int hit = (inside > 0) & (slant < -0.02f) & (z > NEAREST_PLANE) & (i < wide);
        depth[i] = z;
        weight[i] = hit ? inside * inside + 1e-3f : 0;
    }
    for (const float *clip = disc->clips, *end = clip + 4 * disc->ends; clip < end; clip += 4) {
        float sideways = clip[0], ahead = clip[1] * ry + clip[2], most = clip[3];
        for (int i = 0; i < whole; i++) {
            float rx = first + (float)i * step;
            int over = (depth[i] * (sideways * rx + ahead) > most) & (weight[i] > 0);
            weight[i] = over ? -DOUBT * weight[i] : weight[i];
        }
    }
}

/* Whether the disc's centre lies in the box's rows and far behind what is seen there. */
static int hidden(const Disc *disc, const float *front, int stride, const Box *box, float focal, int width, int height,
                  float slack) {
    float x = disc->at[0] / disc->at[2] * focal + 0.5f * (float)width;
    float y = disc->at[1] / disc->at[2] * focal + 0.5f * (float)height;
    if (!(x >= 0 && x < (float)width && y >= (float)box->top && y < (float)(box->top + box->high))) return 0;
    const float *nearest = front + (size_t)((int)y - box->top) * stride + ((int)x - box->left);
    return disc->at[2] > *nearest + (slack + 1) * disc->radius;
}

INLINE void keep_nearest(int count, const float *restrict depth, const float *restrict weight,
                         float *restrict nearest) {
    for (int i = 0; i < count; i++) {
        float found = weight[i] > 0 ? depth[i] : INFINITY;
        nearest[i] = found < nearest[i] ? found : nearest[i];
    }
}

/* Adds the disc to the sums, lines `stride` apart, of those pixels where it lies at most `slack` of its radius
 * behind the nearest one. What goes beyond the disc's end, to whole LANES, counts 0. */
INLINE void add_row(const Disc *disc, const float *restrict depth, float *restrict weight,
                    const float *restrict nearest, const float *restrict features, float slack, int stride,
                    float *restrict sums) {
    int wide = disc->right - disc->left + 1, whole = (wide + LANES - 1) / LANES * LANES;
    float behind = slack * disc->radius;
    for (int i = 0; i < whole; i++) {
        float counts = depth[i] <= nearest[i] + behind ? fabsf(weight[i]) : 0;
        weight[i] = counts;
        sums[i] += counts;
        sums[stride + i] += counts * depth[i];
    }
    for (int c = 2; c < PIXEL; c++) {
        float *restrict line = sums + (size_t)c * stride, value = features[c - 2];
        for (int i = 0; i < whole; i++) line[i] += weight[i] * value;
    }
}

/* Turns the sums in the box into the picture's planes (9, height, width): coverage, density, depth and features. */
INLINE void resolve(const float *sums, int stride, const Box *box, int width, int height, float sure, float full,
                    float near, float far, float *picture) {
    size_t plane = (size_t)width * height;
    float scale = 1 / (far - near), inverse[ROW];
    for (int y = 0; y < box->high; y++)
        for (int first = 0; first < box->wide; first += ROW) {
            const float *restrict line = sums + (size_t)y * PIXEL * stride + first;
            float *restrict row = picture + (size_t)(box->top + y) * width + box->left + first;
            int count = box->wide - first < ROW ? box->wide - first : ROW;
            for (int x = 0; x < count; x++) {
                float weight = line[x], density = weight / full;
                inverse[x] = weight > 0 ? 1 / weight : 0;
                float depth = weight > 0 ? (far - line[stride + x] * inverse[x]) * scale : 0;
                row[x] = 1 - exp_fast(-sure * weight);
                row[plane + x] = density > 1 ? 1 : density;
                row[2 * plane + x] = depth < 0 ? 0 : depth > 1 ? 1 : depth;
            }
            for (int c = 2; c < PIXEL; c++) {
                float *restrict out = row + (size_t)(c + 1) * plane;
                for (int x = 0; x < count; x++) out[x] = line[(size_t)c * stride + x] * inverse[x];
            }
        }
}

/* Rows from `first` to `last` - 1 of picture (9, height, width), whatever is there before: coverage
 * 1 - exp(-sure x weight), density weight / full up to 1, depth from 1 at `near` to 0 at `far`, and six features,
 * averaged over what the nearest surfels show; 0 where there is none. Points and normals are in the camera's axes,
 * normals facing it, and so are the planes `clips` (count, CLIPS, 4) that nothing of a disc lies over; features
 * (count, 6). A surfel counts where it lies at most `slack` of its radius behind the nearest. */
FAST int z2p_surfels(const float *points, const float *normals, const float *radii, const float *clips,
                     const float *features, int count, float focal, int width, int height, int first, int last,
                     float slack, float sure, float full, float near, float far, float *picture) {
    Disc *discs = malloc(sizeof(Disc) * ((size_t)count + 1));
    if (!discs) return 0;
    for (int c = 0; c <= PIXEL; c++)
        memset(picture + ((size_t)c * height + first) * width, 0, sizeof(float) * (size_t)(last - first) * width);
    Box box;
    int placed = place_all(points, normals, radii, clips, count, focal, width, height, first, last, discs, &box);
    if (!placed) { free(discs); return 1; }
    int stride = box.wide + LANES; /* rows of pixels are met in whole lanes */
    size_t pixels = (size_t)stride * box.high;
    float *front = malloc(sizeof(float) * pixels), *sums = calloc(pixels * PIXEL, sizeof(float));
    float *depth = malloc(sizeof(float) * 2 * (size_t)stride), *weight = depth + stride;
    int fine = front && sums && depth;
    for (size_t i = 0; fine && i < pixels; i++) front[i] = INFINITY;
    for (int pass = 0; fine && pass < 2; pass++)
        for (int i = 0; i < placed; i++) {
            const Disc *disc = discs + i;
            if (pass && hidden(disc, front, stride, &box, focal, width, height, slack)) continue;
            int whole = (disc->right - disc->left + LANES) / LANES * LANES;
            for (int y = disc->top; y <= disc->bottom; y++) {
                size_t column = (size_t)(disc->left - box.left), row = (size_t)(y - box.top);
                float *nearest = front + row * stride + column;
                meet_row(disc, focal, 0.5f * (float)width, ((float)y + 0.5f - 0.5f * (float)height) / focal, depth,
                         weight);
                if (pass)
                    add_row(disc, depth, weight, nearest, features + (size_t)disc->point * (PIXEL - 2), slack, stride,
                            sums + row * PIXEL * stride + column);
                else
                    keep_nearest(whole, depth, weight, nearest);
            }
        }
    if (fine) resolve(sums, stride, &box, width, height, sure, full, near, far, picture);
    free(discs); free(front); free(sums); free(depth);
    return fine;
}
