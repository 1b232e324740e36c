/* Direct lighting of a point cloud by an area light, with one shadow map per light sample (Williams, "Casting Curved
 * Shadows on Curved Surfaces", 1978). Input: points, normals, shadow casters and light samples; output: irradiance on
 * both sides of each point. */

#include <math.h>
#include <stdint.h>
#include <stdlib.h>

#include "common/vec3.h"
#include "lighting/occlusion.h"

#define MAX_POINTS 0xffff   /* point indices fill the lower 16 bits of a map's keys */
#define DEPTH_LEVELS 0x7ffe /* quantized depths, in the upper bits */

/* Scales of the cloud, in world units: mean point spacing, width of a shadow map's cells at the cloud's center, and
 * radius of a sphere about the origin that holds the cloud. Mirrored by z2p_core/native/lighting.py. */
typedef struct {
    float spacing, cell_size, cloud_radius;
} ShadowMapScale;

/* Unit axes of the view from a light sample to the origin. */
typedef struct {
    float right[3], up[3], forward[3];
} LightView;

static LightView view_from(const float *light) {
    LightView view;
    float length = sqrtf(dot(light, light)), level = sqrtf(light[0] * light[0] + light[1] * light[1]);
    for (int axis = 0; axis < 3; axis++) view.forward[axis] = -light[axis] / length;
    view.right[0] = level > 1e-6f ? -light[1] / level : 1;
    view.right[1] = level > 1e-6f ? light[0] / level : 0;
    view.right[2] = 0;
    cross(view.right, view.forward, view.up);
    return view;
}

/* Depth of a point as seen from a light sample. */
INLINE float light_depth(const float *point, const float *light, const LightView *view) {
    float offset[3] = {point[0] - light[0], point[1] - light[1], point[2] - light[2]};
    return dot(offset, view->forward);
}

/* Positions (count, 3) that cast shadows, each on behalf of the point with that index. */
typedef struct {
    const float *positions;
    const int *owners;
    int count;
} Casters;

/* A shadow map (side, side) over tangents of up to `half` to each side of the view's axis, `step` per cell. */
typedef struct {
    float half, step;
    int side;
    int32_t *keys, *scratch;
} ShadowMap;

/* Projects points into a shadow map, shifted by `shift` cells: depths, and cell indices, -1 outside. Without a branch,
 * so that the loop becomes vector code. */
INLINE void project_to_light(const float *restrict points, int count, const float *restrict light,
                             const LightView *view, const ShadowMap *map, float shift, float *restrict depth,
                             int *restrict cell) {
    const float *f = view->forward, *r = view->right, *u = view->up;
    float scale = 1 / map->step, middle = map->half * scale + shift;
    int side = map->side;
    for (int i = 0; i < count; i++) {
        float dx = points[3 * i] - light[0], dy = points[3 * i + 1] - light[1], dz = points[3 * i + 2] - light[2];
        float forward = dx * f[0] + dy * f[1] + dz * f[2];
        float per_depth = scale / forward;
        float x = dx * r[0] + dy * r[1] + dz * r[2], y = dx * u[0] + dy * u[1] + dz * u[2];
        int column = (int)(x * per_depth + middle) + MAP_MARGIN, row = (int)(y * per_depth + middle) + MAP_MARGIN;
        int inside = (column > 0) & (row > 0) & (column < side - 1) & (row < side - 1) & (forward > 0);
        depth[i] = forward;
        cell[i] = inside ? row * side + column : -1;
    }
}

/* Draws the shadow map of the casters as seen from a light sample: in each cell the nearest one's key, its quantized
 * depth above its point's index. A caster fills the whole cell that it falls into, which makes shadows half a cell too
 * wide on every side, while sampled surfaces fall a little short of their outlines. So half of the light samples get
 * `eroded` maps, whose shadows are a cell narrower. */
INLINE void draw_shadow_map(const Casters *casters, const float *light, const LightView *view, float min_depth,
                            float levels_per_depth, int eroded, ShadowMap *map, float *depth, int *cell,
                            int32_t *key) {
    project_to_light(casters->positions, casters->count, light, view, map, eroded ? 0.5f : 0, depth, cell);
    for (int i = 0; i < map->side * map->side; i++) map->keys[i] = EMPTY_CELL;
    for (int i = 0; i < casters->count; i++) { /* casters outside write EMPTY_CELL to cell 0, which changes nothing */
        /* clamped, as a disc may reach beyond the cloud */
        float level = smaller(larger((depth[i] - min_depth) * levels_per_depth, 0), DEPTH_LEVELS);
        int32_t caster_key = (int32_t)level * (MAX_POINTS + 1) + casters->owners[i];
        key[i] = cell[i] < 0 ? EMPTY_CELL : caster_key;
        cell[i] = cell[i] < 0 ? 0 : cell[i];
    }
    for (int i = 0; i < casters->count; i++) {
        int32_t *nearest = map->keys + cell[i], before = *nearest;
        *nearest = key[i] < before ? key[i] : before;
    }
    close_gaps(map->keys, map->side, eroded, map->scratch);
}

/* Writes visible (count): 1 where a light sample is visible from a point, else 0. depth, cell and key are scratch. */
INLINE void test_visibility(const float *points, const float *normals, int count, const Casters *casters,
                            const float *light, int eroded, const ShadowMapScale *scale, ShadowMap *map,
                            float *depth, int *cell, int32_t *key, float *visible) {
    LightView view = view_from(light);
    float radius = scale->cloud_radius, distance = sqrtf(dot(light, light));
    float tangent_length_sq = larger(distance * distance - radius * radius, 0.25f);
    map->half = radius / sqrtf(tangent_length_sq) * 1.02f;
    map->side = (int)smaller(2 * map->half * distance / scale->cell_size + 1 + 2 * MAP_MARGIN, MAX_MAP_SIDE);
    map->step = 2 * map->half / (float)(map->side - 2 * MAP_MARGIN);
    float min_depth = distance - 1.01f * radius, levels_per_depth = DEPTH_LEVELS / (2.02f * radius);
    draw_shadow_map(casters, light, &view, min_depth, levels_per_depth, eroded, map, depth, cell, key);
    project_to_light(points, count, light, &view, map, 0, depth, cell);
    for (int i = 0; i < count; i++) {
        int32_t nearest = cell[i] >= 0 ? map->keys[cell[i]] : EMPTY_CELL;
        const float *p = points + 3 * i, to_light[3] = {light[0] - p[0], light[1] - p[1], light[2] - p[2]};
        int occluder = nearest != EMPTY_CELL ? nearest & MAX_POINTS : i;
        float gap = depth[i] - light_depth(points + 3 * occluder, light, &view);
        visible[i] = gap < SHADOW_BIAS_SPACINGS * scale->spacing ||
                     is_own_surface(points, normals, i, occluder, to_light);
    }
}

/* Adds to irradiance (2, count) what a light sample of that power contributes where it is visible: in row 0 on the side
 * that the normal points to, in row 1 on the other. Without a branch, so that the loop becomes vector code. */
INLINE void add_irradiance(const float *restrict points, const float *restrict normals, int count,
                           const float *restrict light, const float *restrict axis, float power,
                           const float *restrict visible, float *restrict irradiance) {
    for (int i = 0; i < count; i++) {
        float dx = light[0] - points[3 * i], dy = light[1] - points[3 * i + 1], dz = light[2] - points[3 * i + 2];
        float distance_sq = dx * dx + dy * dy + dz * dz, distance = sqrtf(distance_sq);
        float n_dot_l = (dx * normals[3 * i] + dy * normals[3 * i + 1] + dz * normals[3 * i + 2]) / distance;
        float cos_at_light = -(dx * axis[0] + dy * axis[1] + dz * axis[2]) / distance;
        float received = cos_at_light > 0 ? visible[i] * power * fabsf(n_dot_l) * cos_at_light / distance_sq : 0;
        irradiance[i] += n_dot_l > 0 ? received : 0;
        irradiance[count + i] += n_dot_l > 0 ? 0 : received;
    }
}

/* Writes irradiance (2, count) of points (count, 3), at most MAX_POINTS, with unit normals (count, 3), on the side that
 * the normal points to and on the other one: the sum over the visible light samples of
 * power |n_dot_l| cos_at_light / distance^2.
 * A light sample has a position (3), a unit axis (3) along which it emits and a power; samples form a square grid, row
 * by row, and every other one's shadows are eroded by a cell. Shadows are cast by caster_positions (caster_count, 3) on
 * behalf of the points with indices caster_owners (caster_count). */
FAST int z2p_direct_lighting(const float *points, const float *normals, int count, const float *caster_positions,
                             const int *caster_owners, int caster_count, const float *light_positions,
                             const float *light_axes, const float *light_powers, int light_count,
                             const ShadowMapScale *scale, float *irradiance) {
    ShadowMapScale scales = *scale; /* a copy, which the output cannot alias */
    Casters casters = {caster_positions, caster_owners, caster_count};
    size_t most = (size_t)(caster_count > count ? caster_count : count) + 1;
    ShadowMap map = {.keys = malloc(sizeof(int32_t) * 2 * MAX_MAP_SIDE * MAX_MAP_SIDE)};
    float *depth = malloc(sizeof(float) * 2 * most), *visible = depth + most;
    int *cell = malloc(sizeof(int) * 2 * most), grid_side = (int)sqrtf((float)light_count + 0.5f);
    int allocated = map.keys && depth && cell && count <= MAX_POINTS;
    map.scratch = map.keys + MAX_MAP_SIDE * MAX_MAP_SIDE;
    for (size_t i = 0; i < 2 * (size_t)count; i++) irradiance[i] = 0;
    for (int l = 0; allocated && l < light_count; l++) {
        int eroded = (l ^ (l / grid_side)) & 1;
        const float *light = light_positions + 3 * l;
        test_visibility(points, normals, count, &casters, light, eroded, &scales, &map, depth, cell, cell + most,
                        visible);
        add_irradiance(points, normals, count, light, light_axes + 3 * l, light_powers[l], visible, irradiance);
    }
    free(map.keys); free(depth); free(cell);
    return allocated;
}

/* Writes irradiance (count) of points [begin, end) with unit normals on the side that these point to, under light
 * samples as above that nothing hides. */
FAST int z2p_unshadowed_light(const float *points, const float *normals, int begin, int end,
                              const float *light_positions, const float *light_axes, const float *light_powers,
                              int light_count, float *irradiance) {
    for (int i = begin; i < end; i++) irradiance[i] = 0;
    for (int l = 0; l < light_count; l++) {
        const float *light = light_positions + 3 * l, *axis = light_axes + 3 * l;
        float power = light_powers[l];
        for (int i = begin; i < end; i++) {
            float dx = light[0] - points[3 * i], dy = light[1] - points[3 * i + 1], dz = light[2] - points[3 * i + 2];
            float distance_sq = dx * dx + dy * dy + dz * dz, inverse = 1 / sqrtf(distance_sq);
            float n_dot_l = (dx * normals[3 * i] + dy * normals[3 * i + 1] + dz * normals[3 * i + 2]) * inverse;
            float cos_at_light = -(dx * axis[0] + dy * axis[1] + dz * axis[2]) * inverse;
            irradiance[i] += power * larger(n_dot_l, 0) * larger(cos_at_light, 0) / distance_sq;
        }
    }
    return 1;
}
