/* Indirect light: from the sky and the lit floor to the points of a cloud, from the points to each other, and from the
 * points to the floor and back. Directions and who sees whom along them are known beforehand (visibility.c for points,
 * z2p_floor_visibility for the floor).
 *
 * All radiances are those of white diffuse surfaces (irradiance / pi); the caller applies albedos. Points have two
 * sides: row 0 of (2, count) is the side that the normal points to, row 1 the other. */

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "common/vec3.h"
#include "lighting/floor.h"
#include "lighting/occlusion.h"

/* The cell of the floor's grid (side, side) that a ray from a point hits, -1 outside of its square; and where, in
 * `position` (2). */
INLINE int floor_cell(const float *point, const float *ray, const FloorLight *floor, int side, float *position) {
    float distance = (floor->height - point[2]) / ray[2], scale = (float)side / (2 * floor->half_size);
    position[0] = point[0] + distance * ray[0];
    position[1] = point[1] + distance * ray[1];
    float column = (position[0] + floor->half_size) * scale, row = (position[1] + floor->half_size) * scale;
    int inside = column >= 0 && row >= 0 && column < (float)side && row < (float)side;
    return inside ? (int)row * side + (int)column : -1;
}

/* Radiance of the floor, lit by the area light and the sky, where a ray from a point hits it. */
INLINE float lit_floor_radiance(const float *point, const float *ray, const FloorLight *floor,
                                const float *light_occlusion, const float *sky_occlusion, int side) {
    float position[2];
    int cell = floor_cell(point, ray, floor, side, position);
    float light = unoccluded_light(floor, position[0], position[1]), sky = floor->sky_radiance;
    if (cell >= 0) {
        light *= 1 - light_occlusion[cell];
        sky *= 1 - sky_occlusion[cell];
    }
    return floor->albedo * (light + sky);
}

/* Direction d of 2 x axis_count: along axis d / 2 if d is even, against it if it is odd. */
INLINE void get_direction(const float *axes, int direction, float *ray) {
    for (int a = 0; a < 3; a++) ray[a] = (direction % 2 ? -1.0f : 1.0f) * axes[3 * (direction / 2) + a];
}

/* For the points [begin, end): adds to radiance (2, count) what arrives from the environment, that is the sky and the
 * floor lit by it and by the area light, along those directions in which no other point is visible. `visible` is that
 * of z2p_first_visible for the same axes; the occlusion grids (side, side) are those of z2p_floor_occlusion. */
FAST int z2p_gather_environment(const float *points, const float *normals, int count, int begin, int end,
                                const float *axes, int axis_count, const int *visible, const FloorLight *floor,
                                const float *light_occlusion, const float *sky_occlusion, int side, float *radiance) {
    float weight = 2.0f / (float)axis_count; /* 4 pi / (2 axis_count) of solid angle, over pi */
    for (int d = 0; d < 2 * axis_count; d++) {
        float ray[3];
        get_direction(axes, d, ray);
        for (int i = begin; i < end; i++) {
            if (visible[(size_t)d * count + i] >= 0) continue;
            float cosine = dot(normals + 3 * i, ray), incoming = floor->sky_radiance;
            if (ray[2] <= 0)
                incoming = lit_floor_radiance(points + 3 * i, ray, floor, light_occlusion, sky_occlusion, side);
            radiance[(cosine < 0) * (size_t)count + i] += weight * fabsf(cosine) * incoming;
        }
    }
    return 1;
}

/* For the points [begin, end): writes to indirect (2, count) what arrives from other points with this radiance
 * (2, count), directly and by way of the floor, whose cells (side, side) receive floor_irradiance from the cloud (see
 * z2p_floor_irradiance). `visible` is that of z2p_first_visible for the same axes. */
FAST int z2p_gather_indirect(const float *points, const float *normals, int count, int begin, int end,
                             const float *axes, int axis_count, const int *visible, const FloorLight *floor,
                             const float *floor_irradiance, int side, const float *radiance, float *indirect) {
    float weight = 2.0f / (float)axis_count;
    for (int i = begin; i < end; i++) indirect[i] = indirect[(size_t)count + i] = 0;
    for (int d = 0; d < 2 * axis_count; d++) {
        float ray[3], position[2];
        get_direction(axes, d, ray);
        for (int i = begin; i < end; i++) {
            int other = visible[(size_t)d * count + i];
            float cosine = dot(normals + 3 * i, ray), incoming;
            if (other >= 0) {
                incoming = radiance[(dot(normals + 3 * other, ray) > 0) * (size_t)count + other];
            } else {
                int cell = ray[2] < 0 ? floor_cell(points + 3 * i, ray, floor, side, position) : -1;
                if (cell < 0) continue;
                incoming = floor->albedo * floor_irradiance[cell];
            }
            indirect[(cosine < 0) * (size_t)count + i] += weight * fabsf(cosine) * incoming;
        }
    }
    return 1;
}

/* For the points [begin, end): writes vectors (count, 3) whose product with a unit normal near the point's own is the
 * radiance that a white point with that normal would have by the light of the sky, of the lit floor and of other points
 * with this radiance (2, count) and albedo: the sum of what arrives on the side that the normal points to, along the
 * rays. Other parameters are those of z2p_gather_environment. */
FAST int z2p_gather_vectors(const float *points, const float *normals, int count, int begin, int end, const float *axes,
                            int axis_count, const int *visible, const FloorLight *floor, const float *light_occlusion,
                            const float *sky_occlusion, int side, const float *radiance, float albedo, float *vectors) {
    float weight = 2.0f / (float)axis_count;
    memset(vectors + 3 * (size_t)begin, 0, sizeof(float) * 3 * (size_t)(end - begin));
    for (int d = 0; d < 2 * axis_count; d++) {
        float ray[3];
        get_direction(axes, d, ray);
        for (int i = begin; i < end; i++) {
            if (!(dot(normals + 3 * i, ray) > 0)) continue;
            int other = visible[(size_t)d * count + i];
            float incoming = floor->sky_radiance;
            if (other >= 0)
                incoming = albedo * radiance[(dot(normals + 3 * other, ray) > 0) * (size_t)count + other];
            else if (ray[2] <= 0)
                incoming = lit_floor_radiance(points + 3 * i, ray, floor, light_occlusion, sky_occlusion, side);
            for (int a = 0; a < 3; a++) vectors[3 * (size_t)i + a] += weight * incoming * ray[a];
        }
    }
    return 1;
}

/* As z2p_gather_indirect, of radiances (2, count, 3) and floor_irradiance (side, side, 3) in three colors, for the side
 * that normals point to alone: indirect (count, 3). */
FAST int z2p_gather_colors(const float *points, const float *normals, int count, int begin, int end, const float *axes,
                           int axis_count, const int *visible, const FloorLight *floor, const float *floor_irradiance,
                           int side, const float *radiance, float *indirect) {
    float weight = 2.0f / (float)axis_count;
    memset(indirect + 3 * (size_t)begin, 0, sizeof(float) * 3 * (size_t)(end - begin));
    for (int d = 0; d < 2 * axis_count; d++) {
        float ray[3], position[2];
        get_direction(axes, d, ray);
        for (int i = begin; i < end; i++) {
            float cosine = dot(normals + 3 * i, ray), share = weight * cosine;
            if (!(cosine > 0)) continue;
            int other = visible[(size_t)d * count + i];
            const float *incoming;
            if (other >= 0) {
                size_t seen_side = dot(normals + 3 * other, ray) > 0;
                incoming = radiance + 3 * (seen_side * (size_t)count + (size_t)other);
            } else {
                int cell = ray[2] < 0 ? floor_cell(points + 3 * i, ray, floor, side, position) : -1;
                if (cell < 0) continue;
                incoming = floor_irradiance + 3 * (size_t)cell;
                share *= floor->albedo;
            }
            for (int c = 0; c < 3; c++) indirect[3 * (size_t)i + c] += share * incoming[c];
        }
    }
    return 1;
}

/* Packs one direction's visible points: row 0 of visible (2, count) gets the cells that see a point, ended by -1 if
 * they are fewer than count; row 1 the index into (2, count) radiances of the side that they see. */
INLINE void pack_visible(const int *cells, const float *normals, int count, const float *axis, int *visible) {
    int *sides = visible + count, kept = 0;
    for (int i = 0; i < count; i++) {
        if (cells[i] < 0) continue; /* most are occluded */
        visible[kept] = cells[i];
        sides[kept++] = i + (dot(normals + 3 * (size_t)i, axis) > 0 ? count : 0);
    }
    if (kept < count) visible[kept] = -1;
}

/* Writes visible (axis_count, 2, count): which cells of the floor's grid (side, side) see which point first along each
 * upward unit axis (3), see pack_visible. */
FAST int z2p_floor_visibility(const float *points, const float *normals, int count, const float *axes, int axis_count,
                              float floor_height, float half_size, int side, int *visible) {
    float scale = (float)side / (2 * half_size);
    int *lowest = malloc(sizeof(int) * ((size_t)side * side + (size_t)count)), *cells = lowest + (size_t)side * side;
    if (!lowest) return 0;
    for (int a = 0; a < axis_count; a++) {
        const float *axis = axes + 3 * a;
        for (int i = 0; i < count; i++) {
            const float *p = points + 3 * (size_t)i;
            float distance = (p[2] - floor_height) / axis[2];
            float x = (p[0] - distance * axis[0] + half_size) * scale;
            float y = (p[1] - distance * axis[1] + half_size) * scale;
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
        pack_visible(cells, normals, count, axis, visible + 2 * (size_t)a * count);
    }
    free(lowest);
    return 1;
}

/* Writes irradiance (side, side), divided by pi, that the floor's cells receive from a cloud with this radiance
 * (2, count): the sum over directions, each with this weight. `visible` is that of z2p_floor_visibility. */
FAST int z2p_floor_irradiance(const float *radiance, int count, int axis_count, const int *visible, float weight,
                              int side, float *irradiance) {
    memset(irradiance, 0, sizeof(float) * (size_t)side * side);
    for (int a = 0; a < axis_count; a++, visible += 2 * (size_t)count)
        for (int i = 0; i < count && visible[i] >= 0; i++)
            irradiance[visible[i]] += weight * radiance[visible[count + i]];
    return 1;
}

/* As z2p_floor_irradiance, of radiances (2, count, 3) in three colors: irradiance (side, side, 3). */
FAST int z2p_floor_colors(const float *radiance, int count, int axis_count, const int *visible, float weight, int side,
                          float *irradiance) {
    memset(irradiance, 0, sizeof(float) * 3 * (size_t)side * side);
    for (int a = 0; a < axis_count; a++, visible += 2 * (size_t)count)
        for (int i = 0; i < count && visible[i] >= 0; i++)
            for (int c = 0; c < 3; c++)
                irradiance[3 * (size_t)visible[i] + c] += weight * radiance[3 * (size_t)visible[count + i] + c];
    return 1;
}
