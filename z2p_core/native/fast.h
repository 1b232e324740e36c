/* FAST marks a function that is compiled twice, for plain and for wide registers; the processor chooses at load time. */

#if defined(__x86_64__) && defined(__GNUC__) && defined(__linux__)
#define FAST __attribute__((target_clones("arch=x86-64-v3", "default")))
#else
#define FAST
#endif

