/* Light on the points of a cloud and on the floor below it: shadow maps and occlusion masks, a bit for each lamp. */

#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "fast.h"

#define LARGEST_MAP 512
#define MOST_LAMPS 32

typedef struct {
    float across[3], up[3], ahead[3]; /* axes of the view from a lamp at the origin */
} View;

static float dot(const float *a, const float *b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

static inline float least(float a, float b) { return b < a ? b : a; } /* unlike fminf one instruction */

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

/* Minimum over 3 x 3 windows, in place; `line` holds one row. */
static inline void spread_nearest(float *map, int side, float *line) {
    for (int y = 0; y < side; y++) {
        float *row = map + (size_t)y * side;
        memcpy(line, row, sizeof(float) * (size_t)side);
        for (int x = 1; x < side - 1; x++) row[x] = least(line[x], least(line[x - 1], line[x + 1]));
    }
    float *above = line, *kept = line + side;
    memcpy(above, map, sizeof(float) * (size_t)side);
    for (int y = 1; y < side - 1; y++) {
        float *row = map + (size_t)y * side;
        memcpy(kept, row, sizeof(float) * (size_t)side);
        for (int x = 0; x < side; x++) row[x] = least(row[x], least(above[x], row[x + side]));
        float *swap = above;
        above = kept;
        kept = swap;
    }
}

/* Depth and cell in a lamp's map, -1 outside of it, of each point. Plain arithmetic, for vectors. */
static inline void place_points(const float *restrict points, int count, const float *restrict lamp, const View *view,
                                float half, float step, int side, float *restrict depth, int *restrict cell) {
    const float *f = view->ahead, *r = view->across, *u = view->up;
    for (int i = 0; i < count; i++) {
        float dx = points[3 * i] - lamp[0], dy = points[3 * i + 1] - lamp[1], dz = points[3 * i + 2] - lamp[2];
        float ahead = dx * f[0] + dy * f[1] + dz * f[2];
        float x = (dx * r[0] + dy * r[1] + dz * r[2]) / ahead, y = (dx * u[0] + dy * u[1] + dz * u[2]) / ahead;
        int column = (int)((x + half) / step) + 2, row = (int)((y + half) / step) + 2;
        int inside = (column > 0) & (row > 0) & (column < side - 1) & (row < side - 1) & (ahead > 0);
        depth[i] = ahead;
        cell[i] = inside ? row * side + column : -1;
    }
}

/* Draws the depth map of the cloud seen from a lamp, each point spread over 3 x 3 cells, and gives each point's depth
 * in it and the depth of the nearest point about its cell. */
static inline void draw_map(const float *points, int count, const float *lamp, float spacing, float radius, float *map,
                            float *line, float *depth, int *cell, float *nearest) {
    View view = look_from(lamp);
    float away = sqrtf(dot(lamp, lamp)), reach = fmaxf(away * away - radius * radius, 0.25f);
    float half = radius / sqrtf(reach) * 1.02f, step = spacing / 1.5f / away;
    int side = (int)fminf(2 * half / step + 5, LARGEST_MAP);
    step = 2 * half / (float)(side - 4);
    place_points(points, count, lamp, &view, half, step, side, depth, cell);
    for (int i = 0; i < side * side; i++) map[i] = INFINITY;
    for (int i = 0; i < count; i++)
        if (cell[i] >= 0 && depth[i] < map[cell[i]]) map[cell[i]] = depth[i];
    spread_nearest(map, side, line);
    for (int i = 0; i < count; i++) nearest[i] = cell[i] >= 0 ? map[cell[i]] : INFINITY;
}

/* Adds to light (count) what a lamp gives the points that nothing nearer hides from it. Plain arithmetic again. */
static inline void add_light(const float *restrict points, const float *restrict normals, int count,
                             const float *restrict lamp, const float *restrict axis, float power, float spacing,
                             const float *restrict depth, const float *restrict nearest, float *restrict light) {
    for (int i = 0; i < count; i++) {
        float dx = lamp[0] - points[3 * i], dy = lamp[1] - points[3 * i + 1], dz = lamp[2] - points[3 * i + 2];
        float square = dx * dx + dy * dy + dz * dz, length = sqrtf(square);
        float facing = (dx * normals[3 * i] + dy * normals[3 * i + 1] + dz * normals[3 * i + 2]) / length;
        float shining = -(dx * axis[0] + dy * axis[1] + dz * axis[2]) / length, sine = 1 - facing * facing;
        /* a slanting surface comes nearer within its own cells: do not let it shade itself */
        float slope = sqrtf(sine > 0 ? sine : 0) / (facing > 0.05f ? facing : 0.05f);
        float slack = spacing * (1.0f + 1.4f * (slope < 3.0f ? slope : 3.0f));
        int lit = (facing > 0) & (shining > 0) & !(depth[i] > nearest[i] + slack);
        light[i] += lit ? power * facing * shining / square : 0;
    }
}

/* light (count): what the lamps give each point, sum of power x cos(at the point) x cos(at the lamp) / distance^2 over
 * the lamps that no other part of the cloud hides from it. A lamp has a place (3), a unit axis (3) along which it shines
 * and a power; one far away is a direction of the sky. `spacing` is that of the cloud, `radius` bounds it. */
FAST int z2p_illuminate(const float *points, const float *normals, int count, const float *lamps, const float *axes,
                   const float *powers, int lamp_count, float spacing, float radius, float *light) {
    float *map = malloc(sizeof(float) * LARGEST_MAP * LARGEST_MAP), *line = malloc(sizeof(float) * 2 * LARGEST_MAP);
    float *depth = malloc(sizeof(float) * 2 * ((size_t)count + 1)), *nearest = depth + count;
    int *cell = malloc(sizeof(int) * ((size_t)count + 1));
    int fine = map && line && depth && cell;
    for (int i = 0; i < count; i++) light[i] = 0;
    for (int l = 0; fine && l < lamp_count; l++) {
        draw_map(points, count, lamps + 3 * l, spacing, radius, map, line, depth, cell, nearest);
        add_light(points, normals, count, lamps + 3 * l, axes + 3 * l, powers[l], spacing, depth, nearest, light);
    }
    free(map); free(line); free(depth); free(cell);
    return fine;
}

/* Bits of the cell itself and its four neighbours along an axis, joined or shared, from one mask into another. The axis
 * has the stride of its step; cells at the rim, which stay empty, are left out. */
FAST static void window_bits(const uint32_t *restrict from, uint32_t *restrict to, size_t side, size_t step, int shared) {
    for (size_t i = 2 * side; i < side * (side - 2); i++) {
        uint32_t a = from[i - 2 * step], b = from[i - step], c = from[i], d = from[i + step], e = from[i + 2 * step];
        to[i] = shared ? a & b & c & d & e : a | b | c | d | e;
    }
}

/* shade (side, side): how much of the lamps' weight the cloud hides from each cell of the floor. The floor's square
 * reaches `half` to every side of the origin at height `floor`; holes between points are closed over two cells. */
int z2p_floor_shade(const float *points, int count, const float *lamps, const float *weights, int lamp_count,
                    float floor, float half, int side, float *shade) {
    uint32_t *mask = calloc((size_t)side * side, sizeof(uint32_t)), *other = calloc((size_t)side * side, sizeof(uint32_t));
    int fine = mask && other && lamp_count <= MOST_LAMPS;
    float scale = (float)side / (2 * half);
    for (int l = 0; fine && l < lamp_count; l++) {
        const float *lamp = lamps + 3 * l;
        for (int i = 0; i < count; i++) {
            const float *p = points + 3 * i;
            float drop = lamp[2] - p[2];
            if (drop <= 1e-3f) continue;
            float stretch = (lamp[2] - floor) / drop;
            float x = (lamp[0] + (p[0] - lamp[0]) * stretch + half) * scale;
            float y = (lamp[1] + (p[1] - lamp[1]) * stretch + half) * scale;
            if (x >= 4 && y >= 4 && x < (float)side - 4 && y < (float)side - 4)
                mask[(size_t)(int)y * side + (int)x] |= 1u << l;
        }
    }
    for (int shared = 0; fine && shared < 2; shared++) {
        window_bits(mask, other, side, 1, shared);
        window_bits(other, mask, side, side, shared);
    }
    for (size_t i = 0; fine && i < (size_t)side * side; i++) {
        float sum = 0;
        for (uint32_t bits = mask[i]; bits; bits &= bits - 1) sum += weights[__builtin_ctz(bits)];
        shade[i] = sum;
    }
    free(mask); free(other);
    return fine;
}

/* Value of a floor grid at a place, linear between the cells' centres, 0 outside. */
static float sample(const float *grid, int side, float column, float row) {
    if (!(column >= 0 && row >= 0 && column < (float)side - 1 && row < (float)side - 1)) return 0;
    int left = (int)column, top = (int)row;
    float x = column - (float)left, y = row - (float)top;
    const float *at = grid + (size_t)top * side + left;
    return (at[0] * (1 - x) + at[1] * x) * (1 - y) + (at[side] * (1 - x) + at[side + 1] * x) * y;
}

/* alpha (height, width): the share of the floor's light that is hidden at each pixel, 0 where no floor is seen. The
 * lamp (3) shines along its axis (3) with that power, the sky gives `sky`; rotation (3, 3) and place (3) are the
 * camera's. The two grids (side, side) say how much of each is hidden; see z2p_floor_shade. */
FAST int z2p_floor_shadow(const float *lamp_shade, const float *sky_shade, int side, float half, float floor,
                     const float *lamp, const float *axis, float power, float sky, const float *rotation,
                     const float *place, float focal, int width, int height, float *alpha) {
    float scale = (float)side / (2 * half);
    for (int v = 0; v < height; v++)
        for (int u = 0; u < width; u++) {
            float x = ((float)u + 0.5f - 0.5f * (float)width) / focal;
            float y = ((float)v + 0.5f - 0.5f * (float)height) / focal, ray[3];
            for (int a = 0; a < 3; a++) ray[a] = x * rotation[a] + y * rotation[3 + a] + rotation[6 + a];
            float *out = alpha + (size_t)v * width + u;
            *out = 0;
            if (ray[2] > -1e-6f) continue;
            float reach = (floor - place[2]) / ray[2];
            float at[3] = {place[0] + reach * ray[0], place[1] + reach * ray[1], floor};
            float column = (at[0] + half) * scale - 0.5f, row = (at[1] + half) * scale - 0.5f;
            float hidden_lamp = sample(lamp_shade, side, column, row), hidden_sky = sample(sky_shade, side, column, row);
            if (hidden_lamp + hidden_sky <= 0) continue;
            float d[3] = {lamp[0] - at[0], lamp[1] - at[1], lamp[2] - at[2]}, square = dot(d, d);
            float light = power * fmaxf(-dot(d, axis), 0) * d[2] / (square * square);
            *out = (light * hidden_lamp + sky * hidden_sky) / (light + sky);
        }
    return 1;
}
