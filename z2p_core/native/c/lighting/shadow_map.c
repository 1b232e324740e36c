/* Light on the points of a cloud, by a shadow map for each lamp. */

#include <math.h>
#include <stdint.h>
#include <stdlib.h>

#include "common/simd.h"
#include "lighting/occlusion.h"

#define MOST_POINTS 0xffff /* whose numbers go into the lower half of a map's cells */
#define DEPTHS 0x7ffe      /* that the upper half tells apart */

typedef struct {
    float across[3], up[3], ahead[3]; /* axes of the view from a lamp at the origin */
} View;

static View look_from(const float *lamp) {
    View view;
    float length = sqrtf(dot(lamp, lamp)), side = sqrtf(lamp[0] * lamp[0] + lamp[1] * lamp[1]);
    for (int axis = 0; axis < 3; axis++) view.ahead[axis] = -lamp[axis] / length;
    view.across[0] = side > 1e-6f ? -lamp[1] / side : 1;
    view.across[1] = side > 1e-6f ? lamp[0] / side : 0;
    view.across[2] = 0;
    const float *f = view.ahead, *r = view.across;
    view.up[0] = r[1] * f[2] - r[2] * f[1];
    view.up[1] = r[2] * f[0] - r[0] * f[2];
    view.up[2] = r[0] * f[1] - r[1] * f[0];
    return view;
}

/* How far a point lies ahead of a lamp. */
INLINE float along(const float *point, const float *lamp, const View *view) {
    float way[3] = {point[0] - lamp[0], point[1] - lamp[1], point[2] - lamp[2]};
    return dot(way, view->ahead);
}

/* What of a cloud hides its points from the lamps: places (count, 3), each of the point with that number, kept in maps
 * with cells of that width at the cloud's middle. */
typedef struct {
    const float *places;
    const int *owners;
    int count;
    float cell;
} Casters;

/* A lamp's map (side, side) of directions up to a slope of `half` to every side, in steps. */
typedef struct {
    float half, step;
    int side;
    int32_t *cells, *room;
} Map;

/* Depth and cell in a lamp's map, -1 outside of it, of each point, all of them so many cells on. Plain arithmetic, for
 * vectors. */
INLINE void place_points(const float *restrict points, int count, const float *restrict lamp, const View *view,
                         const Map *map, float on, float *restrict depth, int *restrict cell) {
    const float *f = view->ahead, *r = view->across, *u = view->up;
    float scale = 1 / map->step, middle = map->half * scale + on;
    int side = map->side;
    for (int i = 0; i < count; i++) {
        float dx = points[3 * i] - lamp[0], dy = points[3 * i + 1] - lamp[1], dz = points[3 * i + 2] - lamp[2];
        float ahead = dx * f[0] + dy * f[1] + dz * f[2];
        float shrunk = scale / ahead, x = dx * r[0] + dy * r[1] + dz * r[2], y = dx * u[0] + dy * u[1] + dz * u[2];
        int column = (int)(x * shrunk + middle) + MARGIN, row = (int)(y * shrunk + middle) + MARGIN;
        int inside = (column > 0) & (row > 0) & (column < side - 1) & (row < side - 1) & (ahead > 0);
        depth[i] = ahead;
        cell[i] = inside ? row * side + column : -1;
    }
}

/* Draws the map of what casts shadows, as seen from a lamp: depth, and in the lower half of its bits the point's number.
 * A cell that one of them only touches is all in it, so shadows are half a cell too wide on every side; and what casts
 * them falls a little short of outlines. So a map is made a cell narrower than it is, or, for other lamps, not. */
INLINE void draw_map(const Casters *casters, const float *lamp, const View *view, float nearest, float steps,
                     int narrower, Map *map, float *depth, int *cell, int32_t *key) {
    place_points(casters->places, casters->count, lamp, view, map, narrower ? 0.5f : 0, depth, cell);
    for (int i = 0; i < map->side * map->side; i++) map->cells[i] = NOTHING;
    for (int i = 0; i < casters->count; i++) { /* plain, for vectors; what is outside changes nothing in a first cell */
        float level = smaller(larger((depth[i] - nearest) * steps, 0), DEPTHS); /* a disc may reach beyond the cloud */
        int32_t found = (int32_t)level * (MOST_POINTS + 1) + casters->owners[i];
        key[i] = cell[i] < 0 ? NOTHING : found;
        cell[i] = cell[i] < 0 ? 0 : cell[i];
    }
    for (int i = 0; i < casters->count; i++) {
        int32_t *at = map->cells + cell[i], before = *at;
        *at = key[i] < before ? key[i] : before;
    }
    close_holes(map->cells, map->side, narrower, map->room);
}

/* Says which points nothing nearer to a lamp hides, 0 or 1. */
INLINE void cast_shadows(const float *points, const float *normals, int count, const Casters *casters,
                         const float *lamp, int narrower, float spacing, float radius, Map *map, float *depth,
                         int *cell, int32_t *key, float *open) {
    View view = look_from(lamp);
    float away = sqrtf(dot(lamp, lamp)), reach = larger(away * away - radius * radius, 0.25f);
    map->half = radius / sqrtf(reach) * 1.02f;
    map->side = (int)smaller(2 * map->half * away / casters->cell + 1 + 2 * MARGIN, LARGEST_MAP);
    map->step = 2 * map->half / (float)(map->side - 2 * MARGIN);
    float nearest = away - 1.01f * radius, steps = DEPTHS / (2.02f * radius);
    draw_map(casters, lamp, &view, nearest, steps, narrower, map, depth, cell, key);
    place_points(points, count, lamp, &view, map, 0, depth, cell);
    for (int i = 0; i < count; i++) {
        int32_t found = cell[i] >= 0 ? map->cells[cell[i]] : NOTHING;
        const float *p = points + 3 * i, way[3] = {lamp[0] - p[0], lamp[1] - p[1], lamp[2] - p[2]};
        int first = found != NOTHING ? found & MOST_POINTS : i;
        open[i] = depth[i] - along(points + 3 * first, lamp, &view) < TOUCH * spacing ||
                  own_surface(points, normals, i, first, way);
    }
}

/* Adds to light (2, count) what a lamp gives the points that are open to it, on the side that the normal points to and
 * on the other one. Plain arithmetic again. */
INLINE void add_light(const float *restrict points, const float *restrict normals, int count,
                      const float *restrict lamp, const float *restrict axis, float power,
                      const float *restrict open, float *restrict light) {
    for (int i = 0; i < count; i++) {
        float dx = lamp[0] - points[3 * i], dy = lamp[1] - points[3 * i + 1], dz = lamp[2] - points[3 * i + 2];
        float square = dx * dx + dy * dy + dz * dz, length = sqrtf(square);
        float towards = (dx * normals[3 * i] + dy * normals[3 * i + 1] + dz * normals[3 * i + 2]) / length;
        float shining = -(dx * axis[0] + dy * axis[1] + dz * axis[2]) / length;
        float found = shining > 0 ? open[i] * power * fabsf(towards) * shining / square : 0;
        light[i] += towards > 0 ? found : 0;
        light[count + i] += towards > 0 ? 0 : found;
    }
}

/* light (2, count): what the lamps give each point, on the side that its normal points to and on the other one: the sum
 * of power x cos(at the point) x cos(at the lamp) / distance^2 over the lamps that none of the `casters`, places (3) of
 * the points with these numbers, at most MOST_POINTS, hides from it. A lamp has a place (3), a unit axis (3) along which
 * it shines and a power; they stand in a square, row by row, and every other one's shadows are narrowed. `spacing` is
 * that of the cloud, `cell` the width of the maps' cells, `radius` bounds the cloud. */
FAST int z2p_illuminate(const float *points, const float *normals, int count, const float *places, const int *owners,
                        int place_count, const float *lamps, const float *axes, const float *powers, int lamp_count,
                        float spacing, float cell, float radius, float *light) {
    Casters casters = {places, owners, place_count, cell};
    size_t most = (size_t)(place_count > count ? place_count : count) + 1;
    Map map = {.cells = malloc(sizeof(int32_t) * 2 * LARGEST_MAP * LARGEST_MAP)};
    float *depth = malloc(sizeof(float) * 2 * most), *open = depth + most;
    int *cells = malloc(sizeof(int) * 2 * most), across = (int)sqrtf((float)lamp_count + 0.5f);
    int fine = map.cells && depth && cells && count <= MOST_POINTS;
    map.room = map.cells + LARGEST_MAP * LARGEST_MAP;
    for (size_t i = 0; i < 2 * (size_t)count; i++) light[i] = 0;
    for (int l = 0; fine && l < lamp_count; l++) {
        int narrower = (l ^ (l / across)) & 1;
        cast_shadows(points, normals, count, &casters, lamps + 3 * l, narrower, spacing, radius, &map, depth, cells,
                     cells + most, open);
        add_light(points, normals, count, lamps + 3 * l, axes + 3 * l, powers[l], open, light);
    }
    free(map.cells); free(depth); free(cells);
    return fine;
}
