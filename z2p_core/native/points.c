/* Neighbours in a bare cloud: how far apart its points lie, and which way its surface faces. */

#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "fast.h"

#define K 12          /* neighbours, the point itself among them */
#define COARSE 24     /* cells along the longest side of the grid that estimates the surface's area */
#define POINTS_A_CELL 3.5f
#define MOST_CELLS (1 << 22)
#define FARTHEST_RING 6
#define CHUNK 32      /* points whose distances are computed at a time */
#define LANES 16      /* points whose normals are */

typedef struct {
    float low[3], cell;
    int size[3];
    int *start; /* first point of each cell, and one past the last */
} Grid;

static int clamp_int(int value, int low, int high) { return value < low ? low : value > high ? high : value; }

static int place(const Grid *grid, const float *point, int axis) {
    return clamp_int((int)((point[axis] - grid->low[axis]) / grid->cell), 0, grid->size[axis] - 1);
}

static int cell_of(const Grid *grid, const float *point) {
    return (place(grid, point, 2) * grid->size[1] + place(grid, point, 1)) * grid->size[0] + place(grid, point, 0);
}

static int shape_grid(Grid *grid, const float *extent, float cell) {
    long cells = 1;
    grid->cell = cell;
    for (int axis = 0; axis < 3; axis++) {
        grid->size[axis] = (int)(extent[axis] / cell) + 1;
        cells *= grid->size[axis];
    }
    return cells <= MOST_CELLS ? (int)cells : 0;
}

static int by_place(const void *first, const void *second) {
    const float *a = first, *b = second;
    for (int axis = 0; axis < 3; axis++)
        if (a[axis] != b[axis]) return a[axis] < b[axis] ? -1 : 1;
    return 0;
}

/* Counting sort by cell, then by coordinates in each: `sorted` does not depend on the order of `points`. */
static int fill(Grid *grid, int cells, const float *points, int count, float *sorted) {
    int *cell = malloc(sizeof(int) * (size_t)(count ? count : 1));
    grid->start = calloc((size_t)cells + 2, sizeof(int));
    if (!cell || !grid->start) { free(cell); return 0; }
    int *fill_at = grid->start + 1;
    for (int i = 0; i < count; i++) grid->start[(cell[i] = cell_of(grid, points + 3 * i)) + 2]++;
    for (int c = 0; c < cells; c++) fill_at[c + 1] += fill_at[c];
    for (int i = 0; i < count; i++) memcpy(sorted + 3 * fill_at[cell[i]]++, points + 3 * i, sizeof(float[3]));
    free(cell);
    for (int c = 0; c < cells; c++) {
        int first = grid->start[c], members = grid->start[c + 1] - first;
        if (members > 1) qsort(sorted + 3 * first, (size_t)members, sizeof(float[3]), by_place);
    }
    return 1;
}

static int build(Grid *grid, const float *points, int count, float *sorted) {
    float high[3], extent[3], longest = 0;
    for (int axis = 0; axis < 3; axis++) {
        grid->low[axis] = high[axis] = points[axis];
        for (int i = 1; i < count; i++) {
            float x = points[3 * i + axis];
            if (x < grid->low[axis]) grid->low[axis] = x;
            if (x > high[axis]) high[axis] = x;
        }
        extent[axis] = high[axis] - grid->low[axis];
        if (extent[axis] > longest) longest = extent[axis];
    }
    if (longest <= 0) longest = 1e-6f;
    /* coarse occupancy: area of the surface, give or take */
    static const int cube = COARSE * COARSE * COARSE;
    uint8_t *seen = calloc(cube, 1);
    if (!seen) return 0;
    shape_grid(grid, extent, longest / (COARSE - 0.01f));
    int occupied = 0;
    for (int i = 0; i < count; i++) {
        uint8_t *here = seen + clamp_int(cell_of(grid, points + 3 * i), 0, cube - 1);
        occupied += !*here;
        *here = 1;
    }
    free(seen);
    float cell = sqrtf((float)occupied * grid->cell * grid->cell * POINTS_A_CELL / (float)count);
    int cells = 0;
    if (cell < longest * 1e-4f) cell = longest * 1e-4f;
    while (!(cells = shape_grid(grid, extent, cell))) cell *= 1.25f;
    return fill(grid, cells, points, count, sorted);
}

typedef struct {
    int count, found[K];
    float distance[K]; /* squared, nearest first */
} Near;

/* Takes in those of points[first] to points[last - 1] that are nearer to p than the farthest so far. */
static void take_in(Near *near, const float *points, int first, int last, const float *p) {
    float squares[CHUNK];
    for (; first < last; first += CHUNK) {
        int size = last - first < CHUNK ? last - first : CHUNK;
        for (int i = 0; i < size; i++) {
            const float *q = points + 3 * (first + i);
            float dx = q[0] - p[0], dy = q[1] - p[1], dz = q[2] - p[2];
            squares[i] = dx * dx + dy * dy + dz * dz;
        }
        for (int i = 0; i < size; i++) {
            float square = squares[i];
            if (near->count == K && square >= near->distance[K - 1]) continue;
            int at = near->count < K ? near->count++ : K - 1;
            for (; at > 0 && near->distance[at - 1] > square; at--) {
                near->distance[at] = near->distance[at - 1];
                near->found[at] = near->found[at - 1];
            }
            near->distance[at] = square;
            near->found[at] = first + i;
        }
    }
}

/* K near points of `points[self]`, nearest first, itself among them, the nearest but for a few at the end. */
static void nearest(const Grid *grid, const float *points, int self, Near *near) {
    const float *p = points + 3 * self;
    int home[3], low[3], high[3];
    near->count = 0;
    for (int axis = 0; axis < 3; axis++) home[axis] = place(grid, p, axis);
    for (int ring = 0; ring <= FARTHEST_RING; ring++) {
        for (int axis = 0; axis < 3; axis++) {
            low[axis] = clamp_int(home[axis] - ring, 0, grid->size[axis] - 1);
            high[axis] = clamp_int(home[axis] + ring, 0, grid->size[axis] - 1);
        }
        for (int z = low[2]; z <= high[2]; z++)
            for (int y = low[1]; y <= high[1]; y++) {
                const int *start = grid->start + (size_t)(z * grid->size[1] + y) * grid->size[0];
                if (abs(z - home[2]) == ring || abs(y - home[1]) == ring) { /* the points of a row lie in one piece */
                    take_in(near, points, start[low[0]], start[high[0] + 1], p);
                    continue;
                }
                if (home[0] - ring >= 0) take_in(near, points, start[low[0]], start[low[0] + 1], p);
                if (home[0] + ring < grid->size[0]) take_in(near, points, start[high[0]], start[high[0] + 1], p);
            }
        /* all but the farthest few are sure to lie in the first ring: cells hold several points each */
        if (ring && near->count == K) break;
    }
}

/* One Jacobi rotation of symmetric matrices, a lane each: takes away pq, turns pr and qr, and the vectors p and q. */
static inline void rotate(float *pp, float *qq, float *pq, float *pr, float *qr, float (*p)[LANES], float (*q)[LANES]) {
    for (int i = 0; i < LANES; i++) {
        int none = fabsf(pq[i]) < 1e-20f;
        float theta = (qq[i] - pp[i]) / (none ? 1.0f : 2 * pq[i]);
        float t = (theta >= 0 ? 1.0f : -1.0f) / (fabsf(theta) + sqrtf(theta * theta + 1));
        if (none) t = 0;
        float c = 1 / sqrtf(t * t + 1), s = t * c, r = pr[i];
        pp[i] -= t * pq[i];
        qq[i] += t * pq[i];
        pq[i] = none ? pq[i] : 0;
        pr[i] = c * r - s * qr[i];
        qr[i] = s * r + c * qr[i];
        for (int axis = 0; axis < 3; axis++) {
            float x = p[axis][i], y = q[axis][i];
            p[axis][i] = c * x - s * y;
            q[axis][i] = s * x + c * y;
        }
    }
}

/* Unit eigenvectors of the smallest eigenvalues of symmetric matrices xx xy xz yy yz zz, which are overwritten. */
FAST void z2p_smallest_axes(float (*m)[LANES], float (*axes)[LANES]) {
    float x[3][LANES], y[3][LANES], z[3][LANES];
    for (int axis = 0; axis < 3; axis++)
        for (int i = 0; i < LANES; i++) {
            x[axis][i] = axis == 0;
            y[axis][i] = axis == 1;
            z[axis][i] = axis == 2;
        }
    for (int sweep = 0; sweep < 6; sweep++) {
        rotate(m[0], m[3], m[1], m[2], m[4], x, y);
        rotate(m[0], m[5], m[2], m[1], m[4], x, z);
        rotate(m[3], m[5], m[4], m[1], m[2], y, z);
    }
    for (int i = 0; i < LANES; i++) {
        int first = m[0][i] <= m[3][i] && m[0][i] <= m[5][i], second = m[3][i] <= m[5][i];
        for (int axis = 0; axis < 3; axis++) axes[axis][i] = first ? x[axis][i] : second ? y[axis][i] : z[axis][i];
    }
}

/* Spacing of a point of `points`, and the covariance xx xy xz yy yz zz of its neighbours; how many these are. */
static int neighbourhood(const Grid *grid, const float *points, int self, float *spacing, float *m) {
    Near near;
    nearest(grid, points, self, &near);
    const int many = near.count, *found = near.found;
    float mean[3] = {0, 0, 0};
    *spacing = many > 1 ? sqrtf(3.14159265f * near.distance[many - 1] / (float)many) : 0;
    for (int j = 0; j < many; j++)
        for (int axis = 0; axis < 3; axis++) mean[axis] += points[3 * found[j] + axis] / (float)many;
    for (int j = 0; j < many; j++) {
        const float *q = points + 3 * found[j];
        float x = q[0] - mean[0], y = q[1] - mean[1], z = q[2] - mean[2];
        m[0] += x * x; m[1] += x * y; m[2] += x * z; m[3] += y * y; m[4] += y * z; m[5] += z * z;
    }
    return many;
}

/* The normal n of a point: the axis of its neighbours, or, where these are too few, the way to the viewer, faced. */
static void face(const float *point, const float *viewer, const float *axis, int many, float *n) {
    float towards[3], facing = 0, length = 0;
    for (int i = 0; i < 3; i++) {
        towards[i] = viewer[i] - point[i];
        length += towards[i] * towards[i];
        facing += axis[i] * towards[i];
    }
    for (int i = 0; i < 3; i++)
        n[i] = many < 3 ? towards[i] / sqrtf(length + 1e-20f) : facing < 0 ? -axis[i] : axis[i];
}

/* For a cloud (count, 3): the same points in an order of their own, each one's spacing (the side of the patch of
 * surface that is its share) and unit normal, turned towards `viewer` (3). Returns 0 when memory is short. */
int z2p_surface(const float *points, int count, const float *viewer, float *sorted, float *spacing, float *normals) {
    Grid grid = {.start = NULL};
    if (!build(&grid, points, count, sorted)) { free(grid.start); return 0; }
    for (int first = 0; first < count; first += LANES) {
        int many[LANES], lanes = count - first < LANES ? count - first : LANES;
        float m[6][LANES] = {{0}}, axes[3][LANES];
        for (int i = 0; i < lanes; i++) {
            float own[6] = {0, 0, 0, 0, 0, 0};
            many[i] = neighbourhood(&grid, sorted, first + i, spacing + first + i, own);
            for (int j = 0; j < 6; j++) m[j][i] = own[j];
        }
        z2p_smallest_axes(m, axes);
        for (int i = 0; i < lanes; i++) {
            const float axis[3] = {axes[0][i], axes[1][i], axes[2][i]};
            face(sorted + 3 * (first + i), viewer, axis, many[i], normals + 3 * (first + i));
        }
    }
    free(grid.start);
    return 1;
}
