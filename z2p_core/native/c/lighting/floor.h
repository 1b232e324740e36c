/* The floor under the cloud and the light on it: twenty floats. Grids (side, side) are of its square, which reaches `half`
 * to every side of the origin. */

#include <math.h>
#include <stddef.h>

#include "common/simd.h"

#define WHITE_OVER_PI 0.31830989f

typedef struct {
    float height, half;
    float lamps[4][3], axis[3], power; /* four places that stand for the light, their unit axis, and all its power */
    float sky, albedo;                 /* radiance of the sky; what the floor sends back */
} Floor;

/* Radiance of a white floor at a place under the light alone, with nothing to hide it. */
INLINE float lamp_on_floor(const Floor *floor, float x, float y) {
    float sum = 0;
    for (int l = 0; l < 4; l++) {
        const float *lamp = floor->lamps[l];
        float d[3] = {lamp[0] - x, lamp[1] - y, lamp[2] - floor->height};
        float square = d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
        float shining = -(d[0] * floor->axis[0] + d[1] * floor->axis[1] + d[2] * floor->axis[2]);
        sum += (shining > 0 ? shining : 0) * d[2] / (square * square);
    }
    return 0.25f * WHITE_OVER_PI * floor->power * sum;
}
