/* Vectors of LANES floats, for kernels that are written in vectors: 8, or 16 where avx512.c compiles them once more.
 * Compilers would keep vectors longer than a register in memory, which is several times as slow. */

#pragma once

#include <stdint.h>
#include <string.h>

#include "common/simd.h"

#ifndef LANES
#define LANES 8
#endif

typedef float Lanes __attribute__((vector_size(4 * LANES)));
typedef int32_t Masks __attribute__((vector_size(4 * LANES)));

INLINE Lanes load_lanes(const float *values) {
    Lanes loaded;
    memcpy(&loaded, values, sizeof loaded);
    return loaded;
}

/* The values where the mask is set, else 0. */
INLINE Lanes where(Masks mask, Lanes values) { return (Lanes)(mask & (Masks)values); }

INLINE Lanes relu(Lanes values) { return where(values > 0, values); }
