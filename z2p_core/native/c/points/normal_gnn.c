/* Patches that neighbours agree upon: rounds of messages between points, in a small network that does the same however
 * the cloud is turned (after Satorras et al., E(n) Equivariant Graph Neural Networks, 2021). It reads lengths and
 * angles alone, none of which tells a normal from its opposite, and what it adds to a normal are shares of its
 * neighbours' normals and of the steps to them. scripts/learn_patches.py has taught it. */

#include <math.h>
#include <stddef.h>
#include <string.h>

#include "common/simd.h"
#include "common/lanes.h"

#include "points/normal_gnn_weights.h" /* static const Network LEARNT, of so many ROUNDS of so many WIDTH units */

#define MET 16     /* neighbours that are measured at a time */
#define REACH 4.0f /* in `scale`, of the longest step to a neighbour: longer ones are told apart less and less */

/* Units are reckoned with by LANES, spelt out, as compilers turn loops over so few the wrong way round. */
#define PARTS (WIDTH / LANES)

typedef float Eight __attribute__((vector_size(32)));

/* What votes are made of, measured of a neighbour: its normal, turned as the point's own; the step to it times how far
 * that rises along either normal; and the rise itself. What the units say is summed over the neighbours times each. */
enum { TURN, CLIMB = 3, THEIR_CLIMB = 6, RISE = 9, MEASURES };

/* The numbers of that part of the units. */
INLINE Lanes part_of(const float *numbers, int part) { return lanes(numbers + LANES * part); }

/* Adds to `sums` numbers times their rows of weights: the odd ones apart, so that fewer additions wait for the one
 * before. */
INLINE void add_product(const float *numbers, const float (*weights)[WIDTH], Lanes *sums) {
    Lanes odd[PARTS];
    for (int u = 0; u < PARTS; u++) odd[u] = (Lanes){0};
    for (int i = 0; i < WIDTH; i += 2)
        for (int u = 0; u < PARTS; u++) {
            sums[u] += numbers[i] * part_of(weights[i], u);
            odd[u] += numbers[i + 1] * part_of(weights[i + 1], u);
        }
    for (int u = 0; u < PARTS; u++) sums[u] += odd[u];
}

/* The sum of votes times sums over all units, eight at a time, so that no addition waits for the one before, and in the
 * same order however many lanes there are. */
INLINE float poll(const float *votes, const Lanes *sums) {
    Eight all = {0};
    for (int first = 0; first < WIDTH; first += 8) {
        Eight vote, sum;
        memcpy(&vote, votes + first, sizeof vote);
        memcpy(&sum, (const float *)sums + first, sizeof sum);
        all += vote * sum;
    }
    return ((all[0] + all[4]) + (all[1] + all[5])) + ((all[2] + all[6]) + (all[3] + all[7]));
}

/* Measures of the first `count` neighbours in `row`, and what the units read of them: lengths and angles. */
INLINE void measure(const float *points, const float *normals, const float *p, const float *n, const int *row,
                    int count, float unit, float (*measures)[MET], float (*features)[MET]) {
    for (int j = 0; j < MET; j++) {
        size_t other = 3 * (size_t)row[j < count ? j : count - 1];
        for (int a = 0; a < 3; a++) {
            measures[CLIMB + a][j] = (points[other + a] - p[a]) * unit;
            measures[TURN + a][j] = normals[other + a];
        }
    }
    for (int j = 0; j < MET; j++) {
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

/* What the units say of the first `count` neighbours in `row`, for whom they have heard so much of the point itself. */
INLINE void say(const Round *round, const Lanes *heard, const float *told, const int *row, int count,
                float (*features)[MET], Lanes (*said)[PARTS]) {
    for (int u = 0; u < PARTS; u++) {
        Lanes own = heard[u], pair[FEATURES];
        for (int f = 0; f < FEATURES; f++) pair[f] = part_of(round->pair[f], u);
        for (int j = 0; j < count; j++) {
            Lanes sum = own + part_of(told + (size_t)row[j] * WIDTH, u);
            for (int f = 0; f < FEATURES; f++) sum += features[f][j] * pair[f];
            said[j][u] = positive(sum);
        }
    }
}

/* Adds that up over the neighbours, as it is and times each measure. */
INLINE void add_up(Lanes (*said)[PARTS], int count, float (*measures)[MET], Lanes *all, Lanes (*sums)[PARTS]) {
    for (int u = 0; u < PARTS; u++) {
        Lanes whole = all[u], times[MEASURES];
        for (int m = 0; m < MEASURES; m++) times[m] = sums[m][u];
        for (int j = 0; j < count; j++) {
            whole += said[j][u];
            for (int m = 0; m < MEASURES; m++) times[m] += said[j][u] * measures[m][j];
        }
        all[u] = whole;
        for (int m = 0; m < MEASURES; m++) sums[m][u] = times[m];
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
    float first[WIDTH];
    Lanes says[PARTS] = {{0}};
    for (int i = 0; i < WIDTH; i++) first[i] = larger(start[0][i] + noise * (start[1][i] + noise * start[2][i]), 0);
    add_product(first, LEARNT.rounds[0].other, says);
    for (int i = 0; i < count; i++) {
        memcpy(memory + (size_t)i * WIDTH, first, sizeof first);
        memcpy(told + (size_t)i * WIDTH, says, sizeof says);
    }
    return 1;
}

/* What a point remembers and tells (WIDTH, each) after a round, by what it remembers now (WIDTH) and what was said. */
INLINE void remember(const Round *round, const float *own, const Lanes *said, float *memory, float *told) {
    Lanes after[PARTS], says[PARTS];
    float heard[WIDTH];
    memcpy(heard, said, sizeof heard);
    for (int u = 0; u < PARTS; u++) after[u] = part_of(round->forget, u), says[u] = (Lanes){0};
    add_product(own, round->keep, after);
    add_product(heard, round->learn, after);
    for (int u = 0; u < PARTS; u++) after[u] = positive(after[u]);
    memcpy(memory, after, sizeof after);
    add_product(memory, round[1].other, says);
    memcpy(told, says, sizeof says);
}

/* What a point hears of itself, and sums that nothing was added to yet. No FAST function calls what returns Lanes: for
 * clang the two do not fit together before one is part of the other. */
INLINE void start(const Round *round, const float *own, Lanes *heard, Lanes *all, Lanes (*sums)[PARTS]) {
    for (int u = 0; u < PARTS; u++) {
        heard[u] = part_of(round->bias, u), all[u] = (Lanes){0};
        for (int m = 0; m < MEASURES; m++) sums[m][u] = (Lanes){0};
    }
    add_product(own, round->own, heard);
}

/* One round, for rows from `begin` to `end`: points (count, 3) on their patches, their unit normals (count, 3), of
 * either sign, memory (count, WIDTH) and what the points tell (count, WIDTH), from those before and from the neighbours
 * found (count, most), whose steps are measured in `scale` (count). */
FAST int z2p_refine(int which, const float *points, const float *normals, const float *memory, const float *told,
                    const int *found, const float *scale, int begin, int end, int most, float *points_after,
                    float *normals_after, float *memory_after, float *told_after) {
    const Round *round = LEARNT.rounds + which;
    float share = 1 / (float)most;
    for (int i = begin; i < end; i++) {
        const float *p = points + 3 * (size_t)i, *n = normals + 3 * (size_t)i, *own = memory + (size_t)i * WIDTH;
        const int *row = found + (size_t)i * most;
        Lanes heard[PARTS], all[PARTS], sums[MEASURES][PARTS];
        start(round, own, heard, all, sums);
        for (int first = 0; first < most; first += MET) {
            float measures[MEASURES][MET], features[FEATURES][MET];
            Lanes said[MET][PARTS];
            int count = most - first < MET ? most - first : MET;
            measure(points, normals, p, n, row + first, count, 1 / scale[i], measures, features);
            say(round, heard, told, row + first, count, features, said);
            add_up(said, count, measures, all, sums);
        }
        float turned[3], lift = share * scale[i] * poll(round->vote[3], sums[RISE]);
        for (int a = 0; a < 3; a++)
            turned[a] = n[a] + share * (poll(round->vote[0], sums[TURN + a]) + poll(round->vote[1], sums[CLIMB + a])
                                        + poll(round->vote[2], sums[THEIR_CLIMB + a]));
        float length = sqrtf(dot(turned, turned));
        for (int a = 0; a < 3; a++) {
            points_after[3 * (size_t)i + a] = p[a] + lift * n[a];
            normals_after[3 * (size_t)i + a] = length > 1e-6f ? turned[a] / length : n[a];
        }
        if (which + 1 == ROUNDS) continue; /* nobody listens any more */
        for (int u = 0; u < PARTS; u++) all[u] *= share;
        remember(round, own, all, memory_after + (size_t)i * WIDTH, told_after + (size_t)i * WIDTH);
    }
    return 1;
}
