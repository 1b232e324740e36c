/* Rows of a binary file whose properties are numbers, or lists that begin with their length, as in PLY.
 *
 * Input: the file's bytes and the types of a row's properties. Output: the wanted numbers as doubles, and where the
 * rows end. */

#include <stdint.h>
#include <string.h>

enum { I1, U1, I2, U2, I4, U4, I8, U8, F4, F8 };
static const int TYPE_BYTES[] = {1, 1, 2, 2, 4, 4, 8, 8, 4, 8};

#define AS(type)                        \
    {                                   \
        type number;                    \
        memcpy(&number, bytes, sizeof number); \
        return (double)number;          \
    }

/* The number of a type at an address, its bytes reversed if `is_swapped`. */
static double read_number(const unsigned char *from, int type_index, int is_swapped) {
    unsigned char bytes[8];
    int size = TYPE_BYTES[type_index];
    for (int b = 0; b < size; b++) bytes[b] = from[is_swapped ? size - 1 - b : b];
    switch (type_index) {
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

/* bounds (6): size of the file, offset of the first row, row count, properties of a row, whether bytes are swapped, and
 * how many columns are wanted. For each property: its type; the type of its length if it is a list, else -1; and its
 * column in values (rows, columns), -1 if it is not wanted. end_offset: where the rows end, -1 if one reaches past the
 * end of the file. */
int z2p_read_list_rows(const unsigned char *file, const int64_t *bounds, const int32_t *types,
                       const int32_t *length_types, const int32_t *columns, double *values, int64_t *end_offset) {
    int64_t size = bounds[0], offset = bounds[1], count = bounds[2];
    int64_t property_count = bounds[3], column_count = bounds[5];
    int is_swapped = bounds[4] != 0;
    *end_offset = -1;
    if (offset < 0 || offset > size) return 1;
    for (int64_t row = 0; property_count > 0 && row < count; row++) {
        for (int64_t p = 0; p < property_count; p++) {
            int64_t items = 1, bytes = TYPE_BYTES[types[p]];
            if (length_types[p] >= 0) {
                int length_bytes = TYPE_BYTES[length_types[p]];
                if (length_bytes > size - offset) return 1;
                double length = read_number(file + offset, length_types[p], is_swapped);
                offset += length_bytes;
                if (!(length >= 0 && length <= (double)((size - offset) / bytes))) return 1;
                items = (int64_t)length;
            } else if (bytes > size - offset) {
                return 1;
            } else if (columns[p] >= 0) {
                values[row * column_count + columns[p]] = read_number(file + offset, types[p], is_swapped);
            }
            offset += items * bytes;
        }
    }
    *end_offset = offset;
    return 1;
}
