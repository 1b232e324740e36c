/* The depth of the nearest point at every pixel, and of every window: what z-buffers are made from. */

#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "common/simd.h"

#define BLOCK 512 /* points projected at a time, before their depths are scattered */

/* Cells of `count` <= BLOCK points and their depths; unseen points get the cell `none`. Plain arithmetic without a
 * branch, so that the compiler makes vectors of it. */
INLINE void project_block(const float *restrict points, int count, const float *restrict camera, float focal,
                          float middle_x, float middle_y, int width, int height, int margin,
                          int32_t *restrict cell, float *restrict depth) {
    const float *r = camera, *c = camera + 9;
    int32_t none = width * height;
    for (int i = 0; i < count; i++) {
        float x = points[3 * i] - c[0], y = points[3 * i + 1] - c[1], z = points[3 * i + 2] - c[2];
        float ahead = r[6] * x + r[7] * y + r[8] * z, scale = focal / ahead;
        float column = floorf((r[0] * x + r[1] * y + r[2] * z) * scale + middle_x) + (float)margin;
        float row = floorf((r[3] * x + r[4] * y + r[5] * z) * scale + middle_y) + (float)margin;
        int seen = (ahead > 0) & (column >= 0) & (row >= 0) & (column < (float)width) & (row < (float)height);
        /* what is not a number fails every comparison, and must not be turned into an integer either */
        int32_t across = (int32_t)(seen ? column : 0.0f), down = (int32_t)(seen ? row : 0.0f);
        cell[i] = seen ? down * width + across : none;
        depth[i] = ahead;
    }
}

/* Lowers depths (height * width + 1, the last of no meaning) to those of the points (count, 3) where they are nearer.
 * The picture has `margin` pixels to each side, which are counted in height and width; camera is its rotation (3, 3),
 * then its place (3). */
FAST int z2p_nearest_depth(const float *points, int64_t count, const float *camera, float focal, int width, int height,
                           int margin, float *depths) {
    int32_t cell[BLOCK];
    float depth[BLOCK], middle_x = 0.5f * (float)(width - 2 * margin), middle_y = 0.5f * (float)(height - 2 * margin);
    for (int64_t first = 0; first < count; first += BLOCK) {
        int size = count - first < BLOCK ? (int)(count - first) : BLOCK;
        project_block(points + 3 * first, size, camera, focal, middle_x, middle_y, width, height, margin, cell, depth);
        for (int i = 0; i < size; i++) {
            float known = depths[cell[i]];
            depths[cell[i]] = depth[i] < known ? depth[i] : known;
        }
    }
    return 1;
}

/* Minimum of each `size` neighbours of a line in place; only the first length - size + 1 places count afterwards. */
INLINE void line_minimum(float *restrict line, int length, int size) {
    int span = 1;
    for (; span * 2 <= size; span *= 2)
        for (int x = 0; x < length - span; x++) line[x] = line[x + span] < line[x] ? line[x + span] : line[x];
    int rest = size - span;
    if (rest)
        for (int x = 0; x < length - rest; x++) line[x] = line[x + rest] < line[x] ? line[x + rest] : line[x];
}

/* out (height - size + 1, width - size + 1): the minimum of every size x size window of (height, width). */
FAST int z2p_window_minimum(const float *picture, int height, int width, int size, float *out) {
    float *line = malloc(sizeof(float) * (size_t)width);
    if (!line) return 0;
    for (int y = 0; y <= height - size; y++) {
        const float *row = picture + (size_t)y * width;
        memcpy(line, row, sizeof(float) * (size_t)width);
        for (int below = 1; below < size; below++) {
            row += width;
            for (int x = 0; x < width; x++) line[x] = row[x] < line[x] ? row[x] : line[x];
        }
        line_minimum(line, width, size);
        memcpy(out + (size_t)y * (width - size + 1), line, sizeof(float) * (size_t)(width - size + 1));
    }
    free(line);
    return 1;
}

/* out (height, width): exp((alpha - depth) / beta), Eq. 1 of the paper; 0 where the depth is infinite. Rows of depths
 * are `stride` apart. */
FAST int z2p_intensity(const float *depth, int64_t stride, int height, int width, float alpha, float beta, float *out) {
    float inverse = 1 / beta;
    for (int y = 0; y < height; y++)
        for (int x = 0; x < width; x++)
            out[(size_t)y * width + x] = exp_fast((alpha - depth[y * stride + x]) * inverse);
    return 1;
}
