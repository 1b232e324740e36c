/* Kernels that reckon by LANES, once more: with sixteen, for processors whose registers hold as many, where they take
 * two thirds to three quarters of the time. The same numbers come out. What they export has another name here. */

#include "common/simd.h"

#define LANES 16
#define z2p_refine z2p_refine_wide
#define z2p_refine_begin z2p_refine_begin_wide
#define z2p_refine_size z2p_refine_size_wide
#define z2p_final_convs z2p_final_convs_wide
#ifdef WIDEST
#undef FAST
#define FAST WIDEST
#endif

#include "points/normal_gnn.c"
#include "image/final_convs.c"

/* Whether the processor has such registers, and the compiler knew how to use them. */
int z2p_is_wide(int *wide) {
#ifdef WIDEST
    *wide = __builtin_cpu_supports("x86-64-v4") != 0;
#else
    *wide = 0;
#endif
    return 1;
}
