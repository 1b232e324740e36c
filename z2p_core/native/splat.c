/* Surfels: each point as a small disc in its tangent plane, drawn where the nearest ones are seen and blended there. */

#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "fast.h"

#define NEAREST_PLANE 0.1f
#define PIXEL 8 /* floats summed in each pixel: weight, depth and six features */

typedef struct {
    float at[3], normal[3]; /* in the camera's axes */
    float radius, plane;    /* plane: normal . at */
    int left, right, top, bottom;
} Disc;

static int clamp_pixel(float value, int high) { return value < 0 ? 0 : value > (float)high ? high : (int)value; }

/* The disc of a point and the rectangle of pixels that may show it; 0 when none does. */
static int make_disc(Disc *disc, float focal, int width, int height) {
    const float *p = disc->at;
    if (p[2] < NEAREST_PLANE) return 0;
    float reach = disc->radius * focal / fmaxf(p[2] - disc->radius, NEAREST_PLANE);
    float x = p[0] / p[2] * focal + 0.5f * (float)width, y = p[1] / p[2] * focal + 0.5f * (float)height;
    if (x + reach < 0 || y + reach < 0 || x - reach >= (float)width || y - reach >= (float)height) return 0;
    disc->left = clamp_pixel(x - reach, width - 1);
    disc->right = clamp_pixel(x + reach, width - 1);
    disc->top = clamp_pixel(y - reach, height - 1);
    disc->bottom = clamp_pixel(y + reach, height - 1);
    disc->plane = disc->normal[0] * p[0] + disc->normal[1] * p[1] + disc->normal[2] * p[2];
    return 1;
}

/* Along a row of pixels from disc->left to disc->right: depth of the disc on each ray, and weight, 0 for a miss. */
static inline void meet_row(const Disc *disc, float focal, float middle, float ry, float *restrict depth,
                            float *restrict weight) {
    float inverse = 1 / (disc->radius * disc->radius), step = 1 / focal;
    float first = ((float)disc->left + 0.5f - middle) * step, across = disc->normal[0];
    float rest = disc->normal[1] * ry + disc->normal[2];
    int wide = disc->right - disc->left + 1;
    for (int i = 0; i < wide; i++) {
        float rx = first + (float)i * step, slant = across * rx + rest;
        /* normals face the camera; a disc seen from its very edge is a miss */
        float z = disc->plane / fminf(slant, -0.02f);
        float dx = rx * z - disc->at[0], dy = ry * z - disc->at[1], dz = z - disc->at[2];
        float inside = 1 - (dx * dx + dy * dy + dz * dz) * inverse;
        int hit = (inside > 0) & (slant < -0.02f) & (z > NEAREST_PLANE);
        depth[i] = z;
        weight[i] = hit ? inside * inside + 1e-3f : 0;
    }
}

/* Whether the disc's centre lies in the picture and far behind what is seen there. */
static int hidden(const Disc *disc, const float *front, float focal, int width, int height, float slack) {
    float x = disc->at[0] / disc->at[2] * focal + 0.5f * (float)width;
    float y = disc->at[1] / disc->at[2] * focal + 0.5f * (float)height;
    if (!(x >= 0 && y >= 0 && x < (float)width && y < (float)height)) return 0;
    return disc->at[2] > front[(size_t)(int)y * width + (int)x] + (slack + 1) * disc->radius;
}

/* picture (height, width, 8), zero at first: summed weights, then weighted depth and features of what the nearest
 * surfels show. Points and normals are in the camera's axes, normals facing it; features (count, 6). A surfel counts
 * where it lies at most `slack` of its radius behind the nearest one. */
FAST int z2p_surfels(const float *points, const float *normals, const float *radii, const float *features, int count,
                     float focal, int width, int height, float slack, float *picture) {
    float *front = malloc(sizeof(float) * (size_t)width * height);
    float *depth = malloc(sizeof(float) * 2 * (size_t)width), *weight = depth + width;
    int fine = front && depth;
    for (size_t i = 0; fine && i < (size_t)width * height; i++) front[i] = INFINITY;
    for (int pass = 0; fine && pass < 2; pass++)
        for (int i = 0; i < count; i++) {
            Disc disc = {{points[3 * i], points[3 * i + 1], points[3 * i + 2]},
                         {normals[3 * i], normals[3 * i + 1], normals[3 * i + 2]}, radii[i], 0, 0, 0, 0, 0};
            if (!make_disc(&disc, focal, width, height)) continue;
            if (pass && hidden(&disc, front, focal, width, height, slack)) continue;
            int wide = disc.right - disc.left + 1;
            float values[PIXEL] = {1, 0};
            memcpy(values + 2, features + (size_t)i * (PIXEL - 2), sizeof(float) * (PIXEL - 2));
            for (int y = disc.top; y <= disc.bottom; y++) {
                float *row = front + (size_t)y * width + disc.left;
                meet_row(&disc, focal, 0.5f * (float)width, ((float)y + 0.5f - 0.5f * (float)height) / focal, depth,
                         weight);
                if (!pass) {
                    for (int x = 0; x < wide; x++) row[x] = weight[x] > 0 && depth[x] < row[x] ? depth[x] : row[x];
                    continue;
                }
                float *pixel = picture + ((size_t)y * width + disc.left) * PIXEL;
                for (int x = 0; x < wide; x++, pixel += PIXEL) {
                    if (weight[x] <= 0 || depth[x] > row[x] + slack * disc.radius) continue;
                    values[1] = depth[x];
                    for (int c = 0; c < PIXEL; c++) pixel[c] += weight[x] * values[c];
                }
            }
        }
    free(front); free(depth);
    return fine;
}
