/* Function attributes and scalar helpers for loops that compilers turn into vector instructions. */

#pragma once

#include <math.h>
#include <stdint.h>
#include <string.h>

/* FAST functions are compiled three times, for x86-64's baseline, AVX2 and AVX-512, and the processor's variant is
 * chosen at load time; on other platforms, and with compilers that cannot do that, once. */
#if defined(__x86_64__) && defined(__GLIBC__) && \
    ((defined(__clang__) && __clang_major__ >= 18) || (!defined(__clang__) && defined(__GNUC__) && __GNUC__ >= 12))
#define FAST __attribute__((target_clones("arch=x86-64-v4", "arch=x86-64-v3", "default")))
/* WIDEST functions are compiled for AVX-512 only, and must not be called on processors without it. */
#define WIDEST __attribute__((target("arch=x86-64-v4")))
#else
#define FAST
#endif
/* INLINE functions are parts of FAST ones: only where they are inlined are they compiled for wide registers. */
#if defined(__GNUC__)
#define INLINE static inline __attribute__((always_inline))
#else
#define INLINE static inline
#endif

/* Unlike fmaxf and fminf, which handle NaN and become library calls, these do not prevent vectorization. */
INLINE float larger(float a, float b) { return a > b ? a : b; }
INLINE float smaller(float a, float b) { return a < b ? a : b; }

/* e^x to about two units in the last place, 0 below -87, without calls and branches (polynomial of Cephes' expf). */
INLINE float exp_fast(float x) {
    float inside = x < -87.0f ? -87.0f : x > 88.0f ? 88.0f : x;
    float n = floorf(inside * 1.44269504f + 0.5f), f = (inside - n * 0.693359375f) + n * 2.12194440e-4f;
    float y = 1.9875691500e-4f;
    y = y * f + 1.3981999507e-3f;
    y = y * f + 8.3334519073e-3f;
    y = y * f + 4.1665795894e-2f;
    y = y * f + 1.6666665459e-1f;
    y = y * f + 5.0000001201e-1f;
    y = y * f * f + f + 1.0f;
    int32_t bits = ((int32_t)n + 127) * (1 << 23);
    float power;
    memcpy(&power, &bits, sizeof power);
    return x < -87.0f ? 0.0f : y * power;
}
