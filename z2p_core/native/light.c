/* Light on the points of a cloud, by a shadow map for each lamp. */

#include <math.h>
#include <stdint.h>
#include <stdlib.h>

#include "fast.h"
#include "sight.h"

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

/* Depth and cell in a lamp's map, -1 outside of it, of each point. Plain arithmetic, for vectors. */
INLINE void place_points(const float *restrict points, int count, const float *restrict lamp, const View *view,
                         float half, float step, int side, float *restrict depth, int *restrict cell) {
    const float *f = view->ahead, *r = view->across, *u = view->up;
    for (int i = 0; i < count; i++) {
        float dx = points[3 * i] - lamp[0], dy = points[3 * i + 1] - lamp[1], dz = points[3 * i + 2] - lamp[2];
        float ahead = dx * f[0] + dy * f[1] + dz * f[2];
        float x = (dx * r[0] + dy * r[1] + dz * r[2]) / ahead, y = (dx * u[0] + dy * u[1] + dz * u[2]) / ahead;
        int column = (int)((x + half) / step) + MARGIN, row = (int)((y + half) / step) + MARGIN;
        int inside = (column > 0) & (row > 0) & (column < side - 1) & (row < side - 1) & (ahead > 0);
        depth[i] = ahead;
        cell[i] = inside ? row * side + column : -1;
    }
}

/* Draws the map of the cloud seen from a lamp: depth, and in the lower half of its bits the point's number; and says
 * which points nothing nearer to the lamp hides, 0 or 1. */
INLINE void cast_shadows(const float *points, const float *normals, int count, const float *lamp, float spacing,
                         float radius, int32_t *map, int32_t *room, float *depth, int *cell, float *open) {
    View view = look_from(lamp);
    float away = sqrtf(dot(lamp, lamp)), reach = larger(away * away - radius * radius, 0.25f);
    float half = radius / sqrtf(reach) * 1.02f, step = spacing / FINE / away;
    int side = (int)smaller(2 * half / step + 1 + 2 * MARGIN, LARGEST_MAP);
    step = 2 * half / (float)(side - 2 * MARGIN);
    place_points(points, count, lamp, &view, half, step, side, depth, cell);
    float nearest = away - 1.01f * radius, steps = DEPTHS / (2.02f * radius);
    for (int i = 0; i < side * side; i++) map[i] = NOTHING;
    for (int i = 0; i < count; i++) {
        if (cell[i] < 0) continue;
        int32_t key = (int32_t)((depth[i] - nearest) * steps) * (MOST_POINTS + 1) + i;
        if (key < map[cell[i]]) map[cell[i]] = key;
    }
    close_holes(map, side, room);
    for (int i = 0; i < count; i++) {
        int first = cell[i] >= 0 && map[cell[i]] != NOTHING ? map[cell[i]] & MOST_POINTS : i;
        const float *p = points + 3 * i, way[3] = {lamp[0] - p[0], lamp[1] - p[1], lamp[2] - p[2]};
        open[i] = depth[i] - depth[first] < TOUCH * spacing || own_surface(points, normals, i, first, way);
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
 * of power x cos(at the point) x cos(at the lamp) / distance^2 over the lamps that no other part of the cloud, of at
 * most MOST_POINTS, hides from it. A lamp has a place (3), a unit axis (3) along which it shines and a power. `spacing`
 * is that of the cloud, `radius` bounds it. */
FAST int z2p_illuminate(const float *points, const float *normals, int count, const float *lamps, const float *axes,
                   const float *powers, int lamp_count, float spacing, float radius, float *light) {
    int32_t *map = malloc(sizeof(int32_t) * 2 * LARGEST_MAP * LARGEST_MAP), *room = map + LARGEST_MAP * LARGEST_MAP;
    float *depth = malloc(sizeof(float) * 2 * ((size_t)count + 1)), *open = depth + count;
    int *cell = malloc(sizeof(int) * ((size_t)count + 1));
    int fine = map && depth && cell && count <= MOST_POINTS;
    for (size_t i = 0; i < 2 * (size_t)count; i++) light[i] = 0;
    for (int l = 0; fine && l < lamp_count; l++) {
        cast_shadows(points, normals, count, lamps + 3 * l, spacing, radius, map, room, depth, cell, open);
        add_light(points, normals, count, lamps + 3 * l, axes + 3 * l, powers[l], open, light);
    }
    free(map); free(depth); free(cell);
    return fine;
}
