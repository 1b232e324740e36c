/* The floor under the cloud and the light on it: eleven floats, then grids (side, side) of its square, which reaches
 * `half` to every side of the origin. */

#include <math.h>
#include <stddef.h>

#include "fast.h"

#define WHITE_OVER_PI 0.31830989f

typedef struct {
    float height, half;
    float lamp[3], axis[3], power; /* the light's place, unit axis and power */
    float sky, albedo;             /* radiance of the sky; what the floor sends back */
} Floor;

/* Radiance of a white floor at a place under the lamp alone, with nothing to hide it. */
INLINE float lamp_on_floor(const Floor *floor, float x, float y) {
    float d[3] = {floor->lamp[0] - x, floor->lamp[1] - y, floor->lamp[2] - floor->height};
    float square = d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
    float shining = -(d[0] * floor->axis[0] + d[1] * floor->axis[1] + d[2] * floor->axis[2]);
    return WHITE_OVER_PI * floor->power * (shining > 0 ? shining : 0) * d[2] / (square * square);
}
