/* Depth maps of a point cloud: their resolution, closing of the gaps between points, and the test against
 * self-occlusion. Shared by the shadow maps (shadow_map.c), the visibility sweep (visibility.c) and ray casting
 * (disc_raycast.c). */

#pragma once

#include <stddef.h>
#include <stdint.h>

#include "common/vec3.h"

#define MAX_MAP_SIDE 512            /* cells */
#define MAP_MARGIN 4                /* empty cells around a map's content: gaps are closed at its border as well */
#define MAP_CELLS_PER_SPACING 1.5f  /* resolution of visibility maps */
#define EMPTY_CELL INT32_MAX        /* what a map holds where there is no point */
#define SELF_DISTANCE_SPACINGS 3.2f /* occluders nearer than this along a direction may be the point's own surface */
#define SHADOW_BIAS_SPACINGS 1.2f   /* an occluder must be nearer to the light than the point by at least this */
#define SELF_SURFACE_SLOPE 0.5f     /* see is_own_surface */

/* Whether an occluder, which lies about along `direction` from a point, is part of the surface around the point: it is
 * closer to the tangent plane than to the ray, by height over the plane against the ray's height there. */
INLINE int is_own_surface(const float *points, const float *normals, int point, int occluder, const float *direction) {
    const float *p = points + 3 * (size_t)point, *q = points + 3 * (size_t)occluder, *n = normals + 3 * (size_t)point;
    float offset[3] = {q[0] - p[0], q[1] - p[1], q[2] - p[2]};
    float slope = dot(direction, n), height = dot(offset, n);
    float along = dot(offset, direction) / dot(direction, direction);
    return slope < 0 ? height > SELF_SURFACE_SLOPE * along * slope : height < SELF_SURFACE_SLOPE * along * slope;
}

/* Sliding minimum, or maximum, for the cells [first, last): over the cells from two before to `after` behind, which are
 * `stride` apart. */
INLINE void window_extremum(const int32_t *restrict from, int32_t *restrict to, int first, int last, int stride,
                            int after, int maximum) {
    for (int i = first; i < last; i++) {
        int32_t extremum = from[i];
        for (int k = -2; k <= after; k++) {
            int32_t other = from[i + k * stride];
            extremum = maximum ? (other > extremum ? other : extremum) : (other < extremum ? other : extremum);
        }
        to[i] = extremum;
    }
}

/* Morphological closing of a map (side, side) of keys, smallest nearest, or EMPTY_CELL: closes gaps up to four cells
 * wide. Outlines stay where they are or, with `eroded`, come in by one cell on the far side of both axes. `scratch` is
 * as large as the map. */
INLINE void close_gaps(int32_t *map, int side, int eroded, int32_t *scratch) {
    int cells = side * side;
    scratch[0] = scratch[1] = scratch[cells - 3] = scratch[cells - 2] = scratch[cells - 1] = EMPTY_CELL;
    window_extremum(map, scratch, 2, cells - 2, 1, 2, 0);
    window_extremum(scratch, map, 2 * side, cells - 2 * side, side, 2, 0);
    if (eroded) {
        window_extremum(map, scratch, 2, cells - 3, 1, 3, 1);
        window_extremum(scratch, map, 2 * side, cells - 3 * side, side, 3, 1);
    } else {
        window_extremum(map, scratch, 2, cells - 2, 1, 2, 1);
        window_extremum(scratch, map, 2 * side, cells - 2 * side, side, 2, 1);
    }
}
