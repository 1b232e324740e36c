/* The last two convolutions of the fast network, at full resolution: `UnshuffleUNet.refine` of
 * z2p_core/network/unet.py. Input: the decoder's output in cells of unshuffled pixels and the input buffers; output:
 * the image in [0, 1].
 *
 * Inference engines run them layer by layer, with few channels of many pixels that fall out of the cache. Here both run
 * down a tile of columns together, on a rolling window of three rows. avx512.c compiles this file once more with 16
 * lanes. */

#include <stddef.h>
#include <stdlib.h>
#include <string.h>

#include "common/simd.h"
#include "common/lanes.h"

#define BLOCK_LANES 2               /* vectors of LANES pixels of a row that are computed at a time, */
#define GROUP 4                     /* for this many output channels: their sums fit into registers */
#define BLOCK (LANES * BLOCK_LANES) /* pixels */
#define TILE (BLOCK * 6)            /* columns that the first convolution computes at a time; the second two less */
#define ROW_STRIDE (TILE + LANES)   /* floats of a row in memory, padded */
#define TAPS 9                      /* of a 3 x 3 convolution, row by row */

/* A 3 x 3 convolution with GROUP x groups outputs: weights (groups, inputs, TAPS, GROUP) and bias (groups, GROUP). */
typedef struct {
    int inputs, groups;
    const float *weights, *bias;
} Convolution;

/* Convolves three rows (inputs, ROW_STRIDE) for one group of outputs, in the block that begins at that column. */
INLINE void convolve(const Convolution *convolution, int group, const float *const *rows, int column,
                     Lanes (*sums)[BLOCK_LANES]) {
    const float *weights = convolution->weights + (size_t)group * convolution->inputs * TAPS * GROUP;
    for (int g = 0; g < GROUP; g++)
        for (int b = 0; b < BLOCK_LANES; b++) sums[g][b] = (Lanes){0} + convolution->bias[group * GROUP + g];
    for (int channel = 0; channel < convolution->inputs; channel++)
        for (int dy = 0; dy < 3; dy++) {
            const float *row = rows[dy] + (size_t)channel * ROW_STRIDE + column;
            for (int dx = 0; dx < 3; dx++, weights += GROUP) {
                Lanes pixels[BLOCK_LANES];
                for (int b = 0; b < BLOCK_LANES; b++) pixels[b] = load_lanes(row + dx + LANES * b);
                for (int g = 0; g < GROUP; g++)
                    for (int b = 0; b < BLOCK_LANES; b++) sums[g][b] += weights[g] * pixels[b];
            }
        }
}

/* What the first convolution reads: the decoder's output in cells (GROUP u u, H / u, W / u), u = unshuffle pixels a
 * side, and the buffers (channels, H, W). */
typedef struct {
    const float *cells, *buffers;
    int channels, height, width, unshuffle;
} Inputs;

/* Writes row y of the decoder's image and of the buffers (GROUP + channels, ROW_STRIDE), from column `first` on; 0
 * outside of the image. */
INLINE void load_row(const Inputs *inputs, int y, int first, float *row) {
    int width = inputs->width, u = inputs->unshuffle, channels = inputs->channels;
    int from = first < 0 ? -first : 0, to = width - first < ROW_STRIDE ? width - first : ROW_STRIDE;
    memset(row, 0, sizeof(float) * (size_t)(GROUP + channels) * ROW_STRIDE);
    if (y < 0 || y >= inputs->height || from >= to) return;
    size_t cells_wide = (size_t)(width / u), plane = (size_t)(inputs->height / u) * cells_wide;
    for (int c = 0; c < GROUP; c++)
        for (int x = 0; x < u; x++) { /* every u-th pixel comes from the same channel of cells */
            const float *cells =
                inputs->cells + (size_t)((c * u + y % u) * u + x) * plane + (size_t)(y / u) * cells_wide;
            int i = from + (x + u - (first + from) % u) % u;
            for (cells += (first + i) / u; i < to; i += u) row[c * ROW_STRIDE + i] = *cells++;
        }
    for (int c = 0; c < channels; c++)
        memcpy(row + (GROUP + c) * ROW_STRIDE + from,
               inputs->buffers + ((size_t)c * inputs->height + y) * width + first + from,
               sizeof(float) * (size_t)(to - from));
}

/* First convolution and ReLU: writes a row of hidden (GROUP x groups, ROW_STRIDE), which begins at column `first` of
 * the image, from three input rows; 0 outside of the image. */
INLINE void convolve_first(const Convolution *convolution, const float *const *rows, int first, int columns, int width,
                           float *hidden) {
    for (int group = 0; group < convolution->groups; group++)
        for (int column = 0; column < columns; column += BLOCK) {
            Lanes sums[GROUP][BLOCK_LANES];
            convolve(convolution, group, rows, column, sums);
            for (int g = 0; g < GROUP; g++)
                for (int b = 0; b < BLOCK_LANES; b++) {
                    Lanes activation = relu(sums[g][b]);
                    float *out = hidden + (size_t)(group * GROUP + g) * ROW_STRIDE + column + LANES * b;
                    memcpy(out, &activation, sizeof activation);
                }
        }
    for (int c = 0; c < convolution->groups * GROUP; c++) {
        if (first < 0) hidden[c * ROW_STRIDE] = 0;
        for (int i = width - first; i < ROW_STRIDE; i++) hidden[c * ROW_STRIDE + i] = 0;
    }
}

/* Second convolution and skip connection: adds three hidden rows' convolution to a row of the decoder's image (GROUP,
 * ROW_STRIDE), clips it to [0, 1] and writes `columns` columns of it (GROUP, plane). */
INLINE void convolve_last(const Convolution *convolution, const float *const *rows, const float *decoded, int columns,
                          size_t plane, float *out) {
    for (int column = 0; column < columns; column += BLOCK) {
        Lanes sums[GROUP][BLOCK_LANES];
        float block[BLOCK];
        convolve(convolution, 0, rows, column, sums);
        for (int g = 0; g < GROUP; g++) {
            for (int b = 0; b < BLOCK_LANES; b++)
                sums[g][b] += load_lanes(decoded + g * ROW_STRIDE + column + LANES * b);
            memcpy(block, sums[g], sizeof block);
            for (int i = 0; i < BLOCK && column + i < columns; i++)
                out[g * plane + column + i] = smaller(larger(block[i], 0), 1);
        }
    }
}

/* Writes the rows [begin, end) of image (GROUP, height, width) in [0, 1]: the decoder's image, given in cells (GROUP u
 * u, height / u, width / u) of u = unshuffle pixels a side, plus two convolutions of it and of buffers (channels,
 * height, width). The first has GROUP x groups outputs and a ReLU. */
FAST int z2p_final_convs(const float *cells, const float *buffers, int channels, int height, int width, int unshuffle,
                         const float *first_weights, const float *first_bias, int groups, const float *last_weights,
                         const float *last_bias, int begin, int end, float *image) {
    Inputs inputs = {cells, buffers, channels, height, width, unshuffle};
    Convolution first = {GROUP + channels, groups, first_weights, first_bias};
    Convolution last = {GROUP * groups, 1, last_weights, last_bias};
    size_t input_size = (size_t)first.inputs * ROW_STRIDE, hidden_size = (size_t)last.inputs * ROW_STRIDE;
    size_t plane = (size_t)height * width;
    float *memory = calloc(3 * (input_size + hidden_size), sizeof(float)), *input_rows[3], *hidden_rows[3];
    if (!memory) return 0;
    for (int i = 0; i < 3; i++)
        input_rows[i] = memory + input_size * i, hidden_rows[i] = memory + 3 * input_size + hidden_size * i;
    for (int left = 0; left < width; left += TILE - 2) {
        int columns = width - left < TILE - 2 ? width - left : TILE - 2;
        /* Input row y completes hidden row y - 1, which completes image row y - 2; row i is kept at i mod 3. */
        for (int y = begin - 2; y <= end + 1; y++) {
            const float *rows[3];
            load_row(&inputs, y, left - 2, input_rows[(y + 3) % 3]);
            if (y < begin) continue;
            for (int i = 0; i < 3; i++) rows[i] = input_rows[(y + 1 + i) % 3];
            float *hidden = hidden_rows[(y + 2) % 3];
            if (y == 0 || y > height) memset(hidden, 0, sizeof(float) * hidden_size); /* outside of the image */
            else convolve_first(&first, rows, left - 1, columns + 2, width, hidden);
            if (y < begin + 2) continue;
            for (int i = 0; i < 3; i++) rows[i] = hidden_rows[(y + i) % 3];
            convolve_last(&last, rows, input_rows[(y + 1) % 3] + 2, columns, plane,
                          image + (size_t)(y - 2) * width + left);
        }
    }
    free(memory);
    return 1;
}
