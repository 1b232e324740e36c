/* Extent of a point's Voronoi cell in its tangent plane: the distance to the farthest border of the cell, which is the
 * smallest disc radius that leaves no hole. Input: points, normals and neighbor indices; output: the extents and the
 * farthest border positions. */

#include <math.h>
#include <stddef.h>

#include "common/vec3.h"
#include "common/simd.h"
#include "points/neighbor_grid.h"

#define DIRECTIONS 16                /* evenly spaced directions in which the cell's border is measured */
#define OTHER_SURFACE_MIN_SINE 0.75f /* neighbors this steep over the plane belong to another surface */

/* Distance to the farthest border of the cell of point p with normal n along directions (2, DIRECTIONS), cosines and
 * sines in the tangent plane; writes that border's position to `farthest`. INFINITY where the neighbors leave the cell
 * open. A neighbor at offset q bounds the cell by r . q = |q|^2 / 2, that is 1 / r = 2 (direction . q) / |q|^2.
 * in_space = 0: 2-D cell of the neighbors projected onto the plane; 1: cross section of the 3-D cell with the plane. */
INLINE float voronoi_extent(const float *points, const float *p, const float *n, const int *neighbors,
                            int neighbor_count, int in_space, float (*directions)[DIRECTIONS], float *farthest) {
    float u[3], v[3], inverse[DIRECTIONS] = {0}, offsets[3][MAX_NEIGHBORS];
    float x[MAX_NEIGHBORS], y[MAX_NEIGHBORS];
    tangent_basis(n, u, v);
    for (int j = 0; j < neighbor_count; j++)
        for (int a = 0; a < 3; a++) offsets[a][j] = points[3 * (size_t)neighbors[j] + a] - p[a];
    for (int j = 0; j < neighbor_count; j++) {
        float offset[3] = {offsets[0][j], offsets[1][j], offsets[2][j]};
        float height = dot(offset, n), distance_sq = dot(offset, offset);
        int ignored = (distance_sq < 1e-12f) |
            (!in_space & (height * height > OTHER_SURFACE_MIN_SINE * OTHER_SURFACE_MIN_SINE * distance_sq));
        float along_u = dot(offset, u), along_v = dot(offset, v);
        float half_sq = 0.5f * (in_space ? distance_sq : along_u * along_u + along_v * along_v);
        half_sq = ignored ? INFINITY : half_sq; /* a neighbor at infinity bounds nothing */
        x[j] = along_u / half_sq;
        y[j] = along_v / half_sq;
    }
    for (int j = 0; j < neighbor_count; j++)
        for (int k = 0; k < DIRECTIONS; k++) {
            float bound = x[j] * directions[0][k] + y[j] * directions[1][k];
            inverse[k] = bound > inverse[k] ? bound : inverse[k];
        }
    int best = 0;
    for (int k = 1; k < DIRECTIONS; k++) best = inverse[k] < inverse[best] ? k : best;
    float extent = inverse[best] > 0 ? 1 / inverse[best] : INFINITY;
    float cosine = directions[0][best], sine = directions[1][best];
    for (int a = 0; a < 3; a++) farthest[a] = p[a] + extent * (cosine * u[a] + sine * v[a]);
    return extent;
}

/* For `begin` <= i < `end`: writes extents (m) and farthest (m, 3) of the Voronoi cells of the points with indices
 * query_indices (m), given the points (n, 3), their unit normals (n, 3) and the neighbor indices (m, neighbor_count) of
 * the queried points. in_space: see voronoi_extent. */
FAST int z2p_voronoi_extent(const float *points, const float *normals, const int *query_indices, const int *neighbors,
                            int begin, int end, int neighbor_count, int in_space, float *extents, float *farthest) {
    float directions[2][DIRECTIONS];
    for (int k = 0; k < DIRECTIONS; k++) {
        float angle = 2 * PI * (float)k / DIRECTIONS;
        directions[0][k] = cosf(angle);
        directions[1][k] = sinf(angle);
    }
    for (int i = begin; i < end; i++) {
        size_t at = 3 * (size_t)query_indices[i];
        extents[i] = voronoi_extent(points, points + at, normals + at, neighbors + (size_t)i * neighbor_count,
                                    neighbor_count, in_space, directions, farthest + 3 * (size_t)i);
    }
    return 1;
}
