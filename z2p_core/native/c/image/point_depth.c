/* Z-buffers: the depth of the nearest point at every pixel, its minimum over windows, and Eq. 1's depth encoding of the
 * Z2P paper (Metzer et al., "Z2P: Instant Visualization of Point Clouds", 2022). */

#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "common/screen_view.h"
#include "common/simd.h"

/* Lowers depths (rows * columns + 1, of which the last takes all points outside) to those of points (count, 3). Rows and
 * columns include a margin of `margin` cells on every side of the screen. */
FAST int z2p_nearest_depth(const float *points, int64_t count, const ScreenView *view, int margin, float *depths) {
    int32_t pixel[BLOCK];
    float depth[BLOCK];
    for (int64_t first = 0; first < count; first += BLOCK) {
        int size = count - first < BLOCK ? (int)(count - first) : BLOCK;
        project_block(points + 3 * first, size, view, margin, pixel, depth);
        for (int i = 0; i < size; i++) {
            float known = depths[pixel[i]];
            depths[pixel[i]] = depth[i] < known ? depth[i] : known;
        }
    }
    return 1;
}

/* Sliding minimum over `size` entries of a line, in place, by doubling; the first length - size + 1 entries are the
 * result. */
INLINE void line_minimum(float *restrict line, int length, int size) {
    int span = 1;
    for (; span * 2 <= size; span *= 2)
        for (int x = 0; x < length - span; x++) line[x] = line[x + span] < line[x] ? line[x + span] : line[x];
    int rest = size - span;
    if (rest)
        for (int x = 0; x < length - rest; x++) line[x] = line[x + rest] < line[x] ? line[x + rest] : line[x];
}

/* Writes out (height - size + 1, width - size + 1): the minimum of every size x size window of an image. */
FAST int z2p_window_minimum(const float *image, int height, int width, int size, float *out) {
    float *line = malloc(sizeof(float) * (size_t)width);
    if (!line) return 0;
    for (int y = 0; y <= height - size; y++) {
        const float *row = image + (size_t)y * width;
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

/* Writes out (height, width): exp((alpha - depth) / beta), equation 1 of the paper; 0 where the depth is infinite. Rows
 * of depth begin `stride` floats apart. */
FAST int z2p_depth_to_intensity(const float *depth, int64_t stride, int height, int width, float alpha, float beta,
                                float *out) {
    float inverse = 1 / beta;
    for (int y = 0; y < height; y++)
        for (int x = 0; x < width; x++)
            out[(size_t)y * width + x] = exp_fast((alpha - depth[y * stride + x]) * inverse);
    return 1;
}
