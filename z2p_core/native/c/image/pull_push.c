/* Extends an image beyond the pixels that have values: pull-push interpolation (Gortler et al., The Lumigraph,
 * 1996). */

#include <stddef.h>
#include <stdlib.h>
#include <string.h>

#include "common/simd.h"

#define COLORS 3
#define MAX_LEVELS 9      /* of the pyramid, the image's own size included */
#define MIN_WEIGHT 1e-6f  /* weights are taken for at least this */

/* A level: values (3, height, width), first times weights, and weights (height, width) in [0, 1]. */
typedef struct {
    float *values, *weights;
    int width, height;
} Level;

/* Sums the 2 x 2 blocks of the finer level, whose values are already multiplied by weights unless `is_weighted` is 0,
 * and divides by weights where these exceed 1. */
INLINE void pull(const float *values, const float *weights, int width, int height, float scale, int is_weighted,
                 Level *coarse) {
    size_t plane = (size_t)width * height, coarse_plane = (size_t)coarse->width * coarse->height;
    for (int y = 0; y < height; y++) {
        size_t row = (size_t)y * width, out = (size_t)(y / 2) * coarse->width;
        for (int x = 0; x < width; x++) {
            float weight = weights[row + x] * scale;
            weight = weight < 0 ? 0 : weight > 1 ? 1 : weight;
            if (!(weight > 0)) continue;
            float share = is_weighted ? 1 : weight;
            coarse->weights[out + x / 2] += weight;
            for (int c = 0; c < COLORS; c++)
                coarse->values[c * coarse_plane + out + x / 2] += share * values[c * plane + row + x];
        }
    }
    for (size_t i = 0; i < coarse_plane; i++) {
        if (!(coarse->weights[i] > 1)) continue;
        for (int c = 0; c < COLORS; c++) coarse->values[c * coarse_plane + i] /= coarse->weights[i];
        coarse->weights[i] = 1;
    }
}

/* Completes a level's values, where weights are below 1, by those of the coarser one. */
INLINE void push(const Level *coarse, Level *fine) {
    size_t plane = (size_t)fine->width * fine->height, coarse_plane = (size_t)coarse->width * coarse->height;
    for (int c = 0; c < COLORS; c++)
        for (int y = 0; y < fine->height; y++) {
            const float *above = coarse->values + c * coarse_plane + (size_t)(y / 2) * coarse->width;
            size_t row = (size_t)y * fine->width;
            for (int x = 0; x < fine->width; x++)
                fine->values[c * plane + row + x] += (1 - fine->weights[row + x]) * above[x / 2];
        }
}

/* Fills the coarsest level with its mean. */
INLINE void fill_with_mean(Level *level) {
    size_t plane = (size_t)level->width * level->height;
    float total = 0;
    for (size_t i = 0; i < plane; i++) total += level->weights[i];
    for (int c = 0; c < COLORS; c++) {
        float *values = level->values + c * plane, sum = 0;
        for (size_t i = 0; i < plane; i++) sum += values[i];
        for (size_t i = 0; i < plane; i++)
            values[i] += (1 - level->weights[i]) * sum / larger(total, MIN_WEIGHT);
    }
}

/* Writes half (3, ceil(height / 2), ceil(width / 2)): means of values (3, height, width) in 2 x 2 blocks, by weights
 * (height, width), which times `scale` count up to 1; where these are small, means over larger blocks around. */
FAST int z2p_extend_halved(const float *values, const float *weights, float scale, int height, int width, float *half) {
    Level levels[MAX_LEVELS];
    int count = 0;
    for (int w = (width + 1) / 2, h = (height + 1) / 2; count < MAX_LEVELS; w = (w + 1) / 2, h = (h + 1) / 2) {
        levels[count].width = w, levels[count++].height = h;
        if (w <= 1 && h <= 1) break;
    }
    size_t room = 0;
    for (int i = 0; i < count; i++) room += (size_t)levels[i].width * levels[i].height * (COLORS + 1);
    float *memory = calloc(room, sizeof(float)), *next = memory;
    if (!memory) return 0;
    for (int i = 0; i < count; i++) {
        size_t plane = (size_t)levels[i].width * levels[i].height;
        levels[i].values = next, levels[i].weights = next + COLORS * plane, next += (COLORS + 1) * plane;
    }
    pull(values, weights, width, height, scale, 0, levels);
    for (int i = 1; i < count; i++)
        pull(levels[i - 1].values, levels[i - 1].weights, levels[i - 1].width, levels[i - 1].height, 1, 1, levels + i);
    fill_with_mean(levels + count - 1);
    for (int i = count - 2; i >= 0; i--) push(levels + i + 1, levels + i);
    memcpy(half, levels[0].values, sizeof(float) * COLORS * (size_t)levels[0].width * levels[0].height);
    free(memory);
    return 1;
}
