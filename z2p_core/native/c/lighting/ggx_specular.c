/* Specular reflection of an area light by rough and smooth surfaces, towards the viewer. Input: points, unit normals,
 * view directions and the light; output: reflected radiance, in parts from which the caller blends Fresnel reflection
 * for any f0 and f90.
 *
 * BRDF = D F G2 / (4 n_dot_l n_dot_v) with the GGX distribution D (Walter et al., "Microfacet Models for Refraction
 * through Rough Surfaces", 2007) and the height-correlated Smith term G2 (Heitz, "Understanding the Masking-Shadowing
 * Function in Microfacet-Based BRDFs", 2014). F = f0 + (f90 - f0) w(v_dot_h), with a normalized Fresnel curve w from 0
 * at normal to 1 at grazing incidence: Schlick's for metals, the exact one for dielectrics. alpha_sq is alpha^2, alpha
 * the GGX roughness. numpy counterpart: z2p_core/shading/microfacet.py; tests compare the two. */

#include <math.h>
#include <stddef.h>

#include "common/vec3.h"

#define BLOCK 64           /* points that are shaded at a time: they stay in registers and the nearest cache */
#define MIN_N_DOT_V 0.03f   /* estimated normals are not certain enough for smaller cosines to the viewer */
#define LOGISTIC_SLOPE 1.7f /* scales the logistic function to approximate the normal distribution's */

/* A block of points, axis by axis: positions, unit normals and view directions; n_dot_v; smith_v, the square root in
 * the Smith term for the view direction; and sums over light samples: radiance reflected at F = 1, the same weighted by
 * the normalized Fresnel curves of metals and of dielectrics, and radiance of a white diffuse surface. */
typedef struct {
    float point[3][BLOCK], normal[3][BLOCK], view_dir[3][BLOCK], n_dot_v[BLOCK], smith_v[BLOCK];
    float reflected[BLOCK], metal_fresnel[BLOCK], dielectric_fresnel[BLOCK], diffuse[BLOCK];
} Block;

/* Unpolarized Fresnel reflectance of a dielectric (Walter et al. 2007, equation 22), normalized to 0 at normal and 1 at
 * grazing incidence: (F - f0) / (1 - f0). ior_sq_minus_1 is ior^2 - 1, ior the index of refraction. */
INLINE float normalized_dielectric_fresnel(float cosine, float ior_sq_minus_1, float f0) {
    float g = sqrtf(ior_sq_minus_1 + cosine * cosine), s = (g - cosine) / (g + cosine);
    float p = (cosine * (g + cosine) - 1) / (cosine * (g - cosine) + 1);
    return (0.5f * s * s * (1 + p * p) - f0) / (1 - f0);
}

/* Schlick's (1 - cosine)^5 (Schlick, "An Inexpensive BRDF Model for Physically-Based Rendering", 1994). */
INLINE float schlick_weight(float cosine) {
    float grazing = 1 - cosine, grazing_sq = grazing * grazing;
    return grazing_sq * grazing_sq * grazing;
}

INLINE float f0_from_ior(float ior) { return (ior - 1) * (ior - 1) / ((ior + 1) * (ior + 1)); }

/* Square root in the Smith term, cosine sqrt(1 + alpha^2 tan^2): Smith's Lambda is (smith_root / cosine - 1) / 2. */
INLINE float smith_root(float cosine, float alpha_sq) {
    return sqrtf(cosine * cosine * (1 - alpha_sq) + alpha_sq);
}

/* Loads points from row `begin` on; beyond `end`, the last one again. */
INLINE void load_block(Block *block, const float *points, const float *normals, const float *view_dirs, int begin,
                       int end, float alpha_sq) {
    for (int i = 0; i < BLOCK; i++) {
        size_t at = 3 * (size_t)(begin + i < end ? begin + i : end - 1);
        for (int a = 0; a < 3; a++) {
            block->point[a][i] = points[at + a];
            block->normal[a][i] = normals[at + a];
            block->view_dir[a][i] = view_dirs[at + a];
        }
        float n_dot_v = larger(dot(normals + at, view_dirs + at), MIN_N_DOT_V);
        block->n_dot_v[i] = n_dot_v;
        block->smith_v[i] = smith_root(n_dot_v, alpha_sq);
        block->reflected[i] = block->metal_fresnel[i] = block->dielectric_fresnel[i] = block->diffuse[i] = 0;
    }
}

/* Adds what a light sample contributes. Without a branch, so that the loop becomes vector code. */
INLINE void add_light_sample(Block *restrict block, const float *light, const float *axis, float power, float alpha_sq,
                             float ior) {
    float ior_sq_minus_1 = ior * ior - 1, f0 = f0_from_ior(ior);
    for (int i = 0; i < BLOCK; i++) {
        float light_dir[3], half[3], distance_sq = 0, n_dot_l = 0, cos_at_light = 0, half_sq = 0;
        float n_dot_h = 0, v_dot_h = 0;
        for (int a = 0; a < 3; a++) {
            light_dir[a] = light[a] - block->point[a][i];
            distance_sq += light_dir[a] * light_dir[a];
        }
        float inverse_distance = 1 / sqrtf(distance_sq);
        for (int a = 0; a < 3; a++) {
            light_dir[a] *= inverse_distance;
            half[a] = light_dir[a] + block->view_dir[a][i];
            n_dot_l += light_dir[a] * block->normal[a][i];
            cos_at_light -= light_dir[a] * axis[a];
            half_sq += half[a] * half[a];
            n_dot_h += half[a] * block->normal[a][i];
            v_dot_h += half[a] * block->view_dir[a][i];
        }
        float inverse_half = 1 / sqrtf(larger(half_sq, 1e-12f)), n_dot_v = block->n_dot_v[i];
        n_dot_h *= inverse_half, v_dot_h = larger(v_dot_h * inverse_half, 0);
        n_dot_l = larger(n_dot_l, 0);
        /* D = alpha^2 / (pi d_root^2) and G2 / (4 n_dot_l n_dot_v) = 1 / (2 smith) */
        float d_root = n_dot_h * n_dot_h * (alpha_sq - 1) + 1, smith = n_dot_l * block->smith_v[i]
            + n_dot_v * smith_root(n_dot_l, alpha_sq);
        float irradiance = power * n_dot_l * larger(cos_at_light, 0) * inverse_distance * inverse_distance;
        float radiance = irradiance * alpha_sq / (2 * PI * d_root * d_root * larger(smith, 1e-4f));
        block->reflected[i] += radiance;
        block->metal_fresnel[i] += radiance * schlick_weight(v_dot_h);
        block->dielectric_fresnel[i] += radiance * normalized_dielectric_fresnel(v_dot_h, ior_sq_minus_1, f0);
        block->diffuse[i] += irradiance / PI;
    }
}

/* For the points [begin, end): writes specular (count, 3), the radiance that a surface of GGX roughness alpha reflects
 * to view_dirs (count, 3), unit vectors, from unoccluded light samples: at F = 1; the same weighted by Schlick's curve;
 * and weighted by the normalized Fresnel curve of a dielectric with index of refraction `ior`. And diffuse (count),
 * the radiance of a white diffuse surface. Light samples have positions (light_count, 3), one power and one unit axis
 * (3), along which they emit. */
FAST int z2p_specular_radiance(const float *points, const float *normals, const float *view_dirs, int begin, int end,
                               const float *light_positions, int light_count, const float *light_axis, float power,
                               float alpha_sq, float ior, float *specular, float *diffuse) {
    Block block;
    for (int first = begin; first < end; first += BLOCK) {
        load_block(&block, points, normals, view_dirs, first, end, alpha_sq);
        for (int l = 0; l < light_count; l++)
            add_light_sample(&block, light_positions + 3 * l, light_axis, power, alpha_sq, ior);
        for (int i = 0; i < BLOCK && first + i < end; i++) {
            float *out = specular + 3 * (size_t)(first + i);
            out[0] = block.reflected[i], out[1] = block.metal_fresnel[i], out[2] = block.dielectric_fresnel[i];
            diffuse[first + i] = block.diffuse[i];
        }
    }
    return 1;
}

/* Share of a blurred edge that lies below a position; inverse_sigma is one over the blur's standard deviation. */
INLINE float blurred_edge(float position, float inverse_sigma) {
    return 1 / (1 + exp_fast(-LOGISTIC_SLOPE * inverse_sigma * position));
}

/* Sets the reflection of a parallelogram light, given by its center and two edge vectors (3, 3), in a block. */
INLINE void reflect_area_light(Block *restrict block, const float *light, float radiance, float blur, float ior) {
    const float *u = light + 3, *v = light + 6;
    float axis[3];
    cross(u, v, axis);
    float width = sqrtf(dot(u, u)), height = sqrtf(dot(v, v)), ior_sq_minus_1 = ior * ior - 1;
    float f0 = f0_from_ior(ior), sign = dot(light, axis) < 0 ? -1.0f : 1.0f; /* the light faces the origin */
    for (int i = 0; i < BLOCK; i++) {
        float ray[3], offset[3], ray_along_axis = 0, offset_along_axis = 0, x = 0, y = 0, n_dot_v = block->n_dot_v[i];
        for (int a = 0; a < 3; a++) {
            ray[a] = 2 * n_dot_v * block->normal[a][i] - block->view_dir[a][i];
            offset[a] = light[a] - block->point[a][i];
            ray_along_axis += sign * ray[a] * axis[a];
            offset_along_axis += sign * offset[a] * axis[a];
        }
        float distance = offset_along_axis / larger(ray_along_axis, 1e-6f);
        for (int a = 0; a < 3; a++) {
            float from_center = distance * ray[a] - offset[a];
            x += from_center * u[a] / width, y += from_center * v[a] / height;
        }
        float inverse_sigma = 1 / (blur * larger(distance, 1e-3f));
        float inside = (blurred_edge(x + 0.5f * width, inverse_sigma) - blurred_edge(x - 0.5f * width, inverse_sigma))
            * (blurred_edge(y + 0.5f * height, inverse_sigma) - blurred_edge(y - 0.5f * height, inverse_sigma));
        float reflected = (ray_along_axis > 0) & (offset_along_axis > 0) ? radiance * inside : 0;
        block->reflected[i] = reflected;
        block->metal_fresnel[i] = reflected * schlick_weight(n_dot_v);
        block->dielectric_fresnel[i] = reflected * normalized_dielectric_fresnel(n_dot_v, ior_sq_minus_1, f0);
    }
}

/* For the points [begin, end): writes specular (count, 3) as z2p_specular_radiance does, for surfaces so smooth that
 * the light's outline is recognizable: the mirror image of a square light (center and two edge vectors, 3 x 3) of that
 * radiance, with edges blurred by a standard deviation of `blur` times the distance to it. */
FAST int z2p_sharp_light_reflection(const float *points, const float *normals, const float *view_dirs, int begin,
                                    int end, const float *light, float radiance, float blur, float ior,
                                    float *specular) {
    Block block;
    for (int first = begin; first < end; first += BLOCK) {
        load_block(&block, points, normals, view_dirs, first, end, 0);
        reflect_area_light(&block, light, radiance, blur, ior);
        for (int i = 0; i < BLOCK && first + i < end; i++) {
            float *out = specular + 3 * (size_t)(first + i);
            out[0] = block.reflected[i], out[1] = block.metal_fresnel[i], out[2] = block.dielectric_fresnel[i];
        }
    }
    return 1;
}
