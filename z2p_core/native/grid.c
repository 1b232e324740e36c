/* Neighbours in a bare cloud: a grid whose cells hold a few points each. */

#include "grid.h"

#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "fast.h"

#define COARSE 24     /* cells along the longest side of the grid that estimates the surface's area */
#define POINTS_A_CELL 3.5f
#define MOST_CELLS (1 << 22)
#define FARTHEST_RING 6
#define CHUNK 32      /* points whose distances are computed at a time */

INLINE int clamp_int(int value, int low, int high) { return value < low ? low : value > high ? high : value; }

INLINE int place(const Grid *grid, const float *point, int axis) {
    return clamp_int((int)((point[axis] - grid->low[axis]) / grid->cell), 0, grid->size[axis] - 1);
}

INLINE int cell_of(const Grid *grid, const float *point) {
    return (place(grid, point, 2) * grid->size[1] + place(grid, point, 1)) * grid->size[0] + place(grid, point, 0);
}

static int shape_grid(Grid *grid, const float *extent, float cell) {
    long cells = 1;
    grid->cell = cell;
    for (int axis = 0; axis < 3; axis++) {
        grid->size[axis] = (int)(extent[axis] / cell) + 1;
        cells *= grid->size[axis];
    }
    return cells <= MOST_CELLS ? (int)cells : 0;
}

static int by_place(const void *first, const void *second) {
    const float *a = first, *b = second;
    for (int axis = 0; axis < 3; axis++)
        if (a[axis] != b[axis]) return a[axis] < b[axis] ? -1 : 1;
    return 0;
}

/* Counting sort by cell, then by coordinates in each: `sorted` does not depend on the order of `points`. */
static int fill(Grid *grid, int cells, const float *points, int count, float *sorted) {
    int *cell = malloc(sizeof(int) * (size_t)(count ? count : 1));
    grid->start = calloc((size_t)cells + 2, sizeof(int));
    if (!cell || !grid->start) { free(cell); return 0; }
    int *fill_at = grid->start + 1;
    for (int i = 0; i < count; i++) grid->start[(cell[i] = cell_of(grid, points + 3 * i)) + 2]++;
    for (int c = 0; c < cells; c++) fill_at[c + 1] += fill_at[c];
    for (int i = 0; i < count; i++) memcpy(sorted + 3 * fill_at[cell[i]]++, points + 3 * i, sizeof(float[3]));
    free(cell);
    for (int c = 0; c < cells; c++) {
        int first = grid->start[c], members = grid->start[c + 1] - first;
        if (members > 1) qsort(sorted + 3 * first, (size_t)members, sizeof(float[3]), by_place);
    }
    return 1;
}

int z2p_grid_build(Grid *grid, const float *points, int count, float *sorted) {
    float high[3], extent[3], longest = 0;
    for (int axis = 0; axis < 3; axis++) {
        grid->low[axis] = high[axis] = points[axis];
        for (int i = 1; i < count; i++) {
            float x = points[3 * i + axis];
            if (x < grid->low[axis]) grid->low[axis] = x;
            if (x > high[axis]) high[axis] = x;
        }
        extent[axis] = high[axis] - grid->low[axis];
        if (extent[axis] > longest) longest = extent[axis];
    }
    if (longest <= 0) longest = 1e-6f;
    /* coarse occupancy: area of the surface, give or take */
    static const int cube = COARSE * COARSE * COARSE;
    uint8_t *seen = calloc(cube, 1);
    if (!seen) return 0;
    shape_grid(grid, extent, longest / (COARSE - 0.01f));
    int occupied = 0;
    for (int i = 0; i < count; i++) {
        uint8_t *here = seen + clamp_int(cell_of(grid, points + 3 * i), 0, cube - 1);
        occupied += !*here;
        *here = 1;
    }
    free(seen);
    float cell = sqrtf((float)occupied * grid->cell * grid->cell * POINTS_A_CELL / (float)count);
    int cells = 0;
    if (cell < longest * 1e-4f) cell = longest * 1e-4f;
    if (count <= MOST_NEIGHBOURS) cell = longest; /* few points lie too far apart to be met ring by ring */
    while (!(cells = shape_grid(grid, extent, cell))) cell *= 1.25f;
    return fill(grid, cells, points, count, sorted);
}

/* Takes in those of points[first] to points[last - 1] that are nearer to p than the farthest so far. */
INLINE void take_in(Near *near, const float *points, int first, int last, const float *p) {
    float squares[CHUNK];
    for (; first < last; first += CHUNK) {
        int size = last - first < CHUNK ? last - first : CHUNK;
        for (int i = 0; i < size; i++) {
            const float *q = points + 3 * (first + i);
            float dx = q[0] - p[0], dy = q[1] - p[1], dz = q[2] - p[2];
            squares[i] = dx * dx + dy * dy + dz * dz;
        }
        for (int i = 0; i < size; i++) {
            float square = squares[i];
            if (near->count == near->most && square >= near->distance[near->most - 1]) continue;
            int at = near->count < near->most ? near->count++ : near->most - 1;
            for (; at > 0 && near->distance[at - 1] > square; at--) {
                near->distance[at] = near->distance[at - 1];
                near->found[at] = near->found[at - 1];
            }
            near->distance[at] = square;
            near->found[at] = first + i;
        }
    }
}

FAST void z2p_grid_nearest(const Grid *grid, const float *points, int self, Near *near) {
    const float *p = points + 3 * self;
    int home[3], low[3], high[3];
    near->count = 0;
    for (int axis = 0; axis < 3; axis++) home[axis] = place(grid, p, axis);
    for (int ring = 0; ring <= FARTHEST_RING; ring++) {
        for (int axis = 0; axis < 3; axis++) {
            low[axis] = clamp_int(home[axis] - ring, 0, grid->size[axis] - 1);
            high[axis] = clamp_int(home[axis] + ring, 0, grid->size[axis] - 1);
        }
        for (int z = low[2]; z <= high[2]; z++)
            for (int y = low[1]; y <= high[1]; y++) {
                const int *start = grid->start + (size_t)(z * grid->size[1] + y) * grid->size[0];
                if (abs(z - home[2]) == ring || abs(y - home[1]) == ring) { /* the points of a row lie in one piece */
                    take_in(near, points, start[low[0]], start[high[0] + 1], p);
                    continue;
                }
                if (home[0] - ring >= 0) take_in(near, points, start[low[0]], start[low[0] + 1], p);
                if (home[0] + ring < grid->size[0]) take_in(near, points, start[high[0]], start[high[0] + 1], p);
            }
        /* all but the farthest few are sure to lie in the first ring: cells hold several points each */
        if (ring && near->count == near->most) break;
    }
}
