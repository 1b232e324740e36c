/* The network's output made a picture for files. */

#include <stddef.h>
#include <stdint.h>

#include "common/simd.h"

INLINE float unit(float value) { return value > 0 ? (value < 1 ? value : 1) : 0; }

INLINE uint8_t byte_of(float value) { return (uint8_t)(int32_t)(unit(value) * 255 + 0.5f); }

/* Moves colour times alpha in planes (4, pixels), from `first` to `last` - 1, towards the colours (3, pixels) that were
 * given, by the share `trust` and where they differ by more than `most` by that of it; only in the midst of what both
 * the coverage and the alpha show whole. */
FAST int z2p_reconcile(float *planes, const float *coverage, const float *colors, int64_t pixels, int64_t first,
                    int64_t last, float trust, float most) {
    const float *alpha = planes + 3 * pixels;
    for (int color = 0; color < 3; color++) {
        float *plane = planes + color * pixels;
        const float *given = colors + color * pixels;
        for (int64_t i = first; i < last; i++) {
            float amid = unit(10 * coverage[i] - 9) * unit(20 * alpha[i] - 19);
            float off = given[i] * alpha[i] - plane[i];
            off = off > most ? most : off < -most ? -most : off;
            plane[i] += trust * amid * off;
        }
    }
    return 1;
}

/* Moves alpha (pixels), from `first` to `last` - 1, by the share `trust` towards what was given; only off what the
 * coverage shows, and less the more they differ, from `most` on and not at all from twice as much. */
FAST int z2p_reconcile_shadow(float *alpha, const float *coverage, const float *given, int64_t first, int64_t last,
                              float trust, float most) {
    for (int64_t i = first; i < last; i++) {
        float off = given[i] - alpha[i], far = off < 0 ? -off : off;
        alpha[i] += trust * unit(1 - 10 * coverage[i]) * unit(2 - far / most) * off;
    }
    return 1;
}

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
