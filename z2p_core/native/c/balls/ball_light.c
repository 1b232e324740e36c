/* Light on balls: light rays from their centers, the area light on their surfaces, and what they send to each other.
 * Input: a tree of balls (ball_tree.h); output: light of groups of balls and what the balls see around them. */

#include <math.h>
#include <stdlib.h>

#include "balls/ball_light.h"

/* Writes the balls (count, direction_count) that rays from the centers of balls [begin, end) of the list `balls` along
 * unit directions (direction_count, 3) hit first, -1 for none, and the distances. Balls whose surfaces are nearer to
 * the center than the ball's limit (min_distances) do not count. */
FAST int z2p_trace_from_balls(const float *tree, const BallLevels *levels, const int *balls, int begin, int end,
                              const float *min_distances, const float *directions, int direction_count, int *hits,
                              float *distances) {
    for (int i = begin; i < end; i++) {
        float center[3], radius;
        get_ball(tree, balls[i], center, &radius);
        for (int d = 0; d < direction_count; d++) {
            RayHit hit = trace_balls(tree, levels, center, directions + 3 * d, balls[i], min_distances[i]);
            hits[(size_t)i * direction_count + d] = hit.ball;
            distances[(size_t)i * direction_count + d] = hit.distance;
        }
    }
    return 1;
}

/* The unit normal (3) at the middle of a cell of the octahedral map. */
INLINE void table_normal(int cell, float *n) {
    float x = ((float)(cell % TABLE_SIDE) + 0.5f) * (2.0f / TABLE_SIDE) - 1;
    float y = ((float)(cell / TABLE_SIDE) + 0.5f) * (2.0f / TABLE_SIDE) - 1, z = 1 - fabsf(x) - fabsf(y);
    n[0] = z < 0 ? (1 - fabsf(y)) * (x < 0 ? -1.0f : 1.0f) : x;
    n[1] = z < 0 ? (1 - fabsf(x)) * (y < 0 ? -1.0f : 1.0f) : y;
    n[2] = z;
    normalize(n);
}

/* Writes the tables of the direct light (count, LIGHT_VALUES) of balls [begin, end) of the list, white ones. */
FAST int z2p_ball_direct_light(const float *tree, const BallLevels *levels, const BallScene *scene, const int *balls,
                               int begin, int end, float *light) {
    for (int i = begin; i < end; i++) {
        float center[3], radius, *out = light + LIGHT_VALUES * (size_t)i + INDIRECT_VALUES;
        get_ball(tree, balls[i], center, &radius);
        for (int k = 0; k < TABLE_SIDE * TABLE_SIDE; k++) {
            float n[3], p[3], unhidden;
            table_normal(k, n);
            for (int a = 0; a < 3; a++) p[a] = center[a] + radius * n[a];
            out[k] = direct_light(tree, levels, scene, p, n, &unhidden);
        }
    }
    return 1;
}

/* Radiance (count, direction_count, 3) that comes to the centers of balls [begin, end) of the list along directions, of
 * what z2p_trace_from_balls found there. Ball b has the light of group b >> group_bits. */
FAST int z2p_radiance_around_balls(const float *tree, const BallScene *scene, const int *balls, int begin, int end,
                                   const float *directions, int direction_count, const int *hits,
                                   const float *distances, const float *light, int group_bits, const float *albedo,
                                   const float *floor, const float *outside, float *radiance) {
    for (int i = begin; i < end; i++) {
        float origin[3], radius, center[3];
        get_ball(tree, balls[i], origin, &radius);
        for (int d = 0; d < direction_count; d++) {
            size_t at = (size_t)i * direction_count + d;
            const float *ray = directions + 3 * d;
            float normal[3];
            int hit = hits[at];
            if (hit < 0) {
                environment_radiance(scene, floor, outside, origin, ray, radiance + 3 * at);
                continue;
            }
            get_ball(tree, hit, center, &radius);
            for (int a = 0; a < 3; a++) normal[a] = (origin[a] + distances[at] * ray[a] - center[a]) / radius;
            ball_radiance(light + LIGHT_VALUES * (size_t)(hit >> group_bits), albedo + 3 * (size_t)hit, normal,
                          radiance + 3 * at);
        }
    }
    return 1;
}

/* The balls nearest to the balls [begin, end) of the list: those whose surfaces lie within min(reach * radius) of the
 * ball's center, at most `room`, nearest first and then -1, (count, room); and how far that search came (count). */
FAST int z2p_nearest_balls(const float *tree, const BallLevels *levels, const int *balls, int begin, int end,
                           float reach, int room, int *nearest, float *limits) {
    float *found = malloc(sizeof(float) * (size_t)room);
    if (!found) return 0;
    for (int i = begin; i < end; i++) {
        float center[3], radius;
        int *out = nearest + (size_t)i * room, count = 0, depth = 0;
        get_ball(tree, balls[i], center, &radius);
        float limit = reach * radius;
        Visit stack[STACK_ROOM];
        stack[depth++] = root_of(levels);
        while (depth) {
            Visit at = stack[--depth];
            const float *restrict spheres = block_spheres(tree, levels, at);
            float gaps[BLOCK];
            for (int k = 0; k < BLOCK; k++) {
                float x = spheres[k] - center[0], y = spheres[BLOCK + k] - center[1];
                float z = spheres[2 * BLOCK + k] - center[2];
                gaps[k] = sqrtf(x * x + y * y + z * z) - spheres[3 * BLOCK + k];
            }
            for (int k = 0; k < BLOCK; k++) {
                int ball = at.block * BLOCK + k;
                if (!(gaps[k] < limit) || (!at.level && ball == balls[i])) continue;
                if (at.level) {
                    Visit next = {at.level - 1, ball};
                    stack[depth++] = next;
                    continue;
                }
                int place = count < room ? count++ : room - 1;
                while (place > 0 && (found[place - 1] > gaps[k]
                                     || (found[place - 1] == gaps[k] && out[place - 1] > ball))) {
                    found[place] = found[place - 1];
                    out[place] = out[place - 1];
                    place--;
                }
                found[place] = gaps[k];
                out[place] = ball;
                if (count == room) limit = found[room - 1];
            }
        }
        limits[i] = count == room ? nextafterf(found[room - 1], INFINITY) : limit;
        for (int k = count; k < room; k++) out[k] = -1;
    }
    free(found);
    return 1;
}
