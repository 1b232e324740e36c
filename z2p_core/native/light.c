/* Light on the points of a cloud and on the floor below it: shadow maps and occlusion masks, a bit for each lamp. */

#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "fast.h"
#include "floor.h"

#define LARGEST_MAP 512
#define MOST_LAMPS 64

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

/* Adds to light (2, count) what a lamp gives the points that nothing nearer hides from it, on the side that the normal
 * points to and on the other one. Plain arithmetic again. */
static inline void add_light(const float *restrict points, const float *restrict normals, int count,
                             const float *restrict lamp, const float *restrict axis, float power, float spacing,
                             const float *restrict depth, const float *restrict nearest, float *restrict light) {
    for (int i = 0; i < count; i++) {
        float dx = lamp[0] - points[3 * i], dy = lamp[1] - points[3 * i + 1], dz = lamp[2] - points[3 * i + 2];
        float square = dx * dx + dy * dy + dz * dz, length = sqrtf(square);
        float towards = (dx * normals[3 * i] + dy * normals[3 * i + 1] + dz * normals[3 * i + 2]) / length;
        float facing = fabsf(towards);
        float shining = -(dx * axis[0] + dy * axis[1] + dz * axis[2]) / length, sine = 1 - facing * facing;
        /* a slanting surface comes nearer within its own cells: do not let it shade itself */
        float slope = sqrtf(sine > 0 ? sine : 0) / (facing > 0.05f ? facing : 0.05f);
        float slack = spacing * (1.0f + 1.4f * (slope < 3.0f ? slope : 3.0f));
        float found = (shining > 0) & !(depth[i] > nearest[i] + slack) ? power * facing * shining / square : 0;
        light[i] += towards > 0 ? found : 0;
        light[count + i] += towards > 0 ? 0 : found;
    }
}

/* light (2, count): what the lamps give each point, on the side that its normal points to and on the other one: the sum
 * of power x cos(at the point) x cos(at the lamp) / distance^2 over the lamps that no other part of the cloud hides
 * from it. A lamp has a place (3), a unit axis (3) along which it shines and a power. `spacing` is that of the cloud,
 * `radius` bounds it. */
FAST int z2p_illuminate(const float *points, const float *normals, int count, const float *lamps, const float *axes,
                   const float *powers, int lamp_count, float spacing, float radius, float *light) {
    float *map = malloc(sizeof(float) * LARGEST_MAP * LARGEST_MAP), *line = malloc(sizeof(float) * 2 * LARGEST_MAP);
    float *depth = malloc(sizeof(float) * 2 * ((size_t)count + 1)), *nearest = depth + count;
    int *cell = malloc(sizeof(int) * ((size_t)count + 1));
    int fine = map && line && depth && cell;
    for (size_t i = 0; i < 2 * (size_t)count; i++) light[i] = 0;
    for (int l = 0; fine && l < lamp_count; l++) {
        draw_map(points, count, lamps + 3 * l, spacing, radius, map, line, depth, cell, nearest);
        add_light(points, normals, count, lamps + 3 * l, axes + 3 * l, powers[l], spacing, depth, nearest, light);
    }
    free(map); free(line); free(depth); free(cell);
    return fine;
}

/* Sets the lamps' bits in the cells of the mask where the point would lie on the floor; those off it, in the last
 * cell. */
static inline void mark(const float *p, const float *restrict lamps, int lamp_count, float floor, float half, int side,
                        uint64_t *mask, int *restrict cells) {
    float scale = (float)side / (2 * half), low = 4, high = (float)side - 4;
    for (int l = 0; l < lamp_count; l++) {
        float lx = lamps[l], ly = lamps[MOST_LAMPS + l], lz = lamps[2 * MOST_LAMPS + l];
        float drop = lz - p[2], stretch = (lz - floor) / drop;
        float x = (lx + (p[0] - lx) * stretch + half) * scale, y = (ly + (p[1] - ly) * stretch + half) * scale;
        int inside = (drop > 1e-3f) & (x >= low) & (y >= low) & (x < high) & (y < high);
        cells[l] = inside ? (int)y * side + (int)x : side * side;
    }
    for (int l = 0; l < lamp_count; l++) mask[cells[l]] |= (uint64_t)1 << l;
}

/* Bits of the cell itself and its four neighbours along an axis, joined or shared, from one mask into another, over
 * some cells. The axis has the stride of its step. */
FAST static void window_bits(const uint64_t *restrict from, uint64_t *restrict to, size_t first, size_t last,
                             size_t step, int shared) {
    for (size_t i = first; i < last; i++) {
        uint64_t a = from[i - 2 * step], b = from[i - step], c = from[i], d = from[i + step], e = from[i + 2 * step];
        to[i] = shared ? a & b & c & d & e : a | b | c | d | e;
    }
}

/* Sum of the weights of the bits of each cell, from one cell to another. */
FAST static void weigh(const uint64_t *mask, size_t first, size_t last, const float *weights, int even, float *shade) {
    for (size_t i = first; i < last; i++) {
        float sum = 0;
        if (even) sum = (float)__builtin_popcountll(mask[i]) * weights[0];
        else for (uint64_t bits = mask[i]; bits; bits &= bits - 1) sum += weights[__builtin_ctzll(bits)];
        shade[i] = sum;
    }
}

/* shade (side, side): how much of the lamps' weight the cloud hides from each cell of the floor. The floor's square
 * reaches `half` to every side of the origin at height `floor`; holes between points are closed over two cells. */
int z2p_floor_shade(const float *points, int count, const float *lamps, const float *weights, int lamp_count,
                    float floor, float half, int side, float *shade) {
    size_t cells = (size_t)side * side, first = 0, last = cells;
    uint64_t *mask = calloc(cells + 1, sizeof(uint64_t)), *other = calloc(cells + 1, sizeof(uint64_t));
    int fine = mask && other && lamp_count <= MOST_LAMPS, even = 1, found[MOST_LAMPS];
    float places[3 * MOST_LAMPS];
    for (int l = 0; fine && l < lamp_count; l++) {
        for (int a = 0; a < 3; a++) places[a * MOST_LAMPS + l] = lamps[3 * l + a];
        even &= weights[l] == weights[0];
    }
    for (int i = 0; fine && i < count; i++) mark(points + 3 * i, places, lamp_count, floor, half, side, mask, found);
    if (fine) {
        mask[cells] = 0;
        memset(shade, 0, sizeof(float) * cells);
        while (first < cells && !mask[first]) first++;
        while (last > first && !mask[last - 1]) last--;
    }
    if (fine && last > first) { /* rows that closing reaches; the outermost four stay empty */
        size_t top = first / (size_t)side - 2, bottom = (last - 1) / (size_t)side + 3;
        first = top * (size_t)side;
        last = bottom * (size_t)side;
        for (int shared = 0; shared < 2; shared++) {
            window_bits(mask, other, first, last, 1, shared);
            window_bits(other, mask, first, last, (size_t)side, shared);
        }
        weigh(mask, first, last, weights, even, shade);
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

/* Bounds left, right, top and bottom, a cell wider, of the cells where either grid (side, side) is above 0. */
static inline void shaded_part(const float *restrict first, const float *restrict second, int side, float *bounds) {
    int left = side, right = -1, top = side, bottom = -1;
    for (int y = 0; y < side; y++) {
        const float *one = first + (size_t)y * side, *other = second + (size_t)y * side;
        int any = 0, from = 0, to = side - 1;
        for (int x = 0; x < side; x++) any |= one[x] + other[x] > 0;
        if (!any) continue;
        if (top == side) top = y;
        bottom = y;
        while (one[from] + other[from] <= 0) from++;
        while (one[to] + other[to] <= 0) to--;
        if (from < left) left = from;
        if (to > right) right = to;
    }
    bounds[0] = (float)left - 1;
    bounds[1] = (float)right + 1;
    bounds[2] = (float)top - 1;
    bounds[3] = (float)bottom + 1;
}

/* alpha (height, width): the share of the floor's light that is missing at each pixel, 0 where no floor is seen. Two
 * grids (side, side) say how much of the lamp's and the sky's light is hidden (see z2p_floor_shade), and `glow`
 * (coarse, coarse) what comes back from the cloud, as a radiance; rotation (3, 3) and place (3) are the camera's. */
FAST int z2p_floor_shadow(const float *lamp_shade, const float *sky_shade, int side, const float *glow, int coarse,
                          const Floor *floor, const float *rotation, const float *place, float focal, int width,
                          int height, float *alpha) {
    float half = floor->half, scale = (float)side / (2 * half), ratio = (float)coarse / (float)side, part[4];
    float *columns = malloc(sizeof(float) * 2 * ((size_t)width + 1)), *rows = columns + width;
    if (!columns) return 0;
    shaded_part(lamp_shade, sky_shade, side, part);
    for (int v = 0; v < height; v++) {
        float y = ((float)v + 0.5f - 0.5f * (float)height) / focal;
        for (int u = 0; u < width; u++) { /* where each pixel's ray meets the floor, in cells; far off if it does not */
            float x = ((float)u + 0.5f - 0.5f * (float)width) / focal, ray[3];
            for (int a = 0; a < 3; a++) ray[a] = x * rotation[a] + y * rotation[3 + a] + rotation[6 + a];
            float reach = (floor->height - place[2]) / (ray[2] < -1e-6f ? ray[2] : -1e-6f);
            columns[u] = (place[0] + reach * ray[0] + half) * scale - 0.5f;
            rows[u] = ray[2] < -1e-6f ? (place[1] + reach * ray[1] + half) * scale - 0.5f : -2.0f;
        }
        float *out = alpha + (size_t)v * width;
        for (int u = 0; u < width; u++) {
            out[u] = 0;
            float column = columns[u], row = rows[u];
            if (!(column > part[0] && column < part[1] && row > part[2] && row < part[3])) continue;
            float hidden_lamp = sample(lamp_shade, side, column, row);
            float hidden_sky = sample(sky_shade, side, column, row);
            if (hidden_lamp + hidden_sky <= 0) continue;
            float back = sample(glow, coarse, (column + 0.5f) * ratio - 0.5f, (row + 0.5f) * ratio - 0.5f);
            float light = lamp_on_floor(floor, (column + 0.5f) / scale - half, (row + 0.5f) / scale - half);
            float missing = light * hidden_lamp + floor->sky * hidden_sky - back;
            out[u] = fmaxf(missing, 0) / (light + floor->sky);
        }
    }
    free(columns);
    return 1;
}
