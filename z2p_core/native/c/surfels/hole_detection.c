/* Whether a place lies in a small hole of the surface, and how the surface would lie there. */

#include <math.h>
#include <stddef.h>

#include "common/vec3.h"
#include "common/simd.h"
#include "points/neighbor_grid.h"

#define EMPTY 0.7f  /* of the reach: so far no point lies from the middle of a hole */
#define RIM 1.5f    /* times the reach: points up to there are the hole's rim */
#define FLAT 0.4f   /* sine of the angle off the plane up to which a point is of the same surface */
#define OPEN 1.3f   /* widest angle in which there may be no rim, in radians */
#define ALIKE 0.5f  /* cosine of the angle between normals of one surface */
#define NEAREST 8   /* points that tell how the surface lies */
#define GROWN 1.1f  /* a disc in a hole, against its reach */

/* The surface's unit normal around a place, and its height over the place along it; normals count that are like n. */
INLINE float lay(const float *points, const float *normals, const float *place, const int *row, float *n) {
    float sum[3] = {1e-3f * n[0], 1e-3f * n[1], 1e-3f * n[2]}, middle[3] = {0}, height = 0;
    int count = 0;
    for (int j = 0; j < NEAREST; j++) {
        const float *other = normals + 3 * (size_t)row[j], *at = points + 3 * (size_t)row[j];
        float like = dot(other, n);
        if (fabsf(like) <= ALIKE) continue;
        for (int a = 0; a < 3; a++) sum[a] += like > 0 ? other[a] : -other[a];
        for (int a = 0; a < 3; a++) middle[a] += at[a] - place[a];
        count++;
    }
    float length = sqrtf(dot(sum, sum));
    for (int a = 0; a < 3; a++) n[a] = sum[a] / length;
    for (int a = 0; a < 3 && count; a++) height += middle[a] * n[a] / (float)count;
    return height;
}

/* The widest angle around a place, in the plane across n, in which no point of the same surface lies near. */
INLINE float widest_gap(const float *points, const float *place, const int *row, int most, const float *n, float near) {
    float u[3], v[3], angles[MOST_NEIGHBOURS], widest = 0;
    int count = 0;
    axes_across(n, u, v);
    for (int j = 0; j < most; j++) {
        const float *at = points + 3 * (size_t)row[j];
        float d[3] = {at[0] - place[0], at[1] - place[1], at[2] - place[2]}, square = dot(d, d), height = dot(d, n);
        if (square > near * near || height * height > FLAT * FLAT * square) continue;
        float angle = atan2f(dot(d, v), dot(d, u));
        int to = count++;
        for (; to && angles[to - 1] > angle; to--) angles[to] = angles[to - 1];
        angles[to] = angle;
    }
    if (!count) return INFINITY;
    for (int j = 1; j < count; j++) widest = larger(widest, angles[j] - angles[j - 1]);
    return larger(widest, angles[0] + 6.2831853f - angles[count - 1]);
}

/* radii (count) of the discs that close the holes around places (count, 3), 0 where there is none: a hole is empty up
 * to about its reach, and has its rim on all sides. Neighbours of the places are found (count, most); each place has
 * the normal (3) of a point at the rim, and is moved towards the surface and gets the surface's normal. */
FAST int z2p_holes(const float *points, const float *normals, const int *found, int count, int most,
                   const float *reaches, float *places, float *facing, float *radii) {
    for (int i = 0; i < count; i++) {
        const int *row = found + (size_t)i * most;
        float *place = places + 3 * (size_t)i, *n = facing + 3 * (size_t)i, reach = reaches[i], d[3];
        for (int a = 0; a < 3; a++) d[a] = points[3 * (size_t)row[0] + a] - place[a];
        radii[i] = 0;
        if (dot(d, d) < EMPTY * EMPTY * reach * reach) continue;
        float height = lay(points, normals, place, row, n);
        for (int a = 0; a < 3; a++) place[a] += 0.5f * height * n[a];
        if (widest_gap(points, place, row, most, n, RIM * reach) < OPEN) radii[i] = GROWN * reach;
    }
    return 1;
}
