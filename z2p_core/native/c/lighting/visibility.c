/* What the points of a cloud see all around them: each other, or the open. */

#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "common/simd.h"
#include "lighting/occlusion.h"

#define BUCKETS 1024

typedef struct {
    float *height, *heights; /* along the axis, of each point and in their order */
    int *cell, *cells;       /* of a map across it, likewise */
    int *order;              /* of the points by height */
    int *map;                /* in each cell the point met last, -1 for none */
    int32_t *ends;           /* in each cell the place in the order, seen from the far end, of the point there */
    int32_t *room;           /* for another such map */
    int side;
} Sweep;

/* Height along the axis and cell across it of each point. */
INLINE void place_across(const float *restrict points, int count, const float *axis, float radius, float step,
                         Sweep *sweep) {
    float flat = sqrtf(axis[0] * axis[0] + axis[1] * axis[1]);
    float r[3] = {flat > 1e-6f ? -axis[1] / flat : 1, flat > 1e-6f ? axis[0] / flat : 0, 0};
    float u[3] = {r[1] * axis[2], -r[0] * axis[2], r[0] * axis[1] - r[1] * axis[0]};
    float inverse = 1 / step, *restrict height = sweep->height;
    int most = sweep->side - 1 - MARGIN, side = sweep->side, *restrict cell = sweep->cell;
    for (int i = 0; i < count; i++) {
        const float *p = points + 3 * i;
        height[i] = p[0] * axis[0] + p[1] * axis[1] + p[2] * axis[2];
        int column = (int)((p[0] * r[0] + p[1] * r[1] + radius) * inverse) + MARGIN;
        int row = (int)((p[0] * u[0] + p[1] * u[1] + p[2] * u[2] + radius) * inverse) + MARGIN;
        column = column < MARGIN ? MARGIN : column > most ? most : column;
        row = row < MARGIN ? MARGIN : row > most ? most : row;
        cell[i] = row * side + column;
    }
}

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
            sweep->heights[at] = sweep->height[i];
            sweep->cells[at] = sweep->cell[i];
        }
        for (int b = 0; !pass && b < BUCKETS; b++) starts[b + 1] += starts[b];
    }
}

/* Where in the order stands what comes at a place, seen from the end that the axis (sign 1) points to, or from
 * the other. */
INLINE int seen_from(int count, float sign, int place) { return sign > 0 ? count - 1 - place : place; }

/* Which points lie at the far end along the axis (sign 1) or against it (-1), with the holes between them closed. */
INLINE void find_ends(int count, float sign, Sweep *sweep) {
    for (int c = 0; c < sweep->side * sweep->side; c++) sweep->ends[c] = NOTHING;
    for (int place = count - 1; place >= 0; place--) sweep->ends[sweep->cells[seen_from(count, sign, place)]] = place;
    close_holes(sweep->ends, sweep->side, 0, sweep->room);
}

/* What comes first on each point's way. Points are met from the far end on; those that a point could see have been put
 * into the map by then, with the cells around theirs, the nearest one last. */
INLINE void see(int count, float sign, float clear, Sweep *sweep, int *hit) {
    const float *heights = sweep->heights;
    const int *cells = sweep->cells, *order = sweep->order;
    /* the places of seen_from, without a choice for each */
    int next = 0, side = sweep->side, *map = sweep->map, last = sign > 0 ? count - 1 : 0, step = sign > 0 ? -1 : 1;
    memset(map, -1, sizeof(int) * (size_t)side * side);
    for (int place = 0; place < count; place++) {
        int at = last + step * place;
        float end = sign * heights[at] + clear;
        for (; next < count; next++) {
            int other = last + step * next;
            if (sign * heights[other] < end) break;
            for (int y = -1; y < 2; y++) {
                int *cell = map + cells[other] + y * side;
                cell[-1] = cell[0] = cell[1] = order[other];
            }
        }
        hit[order[at]] = map[cells[at]];
    }
}

/* A way is free where the far end is near, or of the point's own surface. Where it is not, but what seems to come first
 * is of that surface, or slipped through a hole, it is the far end that comes first. */
INLINE void settle(const float *points, const float *normals, int count, const float *axis, float sign, float clear,
                   const Sweep *sweep, int *hit) {
    float way[3] = {sign * axis[0], sign * axis[1], sign * axis[2]};
    for (int i = 0; i < count; i++) {
        int32_t end = sweep->ends[sweep->cell[i]];
        int at = seen_from(count, sign, end == NOTHING ? 0 : end), other = sweep->order[at];
        if (end == NOTHING || sign * (sweep->heights[at] - sweep->height[i]) < clear ||
            own_surface(points, normals, i, other, way))
            hit[i] = -1;
        else if (hit[i] < 0 || own_surface(points, normals, i, hit[i], way))
            hit[i] = other;
    }
}

/* hit (2 x axis_count, count): the point that each point of a cloud sees first along each axis (3) and, in the next
 * row, against it; -1 where the view is free. `spacing` is that of the cloud, `radius` bounds it. */
FAST int z2p_first_hits(const float *points, const float *normals, int count, const float *axes, int axis_count,
                        float spacing, float radius, int *hit) {
    Sweep sweep;
    float step = spacing / FINE;
    sweep.side = (int)smaller(2 * radius / step + 1 + 2 * MARGIN, LARGEST_MAP);
    step = 2 * radius / (float)(sweep.side - 2 * MARGIN);
    size_t cells = (size_t)sweep.side * sweep.side;
    sweep.height = malloc(sizeof(float) * 2 * ((size_t)count + 1));
    sweep.heights = sweep.height + count;
    sweep.cell = malloc(sizeof(int) * 3 * ((size_t)count + 1));
    sweep.cells = sweep.cell + count;
    sweep.order = sweep.cells + count;
    sweep.map = malloc(sizeof(int) * cells);
    sweep.ends = malloc(sizeof(int32_t) * 2 * cells);
    sweep.room = sweep.ends + cells;
    int fine = sweep.height && sweep.cell && sweep.map && sweep.ends;
    for (int a = 0; fine && a < axis_count; a++) {
        place_across(points, count, axes + 3 * a, radius, step, &sweep);
        sort_by_height(count, radius, &sweep);
        for (int back = 0; back < 2; back++) {
            float sign = back ? -1.0f : 1.0f;
            int *found = hit + (size_t)(2 * a + back) * count;
            find_ends(count, sign, &sweep);
            see(count, sign, CLEAR * spacing, &sweep, found);
            settle(points, normals, count, axes + 3 * a, sign, CLEAR * spacing, &sweep, found);
        }
    }
    free(sweep.height); free(sweep.cell); free(sweep.map); free(sweep.ends);
    return fine;
}
