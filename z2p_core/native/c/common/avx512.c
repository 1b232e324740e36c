/* Kernels that are written in vectors of LANES, compiled once more with 16 lanes for processors with AVX-512, where
 * they take two thirds to three quarters of the time. Results are identical. Exported names end in _wide here. */

#include "common/simd.h"

#define LANES 16
#define z2p_refine_normals z2p_refine_normals_wide
#define z2p_normal_gnn_begin z2p_normal_gnn_begin_wide
#define z2p_normal_gnn_size z2p_normal_gnn_size_wide
#define z2p_final_convs z2p_final_convs_wide
#ifdef WIDEST
#undef FAST
#define FAST WIDEST
#endif

#include "points/normal_gnn.c"
#include "image/final_convs.c"

/* Whether the processor has AVX-512, and the compiler could compile for it. */
int z2p_has_avx512(int *has_avx512) {
#ifdef WIDEST
    *has_avx512 = __builtin_cpu_supports("x86-64-v4") != 0;
#else
    *has_avx512 = 0;
#endif
    return 1;
}
