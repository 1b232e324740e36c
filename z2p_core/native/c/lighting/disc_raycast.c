/* What single rays from the points of a cloud meet first, its points being discs. */

#include <math.h>
#include <stdlib.h>

#include "common/simd.h"
#include "lighting/occlusion.h"

#define MOST_CELLS 128   /* along a side */
#define GRAZED 0.15f     /* cosine below which a disc, seen from its edge, is a ball: planes of normals found are not so sure */

/* A cube about the origin in cells, each with the rows of the discs that may reach into it. */
typedef struct {
    float low, cell;
    int side, *start, *row;
} Cells;

INLINE int cell_at(const Cells *cells, float x) {
    int at = (int)((x - cells->low) / cells->cell);
    return at < 0 ? 0 : at >= cells->side ? cells->side - 1 : at;
}

/* Sorts discs of that radius into the cells, by counting; 0 when memory is short. */
static int fill_cells(Cells *cells, const float *points, int count, float reach) {
    int side = cells->side;
    size_t all = (size_t)side * side * side;
    int *ends = cells->start = calloc(all + 2, sizeof(int));
    if (!cells->start) return 0;
    for (int pass = 0; pass < 2; pass++) {
        for (int i = 0; i < count; i++) {
            int low[3], high[3];
            for (int a = 0; a < 3; a++) {
                low[a] = cell_at(cells, points[3 * (size_t)i + a] - reach);
                high[a] = cell_at(cells, points[3 * (size_t)i + a] + reach);
            }
            for (int z = low[2]; z <= high[2]; z++)
                for (int y = low[1]; y <= high[1]; y++)
                    for (int x = low[0]; x <= high[0]; x++) {
                        size_t at = ((size_t)z * side + y) * side + x;
                        if (pass) cells->row[ends[at + 1]++] = i;
                        else ends[at + 2]++;
                    }
        }
        if (pass) break;
        for (size_t c = 2; c < all + 2; c++) ends[c] += ends[c - 1];
        cells->row = malloc(sizeof(int) * ((size_t)ends[all + 1] + 1));
        if (!cells->row) return 0;
    }
    return 1;
}

/* How far along a unit ray (3) from a point the disc of another lies; infinite where the ray passes it by. */
INLINE float distance_to(const float *points, const float *normals, int point, int other, const float *ray, float reach,
                         float clear) {
    const float *p = points + 3 * (size_t)point, *q = points + 3 * (size_t)other, *n = normals + 3 * (size_t)other;
    float step[3] = {q[0] - p[0], q[1] - p[1], q[2] - p[2]};
    float along = dot(step, ray), slant = dot(ray, n);
    float far = fabsf(slant) < GRAZED ? along : dot(step, n) / slant, square = 0;
    for (int a = 0; a < 3; a++) square += (step[a] - far * ray[a]) * (step[a] - far * ray[a]);
    if (along <= clear || far <= 0 || square >= reach * reach) return INFINITY;
    return own_surface(points, normals, point, other, ray) ? INFINITY : far;
}

/* Goes from cell to cell along a ray (Amanatides and Woo, A Fast Voxel Traversal Algorithm, 1987). */
INLINE int first_on_way(const Cells *cells, const float *points, const float *normals, int point, const float *ray,
                        float reach, float clear) {
    int at[3], turn[3], found = -1;
    float next[3], pace[3], nearest = INFINITY;
    for (int a = 0; a < 3; a++) {
        float p = points[3 * (size_t)point + a];
        at[a] = cell_at(cells, p);
        turn[a] = ray[a] < 0 ? -1 : 1;
        pace[a] = fabsf(ray[a]) > 1e-9f ? cells->cell / fabsf(ray[a]) : INFINITY;
        float border = cells->low + (float)(at[a] + (turn[a] > 0)) * cells->cell;
        next[a] = fabsf(ray[a]) > 1e-9f ? (border - p) / ray[a] : INFINITY;
    }
    for (;;) {
        int axis = next[0] < next[1] ? (next[0] < next[2] ? 0 : 2) : next[1] < next[2] ? 1 : 2;
        size_t cell = ((size_t)at[2] * cells->side + at[1]) * cells->side + at[0];
        for (int k = cells->start[cell]; k < cells->start[cell + 1]; k++) {
            float far = distance_to(points, normals, point, cells->row[k], ray, reach, clear);
            if (far < nearest) {
                nearest = far;
                found = cells->row[k];
            }
        }
        at[axis] += turn[axis];
        if (nearest <= next[axis] || at[axis] < 0 || at[axis] >= cells->side) return found;
        next[axis] += pace[axis];
    }
}

/* hit: for each of the points `asked`, from `begin` to `end`, the one whose disc of radius `reach` its unit ray (3) meets
 * first; -1 where it meets none. What is of the point's own surface is not met. The cloud (count, 3) has that spacing, and
 * `radius` bounds it. */
FAST int z2p_mirror_hits(const float *points, const float *normals, int count, const int *asked, int begin, int end,
                         const float *rays, float reach, float spacing, float radius, int *hit) {
    Cells cells = {.low = -radius};
    cells.side = (int)smaller(radius / reach, MOST_CELLS);
    if (cells.side < 1) cells.side = 1;
    cells.cell = 2 * radius / (float)cells.side;
    int fine = fill_cells(&cells, points, count, reach);
    for (int i = begin; fine && i < end; i++)
        hit[i] = first_on_way(&cells, points, normals, asked[i], rays + 3 * (size_t)i, reach, CLEAR * spacing);
    free(cells.start);
    free(cells.row);
    return fine;
}
