/* Clip planes of discs: at creases and outlines the surface bends away from a disc's plane, and the tangent planes of
 * neighbors bound the disc there. Input: points, normals, disc radii and neighbor indices; output: up to
 * MAX_CLIP_PLANES planes per disc. After Zwicker et al., "Perspective Accurate Splatting", 2004, where discs are
 * clipped at creases. */

#include <math.h>
#include <stddef.h>

#include "surfels/disc_clipping.h"
#include "common/vec3.h"

#define MAX_COS_BETWEEN_NORMALS 0.906f /* 25 degrees: only neighbors with normals at least that far apart clip a disc */
#define MARGIN_RADII 0.035f            /* a disc reaches this far beyond a neighbor's plane, in units of its radius */
#define NEIGHBOR_DISTANCE_RADII 1.6f   /* neighbors farther away do not clip, in units of the disc's radius */

/* Distance from the center of the disc at p with normal n to the line where the plane through q with normal m cuts it;
 * INFINITY where that plane does not clip the disc: the normals are nearly parallel, or the edge is concave as seen by
 * the viewer, whom both normals face. */
INLINE float distance_to_crease(const float *p, const float *n, const float *q, const float *m, float radius) {
    float offset[3] = {q[0] - p[0], q[1] - p[1], q[2] - p[2]};
    /* height of q over the plane of p, and of p over the plane of q */
    float n_dot_m = dot(n, m), q_height = dot(offset, n), p_height = -dot(offset, m);
    float distance_sq = dot(offset, offset);
    int clips = (fabsf(n_dot_m) < MAX_COS_BETWEEN_NORMALS) & ((q_height < 0) | (p_height < 0)) &
                (fabsf(p_height) > MARGIN_RADII * radius);
    clips &= distance_sq < NEIGHBOR_DISTANCE_RADII * NEIGHBOR_DISTANCE_RADII * radius * radius;
    return clips ? fabsf(p_height) / sqrtf(1 - n_dot_m * n_dot_m) : INFINITY;
}

/* The plane through q with normal m, oriented so that p lies below it, and raised by `margin`. */
INLINE void plane_above(const float *p, const float *q, const float *m, float margin, float *plane) {
    float sign = dot(p, m) < dot(q, m) ? 1.0f : -1.0f;
    for (int a = 0; a < 3; a++) plane[a] = sign * m[a];
    plane[3] = dot(plane, q) + margin;
}

/* For the discs `begin` <= i < `end` at points (count, 3) with unit normals (count, 3) and radii (count): writes
 * planes (count, MAX_CLIP_PLANES, 4), each a unit normal n and an offset d. The disc has no surface where n . x > d.
 * They are the tangent planes of those of its neighbors (count, neighbor_count) that cut it nearest to its center,
 * nearest first; unused planes have normal 0 and offset INFINITY. */
FAST int z2p_disc_clip_planes(const float *points, const float *normals, const float *radii, const int *neighbors,
                              int begin, int end, int neighbor_count, float *planes) {
    for (int i = begin; i < end; i++) {
        const int *row = neighbors + (size_t)i * neighbor_count;
        const float *p = points + 3 * (size_t)i, *n = normals + 3 * (size_t)i;
        float distances[MAX_CLIP_PLANES];
        int clippers[MAX_CLIP_PLANES];
        for (int k = 0; k < MAX_CLIP_PLANES; k++) distances[k] = INFINITY;
        for (int j = 0; j < neighbor_count; j++) {
            const float *q = points + 3 * (size_t)row[j], *m = normals + 3 * (size_t)row[j];
            float distance = distance_to_crease(p, n, q, m, radii[i]);
            if (distance >= distances[MAX_CLIP_PLANES - 1]) continue;
            int slot = MAX_CLIP_PLANES - 1;
            for (; slot > 0 && distances[slot - 1] > distance; slot--) {
                distances[slot] = distances[slot - 1];
                clippers[slot] = clippers[slot - 1];
            }
            distances[slot] = distance;
            clippers[slot] = row[j];
        }
        for (int k = 0; k < MAX_CLIP_PLANES; k++) {
            float *plane = planes + 4 * ((size_t)i * MAX_CLIP_PLANES + k);
            plane[0] = plane[1] = plane[2] = 0;
            plane[3] = INFINITY;
            if (distances[k] == INFINITY) continue;
            plane_above(p, points + 3 * (size_t)clippers[k], normals + 3 * (size_t)clippers[k],
                        MARGIN_RADII * radii[i], plane);
        }
    }
    return 1;
}
