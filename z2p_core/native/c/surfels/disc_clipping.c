/* Where a disc ends: a surface turns away from a disc's plane at creases and at outlines, and the planes of the disc's
 * neighbours say where (after Zwicker et al., Perspective Accurate Splatting, 2004, which clips discs at creases). */

#include <math.h>
#include <stddef.h>

#include "surfels/disc_clipping.h"
#include "common/simd.h"

#define TURNED 0.906f /* cosine of 25 degrees, by which a neighbour must be turned to end a disc */
#define ROOM 0.035f   /* of its radius, by which a disc goes on over a neighbour's plane */
#define REACH 1.6f    /* radii within which neighbours count */

/* How far along the disc of a point p, with normal n, the plane of another, q and m, ends it; INFINITY where it does
 * not: the planes are hardly turned, or the viewer, whom both normals face, looks into the valley between them. */
INLINE float end_of_disc(const float *p, const float *n, const float *q, const float *m, float radius) {
    float step[3] = {q[0] - p[0], q[1] - p[1], q[2] - p[2]};
    /* height of the other point over this plane, and of this one over the other */
    float along = dot(n, m), other = dot(step, n), own = -dot(step, m), square = dot(step, step);
    int ends = (fabsf(along) < TURNED) & ((other < 0) | (own < 0)) & (fabsf(own) > ROOM * radius);
    ends &= square < REACH * REACH * radius * radius;
    return ends ? fabsf(own) / sqrtf(1 - along * along) : INFINITY;
}

/* The plane of another point, q and m, with a point p under it, and `room` over it. */
INLINE void plane_over(const float *p, const float *q, const float *m, float room, float *clip) {
    float sign = dot(p, m) < dot(q, m) ? 1.0f : -1.0f;
    for (int a = 0; a < 3; a++) clip[a] = sign * m[a];
    clip[3] = dot(clip, q) + room;
}

/* clips (count, CLIPS, 4): from row `begin` to `end`, planes, as a normal and how far along it they lie, over which
 * next to nothing is left of the discs (count) about points with these normals. They are those of the neighbours
 * found (count, most) that end a disc nearest to its centre; for want of more, planes that nothing lies over. */
FAST int z2p_clips(const float *points, const float *normals, const float *radii, const int *found, int begin, int end,
                   int most, float *clips) {
    for (int i = begin; i < end; i++) {
        const int *row = found + (size_t)i * most;
        const float *p = points + 3 * (size_t)i, *n = normals + 3 * (size_t)i;
        float ends[CLIPS];
        int kept[CLIPS];
        for (int k = 0; k < CLIPS; k++) ends[k] = INFINITY;
        for (int j = 0; j < most; j++) {
            const float *q = points + 3 * (size_t)row[j], *m = normals + 3 * (size_t)row[j];
            float away = end_of_disc(p, n, q, m, radii[i]);
            if (away >= ends[CLIPS - 1]) continue;
            int at = CLIPS - 1;
            for (; at > 0 && ends[at - 1] > away; at--) {
                ends[at] = ends[at - 1];
                kept[at] = kept[at - 1];
            }
            ends[at] = away;
            kept[at] = row[j];
        }
        for (int k = 0; k < CLIPS; k++) {
            float *clip = clips + 4 * ((size_t)i * CLIPS + k);
            clip[0] = clip[1] = clip[2] = 0;
            clip[3] = INFINITY;
            if (ends[k] == INFINITY) continue;
            plane_over(p, points + 3 * (size_t)kept[k], normals + 3 * (size_t)kept[k], ROOM * radii[i], clip);
        }
    }
    return 1;
}
