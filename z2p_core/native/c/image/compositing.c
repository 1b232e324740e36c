/* Final compositing: blends the network's image towards the rough rendering, and converts it to 8-bit RGBA. Images are
 * planar with premultiplied color: red, green, blue, alpha, each `pixels` floats. */

#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include "common/simd.h"

#define MULTIPLIED_PIXELS 64 /* of a row that are multiplied at a time; even */

INLINE float clamp_unit(float value) { return value > 0 ? (value < 1 ? value : 1) : 0; }

INLINE uint8_t to_byte(float value) { return (uint8_t)(int32_t)(clamp_unit(value) * 255 + 0.5f); }

/* Blends the pixels [first, last) of image (4, pixels) towards straight colors (3, pixels): by the share `weight` of
 * their difference, of which at most max_difference counts. Only where coverage (pixels) and alpha are close to 1. */
FAST int z2p_blend_towards(float *image, const float *coverage, const float *colors, int64_t pixels, int64_t first,
                           int64_t last, float weight, float max_difference) {
    const float *alpha = image + 3 * pixels;
    for (int color = 0; color < 3; color++) {
        float *plane = image + color * pixels;
        const float *target = colors + color * pixels;
        for (int64_t i = first; i < last; i++) {
            float opaque = clamp_unit(10 * coverage[i] - 9) * clamp_unit(20 * alpha[i] - 19);
            float difference = target[i] * alpha[i] - plane[i];
            difference = difference > max_difference ? max_difference
                         : difference < -max_difference ? -max_difference : difference;
            plane[i] += weight * opaque * difference;
        }
    }
    return 1;
}

/* Blends the pixels [first, last) of alpha towards those of shadow by the share `weight` of their difference: in full
 * up to max_difference, fading to nothing at twice that. Only where coverage is close to 0. */
FAST int z2p_blend_shadow_towards(float *alpha, const float *coverage, const float *shadow, int64_t first, int64_t last,
                                  float weight, float max_difference) {
    for (int64_t i = first; i < last; i++) {
        float difference = shadow[i] - alpha[i], size = difference < 0 ? -difference : difference;
        alpha[i] += weight * clamp_unit(1 - 10 * coverage[i]) * clamp_unit(2 - size / max_difference) * difference;
    }
    return 1;
}

/* Writes the pixels [first, last) of rgba (pixels, 4), straight color and alpha in bytes, of image (4, pixels); color
 * is 0 where alpha is. */
FAST int z2p_to_straight_rgba8(const float *image, int64_t pixels, int64_t first, int64_t last, uint8_t *rgba) {
    const float *red = image, *green = image + pixels, *blue = image + 2 * pixels, *alpha = image + 3 * pixels;
    for (int64_t i = first; i < last; i++) {
        float a = clamp_unit(alpha[i]), inverse = a > 1e-6f ? 1 / a : 0;
        rgba[4 * i] = to_byte(clamp_unit(red[i]) * inverse);
        rgba[4 * i + 1] = to_byte(clamp_unit(green[i]) * inverse);
        rgba[4 * i + 2] = to_byte(clamp_unit(blue[i]) * inverse);
        rgba[4 * i + 3] = to_byte(a);
    }
    return 1;
}

/* ln x for x > 0 to about two units in the last place, without calls and branches (polynomial of Cephes' logf). */
INLINE float log_fast(float x) {
    int32_t bits;
    memcpy(&bits, &x, sizeof bits);
    int32_t exponent = ((bits >> 23) & 0xff) - 126, mantissa_bits = (bits & 0x7fffff) | (126 << 23);
    float m;
    memcpy(&m, &mantissa_bits, sizeof m); /* in [0.5, 1) */
    int small = m < 0.707106781f;
    float e = (float)(exponent - small), f = small ? 2 * m - 1 : m - 1, z = f * f;
    float y = 7.0376836292e-2f;
    y = y * f - 1.1514610310e-1f;
    y = y * f + 1.1676998740e-1f;
    y = y * f - 1.2420140846e-1f;
    y = y * f + 1.4249322787e-1f;
    y = y * f - 1.6668057665e-1f;
    y = y * f + 2.0000714765e-1f;
    y = y * f - 2.4999993993e-1f;
    y = y * f + 3.3333331174e-1f;
    y = y * f * z - 2.12194440e-4f * e - 0.5f * z;
    return f + y + 0.693359375f * e;
}

INLINE float linear_from_srgb(float value) {
    float power = exp_fast(2.4f * log_fast((larger(value, 0.04045f) + 0.055f) * (1 / 1.055f)));
    return value <= 0.04045f ? value * (1 / 12.92f) : power;
}

INLINE float srgb_from_linear(float value) {
    float power = 1.055f * exp_fast((1 / 2.4f) * log_fast(larger(value, 0.0031308f))) - 0.055f;
    return value <= 0.0031308f ? value * 12.92f : power;
}

/* Multiplies straight colors of premultiplied pixels by factors >= 0 in linear light. */
INLINE void multiply_pixels(float *plane, const float *alpha, const float *factor, int count) {
    for (int i = 0; i < count; i++) {
        float straight = clamp_unit(plane[i] / larger(alpha[i], 1e-6f));
        float scaled = clamp_unit(linear_from_srgb(straight) * factor[i]);
        plane[i] = alpha[i] > 1e-6f ? srgb_from_linear(scaled) * alpha[i] : 0;
    }
}

/* Multiplies the colors of the rows [first, last) of image (4, height, width) in linear light: by factors (3,
 * height, width) as far as coverage (height, width) is full, and else by those of coarse (3, ceil(height / 2),
 * ceil(width / 2)). Coverage counts in full from full_coverage on. */
FAST int z2p_multiply_linear(float *image, const float *factors, const float *coverage, const float *coarse,
                             float full_coverage, int height, int width, int first, int last) {
    size_t plane = (size_t)height * width, coarse_plane = (size_t)((height + 1) / 2) * ((width + 1) / 2);
    for (int y = first; y < last; y++)
        for (int left = 0; left < width; left += MULTIPLIED_PIXELS) {
            size_t at = (size_t)y * width + left, above = (size_t)(y / 2) * ((width + 1) / 2) + left / 2;
            int count = width - left < MULTIPLIED_PIXELS ? width - left : MULTIPLIED_PIXELS;
            float factor[MULTIPLIED_PIXELS], share[MULTIPLIED_PIXELS], most = 0;
            for (int c = 0; c < 3; c++)
                for (int i = 0; i < count; i++) most = larger(most, image[c * plane + at + i]);
            if (!(most > 0)) continue; /* shadow, or nothing */
            for (int i = 0; i < count; i++) share[i] = clamp_unit(coverage[at + i] / full_coverage);
            for (int c = 0; c < 3; c++) {
                const float *own = factors + c * plane + at, *wide = coarse + c * coarse_plane + above;
                for (int i = 0; i < count; i++) factor[i] = wide[i / 2] + share[i] * (own[i] - wide[i / 2]);
                multiply_pixels(image + c * plane + at, image + 3 * plane + at, factor, count);
            }
        }
    return 1;
}
