/* Light that comes to the points of a cloud by way of the sky, of the lit floor and of each other; and from them to the
 * floor. */

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "common/simd.h"
#include "lighting/floor.h"
#include "lighting/occlusion.h"

/* The cell of a grid (side, side) of the floor that a ray from a point meets, -1 where it is none of the square's. */
INLINE int cell_below(const float *point, const float *ray, const Floor *floor, int side, float *place) {
    float reach = (floor->height - point[2]) / ray[2], scale = (float)side / (2 * floor->half);
    place[0] = point[0] + reach * ray[0];
    place[1] = point[1] + reach * ray[1];
    float column = (place[0] + floor->half) * scale, row = (place[1] + floor->half) * scale;
    int inside = column >= 0 && row >= 0 && column < (float)side && row < (float)side;
    return inside ? (int)row * side + (int)column : -1;
}

/* Radiance of the floor, lit by lamp and sky, where a ray from a point meets it. */
INLINE float lit_floor(const float *point, const float *ray, const Floor *floor, const float *lamp_shade,
                       const float *sky_shade, int side) {
    float place[2];
    int cell = cell_below(point, ray, floor, side, place);
    float lamp = lamp_on_floor(floor, place[0], place[1]), sky = floor->sky;
    if (cell >= 0) {
        lamp *= 1 - lamp_shade[cell];
        sky *= 1 - sky_shade[cell];
    }
    return floor->albedo * (lamp + sky);
}

INLINE void ray_of(const float *axes, int direction, float *ray) {
    for (int a = 0; a < 3; a++) ray[a] = (direction % 2 ? -1.0f : 1.0f) * axes[3 * (direction / 2) + a];
}

/* light (2, count): adds, for the points from `begin` to `end`, what comes from the sky and from the floor that lamp
 * and sky light, to the side that the normal points to and to the other one. `hit` is that of z2p_first_hits. All is
 * radiance of a white diffuse surface. */
FAST int z2p_gather_open(const float *points, const float *normals, int count, int begin, int end, const float *axes,
                         int axis_count, const int *hit, const Floor *floor, const float *lamp_shade,
                         const float *sky_shade, int side, float *light) {
    float share = 2.0f / (float)axis_count; /* 4 pi of the sphere, over pi, over twice as many directions */
    for (int d = 0; d < 2 * axis_count; d++) {
        float ray[3];
        ray_of(axes, d, ray);
        for (int i = begin; i < end; i++) {
            if (hit[(size_t)d * count + i] >= 0) continue;
            float facing = dot(normals + 3 * i, ray), found = floor->sky;
            if (ray[2] <= 0) found = lit_floor(points + 3 * i, ray, floor, lamp_shade, sky_shade, side);
            light[(facing < 0) * (size_t)count + i] += share * fabsf(facing) * found;
        }
    }
    return 1;
}

/* bounced (2, count): for the points from `begin` to `end`, what comes from the other points and, by way of the floor,
 * whose cells (side, side) glow as z2p_floor_glow says, once more from them all, if each point sends back `light`
 * (2, count). */
FAST int z2p_gather_bounced(const float *points, const float *normals, int count, int begin, int end,
                            const float *axes, int axis_count, const int *hit, const Floor *floor, const float *glow,
                            int side, const float *light, float *bounced) {
    float share = 2.0f / (float)axis_count;
    for (int i = begin; i < end; i++) bounced[i] = bounced[(size_t)count + i] = 0;
    for (int d = 0; d < 2 * axis_count; d++) {
        float ray[3], place[2];
        ray_of(axes, d, ray);
        for (int i = begin; i < end; i++) {
            int other = hit[(size_t)d * count + i];
            float facing = dot(normals + 3 * i, ray), found;
            if (other >= 0) {
                found = light[(dot(normals + 3 * other, ray) > 0) * (size_t)count + other];
            } else {
                int cell = ray[2] < 0 ? cell_below(points + 3 * i, ray, floor, side, place) : -1;
                if (cell < 0) continue;
                found = floor->albedo * glow[cell];
            }
            bounced[(facing < 0) * (size_t)count + i] += share * fabsf(facing) * found;
        }
    }
    return 1;
}

/* Keeps the points that some cell of the floor sees along an axis, in their order: seen (2, count) gets their cells, ended
 * by -1 where they are fewer than all, and the places in (2, count) of the light of the side that is seen. */
INLINE void keep_seen(const int *cells, const float *normals, int count, const float *axis, int *seen) {
    int *places = seen + count, found = 0;
    for (int i = 0; i < count; i++) {
        if (cells[i] < 0) continue; /* most are hidden */
        seen[found] = cells[i];
        places[found++] = i + (dot(normals + 3 * (size_t)i, axis) > 0 ? count : 0);
    }
    if (found < count) seen[found] = -1;
}

/* seen (axis_count, 2, count): for each of the directions of the sky (3) the cells of the floor's square (side, side) that
 * see a point first, and which light they see of it; see keep_seen. */
FAST int z2p_floor_hits(const float *points, const float *normals, int count, const float *axes, int axis_count,
                        float floor, float half, int side, int *seen) {
    float scale = (float)side / (2 * half);
    int *lowest = malloc(sizeof(int) * ((size_t)side * side + (size_t)count)), *cells = lowest + (size_t)side * side;
    if (!lowest) return 0;
    for (int a = 0; a < axis_count; a++) {
        const float *axis = axes + 3 * a;
        for (int i = 0; i < count; i++) {
            const float *p = points + 3 * (size_t)i;
            float reach = (p[2] - floor) / axis[2];
            float x = (p[0] - reach * axis[0] + half) * scale, y = (p[1] - reach * axis[1] + half) * scale;
            int inside = (x >= 0) & (y >= 0) & (x < (float)side) & (y < (float)side);
            cells[i] = inside ? (int)y * side + (int)x : -1;
        }
        memset(lowest, -1, sizeof(int) * (size_t)side * side);
        for (int i = 0; i < count; i++) {
            if (cells[i] < 0) continue;
            int *here = lowest + cells[i];
            if (*here >= 0 && points[3 * (size_t)i + 2] >= points[3 * (size_t)*here + 2]) {
                cells[i] = -1;
                continue;
            }
            if (*here >= 0) cells[*here] = -1;
            *here = i;
        }
        keep_seen(cells, normals, count, axis, seen + 2 * (size_t)a * count);
    }
    free(lowest);
    return 1;
}

/* glow (side, side): what the cells of the floor's square see of a white cloud's radiance, summed over directions of
 * the sky, each of which weighs as much as `share`. `seen` is that of z2p_floor_hits, and `light` (2, count) the cloud's
 * radiance on both sides. */
FAST int z2p_floor_glow(const float *light, int count, int axis_count, const int *seen, float share, int side,
                        float *glow) {
    memset(glow, 0, sizeof(float) * (size_t)side * side);
    for (int a = 0; a < axis_count; a++, seen += 2 * (size_t)count)
        for (int i = 0; i < count && seen[i] >= 0; i++) glow[seen[i]] += share * light[seen[count + i]];
    return 1;
}
