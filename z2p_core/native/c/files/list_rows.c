/* Rows of a binary file in which lists stand, so that a row's length is told by the row itself. */

#include <stdint.h>
#include <string.h>

enum { I1, U1, I2, U2, I4, U4, I8, U8, F4, F8 };
static const int BYTES[] = {1, 1, 2, 2, 4, 4, 8, 8, 4, 8};

#define AS(type)                        \
    {                                   \
        type number;                    \
        memcpy(&number, bytes, sizeof number); \
        return (double)number;          \
    }

/* The number of a kind that begins at a place in the file, whose bytes are in the other order if `swapped`. */
static double number_at(const unsigned char *from, int kind, int swapped) {
    unsigned char bytes[8];
    int size = BYTES[kind];
    for (int b = 0; b < size; b++) bytes[b] = from[swapped ? size - 1 - b : b];
    switch (kind) {
        case I1: AS(int8_t)
        case U1: AS(uint8_t)
        case I2: AS(int16_t)
        case U2: AS(uint16_t)
        case I4: AS(int32_t)
        case U4: AS(uint32_t)
        case I8: AS(int64_t)
        case U8: AS(uint64_t)
        case F4: AS(float)
        default: AS(double)
    }
}

/* Walks `count` rows of `width` properties from `start` on, in a file of `size` bytes: the numbers of `bounds`, with
 * whether bytes are swapped, and how many values are wanted of a row. A property has a kind, the kind of the length
 * before it if it is a list (else -1), and its place among the wanted values (else -1). values (count, wanted) get
 * those; `end` gets where the rows end, or -1 where one reaches past the file's end. */
int z2p_rows(const unsigned char *file, const int64_t *bounds, const int32_t *kinds, const int32_t *lengths,
             const int32_t *places, double *values, int64_t *end) {
    int64_t size = bounds[0], at = bounds[1], count = bounds[2], width = bounds[3], wanted = bounds[5];
    int swapped = bounds[4] != 0;
    *end = -1;
    if (at < 0 || at > size) return 1;
    for (int64_t row = 0; width > 0 && row < count; row++) {
        for (int64_t p = 0; p < width; p++) {
            int64_t items = 1, bytes = BYTES[kinds[p]];
            if (lengths[p] >= 0) {
                int before = BYTES[lengths[p]];
                if (before > size - at) return 1;
                double told = number_at(file + at, lengths[p], swapped);
                at += before;
                if (!(told >= 0 && told <= (double)((size - at) / bytes))) return 1;
                items = (int64_t)told;
            } else if (bytes > size - at) {
                return 1;
            } else if (places[p] >= 0) {
                values[row * wanted + places[p]] = number_at(file + at, kinds[p], swapped);
            }
            at += items * bytes;
        }
    }
    *end = at;
    return 1;
}
