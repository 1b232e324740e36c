/* The network's output made a picture for files. */

#include <stddef.h>
#include <stdint.h>

#include "fast.h"

INLINE float unit(float value) { return value > 0 ? (value < 1 ? value : 1) : 0; }

INLINE uint8_t byte_of(float value) { return (uint8_t)(int32_t)(unit(value) * 255 + 0.5f); }

/* rgba (pixels, 4), from `first` to `last` - 1: straight colour and alpha in bytes, of planes (4, pixels) of colour
 * times alpha and alpha; colour is 0 where alpha is. */
FAST int z2p_straight_bytes(const float *planes, int64_t pixels, int64_t first, int64_t last, uint8_t *rgba) {
    const float *red = planes, *green = planes + pixels, *blue = planes + 2 * pixels, *alpha = planes + 3 * pixels;
    for (int64_t i = first; i < last; i++) {
        float a = unit(alpha[i]), inverse = a > 1e-6f ? 1 / a : 0;
        rgba[4 * i] = byte_of(unit(red[i]) * inverse);
        rgba[4 * i + 1] = byte_of(unit(green[i]) * inverse);
        rgba[4 * i + 2] = byte_of(unit(blue[i]) * inverse);
        rgba[4 * i + 3] = byte_of(a);
    }
    return 1;
}
