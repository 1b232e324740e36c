/* Light on balls: the area light past other balls, and what comes from sky, floor and balls around. */

#pragma once

#include "balls/ball_tree.h"

#define LIGHT_SAMPLES 64 /* the centers of 8 x 8 equal parts of the square light */
#define INSIDE_SHARE 0.01f /* a point is inside a ball if the square of its tangent is less than minus that of r^2 */
#define CHANNELS 3
#define INDIRECT_VALUES (4 * CHANNELS) /* indirect light in three colors: its mean, then its gradient along x, y, z */
#define TABLE_SIDE 6                   /* direct light is a table over the octahedral map of normals */
#define LIGHT_VALUES (INDIRECT_VALUES + TABLE_SIDE * TABLE_SIDE) /* a ball's light */

/* The lights of a scene and the grid of its floor, in world units. Mirrored by z2p_core/native/balls.py. */
typedef struct {
    float light[3][3]; /* center of the square area light, and its two sides */
    float light_axis[3], light_power, sky_radiance;
    float floor_height, floor_half_size;
    int floor_side; /* cells of the grid */
} BallScene;

INLINE float sum_samples(const float *values) {
    float parts[BLOCK] = {0}, sum = 0;
    for (int l = 0; l < LIGHT_SAMPLES; l += BLOCK)
        for (int m = 0; m < BLOCK; m++) parts[m] += values[l + m];
    for (int m = 0; m < BLOCK; m++) sum += parts[m];
    return sum;
}

/* Radiance of a white diffuse surface at p with normal n that the area light gives past all balls; and without them. */
INLINE float direct_light(const float *tree, const BallLevels *levels, const BallScene *scene, const float *p,
                          const float *n, float *unhidden) {
    float x[LIGHT_SAMPLES], y[LIGHT_SAMPLES], z[LIGHT_SAMPLES], weight[LIGHT_SAMPLES];
    const float *center = scene->light[0], *u = scene->light[1], *v = scene->light[2], *axis = scene->light_axis;
    float power = scene->light_power / LIGHT_SAMPLES / PI;
    for (int l = 0; l < LIGHT_SAMPLES; l++) {
        float s = ((float)(l & 7) - 3.5f) / 8, t = ((float)(l >> 3) - 3.5f) / 8;
        float dx = center[0] + s * u[0] + t * v[0] - p[0], dy = center[1] + s * u[1] + t * v[1] - p[1];
        float dz = center[2] + s * u[2] + t * v[2] - p[2];
        float distance_sq = dx * dx + dy * dy + dz * dz, inverse = 1 / sqrtf(distance_sq);
        float cos_surface = (dx * n[0] + dy * n[1] + dz * n[2]) * inverse;
        float cos_light = -(dx * axis[0] + dy * axis[1] + dz * axis[2]) * inverse;
        x[l] = dx * inverse;
        y[l] = dy * inverse;
        z[l] = dz * inverse;
        weight[l] = power * larger(cos_surface, 0) * larger(cos_light, 0) / distance_sq;
    }
    *unhidden = sum_samples(weight);
    if (!(*unhidden > 0)) return 0;
    float planes[4][3], corners[4][3];
    for (int k = 0; k < 4; k++) {
        float s = k == 1 || k == 2 ? 0.5f : -0.5f, t = k >= 2 ? 0.5f : -0.5f;
        for (int a = 0; a < 3; a++) corners[k][a] = center[a] + s * u[a] + t * v[a] - p[a];
    }
    for (int k = 0; k < 4; k++) {
        cross(corners[k], corners[(k + 1) % 4], planes[k]);
        normalize(planes[k]);
        if (dot(planes[k], corners[(k + 2) % 4]) < 0)
            for (int a = 0; a < 3; a++) planes[k][a] = -planes[k][a];
    }
    float to_light[3] = {center[0] - p[0], center[1] - p[1], center[2] - p[2]};
    float patch = sqrtf(dot(u, u)) / 8 / dot(to_light, to_light);
    Visit stack[STACK_ROOM];
    int depth = 0;
    stack[depth++] = root_of(levels);
    while (depth) {
        Visit at = stack[--depth];
        const float *restrict spheres = block_spheres(tree, levels, at);
        float inside[BLOCK];
        for (int k = 0; k < BLOCK; k++) {
            float cx = spheres[k] - p[0], cy = spheres[BLOCK + k] - p[1], cz = spheres[2 * BLOCK + k] - p[2];
            float r = spheres[3 * BLOCK + k], margin = cx * n[0] + cy * n[1] + cz * n[2];
            for (int e = 0; e < 4; e++)
                margin = smaller(margin, cx * planes[e][0] + cy * planes[e][1] + cz * planes[e][2]);
            inside[k] = margin + r;
        }
        for (int k = 0; k < BLOCK; k++) {
            if (!(inside[k] > 0)) continue; /* outside the pyramid to the light, or below the horizon */
            if (at.level) {
                Visit next = {at.level - 1, at.block * BLOCK + k};
                stack[depth++] = next;
                continue;
            }
            float cx = spheres[k] - p[0], cy = spheres[BLOCK + k] - p[1], cz = spheres[2 * BLOCK + k] - p[2];
            float r = spheres[3 * BLOCK + k], tangent_sq = cx * cx + cy * cy + cz * cz - r * r;
            if (tangent_sq < -INSIDE_SHARE * r * r) return 0;
            /* at the ball's distance a sample stands for a patch that wide; smaller balls hide a share of it */
            float width = larger((cx * to_light[0] + cy * to_light[1] + cz * to_light[2]) * patch, 1e-9f);
            float blur = larger(r, width), opacity = r * r / (blur * blur), slope = 0.5f / (blur * width);
            float most = blur * blur * slope + 0.5f, center_sq = cx * cx + cy * cy + cz * cz;
            for (int l = 0; l < LIGHT_SAMPLES; l++) {
                float along = cx * x[l] + cy * y[l] + cz * z[l];
                float hidden = most - slope * (center_sq - along * along);
                hidden = smaller(larger(hidden, 0), 1) * opacity;
                weight[l] *= along > 0 ? 1 - hidden : 1;
            }
            float left[BLOCK] = {0}, total = 0;
            for (int l = 0; l < LIGHT_SAMPLES; l += BLOCK)
                for (int m = 0; m < BLOCK; m++) left[m] = larger(left[m], weight[l + m]);
            for (int m = 0; m < BLOCK; m++) total = larger(total, left[m]);
            if (!(total > 0)) return 0;
        }
    }
    return sum_samples(weight);
}

/* Cell of the octahedral map in which a unit normal lies. */
INLINE int table_cell(const float *n) {
    float scale = 1 / (fabsf(n[0]) + fabsf(n[1]) + fabsf(n[2])), x = n[0] * scale, y = n[1] * scale;
    float folded_x = (1 - fabsf(y)) * (x < 0 ? -1 : 1), folded_y = (1 - fabsf(x)) * (y < 0 ? -1 : 1);
    x = n[2] < 0 ? folded_x : x;
    y = n[2] < 0 ? folded_y : y;
    int column = (int)((x + 1) * (0.5f * TABLE_SIDE)), row = (int)((y + 1) * (0.5f * TABLE_SIDE));
    column = column < 0 ? 0 : column >= TABLE_SIDE ? TABLE_SIDE - 1 : column;
    row = row < 0 ? 0 : row >= TABLE_SIDE ? TABLE_SIDE - 1 : row;
    return row * TABLE_SIDE + column;
}

/* Radiance (3) of a ball at a place with that unit normal, from its light (LIGHT_VALUES) and its albedo (3). */
INLINE void ball_radiance(const float *light, const float *albedo, const float *normal, float *radiance) {
    float direct = light[INDIRECT_VALUES + table_cell(normal)];
    for (int c = 0; c < CHANNELS; c++) {
        float white = light[c] + light[3 + c] * normal[0] + light[6 + c] * normal[1] + light[9 + c] * normal[2];
        radiance[c] = albedo[c] * (larger(white, 0) + direct);
    }
}

/* Radiance (3) that comes along a unit ray to the origin which misses all balls: the sky's or the floor's, whose grid
 * (side, side, 3) is linear between the centers of its cells. */
INLINE void environment_radiance(const BallScene *scene, const float *floor, const float *outside, const float *origin,
                                 const float *ray, float *radiance) {
    float height = origin[2] - scene->floor_height;
    for (int c = 0; c < CHANNELS; c++) radiance[c] = scene->sky_radiance;
    if (!(ray[2] < -1e-6f) || height < 0) return;
    float t = -height / ray[2], to_cells = (float)scene->floor_side / (2 * scene->floor_half_size);
    float column = (origin[0] + t * ray[0] + scene->floor_half_size) * to_cells - 0.5f;
    float row = (origin[1] + t * ray[1] + scene->floor_half_size) * to_cells - 0.5f, last = (float)scene->floor_side - 1;
    if (!(column >= 0 && row >= 0 && column < last && row < last)) {
        for (int c = 0; c < CHANNELS; c++) radiance[c] = outside[c];
        return;
    }
    int i = (int)column, j = (int)row;
    float x = column - (float)i, y = row - (float)j;
    const float *at = floor + CHANNELS * ((size_t)j * scene->floor_side + i);
    const float *below = at + CHANNELS * (size_t)scene->floor_side;
    for (int c = 0; c < CHANNELS; c++)
        radiance[c] = (at[c] * (1 - x) + at[3 + c] * x) * (1 - y) + (below[c] * (1 - x) + below[3 + c] * x) * y;
}
