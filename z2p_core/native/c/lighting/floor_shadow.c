/* The shadow on the floor as the camera sees it: resamples the floor's occlusion grids into the image. Input: occlusion
 * of the area light, of the sky and of the floor's reflection, and the cloud's radiance, as grids over the floor;
 * output: the alpha of a shadow layer. */

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "common/simd.h"
#include "lighting/floor.h"

#define NODE_PIXELS 16 /* pixels between those at which light and specular albedo are evaluated; linear between them */

/* Camera of the image, and cells per side of the grids. Mirrored by z2p_core/native/lighting.py. */
typedef struct {
    float rotation[3][3], position[3], focal; /* world to camera: rows right, down, forward; focal length in pixels */
    int width, height;
    int occlusion_side, reflection_side, cloud_side;
} FloorShadowView;

/* The horizontal axes that the camera's image rows and columns lie along, turned against those of the grids. */
typedef struct {
    float cosine, sine;
} Turn;

/* One row of a grid (side, side) that is turned about its center: linear between cell centers, 0 outside. */
INLINE void interpolate_turned(const float *restrict grid, int side, float row, Turn turn, float *restrict out) {
    float middle = 0.5f * (float)(side - 1), most = (float)side - 1;
    float first_column = middle - turn.cosine * middle - turn.sine * (row - middle);
    float first_row = middle - turn.sine * middle + turn.cosine * (row - middle);
    for (int i = 0; i < side; i++) {
        float x = first_column + (float)i * turn.cosine, y = first_row + (float)i * turn.sine;
        int inside = (x >= 0) & (y >= 0) & (x < most) & (y < most);
        int left = inside ? (int)x : 0, top = inside ? (int)y : 0;
        float right_share = x - (float)left, lower_share = y - (float)top;
        const float *upper = grid + (size_t)top * side + left, *lower = upper + side;
        float above = upper[0] * (1 - right_share) + upper[1] * right_share;
        float below = lower[0] * (1 - right_share) + lower[1] * right_share;
        out[i] = inside ? above * (1 - lower_share) + below * lower_share : 0;
    }
}

/* One row of a grid (side, side) at a fractional row index: linear between cell centers, 0 outside. */
INLINE void interpolate_rows(const float *restrict grid, int side, float row, Turn turn, float *restrict out) {
    if (turn.sine != 0 || turn.cosine < 0) {
        interpolate_turned(grid, side, row, turn, out);
        return;
    }
    int top = (int)floorf(row), inside = row >= 0 && row < (float)side - 1;
    float y = row - (float)top;
    const float *at = grid + (size_t)(inside ? top : 0) * side;
    for (int x = 0; x < side; x++) out[x] = inside ? at[x] * (1 - y) + at[side + x] * y : 0;
}

/* Value of such a row at a fractional column index, likewise. */
INLINE float sample_line(const float *restrict line, int side, float column) {
    int inside = (column >= 0) & (column < (float)side - 1), left = inside ? (int)column : 0;
    float x = column - (float)left;
    return inside ? line[left] * (1 - x) + line[left + 1] * x : 0;
}

/* Bounds left, right, top and bottom, widened by a cell, of the cells where either grid (side, side) is positive. */
INLINE void shadow_bounds(const float *restrict first, const float *restrict second, int side, float *bounds) {
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

/* Turns bounds of cells of a grid (side, side) to those of the box around them in the turned grid. */
INLINE void turn_bounds(Turn turn, int side, float *bounds) {
    float middle = 0.5f * (float)(side - 1), x = 0.5f * (bounds[0] + bounds[1]) - middle;
    float y = 0.5f * (bounds[2] + bounds[3]) - middle;
    float width = 0.5f * (bounds[1] - bounds[0]), height = 0.5f * (bounds[3] - bounds[2]);
    float turned_x = turn.cosine * x + turn.sine * y + middle, turned_y = -turn.sine * x + turn.cosine * y + middle;
    float turned_width = fabsf(turn.cosine) * width + fabsf(turn.sine) * height;
    float turned_height = fabsf(turn.sine) * width + fabsf(turn.cosine) * height;
    if (width < 0 || height < 0) return; /* no cell is positive */
    bounds[0] = turned_x - turned_width;
    bounds[1] = turned_x + turned_width;
    bounds[2] = turned_y - turned_height;
    bounds[3] = turned_y + turned_height;
}

/* Directional albedo of the specular lobe of Blender's default material (Principled BSDF, roughness 0.5, index of
 * refraction 1.5): a polynomial fit, right to 0.003. */
INLINE float specular_albedo(float n_dot_v) {
    float grazing = 1 - n_dot_v, grazing_sq = grazing * grazing;
    return 0.0368f + grazing_sq * (0.1133f + 0.073f * grazing_sq * grazing);
}

/* Unoccluded light on the floor, and the floor's specular albedo, at every NODE_PIXELS-th pixel of a row. The first
 * pixel sees the floor at (x, y) along the turned axes, the others `step` apart along x; on the image plane at depth 1
 * that is (left, up), and `pixel` apart. ray_z is the height that rays gain on their way to that plane. */
INLINE void light_row(const FloorLight *floor, Turn turn, float x, float y, float step, float left, float up,
                      float pixel, float ray_z, int nodes, float *restrict light, float *restrict specular) {
    for (int n = 0; n < nodes; n++) {
        float at = (float)(n * NODE_PIXELS), across = left + at * pixel;
        specular[n] = specular_albedo(-ray_z / sqrtf(1 + across * across + up * up));
        float right = x + at * step;
        light[n] = unoccluded_light(floor, turn.cosine * right - turn.sine * y, turn.sine * right + turn.cosine * y);
    }
}

/* Writes alpha (height, width): the share of the floor's radiance that is missing at each pixel, 0 where the floor is
 * not visible. Grids over the floor: occlusion of the area light and of the sky (occlusion_side^2), occlusion of what
 * the floor reflects (reflection_side^2), see z2p_floor_occlusion, and the cloud's mean radiance as seen from the floor
 * (cloud_side^2). The camera's x axis is horizontal, so each row of pixels sees the floor along a row of its grids, or
 * of grids that are turned to the camera's axis. */
FAST int z2p_floor_shadow(const float *light_occlusion, const float *sky_occlusion, const float *reflection_occlusion,
                          const float *cloud_radiance, const FloorLight *floor, const FloorShadowView *view,
                          float *alpha) {
    int side = view->occlusion_side, reflection_side = view->reflection_side, cloud_side = view->cloud_side;
    int width = view->width, height = view->height;
    const float *rotation = view->rotation[0], *position = view->position;
    float focal = view->focal, half = floor->half_size, scale = (float)side / (2 * half), bounds[4];
    float to_reflection = (float)reflection_side / (float)side, to_cloud = (float)cloud_side / (float)side;
    Turn turn = {rotation[0], rotation[1]};
    float across = turn.cosine * position[0] + turn.sine * position[1]; /* of the camera, along the turned axes */
    float ahead = turn.cosine * position[1] - turn.sine * position[0];
    float down_ahead = turn.cosine * rotation[4] - turn.sine * rotation[3];
    float forward_ahead = turn.cosine * rotation[7] - turn.sine * rotation[6];
    int nodes = width / NODE_PIXELS + 2;
    size_t room = 2 * (size_t)side + (size_t)reflection_side + (size_t)cloud_side + 2 * (size_t)nodes;
    float *light_line = malloc(sizeof(float) * room);
    float *sky_line = light_line + side, *reflection_line = sky_line + side;
    float *cloud_line = reflection_line + reflection_side;
    float *lights = cloud_line + cloud_side, *speculars = lights + nodes;
    if (!light_line) return 0;
    shadow_bounds(light_occlusion, sky_occlusion, side, bounds);
    turn_bounds(turn, side, bounds);
    memset(alpha, 0, sizeof(float) * (size_t)width * height);
    for (int v = 0; v < height; v++) {
        float y = ((float)v + 0.5f - 0.5f * (float)height) / focal, ray_z = y * rotation[5] + rotation[8];
        if (ray_z > -1e-6f) continue; /* at the horizon or above it */
        float distance = (floor->height - position[2]) / ray_z;
        if (!(distance > 1e-6f)) continue; /* the camera is on the floor or below it */
        float row = (ahead + distance * (y * down_ahead + forward_ahead) + half) * scale - 0.5f;
        if (!(row > bounds[2] && row < bounds[3])) continue;
        float step = distance / focal * scale, start = (across + half) * scale - 0.5f;
        start += (0.5f - 0.5f * (float)width) * step; /* column of the grids at the first pixel */
        int from = (int)smaller(larger(ceilf((bounds[0] - start) / step), 0), (float)width);
        int to = (int)larger(smaller(floorf((bounds[1] - start) / step), (float)width - 1), -1);
        interpolate_rows(light_occlusion, side, row, turn, light_line);
        interpolate_rows(sky_occlusion, side, row, turn, sky_line);
        float reflection_row = (row + 0.5f) * to_reflection - 0.5f;
        interpolate_rows(reflection_occlusion, reflection_side, reflection_row, turn, reflection_line);
        interpolate_rows(cloud_radiance, cloud_side, (row + 0.5f) * to_cloud - 0.5f, turn, cloud_line);
        float *out = alpha + (size_t)v * width, left = (0.5f - 0.5f * (float)width) / focal;
        light_row(floor, turn, (start + 0.5f) / scale - half, (row + 0.5f) / scale - half, step / scale, left, y,
                  1 / focal, ray_z, nodes, lights, speculars);
        for (int u = from; u <= to; u++) {
            float column = start + (float)u * step, t = (float)(u % NODE_PIXELS) / NODE_PIXELS;
            float occluded_light = sample_line(light_line, side, column);
            float occluded_sky = sample_line(sky_line, side, column);
            float occluded_reflection =
                sample_line(reflection_line, reflection_side, (column + 0.5f) * to_reflection - 0.5f);
            /* an occluder hides the sky, but sends light itself */
            float lost = floor->sky_radiance - sample_line(cloud_line, cloud_side, (column + 0.5f) * to_cloud - 0.5f);
            float light = lights[u / NODE_PIXELS] * (1 - t) + lights[u / NODE_PIXELS + 1] * t;
            float specular = speculars[u / NODE_PIXELS] * (1 - t) + speculars[u / NODE_PIXELS + 1] * t;
            float diffuse = floor->albedo * (1 - specular);
            float missing = diffuse * (light * occluded_light + lost * occluded_sky)
                + specular * lost * occluded_reflection;
            out[u] = missing > 0
                ? missing / (diffuse * (light + floor->sky_radiance) + specular * floor->sky_radiance) : 0;
        }
    }
    free(light_line);
    return 1;
}
