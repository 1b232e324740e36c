/* The shadow of a cloud on the floor below it, by masks of its cells that have a bit for each lamp. */

#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "fast.h"
#include "floor.h"

#define MOST_LAMPS 64
#define SHARE 0.015625f /* of one of so many */
#define CLOSED 2.0f     /* how far shadows of points are drawn out without gaps */
#define LONGEST 64.0f   /* of those drawn out: of points beside a lamp, which no picture shows, they may cover all */
#define EMPTY 4         /* cells at the floor's border that stay without shadow */
#define STEP 16         /* pixels between those for which smooth light is worked out */

/* Where a point's shadows fall: the cell of each lamp's, that of none at the end of the mask where it is not on the
 * floor; and how far its shadow is drawn out to both sides of it, in whole cells, along the way that it falls. */
typedef struct {
    int cell[MOST_LAMPS], steps[MOST_LAMPS], wide[MOST_LAMPS];
    float x[MOST_LAMPS], y[MOST_LAMPS], along_x[MOST_LAMPS], along_y[MOST_LAMPS];
} Shadows;

/* Finds the shadows of a point, a ball with a radius in cells. A lamp below the floor is an eye that looks into it as
 * into a mirror, from which the point hides the cell between them. Says whether the closing of holes does not reach any
 * lamp's shadow. Plain arithmetic, for vectors. */
INLINE int cast(const float *p, const float *restrict lamps, int lamp_count, float floor, float half, int side,
                float ball, Shadows *restrict to) {
    float scale = (float)side / (2 * half), low = EMPTY, high = (float)(side - EMPTY);
    int drawn_out = 0;
    for (int l = 0; l < lamp_count; l++) {
        float lx = lamps[l], ly = lamps[MOST_LAMPS + l], lz = lamps[2 * MOST_LAMPS + l];
        float dx = p[0] - lx, dy = p[1] - ly, drop = lz - p[2], fall = lz - floor, stretch = fall / drop;
        float x = (lx + dx * stretch + half) * scale, y = (ly + dy * stretch + half) * scale;
        int near = fabsf(stretch) < LONGEST, inside = ((fall > 0 ? drop : -drop) > 1e-3f) & (x >= low) & (y >= low) & (x < high) & (y < high);
        float level = dx * dx + dy * dy, far = sqrtf(level + drop * drop) * fabsf(stretch / drop);
        float grown = near & inside & (far > CLOSED) ? ball * (far - CLOSED) / sqrtf(level + 1e-9f) : 0;
        float along_x = grown * dx, along_y = grown * dy;
        float wide_x = fabsf(along_x), wide_y = fabsf(along_y);
        int steps = (int)((wide_x > wide_y ? wide_x : wide_y) + 0.5f);
        int wide = near & inside & (stretch > CLOSED) ? (int)(ball * (stretch - CLOSED) + 0.5f) : 0;
        to->cell[l] = inside ? (int)y * side + (int)x : side * side;
        to->x[l] = x;
        to->y[l] = y;
        to->along_x[l] = along_x;
        to->along_y[l] = along_y;
        to->steps[l] = steps;
        to->wide[l] = wide;
        drawn_out |= steps | wide;
    }
    return drawn_out;
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
    Shadows shadows;
    for (int i = 0; i < count; i++) {
        int drawn_out = cast(points + 3 * (size_t)i, lamps, lamp_count, floor, half, side, ball, &shadows);
        for (int l = 0; l < lamp_count; l++) mask[shadows.cell[l]] |= (uint64_t)1 << l;
        for (int l = 0; drawn_out && l < lamp_count; l++)
            if (shadows.steps[l] | shadows.wide[l]) mark_line(mask, side, &shadows, l);
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
            shade[(size_t)y * side + x] = bits ? fminf(fmaxf(share, 0), 1) : 0;
        }
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

/* shade (side, side): the share of the lamps that the cloud hides from each cell of the floor; where `square` is given,
 * they are the parts of such a light (see weigh_parts). The floor's square reaches `half` to every side of the origin
 * at height `floor`; points are balls of that radius, in cells, where a lamp draws them out, holes between them are closed
 * over two cells, and the whole is averaged over `soft` cells to every side. */
int z2p_floor_shade(const float *points, int count, const float *lamps, int lamp_count, const float *square,
                    float floor, float half, int side, float ball, int soft, float *shade) {
    size_t cells = (size_t)side * side, first = 0, last = cells;
    uint64_t *mask = calloc(cells + 1, sizeof(uint64_t)), *other = calloc(cells + 1, sizeof(uint64_t));
    int fine = mask && other && lamp_count <= MOST_LAMPS;
    float places[3 * MOST_LAMPS];
    for (int l = 0; fine && l < lamp_count; l++)
        for (int a = 0; a < 3; a++) places[a * MOST_LAMPS + l] = lamps[3 * l + a];
    if (fine) mark(points, count, places, lamp_count, floor, half, side, ball, mask);
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
        if (square) weigh_parts(mask, square, floor, half, side, (int)top, (int)bottom, shade);
        else weigh(mask, first, last, 1 / (float)lamp_count, shade);
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

/* What a floor as Blender makes it without a material (a Principled BSDF: roughness 0.5, index of refraction 1.5) sends
 * to an eye like a blurred mirror: a fit of the directional albedo of its GGX lobe, to 0.003. */
INLINE float mirrored(float cosine) {
    float grazing = 1 - cosine, square = grazing * grazing;
    return 0.0368f + square * (0.1133f + 0.073f * square * grazing);
}

/* The lamp's light on the floor at every STEP-th pixel of a row, and the share that the floor mirrors there. The first
 * pixel lies at (x, y) on the floor, the others `step` apart along X; on a screen at depth 1 that is (left, up), and
 * `pixel` apart. `fall` is the height that rays lose on their way to the screen. */
INLINE void light_row(const Floor *floor, float x, float y, float step, float left, float up, float pixel, float fall,
                      int nodes, float *restrict lamp, float *restrict mirror) {
    for (int n = 0; n < nodes; n++) {
        float at = (float)(n * STEP), aside = left + at * pixel;
        mirror[n] = mirrored(-fall / sqrtf(1 + aside * aside + up * up));
        lamp[n] = lamp_on_floor(floor, x + at * step, y);
    }
}

/* alpha (height, width): the share of the floor's light that is missing at each pixel, 0 where no floor is seen. Grids
 * say how much of the lamp's and the sky's light is hidden (side, side), and of what the floor mirrors (half_side,
 * half_side; see z2p_floor_shade); and the cloud's mean radiance as seen from there (coarse, coarse). rotation (3, 3),
 * whose first row is the X axis, and place (3) are the camera's. So each row of pixels sees the floor along a line of
 * its grids. */
FAST int z2p_floor_shadow(const float *lamp_shade, const float *sky_shade, int side, const float *mirror_shade,
                          int half_side, const float *cloud, int coarse, const Floor *floor, const float *rotation,
                          const float *place, float focal, int width, int height, float *alpha) {
    float half = floor->half, scale = (float)side / (2 * half), part[4];
    float to_half = (float)half_side / (float)side, to_coarse = (float)coarse / (float)side;
    int nodes = width / STEP + 2;
    size_t room = 2 * (size_t)side + (size_t)half_side + (size_t)coarse + 2 * (size_t)nodes;
    float *lamp_line = malloc(sizeof(float) * room);
    float *sky_line = lamp_line + side, *mirror_line = sky_line + side, *cloud_line = mirror_line + half_side;
    float *lamps = cloud_line + coarse, *mirrors = lamps + nodes;
    if (!lamp_line) return 0;
    shaded_part(lamp_shade, sky_shade, side, part);
    memset(alpha, 0, sizeof(float) * (size_t)width * height);
    for (int v = 0; v < height; v++) {
        float y = ((float)v + 0.5f - 0.5f * (float)height) / focal, fall = y * rotation[5] + rotation[8];
        if (fall > -1e-6f) continue; /* at the horizon or above it */
        float reach = (floor->height - place[2]) / fall;
        if (!(reach > 1e-6f)) continue; /* the eye is on the floor or below it */
        float row = (place[1] + reach * (y * rotation[4] + rotation[7]) + half) * scale - 0.5f;
        if (!(row > part[2] && row < part[3])) continue;
        float step = reach / focal * scale, start = (place[0] + half) * scale - 0.5f;
        start += (0.5f - 0.5f * (float)width) * step; /* the first pixel's column of the grids */
        int from = (int)fminf(fmaxf(ceilf((part[0] - start) / step), 0), (float)width);
        int to = (int)fmaxf(fminf(floorf((part[1] - start) / step), (float)width - 1), -1);
        blend_rows(lamp_shade, side, row, lamp_line);
        blend_rows(sky_shade, side, row, sky_line);
        blend_rows(mirror_shade, half_side, (row + 0.5f) * to_half - 0.5f, mirror_line);
        blend_rows(cloud, coarse, (row + 0.5f) * to_coarse - 0.5f, cloud_line);
        float *out = alpha + (size_t)v * width, left = (0.5f - 0.5f * (float)width) / focal;
        light_row(floor, (start + 0.5f) / scale - half, (row + 0.5f) / scale - half, step / scale, left, y, 1 / focal,
                  fall, nodes, lamps, mirrors);
        for (int u = from; u <= to; u++) {
            float column = start + (float)u * step, far = (float)(u % STEP) / STEP;
            float hidden_lamp = sample(lamp_line, side, column), hidden_sky = sample(sky_line, side, column);
            float hidden_mirror = sample(mirror_line, half_side, (column + 0.5f) * to_half - 0.5f);
            float darker = floor->sky - sample(cloud_line, coarse, (column + 0.5f) * to_coarse - 0.5f);
            float lamp = lamps[u / STEP] * (1 - far) + lamps[u / STEP + 1] * far;
            float mirror = mirrors[u / STEP] * (1 - far) + mirrors[u / STEP + 1] * far;
            float matt = floor->albedo * (1 - mirror);
            float missing = matt * (lamp * hidden_lamp + darker * hidden_sky) + mirror * darker * hidden_mirror;
            out[u] = missing > 0 ? missing / (matt * (lamp + floor->sky) + mirror * floor->sky) : 0;
        }
    }
    free(lamp_line);
    return 1;
}
