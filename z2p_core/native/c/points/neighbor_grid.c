/* Nearest neighbors in a point cloud. A uniform grid holds a few points a cell; where most points crowd in few cells,
 * as near a scanner, a k-d tree replaces it (Bentley, Multidimensional Binary Search Trees, 1975), which is slower to
 * build and to search, but independent of density.
 *
 * Input: points (count, 3). Output: the points sorted by cell or tree node, in an order that does not depend on that of
 * the input; for queries, indices of the nearest points and the local spacing. */

#include "points/neighbor_grid.h"

#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "common/lanes.h"
#include "common/vec3.h"

#define COARSE_CELLS 24      /* cells along the longest side of the grid that estimates the surface's area */
#define POINTS_PER_CELL 3.5f /* mean number of points in the occupied cells */
#define MAX_CELLS (1 << 22)
#define MAX_RING 6           /* rings of cells that are searched around a query */
#define BATCH 16             /* points whose distances are computed at a time */
#define TREE_CROWDING 40.0f  /* mean number of points that share a point's cell above which the tree is faster */
#define MAX_LEAF_POINTS 16
#define MAX_TREE_DEPTH 32
#define MAX_CANDIDATES 256   /* points that are collected before only the nearest ones are kept */
#define SPACING_NEIGHBORS 12 /* nearest points from whose distance the spacing is estimated */

INLINE int clamp_int(int value, int low, int high) { return value < low ? low : value > high ? high : value; }

INLINE int cell_coordinate(const Grid *grid, const float *point, int axis) {
    return clamp_int((int)((point[axis] - grid->low[axis]) / grid->cell_size), 0, grid->size[axis] - 1);
}

INLINE int cell_index(const Grid *grid, const float *point) {
    return (cell_coordinate(grid, point, 2) * grid->size[1] + cell_coordinate(grid, point, 1)) * grid->size[0] +
           cell_coordinate(grid, point, 0);
}

static int set_cell_size(Grid *grid, const float *extent, float cell) {
    long cells = 1;
    grid->cell_size = cell;
    for (int axis = 0; axis < 3; axis++) {
        grid->size[axis] = (int)(extent[axis] / cell) + 1;
        cells *= grid->size[axis];
    }
    return cells <= MAX_CELLS ? (int)cells : 0;
}

/* Order of two points by one coordinate, then by the next ones. */
INLINE int compare_points(const float *a, const float *b, int axis) {
    for (int i = 0; i < 3; i++, axis = (axis + 1) % 3)
        if (a[axis] != b[axis]) return a[axis] < b[axis] ? -1 : 1;
    return 0;
}

static int by_x(const void *a, const void *b) { return compare_points(a, b, 0); }
static int by_y(const void *a, const void *b) { return compare_points(a, b, 1); }
static int by_z(const void *a, const void *b) { return compare_points(a, b, 2); }
static int (*const by_axis[])(const void *, const void *) = {by_x, by_y, by_z};

/* Stores the coordinates of each axis in one array, padded so that whole batches can be read. */
static int store_axes(Grid *grid, int count, const float *sorted) {
    size_t room = (size_t)count + BATCH;
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

/* Splits `points` (count, 3) at the median of their longest axis, and each half again, down to `levels` levels. */
static void build_subtree(Split *splits, int node, float *points, int count, int levels) {
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
    build_subtree(splits, 2 * node + 1, points, half, levels - 1);
    build_subtree(splits, 2 * node + 2, points + 3 * half, count - half, levels - 1);
}

/* Builds the k-d tree, which replaces the grid, and sorts the points by its leaves. */
static int build_tree(Grid *grid, int count, float *sorted) {
    grid->count = count;
    while (count >> grid->levels > MAX_LEAF_POINTS) grid->levels++;
    grid->splits = malloc(sizeof(Split) << grid->levels);
    if (!grid->splits) return 0;
    build_subtree(grid->splits, 0, sorted, count, grid->levels);
    return store_axes(grid, count, sorted);
}

/* Counting sort by cell, then by coordinates in each cell: `sorted` does not depend on the order of `points`. */
static int sort_into_cells(Grid *grid, int cells, const float *points, int count, float *sorted) {
    int *cell = malloc(sizeof(int) * (size_t)(count ? count : 1));
    grid->start = calloc((size_t)cells + 2, sizeof(int));
    if (!cell || !grid->start) { free(cell); return 0; }
    int *fill_at = grid->start + 1;
    for (int i = 0; i < count; i++) grid->start[(cell[i] = cell_index(grid, points + 3 * i)) + 2]++;
    for (int c = 0; c < cells; c++) fill_at[c + 1] += fill_at[c];
    for (int i = 0; i < count; i++) memcpy(sorted + 3 * fill_at[cell[i]]++, points + 3 * i, sizeof(float[3]));
    free(cell);
    double pairs = 0;
    for (int c = 0; c < cells; c++) {
        double members = grid->start[c + 1] - grid->start[c];
        pairs += members * members;
    }
    if (count > MAX_NEIGHBORS && pairs > TREE_CROWDING * (double)count) return build_tree(grid, count, sorted);
    for (int c = 0; c < cells; c++) {
        int first = grid->start[c], members = grid->start[c + 1] - first;
        if (members > 1) qsort(sorted + 3 * first, (size_t)members, sizeof(float[3]), by_x);
    }
    return store_axes(grid, count, sorted);
}

/* Builds a zeroed grid of `points` (count, 3), and their sorted copy. Returns 0 if memory is short. */
static int build_grid(Grid *grid, const float *points, int count, float *sorted) {
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
    /* estimates the area of the surface from the number of occupied coarse cells */
    static const int cube = COARSE_CELLS * COARSE_CELLS * COARSE_CELLS;
    uint8_t *occupied_cells = calloc(cube, 1);
    if (!occupied_cells) return 0;
    set_cell_size(grid, extent, longest / (COARSE_CELLS - 0.01f));
    int occupied = 0;
    for (int i = 0; i < count; i++) {
        uint8_t *here = occupied_cells + clamp_int(cell_index(grid, points + 3 * i), 0, cube - 1);
        occupied += !*here;
        *here = 1;
    }
    free(occupied_cells);
    float cell = sqrtf((float)occupied * grid->cell_size * grid->cell_size * POINTS_PER_CELL / (float)count);
    int cells = 0;
    if (cell < longest * 1e-4f) cell = longest * 1e-4f;
    if (count <= MAX_NEIGHBORS) cell = longest; /* few points lie too far apart for a search by rings */
    while (!(cells = set_cell_size(grid, extent, cell))) cell *= 1.25f;
    return sort_into_cells(grid, cells, points, count, sorted);
}

/* Points that may be among the nearest, and the squared distance that a further one must fall below. */
typedef struct {
    int count;
    float worst_sq, distance_sq[MAX_CANDIDATES + BATCH];
    int row[MAX_CANDIDATES + BATCH];
} Candidates;

/* Keeps the nearest `max_count` candidates, nearest first; of equally far ones those that came first. */
INLINE void keep_nearest(Candidates *candidates, int max_count) {
    float distance_sq[MAX_NEIGHBORS];
    int row[MAX_NEIGHBORS], count = candidates->count, kept = count < max_count ? count : max_count;
    for (int i = 0; i < BATCH; i++) candidates->distance_sq[count + i] = INFINITY;
    for (int i = 0; i < kept; i++) row[i] = -1;
    for (int first = 0; first < count; first += BATCH) {
        Lanes own[BATCH / LANES];
        Masks nearer[BATCH / LANES] = {{0}};
        int rank[BATCH]; /* number of nearer candidates */
        memcpy(own, candidates->distance_sq + first, sizeof own);
        for (int j = 0; j < count; j++)
            for (int part = 0; part < BATCH / LANES; part++)
                nearer[part] -= candidates->distance_sq[j] < own[part]; /* where it is, -1 */
        memcpy(rank, nearer, sizeof rank);
        for (int i = 0; i < BATCH && first + i < count; i++) {
            int at = rank[i];
            while (at < kept && row[at] >= 0) at++; /* taken by an equally far candidate */
            if (at >= kept) continue;
            distance_sq[at] = candidates->distance_sq[first + i];
            row[at] = candidates->row[first + i];
        }
    }
    memcpy(candidates->distance_sq, distance_sq, sizeof(float) * (size_t)kept);
    memcpy(candidates->row, row, sizeof(int) * (size_t)kept);
    candidates->count = kept;
    if (kept == max_count) candidates->worst_sq = distance_sq[kept - 1];
}

/* Adds the points `first` to `last` - 1 unless they are too far from p. */
INLINE void add_candidates(Candidates *candidates, const Grid *grid, int first, int last, const float *p,
                           int max_count) {
    for (; first < last; first += BATCH) {
        int size = last - first < BATCH ? last - first : BATCH;
        if (candidates->count + BATCH > MAX_CANDIDATES) keep_nearest(candidates, max_count);
        const float *x = grid->x + first, *y = grid->y + first, *z = grid->z + first;
        float *distance_sq = candidates->distance_sq + candidates->count;
        int *row = candidates->row + candidates->count;
        for (int i = 0; i < BATCH; i++) {
            float dx = x[i] - p[0], dy = y[i] - p[1], dz = z[i] - p[2];
            distance_sq[i] = dx * dx + dy * dy + dz * dz;
            row[i] = first + i;
        }
        if (candidates->worst_sq < INFINITY) {
            int near = 0;
            for (int i = 0; i < size; i++) {
                distance_sq[near] = distance_sq[i];
                row[near] = row[i];
                near += distance_sq[i] < candidates->worst_sq;
            }
            size = near;
        }
        candidates->count += size;
    }
}

/* A tree node that is still to be searched, and a lower bound of its squared distance from the query. */
typedef struct {
    int node, level, first, count;
    float distance_sq;
} PendingNode;

/* Collects candidates from the tree. */
INLINE void search_tree(const Grid *grid, const float *p, int max_count, Candidates *candidates) {
    PendingNode pending[MAX_TREE_DEPTH];
    int pending_count = 0;
    pending[pending_count++] = (PendingNode){0, 0, 0, grid->count, 0};
    while (pending_count) {
        PendingNode part = pending[--pending_count];
        if (part.distance_sq > candidates->worst_sq) continue;
        while (part.level < grid->levels) { /* down to the leaf on the query's side */
            Split split = grid->splits[part.node];
            float off = p[split.axis] - split.position;
            int half = part.count / 2, above = off >= 0;
            PendingNode low = {2 * part.node + 1, part.level + 1, part.first, half, part.distance_sq};
            PendingNode high = {2 * part.node + 2, part.level + 1, part.first + half, part.count - half,
                                part.distance_sq};
            PendingNode other = above ? low : high;
            other.distance_sq = larger(part.distance_sq, off * off);
            pending[pending_count++] = other;
            part = above ? high : low;
        }
        add_candidates(candidates, grid, part.first, part.first + part.count, p, max_count);
        if (candidates->count >= max_count + (candidates->worst_sq < INFINITY ? max_count : 0))
            keep_nearest(candidates, max_count);
    }
}

/* Collects candidates from the grid, ring by ring around the query. */
INLINE void search_cells(const Grid *grid, const float *p, int max_count, Candidates *candidates) {
    int center[3], low[3], high[3];
    for (int axis = 0; axis < 3; axis++) center[axis] = cell_coordinate(grid, p, axis);
    for (int ring = 0; ring <= MAX_RING || !candidates->count; ring++) { /* a query may lie far from all points */
        for (int axis = 0; axis < 3; axis++) {
            low[axis] = clamp_int(center[axis] - ring, 0, grid->size[axis] - 1);
            high[axis] = clamp_int(center[axis] + ring, 0, grid->size[axis] - 1);
        }
        for (int z = low[2]; z <= high[2]; z++)
            for (int y = low[1]; y <= high[1]; y++) {
                const int *start = grid->start + (size_t)(z * grid->size[1] + y) * grid->size[0];
                int left = center[0] - ring, right = center[0] + ring;
                if (abs(z - center[2]) == ring || abs(y - center[1]) == ring) {
                    /* the points of a row of cells are contiguous */
                    add_candidates(candidates, grid, start[low[0]], start[high[0] + 1], p, max_count);
                    continue;
                }
                if (left >= 0) add_candidates(candidates, grid, start[left], start[left + 1], p, max_count);
                if (right < grid->size[0])
                    add_candidates(candidates, grid, start[right], start[right + 1], p, max_count);
            }
        /* the rings up to 1 hold all but the farthest few, as cells hold several points each */
        if (ring && candidates->count >= max_count) break;
    }
}

FAST void find_nearest(const Grid *grid, const float *points, int query, Nearest *nearest) {
    const float *p = points + 3 * query;
    Candidates candidates;
    candidates.count = 0;
    candidates.worst_sq = INFINITY;
    if (grid->splits)
        search_tree(grid, p, nearest->max_count, &candidates);
    else
        search_cells(grid, p, nearest->max_count, &candidates);
    keep_nearest(&candidates, nearest->max_count);
    nearest->count = candidates.count;
    memcpy(nearest->distance_sq, candidates.distance_sq, sizeof(float) * (size_t)candidates.count);
    memcpy(nearest->indices, candidates.row, sizeof(int) * (size_t)candidates.count);
}

/* Builds the grid of a cloud (count, 3); `sorted` (count, 3) gets its points in the grid's order. */
int z2p_grid_build(const float *points, int count, float *sorted, Grid **grid) {
    *grid = calloc(1, sizeof(Grid));
    return *grid && build_grid(*grid, points, count, sorted);
}

int z2p_grid_free(Grid *grid) {
    if (grid) {
        free(grid->start);
        free(grid->splits);
        free(grid->x);
    }
    free(grid);
    return 1;
}

/* For the points with `query_indices` (count): `neighbors` (count, max_neighbors), nearest first, the point itself
 * included if it is one of the grid's, the last one repeated if there are fewer; and `spacing` (count), the side of the
 * square patch of surface that is a point's share, from the density of its nearest points. */
int z2p_grid_neighbors(const Grid *grid, const float *points, const int *query_indices, int count, int max_neighbors,
                       int *neighbors, float *spacing) {
    for (int i = 0; i < count; i++, neighbors += max_neighbors) {
        Nearest nearest = {.max_count = max_neighbors};
        find_nearest(grid, points, query_indices[i], &nearest);
        int used = nearest.count < SPACING_NEIGHBORS ? nearest.count : SPACING_NEIGHBORS;
        spacing[i] = used > 1 ? sqrtf(PI * nearest.distance_sq[used - 1] / (float)used) : 0;
        for (int j = 0; j < max_neighbors; j++)
            neighbors[j] = nearest.indices[j < nearest.count ? j : nearest.count - 1];
    }
    return 1;
}

/* Index of a point of the grid that lies exactly at p; -1 if there is none in p's cell. */
INLINE int find_equal(const Grid *grid, const float *p) {
    int cell = cell_index(grid, p);
    for (int i = grid->start[cell]; i < grid->start[cell + 1]; i++)
        if (grid->x[i] == p[0] && grid->y[i] == p[1] && grid->z[i] == p[2]) return i;
    return -1;
}

/* Writes the indices `nearest` (count) of the points nearest to positions (count, 3), which often are points of the
 * grid. */
int z2p_grid_nearest(const Grid *grid, const float *positions, int count, int *nearest) {
    for (int i = 0; i < count; i++) {
        Nearest found = {.max_count = 1};
        nearest[i] = grid->splits ? -1 : find_equal(grid, positions + 3 * (size_t)i);
        if (nearest[i] >= 0) continue;
        find_nearest(grid, positions, i, &found);
        nearest[i] = found.indices[0];
    }
    return 1;
}
