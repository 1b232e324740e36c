/* Light that comes by way of other surfaces: what the points of a cloud see all around them, and the light from
 * there. */

#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "fast.h"
#include "floor.h"

#define LARGEST_MAP 512
#define BUCKETS 1024
#define CLOSEST 2.4f /* spacings: what is nearer along a direction may be a point's own surface */
#define STEEPEST 3.0f

typedef struct {
    float *height; /* along the axis */
    float *slack;  /* what lies nearer along the axis may be the point's own surface */
    int *cell;     /* of a map across it */
    int *order;    /* of the points by height */
    int *map;      /* in each cell the point met last, -1 for none */
    int *floor;    /* the same once all have been met downwards: the lowest points */
    int side;
} Sweep;

static float dot(const float *a, const float *b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

/* Height along the axis, slack and cell across it of each point. */
static inline void place_across(const float *restrict points, const float *restrict normals, int count,
                                const float *axis, float spacing, float radius, float step, Sweep *sweep) {
    float flat = sqrtf(axis[0] * axis[0] + axis[1] * axis[1]);
    float r[3] = {flat > 1e-6f ? -axis[1] / flat : 1, flat > 1e-6f ? axis[0] / flat : 0, 0};
    float u[3] = {r[1] * axis[2], -r[0] * axis[2], r[0] * axis[1] - r[1] * axis[0]};
    float inverse = 1 / step, *restrict height = sweep->height, *restrict slack = sweep->slack;
    int most = sweep->side - 2, side = sweep->side, *restrict cell = sweep->cell;
    for (int i = 0; i < count; i++) {
        const float *p = points + 3 * i, *n = normals + 3 * i;
        float facing = fabsf(n[0] * axis[0] + n[1] * axis[1] + n[2] * axis[2]), sine = 1 - facing * facing;
        float slope = sqrtf(sine > 0 ? sine : 0) / (facing > 0.05f ? facing : 0.05f);
        slack[i] = spacing * (1 + 1.4f * (slope < STEEPEST ? slope : STEEPEST));
        height[i] = p[0] * axis[0] + p[1] * axis[1] + p[2] * axis[2];
        int column = (int)((p[0] * r[0] + p[1] * r[1] + radius) * inverse) + 2;
        int row = (int)((p[0] * u[0] + p[1] * u[1] + p[2] * u[2] + radius) * inverse) + 2;
        column = column < 1 ? 1 : column > most ? most : column;
        row = row < 1 ? 1 : row > most ? most : row;
        cell[i] = row * side + column;
    }
}

static void sort_by_height(int count, float radius, Sweep *sweep) {
    int starts[BUCKETS + 1] = {0};
    float scale = (float)BUCKETS / (2 * radius);
    for (int pass = 0; pass < 2; pass++) {
        for (int i = 0; i < count; i++) {
            int bucket = (int)((sweep->height[i] + radius) * scale);
            bucket = bucket < 0 ? 0 : bucket >= BUCKETS ? BUCKETS - 1 : bucket;
            if (pass) sweep->order[starts[bucket]++] = i;
            else starts[bucket + 1]++;
        }
        for (int b = 0; !pass && b < BUCKETS; b++) starts[b + 1] += starts[b];
    }
}

static inline void insert(Sweep *sweep, int point) {
    for (int y = -1; y < 2; y++) {
        int *cell = sweep->map + sweep->cell[point] + y * sweep->side;
        cell[-1] = cell[0] = cell[1] = point;
    }
}

/* What each point sees along the axis (sign 1) or against it (-1). Points are met from the far end on; those that a
 * point could see have been put into the map by then, the nearest one last. In the end the map holds the others'
 * ends. */
static void see(int count, float sign, float closest, Sweep *sweep, int *hit) {
    int next = 0;
    memset(sweep->map, -1, sizeof(int) * (size_t)sweep->side * sweep->side);
    for (int k = 0; k < count; k++) {
        int i = sweep->order[sign > 0 ? count - 1 - k : k];
        for (; next < count; next++) {
            int other = sweep->order[sign > 0 ? count - 1 - next : next];
            if (sign * (sweep->height[other] - sweep->height[i]) < closest) break;
            insert(sweep, other);
        }
        hit[i] = sweep->map[sweep->cell[i]];
    }
    for (; next < count; next++) insert(sweep, sweep->order[sign > 0 ? count - 1 - next : next]);
}

/* Where the nearest one may be of the point's own surface, takes the farthest one, and no one if that may be too. */
static void settle(int count, float sign, const Sweep *sweep, const int *farthest, int *hit) {
    for (int i = 0; i < count; i++) {
        if (hit[i] < 0 || sign * (sweep->height[hit[i]] - sweep->height[i]) >= sweep->slack[i]) continue;
        int other = farthest[sweep->cell[i]];
        hit[i] = sign * (sweep->height[other] - sweep->height[i]) < sweep->slack[i] ? -1 : other;
    }
}

/* hit (2 x axis_count, count): the point that each point of a cloud sees first along each axis (3) and, in the next
 * row, against it; -1 where the view is free. `spacing` is that of the cloud, `radius` bounds it. */
FAST int z2p_first_hits(const float *points, const float *normals, int count, const float *axes, int axis_count,
                        float spacing, float radius, int *hit) {
    Sweep sweep;
    float step = spacing / 1.5f;
    sweep.side = (int)fminf(2 * radius / step + 5, LARGEST_MAP);
    step = 2 * radius / (float)(sweep.side - 4);
    size_t cells = (size_t)sweep.side * sweep.side;
    sweep.height = malloc(sizeof(float) * 2 * ((size_t)count + 1));
    sweep.slack = sweep.height + count;
    sweep.cell = malloc(sizeof(int) * 2 * ((size_t)count + 1));
    sweep.order = sweep.cell + count;
    sweep.map = malloc(sizeof(int) * 2 * cells);
    sweep.floor = sweep.map + cells;
    int fine = sweep.height && sweep.cell && sweep.map;
    for (int a = 0; fine && a < axis_count; a++) {
        int *along = hit + (size_t)(2 * a) * count, *against = along + count;
        place_across(points, normals, count, axes + 3 * a, spacing, radius, step, &sweep);
        sort_by_height(count, radius, &sweep);
        see(count, 1, CLOSEST * spacing, &sweep, along);
        memcpy(sweep.floor, sweep.map, sizeof(int) * cells);
        see(count, -1, CLOSEST * spacing, &sweep, against);
        settle(count, 1, &sweep, sweep.map, along);
        settle(count, -1, &sweep, sweep.floor, against);
    }
    free(sweep.height); free(sweep.cell); free(sweep.map);
    return fine;
}

/* Radiance of the floor where a ray from a point meets it. */
static inline float floor_radiance(const float *point, const float *ray, const Floor *floor, const float *lamp_shade,
                                   const float *sky_shade, int side) {
    float reach = (floor->height - point[2]) / ray[2], x = point[0] + reach * ray[0], y = point[1] + reach * ray[1];
    float scale = (float)side / (2 * floor->half), column = (x + floor->half) * scale, row = (y + floor->half) * scale;
    float hidden_lamp = 0, hidden_sky = 0;
    if (column >= 0 && row >= 0 && column < (float)side && row < (float)side) {
        size_t at = (size_t)(int)row * side + (int)column;
        hidden_lamp = lamp_shade[at];
        hidden_sky = sky_shade[at];
    }
    return floor->albedo * (lamp_on_floor(floor, x, y) * (1 - hidden_lamp) + floor->sky * (1 - hidden_sky));
}

/* first (2, count), which holds what comes straight from lamps: adds what comes from the sky and from the lit floor, to
 * the side that the normal points to and to the other one. second (count): what comes to the first of these sides from
 * the other points, if those send back all that they get. `hit` is that of z2p_first_hits. All are radiances of a white
 * diffuse surface. */
FAST int z2p_gather(const float *points, const float *normals, int count, const float *axes, int axis_count,
                    const int *hit, const Floor *floor, const float *lamp_shade, const float *sky_shade, int side,
                    float *first, float *second) {
    float share = 2.0f / (float)axis_count; /* 4 pi of the sphere, over pi, over twice as many directions */
    for (int d = 0; d < 2 * axis_count; d++) {
        float sign = d % 2 ? -1.0f : 1.0f, ray[3];
        for (int a = 0; a < 3; a++) ray[a] = sign * axes[3 * (d / 2) + a];
        for (int i = 0; i < count; i++) {
            if (hit[(size_t)d * count + i] >= 0) continue;
            float facing = dot(normals + 3 * i, ray);
            float light = floor->sky;
            if (ray[2] <= 0) light = floor_radiance(points + 3 * i, ray, floor, lamp_shade, sky_shade, side);
            first[(facing < 0) * (size_t)count + i] += share * fabsf(facing) * light;
        }
    }
    for (int i = 0; i < count; i++) second[i] = 0;
    for (int d = 0; d < 2 * axis_count; d++) {
        float sign = d % 2 ? -1.0f : 1.0f, ray[3];
        for (int a = 0; a < 3; a++) ray[a] = sign * axes[3 * (d / 2) + a];
        for (int i = 0; i < count; i++) {
            int other = hit[(size_t)d * count + i];
            float facing = dot(normals + 3 * i, ray);
            if (other < 0 || facing <= 0) continue;
            second[i] += share * facing * first[(dot(normals + 3 * other, ray) > 0) * (size_t)count + other];
        }
    }
    return 1;
}

/* glow (side, side): what the cells of the floor's square see of a white cloud's radiance, summed over directions of
 * the sky (3) with their weights. `light` (2, count) is the `first` of z2p_gather. */
FAST int z2p_floor_glow(const float *points, const float *normals, const float *light, int count, const float *axes,
                        const float *weights, int axis_count, float floor, float half, int side, float *glow) {
    size_t cells = (size_t)side * side;
    float *low = malloc(sizeof(float) * 2 * cells), *found = low + cells, scale = (float)side / (2 * half);
    if (!low) return 0;
    memset(glow, 0, sizeof(float) * cells);
    for (int a = 0; a < axis_count; a++) {
        const float *axis = axes + 3 * a;
        for (size_t c = 0; c < cells; c++) low[c] = INFINITY, found[c] = 0;
        for (int i = 0; i < count; i++) {
            const float *p = points + 3 * i;
            float reach = (p[2] - floor) / axis[2];
            float x = (p[0] - reach * axis[0] + half) * scale, y = (p[1] - reach * axis[1] + half) * scale;
            if (!(x >= 0 && y >= 0 && x < (float)side && y < (float)side)) continue;
            size_t cell = (size_t)(int)y * side + (int)x;
            if (p[2] >= low[cell]) continue;
            low[cell] = p[2];
            found[cell] = light[(dot(normals + 3 * i, axis) > 0) * (size_t)count + i];
        }
        for (size_t c = 0; c < cells; c++) glow[c] += weights[a] * found[c];
    }
    free(low);
    return 1;
}
