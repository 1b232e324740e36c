/* Nearest neighbors among points that all show in one image. Points are sorted by the cell of the screen on which they
 * fall, a few in each; those that lie near each other in space do so on the screen, too, so that only a few adjacent
 * cells are searched, of which each row is contiguous. */

#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "common/lanes.h"
#include "common/screen_view.h"
#include "points/neighbor_grid.h"

#define BATCH 16             /* points whose distances are computed at a time */
#define MAX_RING 16          /* cells on each side of a query's that are searched */
#define REACH_RINGS 3.0f     /* distance of the farthest neighbor with which the search ends, in widths of these cells */
#define CANDIDATE_SHARE 1.5f /* candidates, over the neighbors wanted, with which the search ends */
#define SLOT_BITS 8          /* of a candidate's key: its place in the list, which makes keys unique */
#define MAX_CANDIDATES (1 << SLOT_BITS)
#define SPACING_NEIGHBORS 12 /* nearest points from whose distance the spacing is estimated */

INLINE int clamp_cell(float position, int count) {
    return position > 0 ? position < (float)count ? (int)position : count - 1 : 0;
}

/* Column and row of the cell on which a position falls, the nearest cell for positions beside the screen; returns the
 * width of cells at its depth. */
INLINE float find_cell(const float *p, const ScreenView *screen, int *column, int *row) {
    float x, y, scale = find_place(p, screen, &x, &y);
    *column = clamp_cell(x, screen->width);
    *row = clamp_cell(y, screen->height);
    return 1 / scale;
}

/* Writes to occupied (1) how many cells hold some of the points (count, 3). */
int z2p_screen_occupancy(const float *points, int count, const ScreenView *screen, int *occupied) {
    uint8_t *used = calloc((size_t)screen->width * screen->height, 1);
    if (!used) return 0;
    *occupied = 0;
    for (int i = 0; i < count; i++) {
        int column, row;
        find_cell(points + 3 * (size_t)i, screen, &column, &row);
        uint8_t *here = used + (size_t)row * screen->width + column;
        *occupied += !*here;
        *here = 1;
    }
    free(used);
    return 1;
}

/* Sorts points (count, 3) by cell, those of a cell in their order: writes the sorted points as rows (count, 3) and as
 * columns (3, count + BATCH), where each was before, order (count), and where each cell starts, start (cells + 1). */
int z2p_screen_sort(const float *points, int count, const ScreenView *screen, float *sorted, float *columns,
                    int *order, int *start) {
    int cells = screen->width * screen->height, *cell = malloc(sizeof(int) * ((size_t)count + 1));
    int *fill_at = malloc(sizeof(int) * ((size_t)cells + 1));
    size_t room = (size_t)count + BATCH;
    int allocated = cell && fill_at;
    if (allocated) {
        memset(start, 0, sizeof(int) * ((size_t)cells + 1));
        memset(columns, 0, sizeof(float) * 3 * room);
        for (int i = 0; i < count; i++) {
            int column, row;
            find_cell(points + 3 * (size_t)i, screen, &column, &row);
            cell[i] = row * screen->width + column;
            start[cell[i] + 1]++;
        }
        for (int c = 0; c < cells; c++) {
            start[c + 1] += start[c];
            fill_at[c] = start[c];
        }
        for (int i = 0; i < count; i++) {
            int at = fill_at[cell[i]]++;
            order[at] = i;
            for (int a = 0; a < 3; a++) columns[a * room + at] = sorted[3 * (size_t)at + a] = points[3 * (size_t)i + a];
        }
    }
    free(cell);
    free(fill_at);
    return allocated;
}

/* Points that may be among the nearest. A key's upper bits are those of the squared distance, the lower ones the slot. */
typedef struct {
    int count;
    int32_t worst; /* the key below which a further one has to be */
    int32_t key[MAX_CANDIDATES + BATCH];
    int row[MAX_CANDIDATES + BATCH];
} Candidates;

/* Keeps the nearest `most` candidates, nearest first, of equally far ones those that came first. */
INLINE void keep_nearest(Candidates *candidates, int most) {
    int count = candidates->count, rank[MAX_CANDIDATES + BATCH], row[MAX_CANDIDATES + BATCH];
    int32_t key[MAX_CANDIDATES + BATCH];
    for (int i = 0; i < BATCH; i++) candidates->key[count + i] = INT32_MAX;
    for (int first = 0; first < count; first += BATCH) {
        Masks own[BATCH / LANES], nearer[BATCH / LANES] = {{0}};
        memcpy(own, candidates->key + first, sizeof own);
        for (int j = 0; j < count; j++)
            for (int part = 0; part < BATCH / LANES; part++)
                nearer[part] -= candidates->key[j] < own[part]; /* where it is, -1 */
        memcpy(rank + first, nearer, sizeof nearer);
    }
    for (int i = 0; i < count; i++) {
        key[rank[i]] = candidates->key[i];
        row[rank[i]] = candidates->row[i];
    }
    candidates->count = count < most ? count : most;
    for (int i = 0; i < candidates->count; i++) {
        candidates->key[i] = (key[i] & -MAX_CANDIDATES) | i;
        candidates->row[i] = row[i];
    }
    if (candidates->count == most) candidates->worst = key[most - 1] & -MAX_CANDIDATES;
}

/* Squared distance of a candidate. */
INLINE float squared_distance(const Candidates *candidates, int at) {
    int32_t bits = candidates->key[at] & -MAX_CANDIDATES;
    float square;
    memcpy(&square, &bits, sizeof square);
    return square;
}

/* Adds the sorted points [first, last), given as columns (3, room). */
INLINE void add_candidates(Candidates *candidates, const float *columns, size_t room, int first, int last,
                           const float *p, int most) {
    for (; first < last; first += BATCH) {
        if (candidates->count + BATCH > MAX_CANDIDATES) keep_nearest(candidates, most);
        const float *x = columns + first, *y = x + room, *z = y + room;
        int at = candidates->count, size = last - first < BATCH ? last - first : BATCH, near = 0;
        for (int i = 0; i < BATCH; i++) {
            float dx = x[i] - p[0], dy = y[i] - p[1], dz = z[i] - p[2], square = dx * dx + dy * dy + dz * dz;
            int32_t bits;
            memcpy(&bits, &square, sizeof bits);
            candidates->key[at + i] = (bits & -MAX_CANDIDATES) | (at + i);
            candidates->row[at + i] = first + i;
        }
        if (candidates->worst < INT32_MAX) {
            for (int i = 0; i < size; i++) {
                int32_t bits = candidates->key[at + i] & -MAX_CANDIDATES;
                candidates->key[at + near] = bits | (at + near);
                candidates->row[at + near] = first + i;
                near += bits < candidates->worst;
            }
            size = near;
        }
        candidates->count += size;
    }
}

/* Collects the points near position p: those of the cells around its own, in rings as far out as are needed. */
INLINE void search_screen(const float *columns, size_t room, const int *start, const ScreenView *screen,
                          const float *p, int most, Candidates *candidates) {
    int column, row, farthest = screen->width > screen->height ? screen->width : screen->height;
    float cell = find_cell(p, screen, &column, &row);
    for (int ring = 1; ring <= MAX_RING || (!candidates->count && ring <= 2 * farthest); ring *= 2) {
        int left = column > ring ? column - ring : 0, top = row > ring ? row - ring : 0;
        int right = column + ring < screen->width ? column + ring : screen->width - 1;
        int bottom = row + ring < screen->height ? row + ring : screen->height - 1;
        candidates->count = 0;
        candidates->worst = INT32_MAX;
        for (int y = top; y <= bottom; y++) {
            const int *here = start + (size_t)y * screen->width;
            add_candidates(candidates, columns, room, here[left], here[right + 1], p, most);
        }
        int is_enough = (float)candidates->count >= CANDIDATE_SHARE * (float)most || candidates->worst < INT32_MAX;
        keep_nearest(candidates, most);
        float reach = REACH_RINGS * cell * (float)ring;
        if (is_enough && squared_distance(candidates, most - 1) <= reach * reach) break;
    }
}

/* For the positions [begin, end): neighbors (count, most), rows of the nearest of the points that `z2p_screen_sort`
 * sorted into columns (3, count + BATCH), nearest first, the last one repeated if there are fewer; and spacing (count),
 * the side of the square patch of surface that is a point's share, from the density of the nearest points. */
FAST int z2p_screen_neighbors(const float *columns, int count, const int *start, const ScreenView *screen,
                              const float *positions, int begin, int end, int most, int *neighbors, float *spacing) {
    for (int i = begin; i < end; i++) {
        Candidates candidates;
        candidates.count = 0;
        search_screen(columns, (size_t)count + BATCH, start, screen, positions + 3 * (size_t)i, most, &candidates);
        int found = candidates.count, used = found < SPACING_NEIGHBORS ? found : SPACING_NEIGHBORS;
        spacing[i] = used > 1 ? sqrtf(PI * squared_distance(&candidates, used - 1) / (float)used) : 0;
        int *out = neighbors + (size_t)i * most;
        for (int j = 0; j < most; j++) out[j] = candidates.row[j < found ? j : found - 1];
    }
    return 1;
}
