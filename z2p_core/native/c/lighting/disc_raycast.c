/* Ray casting against a cloud whose points are discs: the first disc that one ray from each queried point hits. Input:
 * points, normals, queried points and ray directions; output: indices of hit points.
 *
 * Discs are sorted into a uniform grid, which rays traverse cell by cell (Amanatides and Woo, "A Fast Voxel Traversal
 * Algorithm for Ray Tracing", 1987). */

#include <math.h>
#include <stdlib.h>

#include "common/vec3.h"
#include "lighting/occlusion.h"

#define MAX_GRID_SIDE 128  /* cells */
#define MIN_DISC_COS 0.15f /* discs hit at a smaller cosine count as balls, as estimated normals are not that certain */

/* A uniform grid over a cube about the origin; a cell lists the discs that may reach into it. */
typedef struct {
    float low, cell_size;
    int side, *starts, *indices; /* the discs of cell c are indices[starts[c]] up to indices[starts[c + 1]] */
} DiscGrid;

INLINE int cell_coordinate(const DiscGrid *grid, float x) {
    int at = (int)((x - grid->low) / grid->cell_size);
    return at < 0 ? 0 : at >= grid->side ? grid->side - 1 : at;
}

/* Counting sort of discs of that radius into the cells; returns 0 if memory is short. */
static int fill_grid(DiscGrid *grid, const float *points, int count, float disc_radius) {
    int side = grid->side;
    size_t cell_count = (size_t)side * side * side;
    int *ends = grid->starts = calloc(cell_count + 2, sizeof(int));
    if (!grid->starts) return 0;
    for (int pass = 0; pass < 2; pass++) {
        for (int i = 0; i < count; i++) {
            int low[3], high[3];
            for (int a = 0; a < 3; a++) {
                low[a] = cell_coordinate(grid, points[3 * (size_t)i + a] - disc_radius);
                high[a] = cell_coordinate(grid, points[3 * (size_t)i + a] + disc_radius);
            }
            for (int z = low[2]; z <= high[2]; z++)
                for (int y = low[1]; y <= high[1]; y++)
                    for (int x = low[0]; x <= high[0]; x++) {
                        size_t cell = ((size_t)z * side + y) * side + x;
                        if (pass) grid->indices[ends[cell + 1]++] = i;
                        else ends[cell + 2]++;
                    }
        }
        if (pass) break;
        for (size_t c = 2; c < cell_count + 2; c++) ends[c] += ends[c - 1];
        grid->indices = malloc(sizeof(int) * ((size_t)ends[cell_count + 1] + 1));
        if (!grid->indices) return 0;
    }
    return 1;
}

/* Distance along a unit ray (3) from a point to the disc of another; INFINITY where the ray misses it, or where it is
 * nearer than self_distance or part of the point's own surface. */
INLINE float intersect_disc(const float *points, const float *normals, int point, int other, const float *ray,
                            float disc_radius, float self_distance) {
    const float *p = points + 3 * (size_t)point, *q = points + 3 * (size_t)other, *n = normals + 3 * (size_t)other;
    float offset[3] = {q[0] - p[0], q[1] - p[1], q[2] - p[2]};
    float along = dot(offset, ray), n_dot_ray = dot(ray, n);
    float distance = fabsf(n_dot_ray) < MIN_DISC_COS ? along : dot(offset, n) / n_dot_ray, miss_sq = 0;
    for (int a = 0; a < 3; a++) miss_sq += (offset[a] - distance * ray[a]) * (offset[a] - distance * ray[a]);
    if (along <= self_distance || distance <= 0 || miss_sq >= disc_radius * disc_radius) return INFINITY;
    return is_own_surface(points, normals, point, other, ray) ? INFINITY : distance;
}

/* Traverses the grid along a unit ray from a point; returns the index of the first disc hit, -1 for none. */
INLINE int trace_ray(const DiscGrid *grid, const float *points, const float *normals, int point, const float *ray,
                     float disc_radius, float self_distance) {
    int at[3], direction[3], hit = -1;
    float border_distance[3], distance_per_cell[3], nearest = INFINITY;
    for (int a = 0; a < 3; a++) {
        float p = points[3 * (size_t)point + a];
        at[a] = cell_coordinate(grid, p);
        direction[a] = ray[a] < 0 ? -1 : 1;
        distance_per_cell[a] = fabsf(ray[a]) > 1e-9f ? grid->cell_size / fabsf(ray[a]) : INFINITY;
        float border = grid->low + (float)(at[a] + (direction[a] > 0)) * grid->cell_size;
        border_distance[a] = fabsf(ray[a]) > 1e-9f ? (border - p) / ray[a] : INFINITY;
    }
    for (;;) {
        int axis = border_distance[0] < border_distance[1] ? (border_distance[0] < border_distance[2] ? 0 : 2)
                   : border_distance[1] < border_distance[2] ? 1 : 2;
        size_t cell = ((size_t)at[2] * grid->side + at[1]) * grid->side + at[0];
        for (int k = grid->starts[cell]; k < grid->starts[cell + 1]; k++) {
            float distance = intersect_disc(points, normals, point, grid->indices[k], ray, disc_radius, self_distance);
            if (distance < nearest) {
                nearest = distance;
                hit = grid->indices[k];
            }
        }
        at[axis] += direction[axis];
        if (nearest <= border_distance[axis] || at[axis] < 0 || at[axis] >= grid->side) return hit;
        border_distance[axis] += distance_per_cell[axis];
    }
}

/* For `begin` <= i < `end`: writes hits[i], the index of the point whose disc the unit ray rays[i] (3) from the point
 * query_indices[i] hits first; -1 for none. Points (count, 3) are discs of radius disc_radius across their unit normals
 * (count, 3); a point's own surface is not hit. `spacing` is the cloud's, which lies within `radius` of the origin. */
FAST int z2p_raycast_discs(const float *points, const float *normals, int count, const int *query_indices, int begin,
                           int end, const float *rays, float disc_radius, float spacing, float radius, int *hits) {
    DiscGrid grid = {.low = -radius};
    grid.side = (int)smaller(radius / disc_radius, MAX_GRID_SIDE);
    if (grid.side < 1) grid.side = 1;
    grid.cell_size = 2 * radius / (float)grid.side;
    int allocated = fill_grid(&grid, points, count, disc_radius);
    for (int i = begin; allocated && i < end; i++)
        hits[i] = trace_ray(&grid, points, normals, query_indices[i], rays + 3 * (size_t)i, disc_radius,
                            SELF_DISTANCE_SPACINGS * spacing);
    free(grid.starts);
    free(grid.indices);
    return allocated;
}
