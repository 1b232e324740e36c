/* The last two convolutions of the fast network, on single pixels: `UnshuffleUNet.refine` of z2p_core/network/unet.py. Engines
 * do them layer by layer, with few channels of many pixels that fall out of the cache; here both go down a tile of
 * columns side by side, three rows at a time. */

#include <stddef.h>
#include <stdlib.h>
#include <string.h>

#include "common/simd.h"
#include "common/lanes.h"

#define WIDE 2                  /* times LANES pixels of a row, */
#define GROUP 4                 /* times so many channels that are written: the sums that registers hold */
#define BLOCK (LANES * WIDE)
#define TILE (BLOCK * 6)        /* columns of a tile; of the second convolution two less */
#define ROOM (TILE + LANES)     /* that a row takes in memory, with what lies beside it */
#define TAPS 9                  /* of a convolution, row by row */

/* A convolution that reads so many channels and writes GROUP in each of some groups: weights (groups, read, TAPS,
 * GROUP) and bias (groups, GROUP). */
typedef struct {
    int read, groups;
    const float *weights, *bias;
} Convolution;

/* What it makes of three rows (read, ROOM) in the block from that column on. */
INLINE void convolve(const Convolution *convolution, int group, const float *const *rows, int column,
                     Lanes (*sums)[WIDE]) {
    const float *weights = convolution->weights + (size_t)group * convolution->read * TAPS * GROUP;
    for (int g = 0; g < GROUP; g++)
        for (int w = 0; w < WIDE; w++) sums[g][w] = (Lanes){0} + convolution->bias[group * GROUP + g];
    for (int channel = 0; channel < convolution->read; channel++)
        for (int down = 0; down < 3; down++) {
            const float *row = rows[down] + (size_t)channel * ROOM + column;
            for (int right = 0; right < 3; right++, weights += GROUP) {
                Lanes seen[WIDE];
                for (int w = 0; w < WIDE; w++) seen[w] = lanes(row + right + LANES * w);
                for (int g = 0; g < GROUP; g++)
                    for (int w = 0; w < WIDE; w++) sums[g][w] += weights[g] * seen[w];
            }
        }
}

/* What the network has drawn, in cells (GROUP u u, H / u, W / u) of u pixels a side, and of what: buffers
 * (channels, H, W). */
typedef struct {
    const float *cells, *buffers;
    int channels, height, width, unshuffle;
} Drawn;

/* A row of the picture and the buffers (GROUP + channels, ROOM) from a column on; 0 beyond the picture. */
INLINE void lay_out(const Drawn *drawn, int y, int first, float *row) {
    int width = drawn->width, u = drawn->unshuffle, channels = drawn->channels;
    int from = first < 0 ? -first : 0, to = width - first < ROOM ? width - first : ROOM;
    memset(row, 0, sizeof(float) * (size_t)(GROUP + channels) * ROOM);
    if (y < 0 || y >= drawn->height || from >= to) return;
    size_t wide = (size_t)(width / u), plane = (size_t)(drawn->height / u) * wide;
    for (int c = 0; c < GROUP; c++)
        for (int side = 0; side < u; side++) { /* every u-th pixel comes from the same channel of cells */
            const float *cells = drawn->cells + (size_t)((c * u + y % u) * u + side) * plane + (size_t)(y / u) * wide;
            int i = from + (side + u - (first + from) % u) % u;
            for (cells += (first + i) / u; i < to; i += u) row[c * ROOM + i] = *cells++;
        }
    for (int c = 0; c < channels; c++)
        memcpy(row + (GROUP + c) * ROOM + from,
               drawn->buffers + ((size_t)c * drawn->height + y) * width + first + from,
               sizeof(float) * (size_t)(to - from));
}

/* What the first convolution makes of three rows, where it is positive, in a row (4 groups, ROOM) that begins at column
 * `first` of the picture; 0 beyond that. */
INLINE void look(const Convolution *convolution, const float *const *rows, int first, int columns, int width,
                 float *hidden) {
    for (int group = 0; group < convolution->groups; group++)
        for (int column = 0; column < columns; column += BLOCK) {
            Lanes sums[GROUP][WIDE];
            convolve(convolution, group, rows, column, sums);
            for (int g = 0; g < GROUP; g++)
                for (int w = 0; w < WIDE; w++) {
                    Lanes kept = positive(sums[g][w]);
                    memcpy(hidden + (size_t)(group * GROUP + g) * ROOM + column + LANES * w, &kept, sizeof kept);
                }
        }
    for (int c = 0; c < convolution->groups * GROUP; c++) {
        if (first < 0) hidden[c * ROOM] = 0;
        for (int i = width - first; i < ROOM; i++) hidden[c * ROOM + i] = 0;
    }
}

/* Adds what the second convolution makes of three rows to one of the picture (GROUP, ROOM), and writes up to `most` of
 * its columns (GROUP, plane), in [0, 1]. */
INLINE void touch(const Convolution *convolution, const float *const *rows, const float *picture, int most,
                  size_t plane, float *out) {
    for (int column = 0; column < most; column += BLOCK) {
        Lanes sums[GROUP][WIDE];
        float block[BLOCK];
        convolve(convolution, 0, rows, column, sums);
        for (int g = 0; g < GROUP; g++) {
            for (int w = 0; w < WIDE; w++) sums[g][w] += lanes(picture + g * ROOM + column + LANES * w);
            memcpy(block, sums[g], sizeof block);
            for (int i = 0; i < BLOCK && column + i < most; i++)
                out[g * plane + column + i] = smaller(larger(block[i], 0), 1);
        }
    }
}

/* Rows from `begin` to `end` of a picture (GROUP, H, W) in [0, 1]: what a network has drawn in cells (GROUP u u, H / u,
 * W / u) of u pixels a side, and what two convolutions add to it, which see it and the buffers (channels, H, W). */
FAST int z2p_touch(const float *cells, const float *buffers, int channels, int height, int width, int unshuffle,
                   const float *look_weights, const float *look_bias, int groups, const float *touch_weights,
                   const float *touch_bias, int begin, int end, float *picture) {
    Drawn drawn = {cells, buffers, channels, height, width, unshuffle};
    Convolution first = {GROUP + channels, groups, look_weights, look_bias};
    Convolution last = {GROUP * groups, 1, touch_weights, touch_bias};
    size_t seen = (size_t)first.read * ROOM, said = (size_t)last.read * ROOM, plane = (size_t)height * width;
    float *room = calloc(3 * (seen + said), sizeof(float)), *sights[3], *hidden[3];
    if (!room) return 0;
    for (int i = 0; i < 3; i++) sights[i] = room + seen * i, hidden[i] = room + 3 * seen + said * i;
    for (int left = 0; left < width; left += TILE - 2) {
        int most = width - left < TILE - 2 ? width - left : TILE - 2;
        /* rows that are seen, the last of which is y, and two of them above and below; each is kept at its number mod 3 */
        for (int y = begin - 2; y <= end + 1; y++) {
            const float *rows[3];
            lay_out(&drawn, y, left - 2, sights[(y + 3) % 3]);
            if (y < begin) continue;
            for (int i = 0; i < 3; i++) rows[i] = sights[(y + 1 + i) % 3];
            float *said_of = hidden[(y + 2) % 3];
            if (y == 0 || y > height) memset(said_of, 0, sizeof(float) * said); /* of a row beyond the picture */
            else look(&first, rows, left - 1, most + 2, width, said_of);
            if (y < begin + 2) continue;
            for (int i = 0; i < 3; i++) rows[i] = hidden[(y + i) % 3];
            touch(&last, rows, sights[(y + 1) % 3] + 2, most, plane, picture + (size_t)(y - 2) * width + left);
        }
    }
    free(room);
    return 1;
}
