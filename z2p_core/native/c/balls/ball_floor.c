/* What balls hide from a grid on the floor, and the light that they send there. Input: balls and light samples;
 * output: grids. Each sample's shadow is drawn ball by ball: a cell is in it if the line from the cell's center to the
 * sample passes through a ball, and the ball nearest to the floor is the one that the cell sees. */

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "balls/ball_light.h"

#define MAX_SHADOW_STRETCH 12.0f /* longest shadow of a ball that is drawn, in its diameters */

/* Draws which of `count` balls (x, y, z, radius each) every cell of the grid sees towards a sample: `seen` (side^2) is
 * set to the ball's index, -1 before, `gaps` to its height above the floor; lists the cells that see one in `cells`.
 * Returns their number. */
INLINE int draw_shadow(const float *balls, int count, const BallScene *scene, const float *sample, int *seen,
                       float *gaps, int *cells) {
    int side = scene->floor_side, listed = 0;
    float half = scene->floor_half_size, cell = 2 * half / (float)side;
    for (int b = 0; b < count; b++) {
        const float *center = balls + 4 * (size_t)b;
        float radius = center[3], drop = sample[2] - center[2], height = center[2] - scene->floor_height;
        float to_floor = sample[2] - scene->floor_height;
        if ((to_floor > 0 ? drop : -drop) < radius) continue;
        float stretch = to_floor / drop, dx = center[0] - sample[0], dy = center[1] - sample[1];
        float x = sample[0] + dx * stretch, y = sample[1] + dy * stretch;
        float slope = smaller(sqrtf(1 + (dx * dx + dy * dy) / (drop * drop)), MAX_SHADOW_STRETCH);
        float reach = radius * fabsf(stretch) * slope * 1.05f;
        float level = sqrtf(dx * dx + dy * dy) + 1e-9f, reach_across = radius * fabsf(stretch) * 1.05f;
        float reach_x = sqrtf(reach * reach * dx * dx + reach_across * reach_across * dy * dy) / level;
        float reach_y = sqrtf(reach * reach * dy * dy + reach_across * reach_across * dx * dx) / level;
        int left = (int)ceilf(larger((x - reach_x + half) / cell - 0.5f, 0));
        int right = (int)floorf(smaller((x + reach_x + half) / cell - 0.5f, (float)side - 1));
        int top = (int)ceilf(larger((y - reach_y + half) / cell - 0.5f, 0));
        int bottom = (int)floorf(smaller((y + reach_y + half) / cell - 0.5f, (float)side - 1));
        for (int v = top; v <= bottom; v++)
            for (int u = left; u <= right; u++) {
                float px = ((float)u + 0.5f) * cell - half, py = ((float)v + 0.5f) * cell - half;
                float rx = sample[0] - px, ry = sample[1] - py, rz = to_floor;
                float cx = center[0] - px, cy = center[1] - py, cz = height;
                float along = (cx * rx + cy * ry + cz * rz) / (rx * rx + ry * ry + rz * rz);
                float ax = cx - along * rx, ay = cy - along * ry, az = cz - along * rz;
                if (ax * ax + ay * ay + az * az >= radius * radius) continue;
                int at = v * side + u;
                if (seen[at] < 0) cells[listed++] = at;
                if (seen[at] < 0 || fabsf(along) < gaps[at]) {
                    seen[at] = b;
                    gaps[at] = fabsf(along);
                }
            }
    }
    return listed;
}

/* Adds, for samples [begin, end) of (sample_count, 3) with weights (sample_count), to `hidden` (side, side) the weights
 * of those that balls (count, 4) hide from each cell; and to `sent` (side, side, 3) the radiance of the balls that are
 * seen there, times the weights. Ball b has the light (LIGHT_VALUES each) and albedo number indices[b]. */
FAST int z2p_balls_over_floor(const float *balls, int count, const BallScene *scene, const float *samples,
                              const float *weights, int begin, int end, const int *light_indices,
                              const int *albedo_indices, const float *light, const float *albedo, float *hidden,
                              float *sent) {
    int side = scene->floor_side;
    size_t cell_count = (size_t)side * side;
    float half = scene->floor_half_size, cell = 2 * half / (float)side;
    int *seen = malloc(sizeof(int) * 2 * cell_count), *cells = seen + cell_count;
    float *gaps = malloc(sizeof(float) * cell_count);
    int enough = seen && gaps;
    if (enough) memset(seen, -1, sizeof(int) * cell_count);
    for (int s = begin; s < end && enough; s++) {
        const float *sample = samples + 3 * s;
        int listed = draw_shadow(balls, count, scene, sample, seen, gaps, cells);
        for (int k = 0; k < listed; k++) {
            int at = cells[k], b = seen[at];
            const float *center = balls + 4 * (size_t)b;
            float px = ((float)(at % side) + 0.5f) * cell - half, py = ((float)(at / side) + 0.5f) * cell - half;
            float ray[3] = {sample[0] - px, sample[1] - py, sample[2] - scene->floor_height};
            float offset[3] = {px - center[0], py - center[1], scene->floor_height - center[2]}, normal[3], radiance[3];
            float length_sq = dot(ray, ray), along = -dot(offset, ray) / length_sq;
            float miss_sq = 0;
            for (int a = 0; a < 3; a++) miss_sq += (offset[a] + along * ray[a]) * (offset[a] + along * ray[a]);
            float half_chord = sqrtf(larger(center[3] * center[3] - miss_sq, 0) / length_sq);
            float t = along > 0 ? along - half_chord : along + half_chord;
            for (int a = 0; a < 3; a++) normal[a] = (offset[a] + t * ray[a]) / center[3];
            ball_radiance(light + LIGHT_VALUES * (size_t)light_indices[b], albedo + 3 * (size_t)albedo_indices[b],
                          normal, radiance);
            hidden[at] += weights[s];
            for (int c = 0; c < CHANNELS; c++) sent[3 * (size_t)at + c] += weights[s] * radiance[c];
            seen[at] = -1;
        }
    }
    free(seen);
    free(gaps);
    return enough;
}
