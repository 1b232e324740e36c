/* The shadow of a cloud on the floor below it, by masks of its cells that have a bit for each lamp. */

#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "common/simd.h"

#define MOST_LAMPS 64
#define SHARE 0.015625f /* of one of so many */
#define CLOSED 2.0f     /* how far shadows of points are drawn out without gaps */
#define LONGEST 64.0f   /* of those drawn out: of points beside a lamp, which no picture shows, they may cover all */
#define EMPTY 5         /* cells at the floor's border that stay without shadow */
#define APART 4         /* cells to every side from which slopes are taken */

/* A cell that a shadow only touches is all in it, so shadows are half a cell too wide on every side; but points fall
 * short of outlines, by more the farther they lie apart. So the shadows of a share of the lamps are narrowed: their
 * points are put half a cell on, and closing takes away a cell more than it adds, on that side. */

/* The lamps of an 8 x 8 square, row by row, that make up that share, as evenly spread as Bayer's ordered dither. */
static uint64_t narrowed_lamps(float share) {
    uint64_t lamps = 0;
    for (int l = 0; l < MOST_LAMPS; l++) {
        int x = l % 8, y = l / 8, rank = 0;
        for (int b = 0; b < 3; b++) rank |= ((((x ^ y) >> b & 1) << 1) | (y >> b & 1)) << (4 - 2 * b);
        if ((float)rank + 0.5f < share * MOST_LAMPS) lamps |= (uint64_t)1 << l;
    }
    return lamps;
}

/* A point's way from a lamp to the floor, in which a lamp below it is an eye that looks into it as into a mirror, from
 * which the point hides the cell between them. */
typedef struct {
    float dx, dy, drop, stretch, x, y; /* to the point; then how much longer to the floor, and where there, in cells */
    int inside;                        /* whether that is on the floor, off its border */
} Way;

INLINE Way way_of(const float *p, const float *restrict lamps, int l, float floor, float half, int side) {
    float scale = (float)side / (2 * half), low = EMPTY, high = (float)(side - EMPTY);
    float lx = lamps[l], ly = lamps[MOST_LAMPS + l], lz = lamps[2 * MOST_LAMPS + l];
    float on = lamps[3 * MOST_LAMPS + l]; /* of a narrowed one half a cell */
    float dx = p[0] - lx, dy = p[1] - ly, drop = lz - p[2], fall = lz - floor, stretch = fall / drop;
    float x = (lx + dx * stretch + half) * scale + on, y = (ly + dy * stretch + half) * scale + on;
    int beyond = (fall > 0 ? drop : -drop) > 1e-3f;
    Way way = {dx, dy, drop, stretch, x, y, beyond & (x >= low) & (y >= low) & (x < high) & (y < high)};
    return way;
}

/* Finds the cell that a point's shadow by each lamp falls on, the one at the end of the mask where it is not on the
 * floor; and says whether any may have to be drawn out: those are more than `far` times as long as what throws them.
 * Plain arithmetic, for vectors. */
INLINE int cast(const float *p, const float *restrict lamps, int lamp_count, float floor, float half, int side,
                float far, int *restrict cells) {
    int drawn_out = 0;
    for (int l = 0; l < lamp_count; l++) {
        Way way = way_of(p, lamps, l, floor, half, side);
        float square = way.dx * way.dx + way.dy * way.dy + way.drop * way.drop, least = far * way.drop;
        drawn_out |= way.inside & (square * way.stretch * way.stretch > least * least);
        cells[l] = way.inside ? (int)way.y * side + (int)way.x : side * side;
    }
    return drawn_out;
}

/* How far each lamp's shadow of a point is drawn out to both sides of its place, and along which way, in cells. */
typedef struct {
    int steps[MOST_LAMPS], wide[MOST_LAMPS];
    float x[MOST_LAMPS], y[MOST_LAMPS], along_x[MOST_LAMPS], along_y[MOST_LAMPS];
} Shadows;

/* Finds them for a point, a ball with a radius in cells. */
INLINE void draw_out(const float *p, const float *restrict lamps, int lamp_count, float floor, float half, int side,
                     float ball, Shadows *restrict to) {
    for (int l = 0; l < lamp_count; l++) {
        Way way = way_of(p, lamps, l, floor, half, side);
        int near = way.inside & (fabsf(way.stretch) < LONGEST);
        float level = way.dx * way.dx + way.dy * way.dy;
        float far = sqrtf(level + way.drop * way.drop) * fabsf(way.stretch / way.drop);
        float grown = near & (far > CLOSED) ? ball * (far - CLOSED) / sqrtf(level + 1e-9f) : 0;
        float along_x = grown * way.dx, along_y = grown * way.dy, wide_x = fabsf(along_x), wide_y = fabsf(along_y);
        to->steps[l] = (int)((wide_x > wide_y ? wide_x : wide_y) + 0.5f);
        to->wide[l] = near & (way.stretch > CLOSED) ? (int)(ball * (way.stretch - CLOSED) + 0.5f) : 0;
        to->x[l] = way.x;
        to->y[l] = way.y;
        to->along_x[l] = along_x;
        to->along_y[l] = along_y;
    }
}

/* Sets a lamp's bit in the cells along the line that a shadow is drawn out to. */
INLINE void mark_line(uint64_t *mask, int side, const Shadows *shadows, int lamp) {
    uint64_t bit = (uint64_t)1 << lamp;
    int steps = shadows->steps[lamp], wide = shadows->wide[lamp], last = side - EMPTY - 1;
    for (int k = -steps; k <= steps; k++) {
        float share = steps ? (float)k / (float)steps : 0;
        int column = (int)(shadows->x[lamp] + share * shadows->along_x[lamp]);
        int row = (int)(shadows->y[lamp] + share * shadows->along_y[lamp]);
        for (int v = row - wide; v <= row + wide; v++)
            for (int u = column - wide; u <= column + wide; u++)
                if (u >= EMPTY && v >= EMPTY && u <= last && v <= last) mask[(size_t)v * side + u] |= bit;
    }
}

/* Sets the lamps' bits in the cells of the mask that each point hides from them. */
FAST static void mark(const float *points, int count, const float *lamps, int lamp_count, float floor, float half,
                      int side, float ball, uint64_t *mask) {
    float far = (CLOSED + 0.5f / larger(ball, 1e-6f)) * 0.9999f; /* half a cell is drawn; what may be is looked at */
    Shadows shadows;
    int cells[MOST_LAMPS];
    for (int i = 0; i < count; i++) {
        const float *p = points + 3 * (size_t)i;
        int drawn_out = cast(p, lamps, lamp_count, floor, half, side, far, cells);
        for (int l = 0; l < lamp_count; l++) mask[cells[l]] |= (uint64_t)1 << l;
        if (drawn_out) draw_out(p, lamps, lamp_count, floor, half, side, ball, &shadows);
        for (int l = 0; drawn_out && l < lamp_count; l++)
            if (shadows.steps[l] | shadows.wide[l]) mark_line(mask, side, &shadows, l);
    }
}

/* Bits of the cell itself and its four neighbours along an axis, joined or shared, of narrowed lamps with a fifth, from
 * one mask into another, over some cells. The axis has the stride of its step. */
FAST static void window_bits(const uint64_t *restrict from, uint64_t *restrict to, size_t first, size_t last,
                             size_t step, uint64_t narrowed, int shared) {
    for (size_t i = first; i < last; i++) {
        uint64_t a = from[i - 2 * step], b = from[i - step], c = from[i], d = from[i + step], e = from[i + 2 * step];
        to[i] = shared ? a & b & c & d & e & (from[i + 3 * step] | ~narrowed) : a | b | c | d | e;
    }
}

/* Closes the shadows in a mask's rows from `top` to `bottom` - 1 over two cells, and makes those of narrowed lamps a cell
 * narrower: what of them is widened is then taken away again. `other` is as large as the mask. The outermost four rows
 * of the floor are empty. */
static void close_shadows(uint64_t *mask, uint64_t *other, int side, size_t top, size_t bottom, uint64_t narrowed) {
    size_t first = top * (size_t)side, last = bottom * (size_t)side;
    for (int shared = 0; shared < 2; shared++) {
        window_bits(mask, other, first, last, 1, narrowed, shared);
        window_bits(other, mask, first, last, (size_t)side, narrowed, shared);
    }
}

/* Share of all lamps whose bits are set, from one cell to another. */
FAST static void weigh(const uint64_t *mask, size_t first, size_t last, float share, float *shade) {
    for (size_t i = first; i < last; i++) shade[i] = (float)__builtin_popcountll(mask[i]) * share;
}

/* Lamps of an 8 x 8 square, row by row, whose column, or row, has bit 0, 1 or 2 in its number. */
static const uint64_t COLUMNS[3] = {0xAAAAAAAAAAAAAAAA, 0xCCCCCCCCCCCCCCCC, 0xF0F0F0F0F0F0F0F0};
static const uint64_t ROWS[3] = {0xFF00FF00FF00FF00, 0xFFFF0000FFFF0000, 0xFFFFFFFF00000000};

/* Twice the number of the column, or row, counted from the middle, summed over the lamps whose bits are set in mask. */
INLINE float from_middle(uint64_t mask, const uint64_t *patterns) {
    int sum = -7 * __builtin_popcountll(mask);
    for (int k = 0; k < 3; k++) sum += __builtin_popcountll(mask & patterns[k]) << (k + 1);
    return (float)sum;
}

/* The same for the 8 x 8 parts of a square light, in the rows from `top` to `bottom` - 1. `square` (9) is its middle
 * and its two sides. Each part counts as much as it shines on the cell, to the first order in its place on the square:
 * a place d away gives light as d_z / d^4. */
FAST static void weigh_parts(const uint64_t *mask, const float *square, float floor, float half, int side, int top,
                             int bottom, float *shade) {
    const float *middle = square, *across = square + 3, *up = square + 6;
    float cell = 2 * half / (float)side, drop = middle[2] - floor;
    for (int y = top; y < bottom; y++) {
        float dy = middle[1] - ((float)y + 0.5f) * cell + half;
        for (int x = 0; x < side; x++) {
            uint64_t bits = mask[(size_t)y * side + x];
            float dx = middle[0] - ((float)x + 0.5f) * cell + half;
            float fall = -4 / (dx * dx + dy * dy + drop * drop);
            float along = across[2] / drop + fall * (dx * across[0] + dy * across[1] + drop * across[2]);
            float aloft = up[2] / drop + fall * (dx * up[0] + dy * up[1] + drop * up[2]);
            float tilt = along * from_middle(bits, COLUMNS) + aloft * from_middle(bits, ROWS);
            float share = SHARE * ((float)__builtin_popcountll(bits) + tilt / 16);
            shade[(size_t)y * side + x] = bits ? smaller(larger(share, 0), 1) : 0;
        }
    }
}

/* Averages the rows from `first` to `last` - 1 of shade (side, side) over `soft` cells to every side, into soft_shade,
 * which may be the same. */
FAST static void soften(const float *shade, float *room, int side, int first, int last, int soft, float *soft_shade) {
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
        float *restrict out = soft_shade + (size_t)y * side;
        for (int x = 0; x < side; x++) out[x] = 0;
        for (int other = y - soft; other <= y + soft; other++) {
            const float *restrict row = room + (size_t)other * side;
            for (int x = 0; x < side && other >= first && other < last; x++) out[x] += row[x] * share;
        }
    }
}

/* Takes the steps out of the penumbrae in the rows from `first` to `last` - 1 of shade (side, side), which eight lamps
 * side by side leave there: the more cells lie from step to step at the penumbra's slope, the nearer it comes to a mean
 * over `wide` cells to every side. `room` is that of two such grids. */
FAST static void take_out_steps(float *shade, float *room, int side, int first, int last, int wide) {
    float *mean = room + (size_t)side * side;
    soften(shade, room, side, first, last, wide, mean);
    for (int y = first + APART; y < last - APART; y++) {
        const float *here = mean + (size_t)y * side, *above = here - APART * side, *below = here + APART * side;
        float *restrict out = shade + (size_t)y * side;
        for (int x = APART; x < side - APART; x++) {
            float across = here[x + APART] - here[x - APART], along = below[x] - above[x];
            float slope = sqrtf(across * across + along * along) / (2 * APART);
            float cells = 0.125f / larger(slope, 1e-4f); /* from step to step */
            out[x] += smaller(larger((cells - 1) / (2 * (float)wide), 0), 1) * (here[x] - out[x]);
        }
    }
}

/* shade (side, side): the share of the lamps that the cloud hides from each cell of the floor; where `square` is
 * given, they are the parts of such a light. The floor's square reaches `half` to every side of the origin at height
 * `floor`; points are balls of that radius, in cells, where a lamp draws them out, holes between them are closed over
 * two cells, the shadows of the share `narrowed` of the lamps are made a cell narrower, and the whole is averaged
 * over `soft` cells to every side; where `square` is given, only as far as that takes steps out of its penumbra. */
int z2p_floor_shade(const float *points, int count, const float *lamps, int lamp_count, const float *square,
                    float floor, float half, int side, float ball, float narrowed, int soft, float *shade) {
    uint64_t narrow = narrowed_lamps(narrowed);
    size_t cells = (size_t)side * side, first = 0, last = cells;
    uint64_t *mask = calloc(2 * cells + 1, sizeof(uint64_t)), *other = mask + cells + 1;
    int fine = mask && lamp_count <= MOST_LAMPS;
    float places[4 * MOST_LAMPS];
    for (int l = 0; fine && l < lamp_count; l++) {
        for (int a = 0; a < 3; a++) places[a * MOST_LAMPS + l] = lamps[3 * l + a];
        places[3 * MOST_LAMPS + l] = (narrow >> l) & 1 ? 0.5f : 0;
    }
    if (fine) mark(points, count, places, lamp_count, floor, half, side, ball, mask);
    if (fine) {
        mask[cells] = 0;
        memset(shade, 0, sizeof(float) * cells);
        while (first < cells && !mask[first]) first++;
        while (last > first && !mask[last - 1]) last--;
    }
    if (fine && last > first) {
        size_t top = first / (size_t)side - 2, bottom = (last - 1) / (size_t)side + 3; /* rows that closing reaches */
        close_shadows(mask, other, side, top, bottom, narrow);
        if (square) weigh_parts(mask, square, floor, half, side, (int)top, (int)bottom, shade);
        else weigh(mask, top * (size_t)side, bottom * (size_t)side, 1 / (float)lamp_count, shade);
        int spare = square ? soft + APART : soft, above = (int)top - spare, below = (int)bottom + spare;
        above = above > 0 ? above : 0;
        below = below < side ? below : side;
        /* the masks have done their work: room for four times as many floats */
        if (square && soft) take_out_steps(shade, (float *)mask, side, above, below, soft);
        else if (soft) soften(shade, (float *)mask, side, above, below, soft, shade);
    }
    free(mask);
    return fine;
}

/* out (wide, wide): a grid (side, side) over the same square in other cells, linear between its cells' centres. */
FAST int z2p_other_cells(const float *grid, int side, int wide, float *out) {
    float ratio = (float)side / (float)wide, last = (float)side - 1, *line = malloc(sizeof(float) * (size_t)side);
    for (int v = 0; line && v < wide; v++) {
        float row = smaller(larger(((float)v + 0.5f) * ratio - 0.5f, 0), last);
        int top = row < last ? (int)row : side - 2;
        float below = row - (float)top;
        const float *restrict at = grid + (size_t)top * side, *restrict next = at + side;
        float *restrict to = out + (size_t)v * wide;
        for (int x = 0; x < side; x++) line[x] = at[x] + below * (next[x] - at[x]);
        for (int u = 0; u < wide; u++) {
            float column = smaller(larger(((float)u + 0.5f) * ratio - 0.5f, 0), last);
            int left = column < last ? (int)column : side - 2;
            to[u] = line[left] + (column - (float)left) * (line[left + 1] - line[left]);
        }
    }
    int fine = line != NULL;
    free(line);
    return fine;
}
