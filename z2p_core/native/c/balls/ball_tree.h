/* A tree of bounding spheres over balls, which shadow rays, light rays and searches traverse. Blocks of eight spheres
 * lie together as x[8], y[8], z[8], radius[8]; the spheres of level 0 are the balls, and sphere i of a higher level
 * bounds block i of the level below. z2p_core/native/balls.py builds it; spheres that only fill a block up lie far
 * away. */

#pragma once

#include <math.h>
#include <stddef.h>
#include <stdint.h>

#include "common/simd.h"
#include "common/vec3.h"

#define BLOCK 8
#define MAX_LEVELS 12 /* the length of starts */
#define STACK_ROOM (BLOCK * MAX_LEVELS)

/* Blocks of level l begin at block starts[l]; the last level has one block. Mirrored by z2p_core/native/balls.py. */
typedef struct {
    int levels, starts[12];
} BallLevels;

/* A block that is still to be visited. */
typedef struct {
    int level, block;
} Visit;

INLINE const float *block_spheres(const float *tree, const BallLevels *levels, Visit at) {
    return tree + 4 * BLOCK * ((size_t)levels->starts[at.level] + at.block);
}

INLINE Visit root_of(const BallLevels *levels) {
    Visit root = {levels->levels - 1, 0};
    return root;
}

/* Center (3) and radius of a ball. */
INLINE void get_ball(const float *tree, int ball, float *center, float *radius) {
    const float *spheres = tree + 4 * BLOCK * (size_t)(ball / BLOCK) + ball % BLOCK;
    for (int a = 0; a < 3; a++) center[a] = spheres[BLOCK * a];
    *radius = spheres[BLOCK * 3];
}

/* What a ray hits first: the ball and the distance; -1 and INFINITY for none. */
typedef struct {
    int ball;
    float distance;
} RayHit;

/* The first ball that a unit ray from `origin` hits, other than `self` and those whose surfaces are nearer to the origin
 * than `min_distance`. */
INLINE RayHit trace_balls(const float *tree, const BallLevels *levels, const float *origin, const float *ray, int self,
                          float min_distance) {
    RayHit hit = {-1, INFINITY};
    Visit stack[STACK_ROOM];
    int depth = 0;
    stack[depth++] = root_of(levels);
    while (depth) {
        Visit at = stack[--depth];
        const float *restrict spheres = block_spheres(tree, levels, at);
        float along[BLOCK], half_chord_sq[BLOCK], distance_sq[BLOCK];
        for (int k = 0; k < BLOCK; k++) {
            float x = spheres[k] - origin[0], y = spheres[BLOCK + k] - origin[1], z = spheres[2 * BLOCK + k] - origin[2];
            float t = x * ray[0] + y * ray[1] + z * ray[2], radius = spheres[3 * BLOCK + k];
            float ax = x - t * ray[0], ay = y - t * ray[1], az = z - t * ray[2];
            along[k] = t;
            distance_sq[k] = x * x + y * y + z * z;
            half_chord_sq[k] = radius * radius - (ax * ax + ay * ay + az * az);
        }
        for (int k = 0; k < BLOCK; k++) {
            if (!(half_chord_sq[k] > 0)) continue;
            float half_chord = sqrtf(half_chord_sq[k]), radius = spheres[3 * BLOCK + k];
            if (at.level) {
                if (along[k] + half_chord > 0 && along[k] - half_chord < hit.distance) {
                    Visit next = {at.level - 1, at.block * BLOCK + k};
                    stack[depth++] = next;
                }
                continue;
            }
            int ball = at.block * BLOCK + k;
            float limit = min_distance + radius;
            if (ball == self || !(along[k] > 0) || distance_sq[k] < limit * limit) continue;
            float distance = larger(along[k] - half_chord, 0);
            if (distance < hit.distance || (distance == hit.distance && ball < hit.ball)) {
                hit.ball = ball;
                hit.distance = distance;
            }
        }
    }
    return hit;
}
