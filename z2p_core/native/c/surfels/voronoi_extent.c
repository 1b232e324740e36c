/* How far a point's share of the surface reaches: its Voronoi cell among its neighbours, in the tangent plane. */

#include <math.h>
#include <stddef.h>

#include "common/vec3.h"
#include "common/simd.h"
#include "points/neighbor_grid.h"

#define DIRECTIONS 16 /* in which a cell's border is looked for, evenly around */
#define STEEP 0.75f   /* sine of the angle off the plane from which on a neighbour lies on another surface */

/* The farthest that the border of a point's cell is, along the directions (2, DIRECTIONS), and where, at `end`;
 * INFINITY where neighbours (most) leave it open. A neighbour at q bounds the cell by r . q = |q|^2 / 2, so by
 * 1 / r = 2 along . q / |q|^2. The cell is that among neighbours laid into the plane, or, if `solid`, what the plane
 * cuts out of the cell in space. */
INLINE float cell_reach(const float *points, const float *p, const float *n, const int *row, int most, int solid,
                        float (*around)[DIRECTIONS], float *end) {
    float u[3], v[3], inverse[DIRECTIONS] = {0}, d[3][MOST_NEIGHBOURS];
    float x[MOST_NEIGHBOURS], y[MOST_NEIGHBOURS];
    axes_across(n, u, v);
    for (int j = 0; j < most; j++)
        for (int a = 0; a < 3; a++) d[a][j] = points[3 * (size_t)row[j] + a] - p[a];
    for (int j = 0; j < most; j++) {
        float step[3] = {d[0][j], d[1][j], d[2][j]}, height = dot(step, n), square = dot(step, step);
        int none = (square < 1e-12f) | (!solid & (height * height > STEEP * STEEP * square));
        float across = dot(step, u), up = dot(step, v), half = 0.5f * (solid ? square : across * across + up * up);
        half = none ? INFINITY : half; /* a neighbour at infinity bounds nothing */
        x[j] = across / half;
        y[j] = up / half;
    }
    for (int j = 0; j < most; j++)
        for (int k = 0; k < DIRECTIONS; k++) {
            float near = x[j] * around[0][k] + y[j] * around[1][k];
            inverse[k] = near > inverse[k] ? near : inverse[k];
        }
    int farthest = 0;
    for (int k = 1; k < DIRECTIONS; k++) farthest = inverse[k] < inverse[farthest] ? k : farthest;
    float reach = inverse[farthest] > 0 ? 1 / inverse[farthest] : INFINITY;
    float x_way = around[0][farthest], y_way = around[1][farthest];
    for (int a = 0; a < 3; a++) end[a] = p[a] + reach * (x_way * u[a] + y_way * v[a]);
    return reach;
}

/* reaches (count) and the places (count, 3) up to which they reach, from `begin` to `end`: of the cells of the points
 * asked for (count), whose neighbours found (count, most) are known, and the unit normals of all points. */
FAST int z2p_cells(const float *points, const float *normals, const int *asked, const int *found, int begin, int end,
                   int most, int solid, float *reaches, float *ends) {
    float around[2][DIRECTIONS];
    for (int k = 0; k < DIRECTIONS; k++) {
        float angle = 6.2831853f * (float)k / DIRECTIONS;
        around[0][k] = cosf(angle);
        around[1][k] = sinf(angle);
    }
    for (int i = begin; i < end; i++) {
        size_t at = 3 * (size_t)asked[i];
        reaches[i] = cell_reach(points, points + at, normals + at, found + (size_t)i * most, most, solid, around,
                                ends + 3 * (size_t)i);
    }
    return 1;
}
