/* Occlusion by relief that is finer than the points for which light is computed: what hides sky and light from a point
 * within a small distance, found on the screen (after Bavoil, Sainz and Dimitrov, Image-space horizon-based ambient
 * occlusion, 2008).
 *
 * Points and normals are in camera axes, the latter facing the camera. An index (height, width) has the nearest point of
 * each cell of the screen, or -1. */

#include <math.h>
#include <stdint.h>
#include <stdlib.h>

#include "common/screen_view.h"

#define DIRECTIONS 8        /* on the screen, in which the horizon is searched */
#define STEPS 5             /* in each of them */
#define STEP_GROWTH 1.7f    /* of a step's distance over that of the one before */
#define MIN_STEP 0.7f       /* in cells: shorter steps hardly leave the own cell */
#define BATCH 16            /* points whose horizons are searched at a time */
#define SKY_BIAS 0.12f      /* sine of an elevation below which a neighbor hides nothing: noise */
#define LIGHT_HALF_SINE 0.12f /* of the elevations over which an area light sets */

/* Cells for each world unit along axis a at depth z. */
INLINE float cells_per_unit(const ScreenView *screen, int a, float z) {
    return screen->focal[a] / (screen->orthographic ? 1 : z);
}

/* The cell of a position, -1 outside. */
INLINE int screen_cell(float x, float y, float z, const ScreenView *screen) {
    float column = x * cells_per_unit(screen, 0, z) + screen->center[0];
    float row = y * cells_per_unit(screen, 1, z) + screen->center[1];
    int inside = z > 0 && column >= 0 && row >= 0 && column < (float)screen->width && row < (float)screen->height;
    return inside ? (int)row * screen->width + (int)column : -1;
}

/* Writes index (height, width): the nearest of points (count, 3) in each cell, the first of several as near, or -1. */
FAST int z2p_index_screen(const float *points, int count, const ScreenView *screen, int *index) {
    size_t cells = (size_t)screen->width * screen->height;
    for (size_t i = 0; i < cells; i++) index[i] = -1;
    for (int i = 0; i < count; i++) {
        const float *p = points + 3 * (size_t)i;
        int cell = screen_cell(p[0], p[1], p[2], screen);
        if (cell >= 0 && (index[cell] < 0 || p[2] < points[3 * (size_t)index[cell] + 2])) index[cell] = i;
    }
    return 1;
}

/* Points whose horizons are searched at a time, one in each lane: positions, normals and places on the screen. */
typedef struct {
    float p[3][BATCH], n[3][BATCH], place[2][BATCH], reach[2][BATCH]; /* the latter two in cells */
} Batch;

/* Loads points from `first` on, the last of them, at `last`, in the lanes that are left. */
INLINE void load_batch(Batch *batch, const float *points, const float *normals, int first, int last,
                       const ScreenView *screen, float radius) {
    for (int i = 0; i < BATCH; i++) {
        size_t at = 3 * (size_t)(first + i < last ? first + i : last);
        for (int a = 0; a < 3; a++) {
            batch->p[a][i] = points[at + a];
            batch->n[a][i] = normals[at + a];
        }
        for (int a = 0; a < 2; a++) {
            float scale = cells_per_unit(screen, a, batch->p[2][i]);
            batch->place[a][i] = batch->p[a][i] * scale + screen->center[a];
            batch->reach[a][i] = radius * scale;
        }
    }
}

/* Sines of the highest elevations over the points' tangent planes at which neighbors lie in directions (x, y) on the
 * screen. Those count less the farther away they are. */
INLINE void find_horizons(const Batch *batch, const float *points, const int *index, const ScreenView *screen,
                          float radius, const float *x, const float *y, float *highest) {
    float width = (float)screen->width, height = (float)screen->height, share = 1;
    float reach = 2.25f * radius * radius, inverse_reach = 1 / reach;
    for (int i = 0; i < BATCH; i++) highest[i] = -1;
    for (int k = 0; k < STEPS; k++, share /= STEP_GROWTH) {
        int other[BATCH];
        for (int i = 0; i < BATCH; i++) {
            float step = batch->reach[0][i] * share, step_down = batch->reach[1][i] * share;
            float u = batch->place[0][i] + step * x[i], v = batch->place[1][i] + step_down * y[i];
            int inside = (step >= MIN_STEP) & (u >= 0) & (v >= 0) & (u < width) & (v < height);
            int cell = inside ? (int)v * screen->width + (int)u : 0, found = index[cell];
            other[i] = inside ? found : -1;
        }
        for (int i = 0; i < BATCH; i++) {
            const float *q = points + 3 * (size_t)(other[i] < 0 ? 0 : other[i]);
            float dx = q[0] - batch->p[0][i], dy = q[1] - batch->p[1][i], dz = q[2] - batch->p[2][i];
            float square = dx * dx + dy * dy + dz * dz;
            float along = dx * batch->n[0][i] + dy * batch->n[1][i] + dz * batch->n[2][i];
            float sine = along / sqrtf(larger(square, 1e-12f)) * (1 - square * inverse_reach);
            int counts = (other[i] >= 0) & (square > 1e-12f) & (square < reach);
            highest[i] = counts ? larger(highest[i], sine) : highest[i];
        }
    }
}

/* Share of a light at this position (3) that near neighbors of the points leave visible. */
INLINE void find_direct(const Batch *batch, const float *points, const int *index, const ScreenView *screen,
                        float radius, const float *light, float *direct) {
    float x[BATCH], y[BATCH], elevation[BATCH], sine[BATCH], length[BATCH];
    for (int i = 0; i < BATCH; i++) {
        float px = batch->p[0][i], py = batch->p[1][i], pz = batch->p[2][i];
        float rx = light[0] - px, ry = light[1] - py, rz = light[2] - pz;
        float scale = 1 / sqrtf(rx * rx + ry * ry + rz * rz);
        rx *= scale; ry *= scale; rz *= scale;
        elevation[i] = rx * batch->n[0][i] + ry * batch->n[1][i] + rz * batch->n[2][i];
        float slope = screen->orthographic ? 0 : rz / pz;
        x[i] = rx - slope * px; /* the direction on the screen in which a step towards the light goes */
        y[i] = ry - slope * py;
        length[i] = sqrtf(x[i] * x[i] + y[i] * y[i]);
        float inverse = 1 / larger(length[i], 1e-6f);
        x[i] *= inverse; y[i] *= inverse;
    }
    find_horizons(batch, points, index, screen, radius, x, y, sine);
    for (int i = 0; i < BATCH; i++) {
        float clear = (elevation[i] - larger(sine[i], 0)) / (2 * LIGHT_HALF_SINE) + 0.5f;
        int hides = (sine[i] > SKY_BIAS) & (length[i] >= 1e-3f);
        direct[i] = hides ? smaller(larger(clear, 0), 1) : 1;
    }
}

/* Writes for the points [begin, end): sky (count), the share of a diffuse surface's sky that neighbors within a radius
 * leave visible, and direct (count), that of a light at this position (3). */
FAST int z2p_fine_occlusion(const float *points, const float *normals, int begin, int end, const int *index,
                            const ScreenView *screen, float radius, const float *light, float *sky, float *direct) {
    for (int first = begin; first < end; first += BATCH) {
        Batch batch;
        float hidden[BATCH] = {0}, clear[BATCH], sine[BATCH], x[BATCH], y[BATCH];
        int size = end - first < BATCH ? end - first : BATCH;
        load_batch(&batch, points, normals, first, end - 1, screen, radius);
        for (int d = 0; d < DIRECTIONS; d++) {
            float angle = 2 * PI * (float)d / DIRECTIONS, cosine = cosf(angle), sine_of_angle = sinf(angle);
            for (int i = 0; i < BATCH; i++) {
                x[i] = cosine;
                y[i] = sine_of_angle;
            }
            find_horizons(&batch, points, index, screen, radius, x, y, sine);
            for (int i = 0; i < BATCH; i++) {
                float over = larger(sine[i] - SKY_BIAS, 0) / (1 - SKY_BIAS);
                hidden[i] += over * over;
            }
        }
        find_direct(&batch, points, index, screen, radius, light, clear);
        for (int i = 0; i < size; i++) {
            sky[first + i] = 1 - hidden[i] / DIRECTIONS;
            direct[first + i] = clear[i];
        }
    }
    return 1;
}
