/* The points of a dense cloud that an image shows, averaged within cells that are smaller than its pixels.
 *
 * In each cell, those count that lie at most a given depth behind the cell's nearest point. Sums are of integers, so
 * that they do not depend on the points' order. */

#include <stdlib.h>
#include <string.h>

#include "common/point_projection.h"

#define UNITS_PER_LENGTH 16777216.0f /* 2^24: steps of coordinates and values in a sum, for each unit */

/* Sums over the points of a cell. */
typedef struct {
    int64_t position[3], value[3], count;
} CellSum;

/* The grid of cells: size, focal length in cells, and its rows [first, last) that are filled. Mirrored by
 * z2p_core/native/points.py. */
typedef struct {
    int width, height, first_row, last_row;
    float focal, merge_depth;
} CellGrid;

/* Projects the next points, at most BLOCK of `left`, to depths and cells, counted from the first of the grid's rows; as
 * unsigned numbers, those of points outside of these rows are too large. Returns how many points there were. */
INLINE int project_cells(const float *points, int64_t left, const float *camera, const CellGrid *grid, int32_t *cell,
                         float *depth) {
    int count = left < BLOCK ? (int)left : BLOCK;
    project_block(points, count, camera, grid->focal, 0.5f * (float)grid->width, 0.5f * (float)grid->height,
                  grid->width, grid->height, 0, cell, depth);
    for (int i = 0; i < count; i++) cell[i] -= grid->first_row * grid->width;
    return count;
}

/* Lowers the depths of the grid's rows (last - first, width) to those of the points in them. */
INLINE void lower_depths(const float *points, int64_t count, const float *camera, const CellGrid *grid,
                         float *nearest) {
    int32_t cell[BLOCK];
    uint32_t size = (uint32_t)((grid->last_row - grid->first_row) * grid->width);
    float depth[BLOCK];
    for (int64_t first = 0; first < count; first += BLOCK) {
        int block = project_cells(points + 3 * first, count - first, camera, grid, cell, depth);
        for (int i = 0; i < block; i++) {
            uint32_t at = (uint32_t)cell[i];
            if (at < size && depth[i] < nearest[at]) nearest[at] = depth[i];
        }
    }
}

/* Adds the points that lie at most merge_depth behind the nearest one of their cell, and their values unless these are
 * NULL, to the sums of the grid's rows. */
INLINE void add_points(const float *points, const float *values, int64_t count, const float *camera,
                       const CellGrid *grid, const float *nearest, CellSum *sums) {
    int32_t cell[BLOCK];
    uint32_t size = (uint32_t)((grid->last_row - grid->first_row) * grid->width);
    float depth[BLOCK];
    for (int64_t first = 0; first < count; first += BLOCK) {
        int block = project_cells(points + 3 * first, count - first, camera, grid, cell, depth);
        for (int i = 0; i < block; i++) {
            uint32_t at = (uint32_t)cell[i];
            if (at >= size || !(depth[i] <= nearest[at] + grid->merge_depth)) continue;
            CellSum *sum = sums + at;
            const float *p = points + 3 * (first + i);
            for (int a = 0; a < 3; a++) sum->position[a] += (int64_t)(p[a] * UNITS_PER_LENGTH);
            sum->count++;
            if (!values) continue;
            for (int c = 0; c < 3; c++) sum->value[c] += (int64_t)(values[3 * (first + i) + c] * UNITS_PER_LENGTH);
        }
    }
}

/* Writes the means of the cells that hold points, row by row, to merged (.., 3), merged_values (.., 3) and numbers;
 * returns how many there are. Cells whose nearest point lies behind the front at their place are left out: front
 * (front_height, front_width) has square cells, each `per_front` of these cells wide. */
INLINE int64_t write_means(const CellSum *sums, const float *nearest, const CellGrid *grid, const float *front,
                           int front_width, int front_height, float per_front, int has_values, float *merged,
                           float *merged_values, float *numbers) {
    int64_t kept = 0;
    float scale = 1 / per_front;
    for (int y = grid->first_row; y < grid->last_row; y++) {
        int row = (int)(((float)y + 0.5f) * scale);
        const float *limits = front + (size_t)(row < front_height ? row : front_height - 1) * front_width;
        for (int x = 0; x < grid->width; x++) {
            size_t at = (size_t)(y - grid->first_row) * grid->width + x;
            const CellSum *sum = sums + at;
            int column = (int)(((float)x + 0.5f) * scale);
            if (!sum->count || nearest[at] > limits[column < front_width ? column : front_width - 1]) continue;
            double per_point = 1 / ((double)UNITS_PER_LENGTH * (double)sum->count);
            for (int a = 0; a < 3; a++) merged[3 * kept + a] = (float)((double)sum->position[a] * per_point);
            for (int c = 0; has_values && c < 3; c++)
                merged_values[3 * kept + c] = (float)((double)sum->value[c] * per_point);
            numbers[kept++] = (float)sum->count;
        }
    }
    return kept;
}

/* Merges the points (count, 3) that are visible in rows [first_row, last_row) of a grid of cells, see above, and values
 * (count, 3) that belong to them unless these are NULL. camera (12) is its rotation (3, 3), world to camera, and its
 * position (3). merged, merged_values and numbers have room for min(count, cells of the rows); merged_count (1) gets
 * how many were written. */
FAST int z2p_merge_visible(const float *points, const float *values, int64_t count, const float *camera,
                           const CellGrid *grid, const float *front, int front_width, int front_height, float per_front,
                           float *merged, float *merged_values, float *numbers, int64_t *merged_count) {
    size_t cells = (size_t)(grid->last_row - grid->first_row) * grid->width;
    float *nearest = malloc(sizeof(float) * (cells + 1));
    CellSum *sums = calloc(cells + 1, sizeof(CellSum));
    int allocated = nearest && sums;
    for (size_t i = 0; allocated && i < cells; i++) nearest[i] = INFINITY;
    if (allocated) {
        lower_depths(points, count, camera, grid, nearest);
        add_points(points, values, count, camera, grid, nearest, sums);
        *merged_count = write_means(sums, nearest, grid, front, front_width, front_height, per_front, values != NULL,
                                    merged, merged_values, numbers);
    }
    free(nearest); free(sums);
    return allocated;
}
