/* Patches that neighbours agree upon: rounds of messages between points, in a small network that does the same however
 * the cloud is turned (after Satorras et al., E(n) Equivariant Graph Neural Networks, 2021). It reads lengths and
 * angles alone, none of which tells a normal from its opposite, and what it adds to a normal are shares of its
 * neighbours' normals and of the steps to them. scripts/learn_patches.py has taught it. */

#include <math.h>
#include <stddef.h>
#include <string.h>

#include "fast.h"

#define ROUNDS 3
#define WIDTH 16   /* units that read a neighbour, and numbers that a point remembers from round to round */
#define FEATURES 6 /* numbers that are read of a neighbour */
#define LANES 16   /* neighbours that are measured at a time */
#define REACH 4.0f /* in `scale`, of the longest step to a neighbour: longer ones are told apart less and less */

typedef struct {
    float pair[FEATURES][WIDTH], bias[WIDTH], own[WIDTH][WIDTH], other[WIDTH][WIDTH]; /* what the units read */
    float vote[4][WIDTH];                                 /* for the normal, either climb, and the height */
    float keep[WIDTH][WIDTH], learn[WIDTH][WIDTH], forget[WIDTH]; /* what is remembered; unused in the last round */
} Round;

typedef struct {
    float start[3][WIDTH]; /* times 1, the noise and its square */
    Round rounds[ROUNDS];
} Network;

#include "refine_weights.h" /* static const Network LEARNT */

/* One number of each unit. Spelt out, as compilers turn loops over so few the wrong way round. */
typedef float Units __attribute__((vector_size(4 * WIDTH)));
typedef int Masks __attribute__((vector_size(4 * WIDTH)));

/* What is measured of a neighbour: its normal, turned as the point's own; the step to it; and how far that rises along
 * either normal. */
enum { NORMAL, STEP = 3, RISE = 6, THEIR_RISE, MEASURES };

/* What the units say is summed over the neighbours as it is, and times a neighbour's normal, the step to it times
 * either rise, and the rise: votes are made of these. */
enum { SAID, TURN, CLIMB = TURN + 3, THEIR_CLIMB = CLIMB + 3, HEIGHT = THEIR_CLIMB + 3, SUMS };

INLINE Units units(const float *numbers) {
    Units all;
    memcpy(&all, numbers, sizeof all);
    return all;
}

INLINE Units positive(Units all) { return (Units)((all > 0) & (Masks)all); }

/* Numbers times their rows of weights, in four sums, so that fewer additions wait for the one before. */
INLINE Units product(Units numbers, const float (*weights)[WIDTH]) {
    Units sums[4] = {{0}};
    for (int i = 0; i < WIDTH; i++) sums[i % 4] += numbers[i] * units(weights[i]);
    return (sums[0] + sums[1]) + (sums[2] + sums[3]);
}

/* Sum of all units, by halves, so that no addition waits for the one before. */
INLINE float total(Units all) {
    float numbers[WIDTH];
    memcpy(numbers, &all, sizeof all);
    for (int half = WIDTH / 2; half; half /= 2)
        for (int i = 0; i < half; i++) numbers[i] += numbers[i + half];
    return numbers[0];
}

/* Measures of the first `count` neighbours in `row`, and what the units read of them: lengths and angles. */
INLINE void measure(const float *points, const float *normals, const float *p, const float *n, const int *row,
                    int count, float unit, float (*measures)[LANES], float (*features)[LANES]) {
    for (int j = 0; j < LANES; j++) {
        size_t other = 3 * (size_t)row[j < count ? j : count - 1];
        for (int a = 0; a < 3; a++) {
            measures[STEP + a][j] = (points[other + a] - p[a]) * unit;
            measures[NORMAL + a][j] = normals[other + a];
        }
    }
    for (int j = 0; j < LANES; j++) {
        float x = measures[STEP][j], y = measures[STEP + 1][j], z = measures[STEP + 2][j];
        float shorter = 1 / sqrtf(1 + (x * x + y * y + z * z) * (1 / (REACH * REACH)));
        float u = measures[NORMAL][j], v = measures[NORMAL + 1][j], w = measures[NORMAL + 2][j];
        float along = u * n[0] + v * n[1] + w * n[2], sign = along < 0 ? -1.0f : 1.0f;
        x *= shorter, y *= shorter, z *= shorter;
        u *= sign, v *= sign, w *= sign;
        float rise = x * n[0] + y * n[1] + z * n[2], theirs = x * u + y * v + z * w, square = x * x + y * y + z * z;
        measures[NORMAL][j] = u, measures[NORMAL + 1][j] = v, measures[NORMAL + 2][j] = w;
        measures[STEP][j] = x, measures[STEP + 1][j] = y, measures[STEP + 2][j] = z;
        measures[RISE][j] = rise, measures[THEIR_RISE][j] = theirs;
        features[0][j] = square;
        features[1][j] = rise * rise;
        features[2][j] = theirs * theirs;
        features[3][j] = rise * theirs;
        features[4][j] = 1 - along * sign;
        features[5][j] = sqrtf(square + 1e-6f);
    }
}

/* Adds up what the units say of the first `count` neighbours in `row`. */
INLINE void add_up(const Round *round, Units own, const float *told, const int *row, int count,
                   float (*measures)[LANES], float (*features)[LANES], Units *sums) {
    Units pair[FEATURES];
    for (int f = 0; f < FEATURES; f++) pair[f] = units(round->pair[f]);
    for (int j = 0; j < count; j++) {
        Units said = own + units(told + (size_t)row[j] * WIDTH);
        for (int f = 0; f < FEATURES; f++) said += features[f][j] * pair[f];
        said = positive(said);
        sums[SAID] += said;
        sums[HEIGHT] += said * measures[RISE][j];
        for (int a = 0; a < 3; a++) {
            sums[TURN + a] += said * measures[NORMAL + a][j];
            sums[CLIMB + a] += said * (measures[STEP + a][j] * measures[RISE][j]);
            sums[THEIR_CLIMB + a] += said * (measures[STEP + a][j] * measures[THEIR_RISE][j]);
        }
    }
}

/* What all of so many points remember before the first round, by the noise in spacings, and what they tell: memory
 * (count, WIDTH) and told (count, WIDTH). */
FAST int z2p_refine_begin(float noise, int count, float *memory, float *told) {
    const float(*start)[WIDTH] = LEARNT.start;
    Units first = positive(units(start[0]) + noise * (units(start[1]) + noise * units(start[2])));
    Units says = product(first, LEARNT.rounds[0].other);
    for (int i = 0; i < count; i++) {
        memcpy(memory + (size_t)i * WIDTH, &first, sizeof first);
        memcpy(told + (size_t)i * WIDTH, &says, sizeof says);
    }
    return 1;
}

/* One round, for rows from `begin` to `end`: points (count, 3) on their patches, their unit normals (count, 3), of
 * either sign, memory (count, WIDTH) and what the points tell (count, WIDTH), from those before and from the neighbours
 * found (count, most), whose steps are measured in `scale` (count). */
FAST int z2p_refine(int which, const float *points, const float *normals, const float *memory, const float *told,
                    const int *found, const float *scale, int begin, int end, int most, float *points_after,
                    float *normals_after, float *memory_after, float *told_after) {
    const Round *round = LEARNT.rounds + which;
    for (int i = begin; i < end; i++) {
        const float *p = points + 3 * (size_t)i, *n = normals + 3 * (size_t)i;
        const int *row = found + (size_t)i * most;
        float share = 1 / (float)most, turned[3];
        Units own = units(memory + (size_t)i * WIDTH), sums[SUMS] = {{0}};
        Units heard = units(round->bias) + product(own, round->own);
        for (int first = 0; first < most; first += LANES) {
            float measures[MEASURES][LANES], features[FEATURES][LANES];
            int count = most - first < LANES ? most - first : LANES;
            measure(points, normals, p, n, row + first, count, 1 / scale[i], measures, features);
            add_up(round, heard, told, row + first, count, measures, features, sums);
        }
        Units vote[4];
        for (int v = 0; v < 4; v++) vote[v] = share * units(round->vote[v]);
        for (int a = 0; a < 3; a++)
            turned[a] = n[a] + total(vote[0] * sums[TURN + a] + vote[1] * sums[CLIMB + a]
                                     + vote[2] * sums[THEIR_CLIMB + a]);
        float length = sqrtf(dot(turned, turned)), lift = scale[i] * total(vote[3] * sums[HEIGHT]);
        for (int a = 0; a < 3; a++) {
            points_after[3 * (size_t)i + a] = p[a] + lift * n[a];
            normals_after[3 * (size_t)i + a] = length > 1e-6f ? turned[a] / length : n[a];
        }
        if (which + 1 == ROUNDS) continue; /* nobody listens any more */
        Units learnt = product(sums[SAID] * share, round->learn);
        Units after = positive(units(round->forget) + product(own, round->keep) + learnt);
        Units says = product(after, round[1].other);
        memcpy(memory_after + (size_t)i * WIDTH, &after, sizeof after);
        memcpy(told_after + (size_t)i * WIDTH, &says, sizeof says);
    }
    return 1;
}
