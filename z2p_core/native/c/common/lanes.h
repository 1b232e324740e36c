/* Several numbers that are reckoned with at a time: as many as wide registers hold. What is longer than a register,
 * compilers keep in memory, several times as slow. wide.c compiles kernels once more, with twice as many. */

#pragma once

#include <stdint.h>
#include <string.h>

#include "common/simd.h"

#ifndef LANES
#define LANES 8
#endif

typedef float Lanes __attribute__((vector_size(4 * LANES)));
typedef int32_t Masks __attribute__((vector_size(4 * LANES)));

INLINE Lanes lanes(const float *numbers) {
    Lanes all;
    memcpy(&all, numbers, sizeof all);
    return all;
}

INLINE Lanes where(Masks mask, Lanes numbers) { return (Lanes)(mask & (Masks)numbers); }

INLINE Lanes positive(Lanes numbers) { return where(numbers > 0, numbers); }
