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
#define LANES 16      /* points whose distances are computed at a time */
#define CROWD 256     /* points among which the nearest ones are looked for at a time */

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

/* Keeps the axes apart, with room behind each for whole LANES. */
static int split_axes(Grid *grid, int count, const float *sorted) {
    size_t room = (size_t)count + LANES;
    grid->x = calloc(3 * room, sizeof(float));
    if (!grid->x) return 0;
    grid->y = grid->x + room;
    grid->z = grid->y + room;
    for (int i = 0; i < count; i++) {
        grid->x[i] = sorted[3 * i];
        grid->y[i] = sorted[3 * i + 1];
        grid->z[i] = sorted[3 * i + 2];
    }
    return 1;
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
    return split_axes(grid, count, sorted);
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

/* Points that may be among the nearest ones, and below which square of the distance another one may. */
typedef struct {
    int count;
    float worst, square[CROWD + LANES];
    int row[CROWD + LANES];
} Crowd;

/* Leaves the nearest ones, at most so many, nearest first; of those equally far the ones that came first. */
INLINE void keep_nearest(Crowd *crowd, int most) {
    float square[MOST_NEIGHBOURS];
    int row[MOST_NEIGHBOURS], count = crowd->count, kept = count < most ? count : most;
    for (int i = 0; i < LANES; i++) crowd->square[count + i] = INFINITY;
    for (int i = 0; i < kept; i++) row[i] = -1;
    for (int first = 0; first < count; first += LANES) {
        int nearer[LANES] = {0}; /* how many are nearer, which is a point's place among all */
        const float *own = crowd->square + first;
        for (int j = 0; j < count; j++)
            for (int i = 0; i < LANES; i++) nearer[i] += crowd->square[j] < own[i];
        for (int i = 0; i < LANES && first + i < count; i++) {
            int at = nearer[i];
            while (at < kept && row[at] >= 0) at++; /* taken by one that is as far */
            if (at >= kept) continue;
            square[at] = own[i];
            row[at] = crowd->row[first + i];
        }
    }
    memcpy(crowd->square, square, sizeof(float) * (size_t)kept);
    memcpy(crowd->row, row, sizeof(int) * (size_t)kept);
    crowd->count = kept;
    if (kept == most) crowd->worst = square[kept - 1];
}

/* Takes in the points from `first` to `last` - 1, but for those that are too far from p. */
INLINE void take_in(Crowd *crowd, const Grid *grid, int first, int last, const float *p, int most) {
    for (; first < last; first += LANES) {
        int size = last - first < LANES ? last - first : LANES;
        if (crowd->count + LANES > CROWD) keep_nearest(crowd, most);
        const float *x = grid->x + first, *y = grid->y + first, *z = grid->z + first;
        float *square = crowd->square + crowd->count;
        int *row = crowd->row + crowd->count;
        for (int i = 0; i < LANES; i++) {
            float dx = x[i] - p[0], dy = y[i] - p[1], dz = z[i] - p[2];
            square[i] = dx * dx + dy * dy + dz * dz;
            row[i] = first + i;
        }
        if (crowd->worst < INFINITY) {
            int near = 0;
            for (int i = 0; i < size; i++) {
                square[near] = square[i];
                row[near] = row[i];
                near += square[i] < crowd->worst;
            }
            size = near;
        }
        crowd->count += size;
    }
}

FAST void z2p_grid_nearest(const Grid *grid, const float *points, int self, Near *near) {
    const float *p = points + 3 * self;
    int home[3], low[3], high[3];
    Crowd crowd;
    crowd.count = 0;
    crowd.worst = INFINITY;
    for (int axis = 0; axis < 3; axis++) home[axis] = place(grid, p, axis);
    for (int ring = 0; ring <= FARTHEST_RING || !crowd.count; ring++) { /* a place of its own may lie far from all */
        for (int axis = 0; axis < 3; axis++) {
            low[axis] = clamp_int(home[axis] - ring, 0, grid->size[axis] - 1);
            high[axis] = clamp_int(home[axis] + ring, 0, grid->size[axis] - 1);
        }
        for (int z = low[2]; z <= high[2]; z++)
            for (int y = low[1]; y <= high[1]; y++) {
                const int *start = grid->start + (size_t)(z * grid->size[1] + y) * grid->size[0];
                int left = home[0] - ring, right = home[0] + ring;
                if (abs(z - home[2]) == ring || abs(y - home[1]) == ring) { /* the points of a row lie in one piece */
                    take_in(&crowd, grid, start[low[0]], start[high[0] + 1], p, near->most);
                    continue;
                }
                if (left >= 0) take_in(&crowd, grid, start[left], start[left + 1], p, near->most);
                if (right < grid->size[0]) take_in(&crowd, grid, start[right], start[right + 1], p, near->most);
            }
        /* all but the farthest few are sure to lie in the first ring: cells hold several points each */
        if (ring && crowd.count >= near->most) break;
    }
    keep_nearest(&crowd, near->most);
    near->count = crowd.count;
    memcpy(near->distance, crowd.square, sizeof(float) * (size_t)crowd.count);
    memcpy(near->found, crowd.row, sizeof(int) * (size_t)crowd.count);
}
