/* The shadow of a cloud on the floor below it, by masks of its cells that have a bit for each lamp. */

#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "fast.h"
#include "floor.h"

#define MOST_LAMPS 64
#define CLOSED 2.0f /* how far shadows of points are drawn out without gaps */
#define EMPTY 4     /* cells at the floor's border that stay without shadow */

/* Sets a lamp's bit in the cells along a line about (x, y), `along` (2) its half, and so far to both sides of it. */
static void mark_line(uint64_t *mask, uint64_t bit, int side, float x, float y, const float *along, int wide) {
    int steps = (int)(fmaxf(fabsf(along[0]), fabsf(along[1])) + 0.5f), last = side - EMPTY - 1;
    for (int k = -steps; k <= steps; k++) {
        float share = steps ? (float)k / (float)steps : 0;
        int column = (int)(x + share * along[0]), row = (int)(y + share * along[1]);
        for (int v = row - wide; v <= row + wide; v++)
            for (int u = column - wide; u <= column + wide; u++)
                if (u >= EMPTY && v >= EMPTY && u <= last && v <= last) mask[(size_t)v * side + u] |= bit;
    }
}

/* Sets the lamps' bits in the cells of the mask where the point would lie on the floor; those off it, in the last
 * cell. Says whether any lamp draws the point's shadow out to more than CLOSED times its size. */
INLINE int mark(const float *p, const float *restrict lamps, int lamp_count, float floor, float half, int side,
                uint64_t *mask, int *restrict cells) {
    float scale = (float)side / (2 * half), low = EMPTY, high = (float)(side - EMPTY);
    int drawn_out = 0;
    for (int l = 0; l < lamp_count; l++) {
        float lx = lamps[l], ly = lamps[MOST_LAMPS + l], lz = lamps[2 * MOST_LAMPS + l];
        float dx = p[0] - lx, dy = p[1] - ly, drop = lz - p[2], fall = lz - floor, stretch = fall / drop;
        float x = (lx + dx * stretch + half) * scale, y = (ly + dy * stretch + half) * scale;
        int inside = (drop > 1e-3f) & (x >= low) & (y >= low) & (x < high) & (y < high);
        cells[l] = inside ? (int)y * side + (int)x : side * side;
        drawn_out |= fall * fall * (dx * dx + dy * dy + drop * drop) > CLOSED * CLOSED * drop * drop * drop * drop;
    }
    for (int l = 0; l < lamp_count; l++) mask[cells[l]] |= (uint64_t)1 << l;
    return drawn_out;
}

/* Draws a point's shadows, those of a ball with a radius in cells, by the lamps for which it lies on the floor (`cells`)
 * and which draw it out farther than the closing of holes reaches. */
static void mark_drawn_out(const float *p, const float *lamps, int lamp_count, float floor, float half, int side,
                           float ball, const int *cells, uint64_t *mask) {
    float scale = (float)side / (2 * half);
    for (int l = 0; l < lamp_count; l++) {
        float lx = lamps[l], ly = lamps[MOST_LAMPS + l], drop = lamps[2 * MOST_LAMPS + l] - p[2];
        float dx = p[0] - lx, dy = p[1] - ly, level = sqrtf(dx * dx + dy * dy) + 1e-6f;
        float stretch = (lamps[2 * MOST_LAMPS + l] - floor) / drop, far = sqrtf(level * level + drop * drop) / drop;
        float grown = ball * (stretch * far - CLOSED) / level, along[2] = {grown * dx, grown * dy};
        if (cells[l] == side * side || grown <= 0) continue;
        mark_line(mask, (uint64_t)1 << l, side, (lx + dx * stretch + half) * scale, (ly + dy * stretch + half) * scale,
                  along, (int)(ball * fmaxf(stretch - CLOSED, 0) + 0.5f));
    }
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

/* Averages the rows from `first` to `last` - 1 of shade (side, side) over `soft` cells to every side. */
FAST static void soften(float *shade, float *room, int side, int first, int last, int soft) {
    float share = 1.0f / (float)((2 * soft + 1) * (2 * soft + 1));
    for (int y = first; y < last; y++) {
        const float *restrict row = shade + (size_t)y * side;
        float *restrict out = room + (size_t)y * side;
        for (int x = 0; x < side; x++) out[x] = 0;
        for (int k = -soft; k <= soft; k++) {
            int from = k < 0 ? -k : 0, to = k < 0 ? side : side - k;
            for (int x = from; x < to; x++) out[x] += row[x + k];
        }
    }
    for (int y = first; y < last; y++) {
        float *restrict out = shade + (size_t)y * side;
        for (int x = 0; x < side; x++) out[x] = 0;
        for (int other = y - soft; other <= y + soft; other++) {
            const float *restrict row = room + (size_t)other * side;
            for (int x = 0; x < side && other >= first && other < last; x++) out[x] += row[x] * share;
        }
    }
}

/* shade (side, side): how much of the lamps' weight the cloud hides from each cell of the floor. The floor's square
 * reaches `half` to every side of the origin at height `floor`; points are balls of that radius, in cells, where a lamp
 * draws them out, holes between them are closed over two cells, and the whole is averaged over `soft` cells to every
 * side. */
int z2p_floor_shade(const float *points, int count, const float *lamps, const float *weights, int lamp_count,
                    float floor, float half, int side, float ball, int soft, float *shade) {
    size_t cells = (size_t)side * side, first = 0, last = cells;
    uint64_t *mask = calloc(cells + 1, sizeof(uint64_t)), *other = calloc(cells + 1, sizeof(uint64_t));
    int fine = mask && other && lamp_count <= MOST_LAMPS, even = 1, found[MOST_LAMPS];
    float places[3 * MOST_LAMPS];
    for (int l = 0; fine && l < lamp_count; l++) {
        for (int a = 0; a < 3; a++) places[a * MOST_LAMPS + l] = lamps[3 * l + a];
        even &= weights[l] == weights[0];
    }
    for (int i = 0; fine && i < count; i++) {
        int drawn_out = mark(points + 3 * i, places, lamp_count, floor, half, side, mask, found);
        if (drawn_out && ball > 0)
            mark_drawn_out(points + 3 * i, places, lamp_count, floor, half, side, ball, found, mask);
    }
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
        int above = (int)top - soft, below = (int)bottom + soft;
        /* the masks have done their work: room for as many floats */
        if (soft) soften(shade, (float *)mask, side, above > 0 ? above : 0, below < side ? below : side, soft);
    }
    free(mask); free(other);
    return fine;
}

/* A row of a floor grid (side, side) at any height, linear between the cells' centres; 0 outside. */
INLINE void blend_rows(const float *restrict grid, int side, float row, float *restrict out) {
    int top = (int)floorf(row), inside = row >= 0 && row < (float)side - 1;
    float y = row - (float)top;
    const float *at = grid + (size_t)(inside ? top : 0) * side;
    for (int x = 0; x < side; x++) out[x] = inside ? at[x] * (1 - y) + at[side + x] * y : 0;
}

/* Value of such a row at a place, likewise. */
INLINE float sample(const float *restrict line, int side, float column) {
    int inside = (column >= 0) & (column < (float)side - 1), left = inside ? (int)column : 0;
    float x = column - (float)left;
    return inside ? line[left] * (1 - x) + line[left + 1] * x : 0;
}

/* Bounds left, right, top and bottom, a cell wider, of the cells where either grid (side, side) is above 0. */
INLINE void shaded_part(const float *restrict first, const float *restrict second, int side, float *bounds) {
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
 * (coarse, coarse) what comes back from the cloud, as a radiance; rotation (3, 3), whose first row is the X axis, and
 * place (3) are the camera's. So each row of pixels sees the floor along a line of its grids. */
FAST int z2p_floor_shadow(const float *lamp_shade, const float *sky_shade, int side, const float *glow, int coarse,
                          const Floor *floor, const float *rotation, const float *place, float focal, int width,
                          int height, float *alpha) {
    float half = floor->half, scale = (float)side / (2 * half), ratio = (float)coarse / (float)side, part[4];
    float *lamp_line = malloc(sizeof(float) * (2 * (size_t)side + (size_t)coarse));
    float *sky_line = lamp_line + side, *glow_line = sky_line + side;
    if (!lamp_line) return 0;
    shaded_part(lamp_shade, sky_shade, side, part);
    memset(alpha, 0, sizeof(float) * (size_t)width * height);
    for (int v = 0; v < height; v++) {
        float y = ((float)v + 0.5f - 0.5f * (float)height) / focal, fall = y * rotation[5] + rotation[8];
        if (fall > -1e-6f) continue; /* at the horizon or above it */
        float reach = (floor->height - place[2]) / fall;
        float row = (place[1] + reach * (y * rotation[4] + rotation[7]) + half) * scale - 0.5f;
        if (!(row > part[2] && row < part[3])) continue;
        float step = reach / focal * scale, start = (place[0] + half) * scale - 0.5f;
        start += (0.5f - 0.5f * (float)width) * step; /* the first pixel's column of the grids */
        int from = (int)fmaxf(ceilf((part[0] - start) / step), 0);
        int to = (int)fminf(floorf((part[1] - start) / step), (float)width - 1);
        blend_rows(lamp_shade, side, row, lamp_line);
        blend_rows(sky_shade, side, row, sky_line);
        blend_rows(glow, coarse, (row + 0.5f) * ratio - 0.5f, glow_line);
        float *out = alpha + (size_t)v * width, y_floor = (row + 0.5f) / scale - half;
        for (int u = from; u <= to; u++) {
            float column = start + (float)u * step;
            float hidden_lamp = sample(lamp_line, side, column), hidden_sky = sample(sky_line, side, column);
            float back = sample(glow_line, coarse, (column + 0.5f) * ratio - 0.5f);
            float light = lamp_on_floor(floor, (column + 0.5f) / scale - half, y_floor);
            float missing = light * hidden_lamp + floor->sky * hidden_sky - back;
            out[u] = (hidden_lamp + hidden_sky > 0) & (missing > 0) ? missing / (light + floor->sky) : 0;
        }
    }
    free(lamp_line);
    return 1;
}
