/* Mutual visibility of a cloud's points along fixed directions: for each point the first other point that it sees, or
 * none, where the environment is visible. Input: points, normals and axes; output: indices of visible points.
 *
 * Points are swept along each axis, from its far end on, while a map across the axis holds the last point that was
 * passed in each cell. */

#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "common/simd.h"
#include "lighting/occlusion.h"

#define BUCKETS 1024 /* of the counting sort by height */

/* Working memory for one axis. Points have a height along the axis and a cell of the map across it. */
typedef struct {
    float *height, *sorted_height; /* by point, and in sorted order */
    int *cell, *sorted_cell;       /* likewise */
    int *order;                    /* point indices sorted by height, lowest first */
    int *last_passed;              /* per cell: the point that was passed last, -1 for none */
    int32_t *farthest;             /* per cell: rank, from the far end, of the farthest point; EMPTY_CELL for none */
    int32_t *scratch;              /* as large as `farthest` */
    int side;
} Sweep;

/* Height along the axis and cell across it of each point. */
INLINE void project_along_axis(const float *restrict points, int count, const float *axis, float radius, float step,
                               Sweep *sweep) {
    float level = sqrtf(axis[0] * axis[0] + axis[1] * axis[1]);
    float r[3] = {level > 1e-6f ? -axis[1] / level : 1, level > 1e-6f ? axis[0] / level : 0, 0};
    float u[3] = {r[1] * axis[2], -r[0] * axis[2], r[0] * axis[1] - r[1] * axis[0]};
    float inverse = 1 / step, *restrict height = sweep->height;
    int most = sweep->side - 1 - MAP_MARGIN, side = sweep->side, *restrict cell = sweep->cell;
    for (int i = 0; i < count; i++) {
        const float *p = points + 3 * i;
        height[i] = p[0] * axis[0] + p[1] * axis[1] + p[2] * axis[2];
        int column = (int)((p[0] * r[0] + p[1] * r[1] + radius) * inverse) + MAP_MARGIN;
        int row = (int)((p[0] * u[0] + p[1] * u[1] + p[2] * u[2] + radius) * inverse) + MAP_MARGIN;
        column = column < MAP_MARGIN ? MAP_MARGIN : column > most ? most : column;
        row = row < MAP_MARGIN ? MAP_MARGIN : row > most ? most : row;
        cell[i] = row * side + column;
    }
}

/* Counting sort into buckets of height; within a bucket points keep their order. */
INLINE void sort_by_height(int count, float radius, Sweep *sweep) {
    int starts[BUCKETS + 1] = {0};
    float scale = (float)BUCKETS / (2 * radius);
    for (int pass = 0; pass < 2; pass++) {
        for (int i = 0; i < count; i++) {
            int bucket = (int)((sweep->height[i] + radius) * scale);
            bucket = bucket < 0 ? 0 : bucket >= BUCKETS ? BUCKETS - 1 : bucket;
            if (!pass) {
                starts[bucket + 1]++;
                continue;
            }
            int at = starts[bucket]++;
            sweep->order[at] = i;
            sweep->sorted_height[at] = sweep->height[i];
            sweep->sorted_cell[at] = sweep->cell[i];
        }
        for (int b = 0; !pass && b < BUCKETS; b++) starts[b + 1] += starts[b];
    }
}

/* Index in sorted order of the point with that rank, counted from the far end: the end that the axis points to (sign 1)
 * or the other one (sign -1). */
INLINE int index_from_far_end(int count, float sign, int rank) { return sign > 0 ? count - 1 - rank : rank; }

/* The farthest point along the axis (sign 1) or against it (-1) in every cell, with the gaps between points closed. */
INLINE void find_farthest(int count, float sign, Sweep *sweep) {
    for (int c = 0; c < sweep->side * sweep->side; c++) sweep->farthest[c] = EMPTY_CELL;
    for (int rank = count - 1; rank >= 0; rank--)
        sweep->farthest[sweep->sorted_cell[index_from_far_end(count, sign, rank)]] = rank;
    close_gaps(sweep->farthest, sweep->side, 0, sweep->scratch);
}

/* Writes to `visible` the first point on each point's ray. Points are visited from the far end on; before one looks up
 * its cell, all points farther than self_distance ahead of it have been put into the map, each into 3 x 3 cells, the
 * nearest last. */
INLINE void sweep_points(int count, float sign, float self_distance, Sweep *sweep, int *visible) {
    const float *heights = sweep->sorted_height;
    const int *cells = sweep->sorted_cell, *order = sweep->order;
    /* the indices of index_from_far_end, without a branch for each */
    int next = 0, side = sweep->side, *map = sweep->last_passed;
    int far_end = sign > 0 ? count - 1 : 0, step = sign > 0 ? -1 : 1;
    memset(map, -1, sizeof(int) * (size_t)side * side);
    for (int rank = 0; rank < count; rank++) {
        int at = far_end + step * rank;
        float min_height = sign * heights[at] + self_distance;
        for (; next < count; next++) {
            int other = far_end + step * next;
            if (sign * heights[other] < min_height) break;
            for (int y = -1; y < 2; y++) {
                int *cell = map + cells[other] + y * side;
                cell[-1] = cell[0] = cell[1] = order[other];
            }
        }
        visible[order[at]] = map[cells[at]];
    }
}

/* Corrects `visible` by the closed map of farthest points: a ray is free if the farthest point is near, or part of the
 * point's own surface. If it is not free, but the first point was missed through a gap or is part of the point's own
 * surface, the farthest point is taken. */
INLINE void close_visibility(const float *points, const float *normals, int count, const float *axis, float sign,
                             float self_distance, const Sweep *sweep, int *visible) {
    float ray[3] = {sign * axis[0], sign * axis[1], sign * axis[2]};
    for (int i = 0; i < count; i++) {
        int32_t rank = sweep->farthest[sweep->cell[i]];
        int at = index_from_far_end(count, sign, rank == EMPTY_CELL ? 0 : rank), farthest = sweep->order[at];
        if (rank == EMPTY_CELL || sign * (sweep->sorted_height[at] - sweep->height[i]) < self_distance ||
            is_own_surface(points, normals, i, farthest, ray))
            visible[i] = -1;
        else if (visible[i] < 0 || is_own_surface(points, normals, i, visible[i], ray))
            visible[i] = farthest;
    }
}

/* Writes visible (2 x axis_count, count): index of the first point that each of points (count, 3) with unit normals
 * (count, 3) sees along each unit axis (3) and, in the next row, against it; -1 where it sees the environment.
 * `spacing` is the cloud's, which lies within `radius` of the origin. */
FAST int z2p_first_visible(const float *points, const float *normals, int count, const float *axes, int axis_count,
                           float spacing, float radius, int *visible) {
    Sweep sweep;
    float step = spacing / MAP_CELLS_PER_SPACING;
    sweep.side = (int)smaller(2 * radius / step + 1 + 2 * MAP_MARGIN, MAX_MAP_SIDE);
    step = 2 * radius / (float)(sweep.side - 2 * MAP_MARGIN);
    size_t cells = (size_t)sweep.side * sweep.side;
    sweep.height = malloc(sizeof(float) * 2 * ((size_t)count + 1));
    sweep.sorted_height = sweep.height + count;
    sweep.cell = malloc(sizeof(int) * 3 * ((size_t)count + 1));
    sweep.sorted_cell = sweep.cell + count;
    sweep.order = sweep.sorted_cell + count;
    sweep.last_passed = malloc(sizeof(int) * cells);
    sweep.farthest = malloc(sizeof(int32_t) * 2 * cells);
    sweep.scratch = sweep.farthest + cells;
    int allocated = sweep.height && sweep.cell && sweep.last_passed && sweep.farthest;
    for (int a = 0; allocated && a < axis_count; a++) {
        const float *axis = axes + 3 * a;
        project_along_axis(points, count, axis, radius, step, &sweep);
        sort_by_height(count, radius, &sweep);
        for (int backward = 0; backward < 2; backward++) {
            float sign = backward ? -1.0f : 1.0f, self_distance = SELF_DISTANCE_SPACINGS * spacing;
            int *row = visible + (size_t)(2 * a + backward) * count;
            find_farthest(count, sign, &sweep);
            sweep_points(count, sign, self_distance, &sweep, row);
            close_visibility(points, normals, count, axis, sign, self_distance, &sweep, row);
        }
    }
    free(sweep.height); free(sweep.cell); free(sweep.last_passed); free(sweep.farthest);
    return allocated;
}
