/* What hides what: maps of a cloud across a way, and which of what they hold is a point's own surface. */

#include <stddef.h>
#include <stdint.h>

#include "common/simd.h"

#define LARGEST_MAP 512
#define MARGIN 4    /* cells around what a map shows, for holes to be closed at its border as well */
#define FINE 1.5f   /* cells of a map for each spacing */
#define NOTHING INT32_MAX
#define CLEAR 3.2f  /* spacings: what is nearer along an axis may be a point's own surface */
#define TOUCH 1.2f  /* spacings: what is so much nearer to a lamp may hide a point from it */
#define OWN 0.5f    /* of the height that a way has gained over a plane: what lies lower is of the plane's surface */

/* Whether another point, which lies on the way (3) from a point as far as a map tells, is of the surface about that
 * point: it lies nearer to the plane there than to the way. */
INLINE int own_surface(const float *points, const float *normals, int point, int other, const float *way) {
    const float *p = points + 3 * (size_t)point, *q = points + 3 * (size_t)other, *n = normals + 3 * (size_t)point;
    float step[3] = {q[0] - p[0], q[1] - p[1], q[2] - p[2]};
    float facing = dot(way, n), above = dot(step, n), along = dot(step, way) / dot(way, way);
    return facing < 0 ? above > OWN * along * facing : above < OWN * along * facing;
}

/* The least, or the largest, of the numbers from two before to `after` behind, `step` apart, for each number from
 * `first` to `last`. */
INLINE void of_several(const int32_t *restrict from, int32_t *restrict to, int first, int last, int step, int after,
                       int largest) {
    for (int i = first; i < last; i++) {
        int32_t found = from[i];
        for (int k = -2; k <= after; k++) {
            int32_t other = from[i + k * step];
            found = largest ? (other > found ? other : found) : (other < found ? other : found);
        }
        to[i] = found;
    }
}

/* Closes the holes, up to four cells wide, of a map (side, side) that holds numbers of its nearest things, or NOTHING;
 * outlines stay where they were, or, where the map is made narrower, come in by a cell from behind. `room` is as large as
 * the map. */
INLINE void close_holes(int32_t *map, int side, int narrower, int32_t *room) {
    int cells = side * side;
    room[0] = room[1] = room[cells - 3] = room[cells - 2] = room[cells - 1] = NOTHING;
    of_several(map, room, 2, cells - 2, 1, 2, 0);
    of_several(room, map, 2 * side, cells - 2 * side, side, 2, 0);
    if (narrower) {
        of_several(map, room, 2, cells - 3, 1, 3, 1);
        of_several(room, map, 2 * side, cells - 3 * side, side, 3, 1);
    } else {
        of_several(map, room, 2, cells - 2, 1, 2, 1);
        of_several(room, map, 2 * side, cells - 2 * side, side, 2, 1);
    }
}
