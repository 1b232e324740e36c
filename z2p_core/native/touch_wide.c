/* touch.c once more, for registers of sixteen numbers, with which it takes half as long. The same numbers come out. */

#include "fast.h"

#define LANES 16
#define z2p_touch z2p_touch_wide
#ifdef WIDEST
#undef FAST
#define FAST WIDEST
#endif

#include "touch.c"

/* Whether the processor has such registers, and the compiler knew how to use them. */
int z2p_is_wide(int *wide) {
#ifdef WIDEST
    *wide = __builtin_cpu_supports("x86-64-v4") != 0;
#else
    *wide = 0;
#endif
    return 1;
}
