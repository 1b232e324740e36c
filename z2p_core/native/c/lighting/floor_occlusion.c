/* Occlusion of the floor: which share of the samples of a light (or of the sky, or of what the floor reflects) a point
 * cloud hides from each cell of the floor. Input: points and light sample positions; output: a grid of shares.
 *
 * Every cell has a 64-bit mask with a bit for each light sample. Points are projected from each sample onto the floor
 * and set its bit; masks are closed morphologically, so that gaps between points do not let light through; the count of
 * bits is the occlusion.
 *
 * A point marks the whole cell that it falls into, which makes shadows half a cell too wide on every side, while
 * sampled surfaces fall short of their outlines, the more the farther their points lie apart. So the shadows of a share
 * of the samples are eroded: their points are shifted by half a cell, and closing takes away a cell more than it adds,
 * on the far side of both axes. */

#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "common/simd.h"

#define MAX_LIGHT_SAMPLES 64
#define SHARE_PER_SAMPLE 0.015625f /* 1 / MAX_LIGHT_SAMPLES */
#define CLOSED_STRETCH 2.0f        /* magnification of a shadow up to which closing fills the gaps between its points */
#define MAX_STRETCH 64.0f          /* larger ones are not filled: points beside a light, which no image shows */
#define BORDER_CELLS 5             /* cells at the floor's border that stay unoccluded */
#define SLOPE_CELLS 4              /* distance to either side at which slopes of a penumbra are measured */

/* The floor's grid and how shadows are drawn; see z2p_floor_occlusion. Mirrored by z2p_core/native/lighting.py. */
typedef struct {
    float height, half_size, ball_radius_cells, eroded_share;
    int side, blur_cells;
} OcclusionGrid;

/* The samples of an 8 x 8 grid, row by row, whose shadows are eroded: that share of them, spread as evenly as in
 * Bayer's ordered dithering. */
static uint64_t eroded_samples(float share) {
    uint64_t samples = 0;
    for (int l = 0; l < MAX_LIGHT_SAMPLES; l++) {
        int x = l % 8, y = l / 8, rank = 0;
        for (int b = 0; b < 3; b++) rank |= ((((x ^ y) >> b & 1) << 1) | (y >> b & 1)) << (4 - 2 * b);
        if ((float)rank + 0.5f < share * MAX_LIGHT_SAMPLES) samples |= (uint64_t)1 << l;
    }
    return samples;
}

/* Projection of a point from a light sample onto the floor. A sample below the floor stands for the camera's mirror
 * image: the point hides the cell that lies between the two. */
typedef struct {
    float dx, dy, drop; /* from the sample to the point; drop is how much lower the point is */
    float stretch;      /* distance from the sample to the floor over that to the point */
    float x, y;         /* on the floor, in cells */
    int inside;         /* on the grid, not in its border */
} Projection;

/* Light samples are laid out (4, MAX_LIGHT_SAMPLES): x, y, z and the shift of eroded ones, half a cell. */
INLINE Projection project_to_floor(const float *p, const float *restrict samples, int l, float floor, float half,
                                   int side) {
    float scale = (float)side / (2 * half), low = BORDER_CELLS, high = (float)(side - BORDER_CELLS);
    float lx = samples[l], ly = samples[MAX_LIGHT_SAMPLES + l], lz = samples[2 * MAX_LIGHT_SAMPLES + l];
    float shift = samples[3 * MAX_LIGHT_SAMPLES + l];
    float dx = p[0] - lx, dy = p[1] - ly, drop = lz - p[2], to_floor = lz - floor, stretch = to_floor / drop;
    float x = (lx + dx * stretch + half) * scale + shift, y = (ly + dy * stretch + half) * scale + shift;
    int beyond = (to_floor > 0 ? drop : -drop) > 1e-3f;
    Projection to = {dx, dy, drop, stretch, x, y, beyond & (x >= low) & (y >= low) & (x < high) & (y < high)};
    return to;
}

/* Writes the cell that each sample's shadow of a point falls on, side^2 if it is not on the grid; returns whether any
 * shadow may have to be filled: those more than `max_length` times as long as the distance in height that casts them.
 * Without a branch, so that the loop becomes vector code. */
INLINE int cast_shadows(const float *p, const float *restrict samples, int sample_count, float floor, float half,
                        int side, float max_length, int *restrict cells) {
    int any_long = 0;
    for (int l = 0; l < sample_count; l++) {
        Projection to = project_to_floor(p, samples, l, floor, half, side);
        float distance_sq = to.dx * to.dx + to.dy * to.dy + to.drop * to.drop, least = max_length * to.drop;
        any_long |= to.inside & (distance_sq * to.stretch * to.stretch > least * least);
        cells[l] = to.inside ? (int)to.y * side + (int)to.x : side * side;
    }
    return any_long;
}

/* Elongated shadows of a point, a ball: a line of `steps` cells to both sides of (x, y), along (along_x, along_y) and
 * `half_width` cells to either side. */
typedef struct {
    int steps[MAX_LIGHT_SAMPLES], half_width[MAX_LIGHT_SAMPLES];
    float x[MAX_LIGHT_SAMPLES], y[MAX_LIGHT_SAMPLES];
    float along_x[MAX_LIGHT_SAMPLES], along_y[MAX_LIGHT_SAMPLES];
} LongShadows;

/* Computes these for the samples whose shadows are stretched beyond what closing fills. */
INLINE void elongate_shadows(const float *p, const float *restrict samples, int sample_count, float floor, float half,
                             int side, float ball_radius, LongShadows *restrict shadows) {
    for (int l = 0; l < sample_count; l++) {
        Projection to = project_to_floor(p, samples, l, floor, half, side);
        int filled = to.inside & (fabsf(to.stretch) < MAX_STRETCH);
        float level_sq = to.dx * to.dx + to.dy * to.dy;
        float length = sqrtf(level_sq + to.drop * to.drop) * fabsf(to.stretch / to.drop);
        float grown = filled & (length > CLOSED_STRETCH)
            ? ball_radius * (length - CLOSED_STRETCH) / sqrtf(level_sq + 1e-9f) : 0;
        float along_x = grown * to.dx, along_y = grown * to.dy, wide_x = fabsf(along_x), wide_y = fabsf(along_y);
        shadows->steps[l] = (int)((wide_x > wide_y ? wide_x : wide_y) + 0.5f);
        shadows->half_width[l] =
            filled & (to.stretch > CLOSED_STRETCH) ? (int)(ball_radius * (to.stretch - CLOSED_STRETCH) + 0.5f) : 0;
        shadows->x[l] = to.x;
        shadows->y[l] = to.y;
        shadows->along_x[l] = along_x;
        shadows->along_y[l] = along_y;
    }
}

/* Sets a sample's bit in the cells of its elongated shadow. */
INLINE void mark_long_shadow(uint64_t *mask, int side, const LongShadows *shadows, int sample) {
    uint64_t bit = (uint64_t)1 << sample;
    int steps = shadows->steps[sample], half_width = shadows->half_width[sample], last = side - BORDER_CELLS - 1;
    for (int k = -steps; k <= steps; k++) {
        float t = steps ? (float)k / (float)steps : 0;
        int column = (int)(shadows->x[sample] + t * shadows->along_x[sample]);
        int row = (int)(shadows->y[sample] + t * shadows->along_y[sample]);
        for (int v = row - half_width; v <= row + half_width; v++)
            for (int u = column - half_width; u <= column + half_width; u++)
                if (u >= BORDER_CELLS && v >= BORDER_CELLS && u <= last && v <= last) mask[(size_t)v * side + u] |= bit;
    }
}

/* Sets the samples' bits in the cells of the mask (side^2 + 1) that each point hides from them. */
FAST static void mark_shadows(const float *points, int count, const float *samples, int sample_count, float floor,
                              float half, int side, float ball_radius, uint64_t *mask) {
    /* shadows that grow by half a cell are elongated; a little less is tested, against rounding */
    float max_length = (CLOSED_STRETCH + 0.5f / larger(ball_radius, 1e-6f)) * 0.9999f;
    LongShadows shadows;
    int cells[MAX_LIGHT_SAMPLES];
    for (int i = 0; i < count; i++) {
        const float *p = points + 3 * (size_t)i;
        int any_long = cast_shadows(p, samples, sample_count, floor, half, side, max_length, cells);
        for (int l = 0; l < sample_count; l++) mask[cells[l]] |= (uint64_t)1 << l;
        if (any_long) elongate_shadows(p, samples, sample_count, floor, half, side, ball_radius, &shadows);
        for (int l = 0; any_long && l < sample_count; l++)
            if (shadows.steps[l] | shadows.half_width[l]) mark_long_shadow(mask, side, &shadows, l);
    }
}

/* Dilation (union) or erosion (intersection) of the bits of cells [first, last) over five cells in a row, `step` apart;
 * erosion of `eroded` samples takes in a sixth cell. */
FAST static void window_bits(const uint64_t *restrict from, uint64_t *restrict to, size_t first, size_t last,
                             size_t step, uint64_t eroded, int erosion) {
    for (size_t i = first; i < last; i++) {
        uint64_t a = from[i - 2 * step], b = from[i - step], c = from[i], d = from[i + step], e = from[i + 2 * step];
        to[i] = erosion ? a & b & c & d & e & (from[i + 3 * step] | ~eroded) : a | b | c | d | e;
    }
}

/* Morphological closing of the mask's rows [top, bottom) by two cells, with the shadows of `eroded` samples a cell
 * narrower. `scratch` is as large as the mask. The outermost four rows and columns of the floor are empty. */
static void close_shadows(uint64_t *mask, uint64_t *scratch, int side, size_t top, size_t bottom, uint64_t eroded) {
    size_t first = top * (size_t)side, last = bottom * (size_t)side;
    for (int erosion = 0; erosion < 2; erosion++) {
        window_bits(mask, scratch, first, last, 1, eroded, erosion);
        window_bits(scratch, mask, first, last, (size_t)side, eroded, erosion);
    }
}

/* Occlusion of the cells [first, last): the number of bits, each counting as much as `share`. */
FAST static void count_samples(const uint64_t *mask, size_t first, size_t last, float share, float *occlusion) {
    for (size_t i = first; i < last; i++) occlusion[i] = (float)__builtin_popcountll(mask[i]) * share;
}

/* Samples of an 8 x 8 grid, row by row, whose column, or row, number has bit 0, 1 or 2 set. */
static const uint64_t COLUMNS[3] = {0xAAAAAAAAAAAAAAAA, 0xCCCCCCCCCCCCCCCC, 0xF0F0F0F0F0F0F0F0};
static const uint64_t ROWS[3] = {0xFF00FF00FF00FF00, 0xFFFF0000FFFF0000, 0xFFFFFFFF00000000};

/* Twice the column, or row, number relative to the grid's center, summed over the samples in the mask. */
INLINE float sum_from_center(uint64_t mask, const uint64_t *patterns) {
    int sum = -7 * __builtin_popcountll(mask);
    for (int k = 0; k < 3; k++) sum += __builtin_popcountll(mask & patterns[k]) << (k + 1);
    return (float)sum;
}

/* Occlusion of the rows [top, bottom) for the 8 x 8 samples of an area light, given by its center and two edge vectors
 * (3, 3). Each sample counts by the light that it gives the cell, to first order in its position on the light: a sample
 * at offset d contributes d_z / |d|^4. */
FAST static void weight_samples(const uint64_t *mask, const float *area_light, float floor, float half, int side,
                                int top, int bottom, float *occlusion) {
    const float *center = area_light, *edge_u = area_light + 3, *edge_v = area_light + 6;
    float cell = 2 * half / (float)side, drop = center[2] - floor;
    for (int y = top; y < bottom; y++) {
        float dy = center[1] - ((float)y + 0.5f) * cell + half;
        for (int x = 0; x < side; x++) {
            uint64_t bits = mask[(size_t)y * side + x];
            float dx = center[0] - ((float)x + 0.5f) * cell + half;
            float falloff = -4 / (dx * dx + dy * dy + drop * drop);
            float along_u = edge_u[2] / drop + falloff * (dx * edge_u[0] + dy * edge_u[1] + drop * edge_u[2]);
            float along_v = edge_v[2] / drop + falloff * (dx * edge_v[0] + dy * edge_v[1] + drop * edge_v[2]);
            float tilt = along_u * sum_from_center(bits, COLUMNS) + along_v * sum_from_center(bits, ROWS);
            float share = SHARE_PER_SAMPLE * ((float)__builtin_popcountll(bits) + tilt / 16);
            occlusion[(size_t)y * side + x] = bits ? smaller(larger(share, 0), 1) : 0;
        }
    }
}

/* Box blur of the rows [first, last) of grid (side, side) over `radius` cells to every side, into blurred, which may be
 * the same. `scratch` is as large as the grid. */
FAST static void box_blur(const float *grid, float *scratch, int side, int first, int last, int radius,
                          float *blurred) {
    float share = 1.0f / (float)((2 * radius + 1) * (2 * radius + 1));
    for (int y = first; y < last; y++) {
        const float *restrict row = grid + (size_t)y * side;
        float *restrict out = scratch + (size_t)y * side;
        for (int x = 0; x < side; x++) out[x] = 0;
        for (int k = -radius; k <= radius; k++) {
            int from = k < 0 ? -k : 0, to = k < 0 ? side : side - k;
            for (int x = from; x < to; x++) out[x] += row[x + k];
        }
    }
    for (int y = first; y < last; y++) {
        float *restrict out = blurred + (size_t)y * side;
        for (int x = 0; x < side; x++) out[x] = 0;
        for (int other = y - radius; other <= y + radius; other++) {
            const float *restrict row = scratch + (size_t)other * side;
            for (int x = 0; x < side && other >= first && other < last; x++) out[x] += row[x] * share;
        }
    }
}

/* Smooths the steps that eight rows of light samples leave in penumbrae, in the rows [first, last) of occlusion (side,
 * side): the more cells lie between steps, by the penumbra's slope, the closer the value comes to a mean over `radius`
 * cells to every side. `scratch` is as large as two such grids. */
FAST static void smooth_penumbra_steps(float *occlusion, float *scratch, int side, int first, int last, int radius) {
    float *mean = scratch + (size_t)side * side;
    box_blur(occlusion, scratch, side, first, last, radius, mean);
    for (int y = first + SLOPE_CELLS; y < last - SLOPE_CELLS; y++) {
        const float *here = mean + (size_t)y * side, *above = here - SLOPE_CELLS * side;
        const float *below = here + SLOPE_CELLS * side;
        float *restrict out = occlusion + (size_t)y * side;
        for (int x = SLOPE_CELLS; x < side - SLOPE_CELLS; x++) {
            float across = here[x + SLOPE_CELLS] - here[x - SLOPE_CELLS], along = below[x] - above[x];
            float slope = sqrtf(across * across + along * along) / (2 * SLOPE_CELLS);
            float cells_per_step = 0.125f / larger(slope, 1e-4f);
            out[x] += smaller(larger((cells_per_step - 1) / (2 * (float)radius), 0), 1) * (here[x] - out[x]);
        }
    }
}

/* Writes occlusion (side, side): the share of the light samples (sample_count, 3), at most MAX_LIGHT_SAMPLES, that the
 * points (count, 3) hide from each cell of a floor at z = height, whose square reaches half_size to every side of the
 * origin. Where a low or near sample stretches shadows, points are balls of ball_radius_cells; the shadows of
 * eroded_share of the samples are a cell narrower; the result is averaged over blur_cells to every side.
 * area_light (3, 3), or NULL, are the center and edge vectors of a square light that the samples are the 8 x 8 parts
 * of: each then counts by the light that it gives a cell, and averaging only smooths the steps of penumbrae. */
int z2p_floor_occlusion(const float *points, int count, const float *samples, int sample_count,
                        const float *area_light, const OcclusionGrid *grid, float *occlusion) {
    int side = grid->side, blur = grid->blur_cells;
    float floor = grid->height, half = grid->half_size;
    uint64_t eroded = eroded_samples(grid->eroded_share);
    size_t cells = (size_t)side * side, first = 0, last = cells;
    uint64_t *mask = calloc(2 * cells + 1, sizeof(uint64_t)), *scratch = mask + cells + 1;
    if (!mask || sample_count > MAX_LIGHT_SAMPLES) { free(mask); return 0; }
    float positions[4 * MAX_LIGHT_SAMPLES];
    for (int l = 0; l < sample_count; l++) {
        for (int a = 0; a < 3; a++) positions[a * MAX_LIGHT_SAMPLES + l] = samples[3 * l + a];
        positions[3 * MAX_LIGHT_SAMPLES + l] = (eroded >> l) & 1 ? 0.5f : 0;
    }
    mark_shadows(points, count, positions, sample_count, floor, half, side, grid->ball_radius_cells, mask);
    mask[cells] = 0;
    memset(occlusion, 0, sizeof(float) * cells);
    while (first < cells && !mask[first]) first++;
    while (last > first && !mask[last - 1]) last--;
    if (last > first) {
        size_t top = first / (size_t)side - 2, bottom = (last - 1) / (size_t)side + 3; /* rows that closing reaches */
        close_shadows(mask, scratch, side, top, bottom, eroded);
        if (area_light) weight_samples(mask, area_light, floor, half, side, (int)top, (int)bottom, occlusion);
        else count_samples(mask, top * (size_t)side, bottom * (size_t)side, 1 / (float)sample_count, occlusion);
        int spare = area_light ? blur + SLOPE_CELLS : blur, above = (int)top - spare, below = (int)bottom + spare;
        above = above > 0 ? above : 0;
        below = below < side ? below : side;
        /* the masks are done with: their memory has room for four times as many floats */
        if (area_light && blur) smooth_penumbra_steps(occlusion, (float *)mask, side, above, below, blur);
        else if (blur) box_blur(occlusion, (float *)mask, side, above, below, blur, occlusion);
    }
    free(mask);
    return 1;
}

/* Writes out (new_side, new_side): grid (side, side) resampled over the same square, linear between cell centers. */
FAST int z2p_resample_grid(const float *grid, int side, int new_side, float *out) {
    float ratio = (float)side / (float)new_side, last = (float)side - 1, *line = malloc(sizeof(float) * (size_t)side);
    for (int v = 0; line && v < new_side; v++) {
        float row = smaller(larger(((float)v + 0.5f) * ratio - 0.5f, 0), last);
        int top = row < last ? (int)row : side - 2;
        float below = row - (float)top;
        const float *restrict at = grid + (size_t)top * side, *restrict next = at + side;
        float *restrict to = out + (size_t)v * new_side;
        for (int x = 0; x < side; x++) line[x] = at[x] + below * (next[x] - at[x]);
        for (int u = 0; u < new_side; u++) {
            float column = smaller(larger(((float)u + 0.5f) * ratio - 0.5f, 0), last);
            int left = column < last ? (int)column : side - 2;
            to[u] = line[left] + (column - (float)left) * (line[left + 1] - line[left]);
        }
    }
    int allocated = line != NULL;
    free(line);
    return allocated;
}
