/* The floor below the cloud and the light on it: shared by indirect_light.c and floor_shadow.c. Grids (side, side) of
 * the floor divide its square into cells, row by row along +y. */

#pragma once

#include <math.h>
#include <stddef.h>

#include "common/simd.h"

#define INVERSE_PI 0.31830989f /* as a double rounded to float */

/* World units; z is up. The floor's square is centered below the origin. Mirrored in native/lighting.py. */
typedef struct {
    float height, half_size;      /* z of the floor; half the length of its square's sides */
    float light_positions[4][3];  /* four samples of the area light */
    float light_axis[3];          /* unit axis along which it emits */
    float light_power, sky_radiance, albedo;
} FloorLight;

/* Radiance of a white diffuse floor at (x, y) lit by the area light alone, without shadows: irradiance / pi. */
INLINE float unoccluded_light(const FloorLight *floor, float x, float y) {
    float sum = 0;
    for (int l = 0; l < 4; l++) {
        const float *light = floor->light_positions[l];
        float d[3] = {light[0] - x, light[1] - y, light[2] - floor->height};
        float distance_sq = d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
        float along_axis = -(d[0] * floor->light_axis[0] + d[1] * floor->light_axis[1] + d[2] * floor->light_axis[2]);
        sum += (along_axis > 0 ? along_axis : 0) * d[2] / (distance_sq * distance_sq);
    }
    return 0.25f * INVERSE_PI * floor->light_power * sum;
}
