/* Interpolation of values on a surface, from a few of its points to others in between. */

#include <stddef.h>

#include "common/simd.h"
#include "common/vec3.h"

#define MAX_VALUES 16
#define LEAST_WEIGHT 1e-4f /* of each neighbor, so that weights never sum to 0 */

/* Writes results (end - begin, value_count <= MAX_VALUES) for the positions [begin, end): means of the values (..,
 * value_count) of neighbors (count, neighbor_count), nearest first. A neighbor weighs less the farther away it lies, to
 * nothing a little beyond the last one, and the more its normal differs from that at the position. */
FAST int z2p_interpolate_values(const float *positions, const float *normals, const int *neighbors, int begin, int end,
                                int neighbor_count, const float *points, const float *point_normals,
                                const float *values, int value_count, float *results) {
    for (int i = begin; i < end; i++) {
        const float *p = positions + 3 * (size_t)i, *n = normals + 3 * (size_t)i;
        const int *row = neighbors + (size_t)i * neighbor_count;
        float sum[MAX_VALUES] = {0}, total = 0, distance[64], farthest = 1e-12f;
        for (int j = 0; j < neighbor_count; j++) {
            const float *q = points + 3 * (size_t)row[j];
            float offset[3] = {q[0] - p[0], q[1] - p[1], q[2] - p[2]};
            distance[j] = dot(offset, offset);
            farthest = larger(farthest, distance[j]);
        }
        for (int j = 0; j < neighbor_count; j++) {
            float cosine = larger(dot(n, point_normals + 3 * (size_t)row[j]), 0);
            float nearness = 1.1f - distance[j] / farthest, weight = nearness * cosine * cosine + LEAST_WEIGHT;
            const float *value = values + (size_t)row[j] * value_count;
            total += weight;
            for (int c = 0; c < value_count; c++) sum[c] += weight * value[c];
        }
        for (int c = 0; c < value_count; c++) results[(size_t)i * value_count + c] = sum[c] / total;
    }
    return 1;
}
