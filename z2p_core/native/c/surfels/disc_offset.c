/* Disc centers on curved surfaces. A flat disc centered at a point of a curved surface lies entirely on one side of it;
 * moving the center along the normal makes the disc lie on the surface on average. Input: points, normals, disc radii
 * and neighbor indices; output: disc centers. */

#include <math.h>
#include <stddef.h>

#include "common/vec3.h"

#define CURVATURE_NEIGHBORS 8        /* nearest neighbors that curvature is estimated from */
#define MAX_HEIGHT_RADII 0.3f        /* neighbor heights are clamped to it: larger ones come from creases */
#define MAX_DISC_TO_NEIGHBOR_SQ 3.0f /* cap on radius^2 / mean squared neighbor distance, which scales the offset */

/* For `begin` <= i < `end`: writes centers (count, 3) of discs with radii (count) at points (count, 3) with unit
 * normals (count, 3). neighbors (count, neighbor_count) are indices, nearest first, beginning with the point itself.
 * A surface z = k r^2 / 2 has mean height k R^2 / 4 over a disc of radius R: half its height at distance R. */
FAST int z2p_offset_disc_centers(const float *points, const float *normals, const float *radii, const int *neighbors,
                                 int begin, int end, int neighbor_count, float *centers) {
    int last = neighbor_count < CURVATURE_NEIGHBORS + 1 ? neighbor_count : CURVATURE_NEIGHBORS + 1;
    for (int i = begin; i < end; i++) {
        const float *p = points + 3 * (size_t)i, *n = normals + 3 * (size_t)i;
        const int *row = neighbors + (size_t)i * neighbor_count;
        float height_sum = 0, distance_sq_sum = 0, max_height = MAX_HEIGHT_RADII * radii[i];
        for (int j = 1; j < last; j++) {
            const float *q = points + 3 * (size_t)row[j];
            float offset[3] = {q[0] - p[0], q[1] - p[1], q[2] - p[2]};
            height_sum += larger(-max_height, smaller(dot(offset, n), max_height));
            distance_sq_sum += dot(offset, offset);
        }
        float count = (float)(last > 1 ? last - 1 : 1);
        float scale = distance_sq_sum > 0
            ? smaller(radii[i] * radii[i] * count / distance_sq_sum, MAX_DISC_TO_NEIGHBOR_SQ) : 0;
        for (int a = 0; a < 3; a++) centers[3 * (size_t)i + a] = p[a] + 0.5f * scale * height_sum / count * n[a];
    }
    return 1;
}
