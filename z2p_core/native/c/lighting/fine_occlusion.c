/* Occlusion by relief that is finer than the points for which light is computed: what hides sky and light from a point
 * within a small distance, found on the screen (after Bavoil, Sainz and Dimitrov, Image-space horizon-based ambient
 * occlusion, 2008).
 *
 * Points and normals are in camera axes, the latter facing the camera. An index (height, width) has the nearest point of
 * each cell of the screen, or -1. */

#include <math.h>
#include <stdint.h>
#include <stdlib.h>

#include "common/vec3.h"

#define DIRECTIONS 8        /* on the screen, in which the horizon is searched */
#define STEPS 5             /* in each of them */
#define STEP_GROWTH 1.7f    /* of a step's distance over that of the one before */
#define SKY_BIAS 0.12f      /* sine of an elevation below which a neighbor hides nothing: noise */
#define LIGHT_HALF_SINE 0.12f /* of the elevations over which an area light sets */

/* Size of the screen in cells, its focal length in cells, and how far away neighbors hide light. Mirrored by
 * z2p_core/native/lighting.py. */
typedef struct {
    int width, height;
    float focal, radius;
} FineScreen;

/* The cell of a position, -1 outside. */
INLINE int screen_cell(float x, float y, float z, const FineScreen *screen) {
    float scale = screen->focal / z;
    float column = x * scale + 0.5f * (float)screen->width, row = y * scale + 0.5f * (float)screen->height;
    int inside = z > 0 && column >= 0 && row >= 0 && column < (float)screen->width && row < (float)screen->height;
    return inside ? (int)row * screen->width + (int)column : -1;
}

/* Writes index (height, width): the nearest of points (count, 3) in each cell, the first of several as near, or -1. */
FAST int z2p_index_screen(const float *points, int count, const FineScreen *screen, int *index) {
    size_t cells = (size_t)screen->width * screen->height;
    for (size_t i = 0; i < cells; i++) index[i] = -1;
    for (int i = 0; i < count; i++) {
        const float *p = points + 3 * (size_t)i;
        int cell = screen_cell(p[0], p[1], p[2], screen);
        if (cell >= 0 && (index[cell] < 0 || p[2] < points[3 * (size_t)index[cell] + 2])) index[cell] = i;
    }
    return 1;
}

/* Sine of the highest elevation over a point's tangent plane at which neighbors lie in one direction (x, y) on the
 * screen. Those count less the farther away they are. */
INLINE float horizon(const float *points, const float *p, const float *n, const int *index, const FineScreen *screen,
                     float x, float y) {
    float cells = screen->radius * screen->focal / p[2], step = cells, highest = -1, reach = 2.25f * screen->radius * screen->radius;
    float column = p[0] * screen->focal / p[2] + 0.5f * (float)screen->width;
    float row = p[1] * screen->focal / p[2] + 0.5f * (float)screen->height;
    for (int k = 0; k < STEPS && step >= 0.7f; k++, step /= STEP_GROWTH) {
        float u = column + step * x, v = row + step * y;
        if (!(u >= 0 && v >= 0 && u < (float)screen->width && v < (float)screen->height)) continue;
        int other = index[(int)v * screen->width + (int)u];
        if (other < 0) continue;
        const float *q = points + 3 * (size_t)other;
        float offset[3] = {q[0] - p[0], q[1] - p[1], q[2] - p[2]}, square = dot(offset, offset);
        if (!(square > 1e-12f && square < reach)) continue;
        float sine = dot(n, offset) / sqrtf(square) * (1 - square / reach);
        highest = larger(highest, sine);
    }
    return highest;
}

/* Writes for the points [begin, end): sky (count), the share of a diffuse surface's sky that near neighbors leave
 * visible, and direct (count), that of a light at this position (3). */
FAST int z2p_fine_occlusion(const float *points, const float *normals, int begin, int end, const int *index,
                            const FineScreen *screen, const float *light, float *sky, float *direct) {
    for (int i = begin; i < end; i++) {
        const float *p = points + 3 * (size_t)i, *n = normals + 3 * (size_t)i;
        float hidden = 0;
        for (int d = 0; d < DIRECTIONS; d++) {
            float angle = 2 * PI * (float)d / DIRECTIONS;
            float sine = (horizon(points, p, n, index, screen, cosf(angle), sinf(angle)) - SKY_BIAS) / (1 - SKY_BIAS);
            hidden += sine > 0 ? sine * sine : 0;
        }
        sky[i] = 1 - hidden / DIRECTIONS;
        float ray[3] = {light[0] - p[0], light[1] - p[1], light[2] - p[2]};
        normalize(ray);
        /* the direction on the screen in which a step towards the light goes */
        float x = ray[0] - ray[2] * p[0] / p[2], y = ray[1] - ray[2] * p[1] / p[2], length = sqrtf(x * x + y * y);
        direct[i] = 1;
        if (length < 1e-3f) continue;
        float sine = larger(horizon(points, p, n, index, screen, x / length, y / length), 0);
        float clear = (dot(n, ray) - sine) / (2 * LIGHT_HALF_SINE) + 0.5f;
        direct[i] = sine > SKY_BIAS ? smaller(larger(clear, 0), 1) : 1;
    }
    return 1;
}
