/* The shadow on the floor, drawn as a camera sees it. */

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "common/simd.h"
#include "lighting/floor.h"

#define STEP 16 /* pixels between those for which smooth light is worked out */

/* A row of a floor grid (side, side) at any height, linear between the cells' centres; 0 outside. */
INLINE void blend_rows(const float *restrict grid, int side, float row, float *restrict out) {
    int top = (int)floorf(row), inside = row >= 0 && row < (float)side - 1;
    float y = row - (float)top;
    const float *at = grid + (size_t)(inside ? top : 0) * side;
    for (int x = 0; x < side; x++) out[x] = inside ? at[x] * (1 - y) + at[side + x] * y : 0;
}

/* Value of such a row at a place, likewise. */
INLINE float sample(const float *restrict line, int side, float column) {
    int inside = (column >= 0) & (column < (float)side - 1), left = inside ? (int)column : 0;
    float x = column - (float)left;
    return inside ? line[left] * (1 - x) + line[left + 1] * x : 0;
}

/* Bounds left, right, top and bottom, a cell wider, of the cells where either grid (side, side) is above 0. */
INLINE void shaded_part(const float *restrict first, const float *restrict second, int side, float *bounds) {
    int left = side, right = -1, top = side, bottom = -1;
    for (int y = 0; y < side; y++) {
        const float *one = first + (size_t)y * side, *other = second + (size_t)y * side;
        int any = 0, from = 0, to = side - 1;
        for (int x = 0; x < side; x++) any |= one[x] + other[x] > 0;
        if (!any) continue;
        if (top == side) top = y;
        bottom = y;
        while (one[from] + other[from] <= 0) from++;
        while (one[to] + other[to] <= 0) to--;
        if (from < left) left = from;
        if (to > right) right = to;
    }
    bounds[0] = (float)left - 1;
    bounds[1] = (float)right + 1;
    bounds[2] = (float)top - 1;
    bounds[3] = (float)bottom + 1;
}

/* What a floor as Blender makes it without a material (a Principled BSDF: roughness 0.5, index of refraction 1.5) sends
 * to an eye like a blurred mirror: a fit of the directional albedo of its GGX lobe, to 0.003. */
INLINE float mirrored(float cosine) {
    float grazing = 1 - cosine, square = grazing * grazing;
    return 0.0368f + square * (0.1133f + 0.073f * square * grazing);
}

/* The lamp's light on the floor at every STEP-th pixel of a row, and the share that the floor mirrors there. The first
 * pixel lies at (x, y) on the floor, the others `step` apart along X; on a screen at depth 1 that is (left, up), and
 * `pixel` apart. `fall` is the height that rays lose on their way to the screen. */
INLINE void light_row(const Floor *floor, float x, float y, float step, float left, float up, float pixel, float fall,
                      int nodes, float *restrict lamp, float *restrict mirror) {
    for (int n = 0; n < nodes; n++) {
        float at = (float)(n * STEP), aside = left + at * pixel;
        mirror[n] = mirrored(-fall / sqrtf(1 + aside * aside + up * up));
        lamp[n] = lamp_on_floor(floor, x + at * step, y);
    }
}

/* alpha (height, width): the share of the floor's light that is missing at each pixel, 0 where no floor is seen. Grids
 * say how much of the lamp's and the sky's light is hidden (side, side), and of what the floor mirrors (half_side,
 * half_side; see z2p_floor_shade); and the cloud's mean radiance as seen from there (coarse, coarse). rotation (3, 3),
 * whose first row is the X axis, and place (3) are the camera's. So each row of pixels sees the floor along a line of
 * its grids. */
FAST int z2p_floor_shadow(const float *lamp_shade, const float *sky_shade, int side, const float *mirror_shade,
                          int half_side, const float *cloud, int coarse, const Floor *floor, const float *rotation,
                          const float *place, float focal, int width, int height, float *alpha) {
    float half = floor->half, scale = (float)side / (2 * half), part[4];
    float to_half = (float)half_side / (float)side, to_coarse = (float)coarse / (float)side;
    int nodes = width / STEP + 2;
    size_t room = 2 * (size_t)side + (size_t)half_side + (size_t)coarse + 2 * (size_t)nodes;
    float *lamp_line = malloc(sizeof(float) * room);
    float *sky_line = lamp_line + side, *mirror_line = sky_line + side, *cloud_line = mirror_line + half_side;
    float *lamps = cloud_line + coarse, *mirrors = lamps + nodes;
    if (!lamp_line) return 0;
    shaded_part(lamp_shade, sky_shade, side, part);
    memset(alpha, 0, sizeof(float) * (size_t)width * height);
    for (int v = 0; v < height; v++) {
        float y = ((float)v + 0.5f - 0.5f * (float)height) / focal, fall = y * rotation[5] + rotation[8];
        if (fall > -1e-6f) continue; /* at the horizon or above it */
        float reach = (floor->height - place[2]) / fall;
        if (!(reach > 1e-6f)) continue; /* the eye is on the floor or below it */
        float row = (place[1] + reach * (y * rotation[4] + rotation[7]) + half) * scale - 0.5f;
        if (!(row > part[2] && row < part[3])) continue;
        float step = reach / focal * scale, start = (place[0] + half) * scale - 0.5f;
        start += (0.5f - 0.5f * (float)width) * step; /* the first pixel's column of the grids */
        int from = (int)smaller(larger(ceilf((part[0] - start) / step), 0), (float)width);
        int to = (int)larger(smaller(floorf((part[1] - start) / step), (float)width - 1), -1);
        blend_rows(lamp_shade, side, row, lamp_line);
        blend_rows(sky_shade, side, row, sky_line);
        blend_rows(mirror_shade, half_side, (row + 0.5f) * to_half - 0.5f, mirror_line);
        blend_rows(cloud, coarse, (row + 0.5f) * to_coarse - 0.5f, cloud_line);
        float *out = alpha + (size_t)v * width, left = (0.5f - 0.5f * (float)width) / focal;
        light_row(floor, (start + 0.5f) / scale - half, (row + 0.5f) / scale - half, step / scale, left, y, 1 / focal,
                  fall, nodes, lamps, mirrors);
        for (int u = from; u <= to; u++) {
            float column = start + (float)u * step, far = (float)(u % STEP) / STEP;
            float hidden_lamp = sample(lamp_line, side, column), hidden_sky = sample(sky_line, side, column);
            float hidden_mirror = sample(mirror_line, half_side, (column + 0.5f) * to_half - 0.5f);
            float darker = floor->sky - sample(cloud_line, coarse, (column + 0.5f) * to_coarse - 0.5f);
            float lamp = lamps[u / STEP] * (1 - far) + lamps[u / STEP + 1] * far;
            float mirror = mirrors[u / STEP] * (1 - far) + mirrors[u / STEP + 1] * far;
            float matt = floor->albedo * (1 - mirror);
            float missing = matt * (lamp * hidden_lamp + darker * hidden_sky) + mirror * darker * hidden_mirror;
            out[u] = missing > 0 ? missing / (matt * (lamp + floor->sky) + mirror * floor->sky) : 0;
        }
    }
    free(lamp_line);
    return 1;
}
