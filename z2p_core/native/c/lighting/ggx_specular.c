/* What rough surfaces mirror of lamps. */

#include <math.h>
#include <stddef.h>

#include "common/simd.h"

#define BLOCK 64         /* points that are lit at a time: they stay in the core's registers and its nearest cache */
#define PI 3.14159265f
#define GRAZING 0.03f    /* cosine to the viewer, at least: normals that are found are not so sure beyond it */

#define WIDTH 1.7f       /* of an image's edges, for a logistic curve in place of the normal one */

/* Some points, their unit normals and the unit directions to the viewer, axis by axis; the cosine between these, and
 * what it has of the surface hiding itself; and what the lamps' light has come to. */
typedef struct {
    float point[3][BLOCK], normal[3][BLOCK], towards[3][BLOCK], facing[BLOCK], hiding[BLOCK];
    float mirrored[BLOCK], of_metal[BLOCK], of_plastic[BLOCK], matt[BLOCK];
} Block;

/* How far what plastic reflects has risen at a cosine, from 0 straight ahead to 1 at a grazing angle: Fresnel's term as
 * Walter et al. (2007) write it, equation 22. `more` is the square of its index of refraction, less 1. */
INLINE float plastic_rise(float cosine, float more, float ahead) {
    float g = sqrtf(more + cosine * cosine), across = (g - cosine) / (g + cosine);
    float along = (cosine * (g + cosine) - 1) / (cosine * (g - cosine) + 1);
    return (0.5f * across * across * (1 + along * along) - ahead) / (1 - ahead);
}

/* The same of metal, as Schlick has it. */
INLINE float metal_rise(float cosine) {
    float grazing = 1 - cosine, twice = grazing * grazing;
    return twice * twice * grazing;
}

INLINE float straight_ahead(float index) { return (index - 1) * (index - 1) / ((index + 1) * (index + 1)); }

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
        block->mirrored[i] = block->of_metal[i] = block->of_plastic[i] = block->matt[i] = 0;
    }
}

/* Adds a lamp's light. Of the microfacets, GGX with the height-correlated hiding of Smith (Heitz, Understanding the
 * Masking-Shadowing Function, 2014), those count that mirror the lamp to the viewer. Plain arithmetic, for vectors. */
INLINE void add_lamp(Block *restrict block, const float *lamp, const float *axis, float power, float square,
                     float index) {
    float more = index * index - 1, ahead = straight_ahead(index);
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
        upright *= inverse, met = larger(met * inverse, 0);
        above = larger(above, 0);
        float fall = upright * upright * (square - 1) + 1, hidden = above * block->hiding[i]
            + facing * sqrtf(above * above * (1 - square) + square);
        float given = power * above * larger(shining, 0) * near * near;
        float found = given * square / (2 * PI * fall * fall * larger(hidden, 1e-4f));
        block->mirrored[i] += found;
        block->of_metal[i] += found * metal_rise(met);
        block->of_plastic[i] += found * plastic_rise(met, more, ahead);
        block->matt[i] += given / PI;
    }
}

/* shine (count, 3) of points from `begin` to `end` - 1, as radiances: what a surface of that roughness alpha, alpha^2 =
 * `square`, mirrors of the lamps to the viewer, if it mirrored all; and how much of it is left by metal's rise to a
 * grazing angle, and by plastic's of that index of refraction. matt (count): what a matt white surface has of them.
 * Nothing hides the lamps (lamp_count, 3), each of that power, that shine along the unit `axis`. `towards` (count, 3)
 * are unit directions to the viewer. */
FAST int z2p_gloss(const float *points, const float *normals, const float *towards, int begin, int end,
                   const float *lamps, int lamp_count, const float *axis, float power, float square, float index,
                   float *shine, float *matt) {
    Block block;
    for (int first = begin; first < end; first += BLOCK) {
        fill_block(&block, points, normals, towards, first, end, square);
        for (int l = 0; l < lamp_count; l++) add_lamp(&block, lamps + 3 * l, axis, power, square, index);
        for (int i = 0; i < BLOCK && first + i < end; i++) {
            float *out = shine + 3 * (size_t)(first + i);
            out[0] = block.mirrored[i], out[1] = block.of_metal[i], out[2] = block.of_plastic[i];
            matt[first + i] = block.matt[i];
        }
    }
    return 1;
}

/* Share of a blurred edge that lies on this side of a place; `sharp` is one over the blur's standard deviation. */
INLINE float edge(float place, float sharp) { return 1 / (1 + exp_fast(-WIDTH * sharp * place)); }

/* Images in a block of a square light, its middle and its two sides (9), and all its radiance. */
INLINE void add_image(Block *restrict block, const float *light, float radiance, float blur, float index) {
    const float *across = light + 3, *up = light + 6;
    float axis[3] = {across[1] * up[2] - across[2] * up[1], across[2] * up[0] - across[0] * up[2],
                     across[0] * up[1] - across[1] * up[0]};
    float wide = sqrtf(dot(across, across)), high = sqrtf(dot(up, up)), more = index * index - 1;
    float ahead = straight_ahead(index), back = dot(light, axis) < 0 ? -1.0f : 1.0f; /* it shines towards the origin */
    for (int i = 0; i < BLOCK; i++) {
        float ray[3], off[3], towards_it = 0, left = 0, x = 0, y = 0, facing = block->facing[i];
        for (int a = 0; a < 3; a++) {
            ray[a] = 2 * facing * block->normal[a][i] - block->towards[a][i];
            off[a] = light[a] - block->point[a][i];
            towards_it += back * ray[a] * axis[a];
            left += back * off[a] * axis[a];
        }
        float reach = left / larger(towards_it, 1e-6f);
        for (int a = 0; a < 3; a++) {
            float place = reach * ray[a] - off[a];
            x += place * across[a] / wide, y += place * up[a] / high;
        }
        float sharp = 1 / (blur * larger(reach, 1e-3f));
        float inside = (edge(x + 0.5f * wide, sharp) - edge(x - 0.5f * wide, sharp))
            * (edge(y + 0.5f * high, sharp) - edge(y - 0.5f * high, sharp));
        float found = (towards_it > 0) & (left > 0) ? radiance * inside : 0;
        block->mirrored[i] = found;
        block->of_metal[i] = found * metal_rise(facing);
        block->of_plastic[i] = found * plastic_rise(facing, more, ahead);
    }
}

/* shine (count, 3) as z2p_gloss says it, of surfaces so smooth that they show the light's image: a square of that
 * radiance, `light` (9) its middle and its two sides, whose edges are blurred by `blur` of the way to it (a standard
 * deviation). */
FAST int z2p_image(const float *points, const float *normals, const float *towards, int begin, int end,
                   const float *light, float radiance, float blur, float index, float *shine) {
    Block block;
    for (int first = begin; first < end; first += BLOCK) {
        fill_block(&block, points, normals, towards, first, end, 0);
        add_image(&block, light, radiance, blur, index);
        for (int i = 0; i < BLOCK && first + i < end; i++) {
            float *out = shine + 3 * (size_t)(first + i);
            out[0] = block.mirrored[i], out[1] = block.of_metal[i], out[2] = block.of_plastic[i];
        }
    }
    return 1;
}
