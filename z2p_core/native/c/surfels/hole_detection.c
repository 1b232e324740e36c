/* Detection of small holes in a sampled surface: for candidate positions (borders of Voronoi cells) it decides whether
 * they are the middle of a hole that the surface surrounds, and with which disc to close it. Input: points, normals,
 * candidates with their neighbor indices; output: disc positions, normals and radii. */

#include <math.h>
#include <stddef.h>

#include "common/vec3.h"
#include "common/simd.h"
#include "points/neighbor_grid.h"

#define EMPTY_EXTENTS 0.7f           /* no point lies this close to a hole's middle, in units of its extent */
#define RIM_EXTENTS 1.5f             /* points up to this distance form the hole's rim, in units of its extent */
#define SURFACE_MAX_SINE 0.4f        /* points up to this steep over the plane are part of the same surface */
#define MAX_RIM_GAP 1.3f             /* widest angle without a rim point that still counts as surrounded, in radians */
#define MIN_COS_BETWEEN_NORMALS 0.5f /* of two points of the same surface */
#define FIT_NEIGHBORS 8              /* nearest points that the surface is fitted to */
#define RADIUS_PER_EXTENT 1.1f       /* radius of the closing disc, in units of the hole's extent */

/* Fits the surface around a position to its nearest points whose normals are close to n (up to sign). Replaces n by the
 * mean unit normal; returns the mean height of these points over the position along it. */
INLINE float fit_surface(const float *points, const float *normals, const float *position, const int *neighbors,
                         float *n) {
    float normal_sum[3] = {1e-3f * n[0], 1e-3f * n[1], 1e-3f * n[2]}, offset_sum[3] = {0}, height = 0;
    int count = 0;
    for (int j = 0; j < FIT_NEIGHBORS; j++) {
        const float *normal = normals + 3 * (size_t)neighbors[j], *point = points + 3 * (size_t)neighbors[j];
        float cosine = dot(normal, n);
        if (fabsf(cosine) <= MIN_COS_BETWEEN_NORMALS) continue;
        for (int a = 0; a < 3; a++) normal_sum[a] += cosine > 0 ? normal[a] : -normal[a];
        for (int a = 0; a < 3; a++) offset_sum[a] += point[a] - position[a];
        count++;
    }
    float length = sqrtf(dot(normal_sum, normal_sum));
    for (int a = 0; a < 3; a++) n[a] = normal_sum[a] / length;
    for (int a = 0; a < 3 && count; a++) height += offset_sum[a] * n[a] / (float)count;
    return height;
}

/* The widest angle (radians) around a position, in the plane with normal n, without a point of the same surface within
 * max_distance; INFINITY if there is no such point at all. */
INLINE float widest_rim_gap(const float *points, const float *position, const int *neighbors, int neighbor_count,
                            const float *n, float max_distance) {
    float u[3], v[3], angles[MAX_NEIGHBORS], widest = 0;
    int count = 0;
    tangent_basis(n, u, v);
    for (int j = 0; j < neighbor_count; j++) {
        const float *point = points + 3 * (size_t)neighbors[j];
        float offset[3] = {point[0] - position[0], point[1] - position[1], point[2] - position[2]};
        float distance_sq = dot(offset, offset), height = dot(offset, n);
        if (distance_sq > max_distance * max_distance) continue;
        if (height * height > SURFACE_MAX_SINE * SURFACE_MAX_SINE * distance_sq) continue;
        float angle = atan2f(dot(offset, v), dot(offset, u));
        int slot = count++;
        for (; slot && angles[slot - 1] > angle; slot--) angles[slot] = angles[slot - 1];
        angles[slot] = angle;
    }
    if (!count) return INFINITY;
    for (int j = 1; j < count; j++) widest = larger(widest, angles[j] - angles[j - 1]);
    return larger(widest, angles[0] + 2 * PI - angles[count - 1]);
}

/* Writes radii (count) of the discs that close holes of the surface of points (n, 3) with unit normals (n, 3) at
 * positions (count, 3) with extents (count); 0 where there is no hole. disc_normals (count, 3) hold the normal of a rim
 * point on entry and the fitted surface's normal on return; positions are moved halfway to the fitted surface.
 * neighbors (count, neighbor_count) are indices of the points nearest to each position, nearest first. */
FAST int z2p_find_hole_discs(const float *points, const float *normals, const int *neighbors, int count,
                             int neighbor_count, const float *extents, float *positions, float *disc_normals,
                             float *radii) {
    for (int i = 0; i < count; i++) {
        const int *row = neighbors + (size_t)i * neighbor_count;
        float *position = positions + 3 * (size_t)i, *n = disc_normals + 3 * (size_t)i, extent = extents[i], offset[3];
        for (int a = 0; a < 3; a++) offset[a] = points[3 * (size_t)row[0] + a] - position[a];
        radii[i] = 0;
        if (dot(offset, offset) < EMPTY_EXTENTS * EMPTY_EXTENTS * extent * extent) continue;
        float height = fit_surface(points, normals, position, row, n);
        for (int a = 0; a < 3; a++) position[a] += 0.5f * height * n[a];
        float gap = widest_rim_gap(points, position, row, neighbor_count, n, RIM_EXTENTS * extent);
        if (gap < MAX_RIM_GAP) radii[i] = RADIUS_PER_EXTENT * extent;
    }
    return 1;
}
