/* The points of a dense cloud that an image shows, averaged within cells that are smaller than its pixels.
 *
 * In each cell, those count that lie at most a given depth behind the cell's nearest point. Sums are of integers, so
 * that they do not depend on the points' order. */

#include <stdlib.h>
#include <string.h>

#include "common/screen_view.h"

#define UNITS_PER_LENGTH 16777216.0f /* 2^24: steps of coordinates and values in a sum, for each unit */

/* Sums over the points of a cell. */
typedef struct {
    int64_t position[3], count;
} CellSum;

/* Which rows [first, last) of the screen's cells are filled, and how far behind the nearest point of its cell a point may
 * lie to count: so many widths of a cell at its depth, and a constant. Mirrored by z2p_core/native/points.py. */
typedef struct {
    int first_row, last_row;
    float merge_cells, merge_depth;
} MergedRows;

/* Projects the next points, at most BLOCK of `left`, to depths and cells, counted from the first of the grid's rows; as
 * unsigned numbers, those of points outside of these rows are too large. Returns how many points there were. */
INLINE int project_cells(const float *points, int64_t left, const ScreenView *view, const MergedRows *rows,
                         int32_t *cell, float *depth) {
    int count = left < BLOCK ? (int)left : BLOCK;
    project_block(points, count, view, 0, cell, depth);
    for (int i = 0; i < count; i++) cell[i] -= rows->first_row * view->width;
    return count;
}

/* Lowers the depths of the grid's rows (last - first, width) to those of the points in them. */
INLINE void lower_depths(const float *points, int64_t count, const ScreenView *view, const MergedRows *rows,
                         float *nearest) {
    int32_t cell[BLOCK];
    uint32_t size = (uint32_t)((rows->last_row - rows->first_row) * view->width);
    float depth[BLOCK];
    for (int64_t first = 0; first < count; first += BLOCK) {
        int block = project_cells(points + 3 * first, count - first, view, rows, cell, depth);
        for (int i = 0; i < block; i++) {
            uint32_t at = (uint32_t)cell[i];
            if (at < size && depth[i] < nearest[at]) nearest[at] = depth[i];
        }
    }
}

/* Numbers the cells that are shown, row by row, in `number` (cells), and returns how many there are. Those without a
 * point, or whose nearest point lies behind the front at their place, get a depth of -INFINITY, so that no point counts
 * there: front (front_height, front_width) has square cells, each `per_front` of these cells wide. */
INLINE int number_cells(float *nearest, const ScreenView *view, const MergedRows *rows, const float *front,
                        int front_width, int front_height, float per_front, int *number) {
    int shown = 0;
    float scale = 1 / per_front;
    for (int y = rows->first_row; y < rows->last_row; y++) {
        int row = (int)(((float)y + 0.5f) * scale);
        const float *limits = front + (size_t)(row < front_height ? row : front_height - 1) * front_width;
        for (int x = 0; x < view->width; x++) {
            size_t at = (size_t)(y - rows->first_row) * view->width + x;
            int column = (int)(((float)x + 0.5f) * scale);
            float limit = limits[column < front_width ? column : front_width - 1];
            int is_shown = nearest[at] < INFINITY && nearest[at] <= limit;
            if (!is_shown) nearest[at] = -INFINITY;
            number[at] = shown;
            shown += is_shown;
        }
    }
    return shown;
}

/* Adds the points that do not lie too far behind the nearest one of their cell to the sums of the cell's number, and
 * their values unless these are NULL to value_sums (shown, 3). */
INLINE void add_points(const float *points, const float *values, int64_t count, const ScreenView *view,
                       const MergedRows *rows, const float *nearest, const int *number, CellSum *sums,
                       int64_t *value_sums) {
    int32_t cell[BLOCK];
    uint32_t size = (uint32_t)((rows->last_row - rows->first_row) * view->width);
    float depth[BLOCK];
    float growth = 1 + rows->merge_cells * cell_width_slope(view);
    float reach = rows->merge_depth + rows->merge_cells * cell_width_constant(view);
    for (int64_t first = 0; first < count; first += BLOCK) {
        int block = project_cells(points + 3 * first, count - first, view, rows, cell, depth);
        for (int i = 0; i < block; i++) {
            uint32_t at = (uint32_t)cell[i];
            if (at >= size || !(depth[i] <= nearest[at] * growth + reach)) continue;
            CellSum *sum = sums + number[at];
            const float *p = points + 3 * (first + i);
            for (int a = 0; a < 3; a++) sum->position[a] += (int64_t)(p[a] * UNITS_PER_LENGTH);
            sum->count++;
            int64_t *value = values ? value_sums + 3 * (size_t)number[at] : NULL;
            for (int c = 0; value && c < 3; c++)
                value[c] += (int64_t)(values[3 * (first + i) + c] * UNITS_PER_LENGTH);
        }
    }
}

/* Writes the means of the cells that are shown to merged (shown, 3), merged_values (shown, 3) and numbers (shown). */
INLINE void write_means(const CellSum *sums, const int64_t *value_sums, int shown, int has_values, float *merged,
                        float *merged_values, float *numbers) {
    for (size_t i = 0; i < (size_t)shown; i++) {
        double per_point = 1 / ((double)UNITS_PER_LENGTH * (double)sums[i].count);
        for (int a = 0; a < 3; a++) merged[3 * i + a] = (float)((double)sums[i].position[a] * per_point);
        for (int c = 0; has_values && c < 3; c++)
            merged_values[3 * i + c] = (float)((double)value_sums[3 * i + c] * per_point);
        numbers[i] = (float)sums[i].count;
    }
}

/* Merges the points (count, 3) that are visible in rows [first_row, last_row) of a grid of cells, see above, and values
 * (count, 3) that belong to them unless these are NULL. merged, merged_values and numbers have room for min(count, cells of the rows); merged_count (1) gets
 * how many were written. */
FAST int z2p_merge_visible(const float *points, const float *values, int64_t count, const ScreenView *view,
                           const MergedRows *rows, const float *front, int front_width, int front_height,
                           float per_front, float *merged, float *merged_values, float *numbers,
                           int64_t *merged_count) {
    size_t cells = (size_t)(rows->last_row - rows->first_row) * view->width;
    float *nearest = malloc(sizeof(float) * (cells + 1));
    int *number = malloc(sizeof(int) * (cells + 1));
    CellSum *sums = NULL;
    int64_t *value_sums = NULL;
    if (nearest && number) {
        for (size_t i = 0; i < cells; i++) nearest[i] = INFINITY;
        lower_depths(points, count, view, rows, nearest);
        int shown = number_cells(nearest, view, rows, front, front_width, front_height, per_front, number);
        sums = calloc((size_t)shown + 1, sizeof(CellSum));
        value_sums = calloc(values ? 3 * (size_t)shown + 1 : 1, sizeof(int64_t));
        if (sums && value_sums) {
            add_points(points, values, count, view, rows, nearest, number, sums, value_sums);
            write_means(sums, value_sums, shown, values != NULL, merged, merged_values, numbers);
            *merged_count = shown;
        }
    }
    int allocated = sums && value_sums;
    free(nearest); free(number); free(sums); free(value_sums);
    return allocated;
}
