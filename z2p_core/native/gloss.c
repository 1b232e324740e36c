/* What rough surfaces mirror of lamps. */

#include <math.h>
#include <stddef.h>

#include "fast.h"

#define BLOCK 64         /* points that are lit at a time: they stay in the core's registers and its nearest cache */
#define PI 3.14159265f
#define GRAZING 0.03f    /* cosine to the viewer, at least: normals that are found are not so sure beyond it */

/* Some points, their unit normals and the unit directions to the viewer, axis by axis; the cosine between these, and
 * what it has of the surface hiding itself; and what the lamps' light has come to. */
typedef struct {
    float point[3][BLOCK], normal[3][BLOCK], towards[3][BLOCK], facing[BLOCK], hiding[BLOCK];
    float mirrored[BLOCK], grazed[BLOCK], matt[BLOCK];
} Block;

INLINE void fill_block(Block *block, const float *points, const float *normals, const float *towards, int begin,
                       int end, float square) {
    for (int i = 0; i < BLOCK; i++) {
        size_t at = 3 * (size_t)(begin + i < end ? begin + i : end - 1);
        for (int a = 0; a < 3; a++) {
            block->point[a][i] = points[at + a];
            block->normal[a][i] = normals[at + a];
            block->towards[a][i] = towards[at + a];
        }
        float facing = larger(dot(normals + at, towards + at), GRAZING);
        block->facing[i] = facing;
        block->hiding[i] = sqrtf(facing * facing * (1 - square) + square);
        block->mirrored[i] = block->grazed[i] = block->matt[i] = 0;
    }
}

/* Adds a lamp's light. Of the microfacets, GGX with the height-correlated hiding of Smith (Heitz, Understanding the
 * Masking-Shadowing Function, 2014), those count that mirror the lamp to the viewer. Plain arithmetic, for vectors. */
INLINE void add_lamp(Block *restrict block, const float *lamp, const float *axis, float power, float square) {
    for (int i = 0; i < BLOCK; i++) {
        float way[3], half[3], far = 0, above = 0, shining = 0, length = 0, upright = 0, met = 0;
        for (int a = 0; a < 3; a++) {
            way[a] = lamp[a] - block->point[a][i];
            far += way[a] * way[a];
        }
        float near = 1 / sqrtf(far);
        for (int a = 0; a < 3; a++) {
            way[a] *= near;
            half[a] = way[a] + block->towards[a][i];
            above += way[a] * block->normal[a][i];
            shining -= way[a] * axis[a];
            length += half[a] * half[a];
            upright += half[a] * block->normal[a][i];
            met += half[a] * block->towards[a][i];
        }
        float inverse = 1 / sqrtf(larger(length, 1e-12f)), facing = block->facing[i];
        upright *= inverse, met *= inverse;
        above = larger(above, 0);
        float fall = upright * upright * (square - 1) + 1, hidden = above * block->hiding[i]
            + facing * sqrtf(above * above * (1 - square) + square);
        float given = power * above * larger(shining, 0) * near * near;
        float found = given * square / (2 * PI * fall * fall * larger(hidden, 1e-4f));
        float grazing = 1 - met, twice = grazing * grazing;
        block->mirrored[i] += found;
        block->grazed[i] += found * twice * twice * grazing;
        block->matt[i] += given / PI;
    }
}

/* shine (count, 3) of points from `begin` to `end` - 1, as radiances: what a surface of that roughness alpha, alpha^2 =
 * `square`, mirrors of the lamps to the viewer, if it mirrored all; how much of it is left by Schlick's fifth power of
 * a grazing angle; and what a matt white one has of them. Nothing hides the lamps (lamp_count, 3), each of that power,
 * that shine along the unit `axis`. `towards` (count, 3) are unit directions to the viewer. */
FAST int z2p_gloss(const float *points, const float *normals, const float *towards, int begin, int end,
                   const float *lamps, int lamp_count, const float *axis, float power, float square, float *shine) {
    Block block;
    for (int first = begin; first < end; first += BLOCK) {
        fill_block(&block, points, normals, towards, first, end, square);
        for (int l = 0; l < lamp_count; l++) add_lamp(&block, lamps + 3 * l, axis, power, square);
        for (int i = 0; i < BLOCK && first + i < end; i++) {
            float *out = shine + 3 * (size_t)(first + i);
            out[0] = block.mirrored[i], out[1] = block.grazed[i], out[2] = block.matt[i];
        }
    }
    return 1;
}
