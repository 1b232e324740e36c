/* Patches that neighbours agree upon: rounds of messages between points, in a small network that does the same however
 * the cloud is turned (after Satorras et al., E(n) Equivariant Graph Neural Networks, 2021). It reads lengths and
 * angles alone, none of which tells a normal from its opposite, and what it adds to a normal are shares of its
 * neighbours' normals and of the steps to them. scripts/learn_patches.py has taught it. */

#include <math.h>
#include <stddef.h>
#include <string.h>

#include "fast.h"

#include "refine_weights.h" /* static const Network LEARNT, of so many ROUNDS of so many WIDTH units */

#define LANES 16   /* neighbours that are measured at a time */
#define REACH 4.0f /* in `scale`, of the longest step to a neighbour: longer ones are told apart less and less */

/* One number of each unit. Spelt out, as compilers turn loops over so few the wrong way round. */
typedef float Units __attribute__((vector_size(4 * WIDTH)));
typedef int Masks __attribute__((vector_size(4 * WIDTH)));
typedef float Half __attribute__((vector_size(2 * WIDTH)));
typedef float Quarter __attribute__((vector_size(WIDTH)));

/* What votes are made of, measured of a neighbour: its normal, turned as the point's own; the step to it times how far
 * that rises along either normal; and the rise itself. What the units say is summed over the neighbours times each. */
enum { TURN, CLIMB = 3, THEIR_CLIMB = 6, RISE = 9, MEASURES };

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
    Half halves[2];
    memcpy(halves, &all, sizeof halves);
    halves[0] += halves[1];
    Quarter quarters[2];
    memcpy(quarters, halves, sizeof quarters);
    Quarter sums = quarters[0] + quarters[1];
    return (sums[0] + sums[2]) + (sums[1] + sums[3]);
}

/* Measures of the first `count` neighbours in `row`, and what the units read of them: lengths and angles. */
INLINE void measure(const float *points, const float *normals, const float *p, const float *n, const int *row,
                    int count, float unit, float (*measures)[LANES], float (*features)[LANES]) {
    for (int j = 0; j < LANES; j++) {
        size_t other = 3 * (size_t)row[j < count ? j : count - 1];
        for (int a = 0; a < 3; a++) {
            measures[CLIMB + a][j] = (points[other + a] - p[a]) * unit;
            measures[TURN + a][j] = normals[other + a];
        }
    }
    for (int j = 0; j < LANES; j++) {
        float x = measures[CLIMB][j], y = measures[CLIMB + 1][j], z = measures[CLIMB + 2][j];
        float shorter = 1 / sqrtf(1 + (x * x + y * y + z * z) * (1 / (REACH * REACH)));
        float u = measures[TURN][j], v = measures[TURN + 1][j], w = measures[TURN + 2][j];
        float along = u * n[0] + v * n[1] + w * n[2], sign = along < 0 ? -1.0f : 1.0f;
        x *= shorter, y *= shorter, z *= shorter;
        u *= sign, v *= sign, w *= sign;
        float rise = x * n[0] + y * n[1] + z * n[2], theirs = x * u + y * v + z * w, square = x * x + y * y + z * z;
        measures[TURN][j] = u, measures[TURN + 1][j] = v, measures[TURN + 2][j] = w;
        measures[CLIMB][j] = x * rise, measures[CLIMB + 1][j] = y * rise, measures[CLIMB + 2][j] = z * rise;
        measures[THEIR_CLIMB][j] = x * theirs, measures[THEIR_CLIMB + 1][j] = y * theirs;
        measures[THEIR_CLIMB + 2][j] = z * theirs, measures[RISE][j] = rise;
        features[0][j] = square;
        features[1][j] = rise * rise;
        features[2][j] = theirs * theirs;
        features[3][j] = rise * theirs;
        features[4][j] = 1 - along * sign;
        features[5][j] = sqrtf(square + 1e-6f);
    }
}

/* Adds up what the units say of the first `count` neighbours in `row`, as it is and times each measure. */
INLINE void add_up(const Round *round, Units own, const float *told, const int *row, int count,
                   float (*measures)[LANES], float (*features)[LANES], Units *all, Units *sums) {
    Units pair[FEATURES];
    for (int f = 0; f < FEATURES; f++) pair[f] = units(round->pair[f]);
    for (int j = 0; j < count; j++) {
        Units said = own + units(told + (size_t)row[j] * WIDTH);
        for (int f = 0; f < FEATURES; f++) said += features[f][j] * pair[f];
        said = positive(said);
        *all += said;
        for (int m = 0; m < MEASURES; m++) sums[m] += said * measures[m][j];
    }
}

/* How many rounds there are, and how many numbers a point remembers and tells. */
int z2p_refine_size(int *rounds, int *width) {
    *rounds = ROUNDS, *width = WIDTH;
    return 1;
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
        Units own = units(memory + (size_t)i * WIDTH), said = {0}, sums[MEASURES] = {{0}};
        Units heard = units(round->bias) + product(own, round->own);
        for (int first = 0; first < most; first += LANES) {
            float measures[MEASURES][LANES], features[FEATURES][LANES];
            int count = most - first < LANES ? most - first : LANES;
            measure(points, normals, p, n, row + first, count, 1 / scale[i], measures, features);
            add_up(round, heard, told, row + first, count, measures, features, &said, sums);
        }
        Units vote[4];
        for (int v = 0; v < 4; v++) vote[v] = share * units(round->vote[v]);
        for (int a = 0; a < 3; a++)
            turned[a] = n[a] + total(vote[0] * sums[TURN + a] + vote[1] * sums[CLIMB + a]
                                     + vote[2] * sums[THEIR_CLIMB + a]);
        float length = sqrtf(dot(turned, turned)), lift = scale[i] * total(vote[3] * sums[RISE]);
        for (int a = 0; a < 3; a++) {
            points_after[3 * (size_t)i + a] = p[a] + lift * n[a];
            normals_after[3 * (size_t)i + a] = length > 1e-6f ? turned[a] / length : n[a];
        }
        if (which + 1 == ROUNDS) continue; /* nobody listens any more */
        Units learnt = product(said * share, round->learn);
        Units after = positive(units(round->forget) + product(own, round->keep) + learnt);
        Units says = product(after, round[1].other);
        memcpy(memory_after + (size_t)i * WIDTH, &after, sizeof after);
        memcpy(told_after + (size_t)i * WIDTH, &says, sizeof says);
    }
    return 1;
}
