/* Neighbours in a bare cloud: a grid whose cells hold a few points each. Where most points crowd in few cells, as near
 * a scanner, a k-d tree takes its place: slower to build and to ask, but whatever the points' density. */

#include "points/neighbor_grid.h"

#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "common/simd.h"

#define COARSE 24     /* cells along the longest side of the grid that estimates the surface's area */
#define POINTS_A_CELL 3.5f
#define MOST_CELLS (1 << 22)
#define FARTHEST_RING 6
#define LANES 16      /* points whose distances are computed at a time */
#define CROWDED 40.0f /* other points in a point's cell, on average, from which on a tree is quicker */
#define LEAF 16       /* points at most in a part of the tree that is not halved any more */
#define DEEPEST 32
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

/* By the coordinate along an axis, and where that is equal by the others. */
INLINE int compare(const float *a, const float *b, int axis) {
    for (int i = 0; i < 3; i++, axis = (axis + 1) % 3)
        if (a[axis] != b[axis]) return a[axis] < b[axis] ? -1 : 1;
    return 0;
}

static int by_x(const void *a, const void *b) { return compare(a, b, 0); }
static int by_y(const void *a, const void *b) { return compare(a, b, 1); }
static int by_z(const void *a, const void *b) { return compare(a, b, 2); }
static int (*const by_axis[])(const void *, const void *) = {by_x, by_y, by_z};

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

/* Halves `points` (count, 3) along their longest axis, and each half again, `levels` times, from the node's split on. */
static void halve(Split *splits, int node, float *points, int count, int levels) {
    float low[3], high[3];
    int axis = 0;
    if (!levels) return;
    for (int a = 0; a < 3; a++) {
        low[a] = high[a] = points[a];
        for (int i = 1; i < count; i++) {
            low[a] = smaller(low[a], points[3 * i + a]);
            high[a] = larger(high[a], points[3 * i + a]);
        }
        if (high[a] - low[a] > high[axis] - low[axis]) axis = a;
    }
    qsort(points, (size_t)count, sizeof(float[3]), by_axis[axis]);
    int half = count / 2;
    splits[node] = (Split){points[3 * half + axis], axis};
    halve(splits, 2 * node + 1, points, half, levels - 1);
    halve(splits, 2 * node + 2, points + 3 * half, count - half, levels - 1);
}

/* The tree of points, sorted by it, in place of the grid. */
static int plant(Grid *grid, int count, float *sorted) {
    grid->count = count;
    while (count >> grid->levels > LEAF) grid->levels++;
    grid->splits = malloc(sizeof(Split) << grid->levels);
    if (!grid->splits) return 0;
    halve(grid->splits, 0, sorted, count, grid->levels);
    return split_axes(grid, count, sorted);
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
    double together = 0;
    for (int c = 0; c < cells; c++) {
        double members = grid->start[c + 1] - grid->start[c];
        together += members * members;
    }
    if (count > MOST_NEIGHBOURS && together > CROWDED * (double)count) return plant(grid, count, sorted);
    for (int c = 0; c < cells; c++) {
        int first = grid->start[c], members = grid->start[c + 1] - first;
        if (members > 1) qsort(sorted + 3 * first, (size_t)members, sizeof(float[3]), by_x);
    }
    return split_axes(grid, count, sorted);
}

int build_grid(Grid *grid, const float *points, int count, float *sorted) {
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

/* A part of the tree that is still to be looked at, and how far from the place it lies at least. */
typedef struct {
    int node, level, first, count;
    float square;
} Part;

/* The tree's points that may be among the nearest ones. */
INLINE void look_through_tree(const Grid *grid, const float *p, int most, Crowd *crowd) {
    Part later[DEEPEST];
    int parts = 0;
    later[parts++] = (Part){0, 0, 0, grid->count, 0};
    while (parts) {
        Part part = later[--parts];
        if (part.square > crowd->worst) continue;
        while (part.level < grid->levels) { /* to the leaf on its side; the other sides wait */
            Split split = grid->splits[part.node];
            float off = p[split.axis] - split.place;
            int half = part.count / 2, above = off >= 0;
            Part low = {2 * part.node + 1, part.level + 1, part.first, half, part.square};
            Part high = {2 * part.node + 2, part.level + 1, part.first + half, part.count - half, part.square};
            Part other = above ? low : high;
            other.square = larger(part.square, off * off);
            later[parts++] = other;
            part = above ? high : low;
        }
        take_in(crowd, grid, part.first, part.first + part.count, p, most);
        if (crowd->count >= most + (crowd->worst < INFINITY ? most : 0)) keep_nearest(crowd, most);
    }
}

/* The grid's points that may be among the nearest ones. */
INLINE void look_through_cells(const Grid *grid, const float *p, int most, Crowd *crowd) {
    int home[3], low[3], high[3];
    for (int axis = 0; axis < 3; axis++) home[axis] = place(grid, p, axis);
    for (int ring = 0; ring <= FARTHEST_RING || !crowd->count; ring++) { /* a place of its own may lie far from all */
        for (int axis = 0; axis < 3; axis++) {
            low[axis] = clamp_int(home[axis] - ring, 0, grid->size[axis] - 1);
            high[axis] = clamp_int(home[axis] + ring, 0, grid->size[axis] - 1);
        }
        for (int z = low[2]; z <= high[2]; z++)
            for (int y = low[1]; y <= high[1]; y++) {
                const int *start = grid->start + (size_t)(z * grid->size[1] + y) * grid->size[0];
                int left = home[0] - ring, right = home[0] + ring;
                if (abs(z - home[2]) == ring || abs(y - home[1]) == ring) { /* the points of a row lie in one piece */
                    take_in(crowd, grid, start[low[0]], start[high[0] + 1], p, most);
                    continue;
                }
                if (left >= 0) take_in(crowd, grid, start[left], start[left + 1], p, most);
                if (right < grid->size[0]) take_in(crowd, grid, start[right], start[right + 1], p, most);
            }
        /* all but the farthest few are sure to lie in the first ring: cells hold several points each */
        if (ring && crowd->count >= most) break;
    }
}

FAST void find_nearest(const Grid *grid, const float *points, int self, Near *near) {
    const float *p = points + 3 * self;
    Crowd crowd;
    crowd.count = 0;
    crowd.worst = INFINITY;
    if (grid->splits)
        look_through_tree(grid, p, near->most, &crowd);
    else
        look_through_cells(grid, p, near->most, &crowd);
    keep_nearest(&crowd, near->most);
    near->count = crowd.count;
    memcpy(near->distance, crowd.square, sizeof(float) * (size_t)crowd.count);
    memcpy(near->found, crowd.row, sizeof(int) * (size_t)crowd.count);
}
