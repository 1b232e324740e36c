/* Refinement of normals and positions by a small graph network: rounds of messages between neighboring points. It is
 * equivariant to rotations and to the signs of normals (after Satorras et al., E(n) Equivariant Graph Neural Networks,
 * 2021): its hidden layer reads lengths and angles only, and its outputs are coefficients of the neighbors' normals and
 * offsets. Trained by scripts/train_normal_gnn.py; scripts/normal_network.py is the same network in torch.
 *
 * Input: points, unit normals of either sign, neighbors, scales and the noise. Output: refined points and normals. */

#include <math.h>
#include <stddef.h>
#include <string.h>

#include "common/vec3.h"
#include "common/lanes.h"

#include "points/normal_gnn_weights.h" /* static const Network NORMAL_GNN_WEIGHTS, ROUNDS and WIDTH */

#define BATCH 16      /* neighbors that are processed at a time */
#define MAX_STEP 4.0f /* in `scale`: offsets to neighbors are compressed smoothly to less than this length */

/* Hidden units are processed as PARTS vectors of LANES. Loops over units are unrolled by hand, as compilers would
 * vectorize them along the wrong dimension. */
#define PARTS (WIDTH / LANES)

typedef float Eight __attribute__((vector_size(32)));

/* Equivariant components of a neighbor: its sign-aligned normal, its offset weighted by its height over the point's
 * plane and by that over its own plane, and the height. Hidden activations are aggregated against each of them. */
enum { ALIGNED_NORMAL, OFFSET_BY_HEIGHT = 3, OFFSET_BY_OTHER_HEIGHT = 6, HEIGHT = 9, COMPONENTS };

/* One vector of a row of WIDTH values. */
INLINE Lanes load_part(const float *numbers, int part) { return load_lanes(numbers + LANES * part); }

/* Adds values (WIDTH) times weights (WIDTH, WIDTH) to `sums`; odd rows are summed apart, for shorter chains of
 * additions. */
INLINE void add_matrix_product(const float *numbers, const float (*weights)[WIDTH], Lanes *sums) {
    Lanes odd[PARTS];
    for (int u = 0; u < PARTS; u++) odd[u] = (Lanes){0};
    for (int i = 0; i < WIDTH; i += 2)
        for (int u = 0; u < PARTS; u++) {
            sums[u] += numbers[i] * load_part(weights[i], u);
            odd[u] += numbers[i + 1] * load_part(weights[i + 1], u);
        }
    for (int u = 0; u < PARTS; u++) sums[u] += odd[u];
}

/* Dot product over all units, eight at a time and in the same order for any number of lanes. */
INLINE float dot_units(const float *weights, const Lanes *sums) {
    Eight all = {0};
    for (int first = 0; first < WIDTH; first += 8) {
        Eight weight, sum;
        memcpy(&weight, weights + first, sizeof weight);
        memcpy(&sum, (const float *)sums + first, sizeof sum);
        all += weight * sum;
    }
    return ((all[0] + all[4]) + (all[1] + all[5])) + ((all[2] + all[6]) + (all[3] + all[7]));
}

/* Components and rotation-invariant features of the first `count` neighbors in `row`. */
INLINE void measure_neighbors(const float *points, const float *normals, const float *p, const float *n, const int *row,
                              int count, float unit, float (*components)[BATCH], float (*features)[BATCH]) {
    for (int j = 0; j < BATCH; j++) {
        size_t other = 3 * (size_t)row[j < count ? j : count - 1];
        for (int a = 0; a < 3; a++) {
            components[OFFSET_BY_HEIGHT + a][j] = (points[other + a] - p[a]) * unit;
            components[ALIGNED_NORMAL + a][j] = normals[other + a];
        }
    }
    for (int j = 0; j < BATCH; j++) {
        float x = components[OFFSET_BY_HEIGHT][j], y = components[OFFSET_BY_HEIGHT + 1][j];
        float z = components[OFFSET_BY_HEIGHT + 2][j];
        float shorter = 1 / sqrtf(1 + (x * x + y * y + z * z) * (1 / (MAX_STEP * MAX_STEP)));
        float u = components[ALIGNED_NORMAL][j], v = components[ALIGNED_NORMAL + 1][j];
        float w = components[ALIGNED_NORMAL + 2][j];
        float cosine = u * n[0] + v * n[1] + w * n[2], sign = cosine < 0 ? -1.0f : 1.0f;
        x *= shorter, y *= shorter, z *= shorter;
        u *= sign, v *= sign, w *= sign;
        float height = x * n[0] + y * n[1] + z * n[2], other_height = x * u + y * v + z * w;
        float length_sq = x * x + y * y + z * z;
        components[ALIGNED_NORMAL][j] = u, components[ALIGNED_NORMAL + 1][j] = v, components[ALIGNED_NORMAL + 2][j] = w;
        components[OFFSET_BY_HEIGHT][j] = x * height, components[OFFSET_BY_HEIGHT + 1][j] = y * height;
        components[OFFSET_BY_HEIGHT + 2][j] = z * height;
        components[OFFSET_BY_OTHER_HEIGHT][j] = x * other_height;
        components[OFFSET_BY_OTHER_HEIGHT + 1][j] = y * other_height;
        components[OFFSET_BY_OTHER_HEIGHT + 2][j] = z * other_height, components[HEIGHT][j] = height;
        features[0][j] = length_sq;
        features[1][j] = height * height;
        features[2][j] = other_height * other_height;
        features[3][j] = height * other_height;
        features[4][j] = 1 - cosine * sign;
        features[5][j] = sqrtf(length_sq + 1e-6f);
    }
}

/* Hidden activations for the first `count` neighbors in `row`; own_input is the part that depends on the point only. */
INLINE void hidden_activations(const Round *round, const Lanes *own_input, const float *messages, const int *row,
                               int count, float (*features)[BATCH], Lanes (*hidden)[PARTS]) {
    for (int u = 0; u < PARTS; u++) {
        Lanes own = own_input[u], pair[FEATURES];
        for (int f = 0; f < FEATURES; f++) pair[f] = load_part(round->pair[f], u);
        for (int j = 0; j < count; j++) {
            Lanes sum = own + load_part(messages + (size_t)row[j] * WIDTH, u);
            for (int f = 0; f < FEATURES; f++) sum += features[f][j] * pair[f];
            hidden[j][u] = relu(sum);
        }
    }
}

/* Sums the hidden activations over the neighbors, plain and times each component. */
INLINE void aggregate(Lanes (*hidden)[PARTS], int count, float (*components)[BATCH], Lanes *all, Lanes (*sums)[PARTS]) {
    for (int u = 0; u < PARTS; u++) {
        Lanes sum = all[u], weighted[COMPONENTS];
        for (int m = 0; m < COMPONENTS; m++) weighted[m] = sums[m][u];
        for (int j = 0; j < count; j++) {
            sum += hidden[j][u];
            for (int m = 0; m < COMPONENTS; m++) weighted[m] += hidden[j][u] * components[m][j];
        }
        all[u] = sum;
        for (int m = 0; m < COMPONENTS; m++) sums[m][u] = weighted[m];
    }
}

/* Number of rounds, and values in the state and in the message of a point. */
int z2p_normal_gnn_size(int *rounds, int *width) {
    *rounds = ROUNDS, *width = WIDTH;
    return 1;
}

/* Initial state (count, WIDTH) and messages (count, WIDTH) of all points, by the noise in spacings. */
FAST int z2p_normal_gnn_begin(float noise, int count, float *state, float *messages) {
    const float(*start)[WIDTH] = NORMAL_GNN_WEIGHTS.start;
    float first[WIDTH];
    Lanes message[PARTS] = {{0}};
    for (int i = 0; i < WIDTH; i++) first[i] = larger(start[0][i] + noise * (start[1][i] + noise * start[2][i]), 0);
    add_matrix_product(first, NORMAL_GNN_WEIGHTS.rounds[0].other, message);
    for (int i = 0; i < count; i++) {
        memcpy(state + (size_t)i * WIDTH, first, sizeof first);
        memcpy(messages + (size_t)i * WIDTH, message, sizeof message);
    }
    return 1;
}

/* State and outgoing message (WIDTH each) of a point after a round, by its state and the aggregated activations. */
INLINE void update_state(const Round *round, const float *own, const Lanes *hidden, float *state,
                         float *message_after) {
    Lanes after[PARTS], message[PARTS];
    float own_input[WIDTH];
    memcpy(own_input, hidden, sizeof own_input);
    for (int u = 0; u < PARTS; u++) after[u] = load_part(round->forget, u), message[u] = (Lanes){0};
    add_matrix_product(own, round->keep, after);
    add_matrix_product(own_input, round->learn, after);
    for (int u = 0; u < PARTS; u++) after[u] = relu(after[u]);
    memcpy(state, after, sizeof after);
    add_matrix_product(state, round[1].other, message);
    memcpy(message_after, message, sizeof message);
}

/* The point's own part of the hidden layer, and sums set to 0. No FAST function calls one that returns Lanes, as clang
 * cannot combine the two unless they are inlined. */
INLINE void begin_point(const Round *round, const float *own, Lanes *own_input, Lanes *all, Lanes (*sums)[PARTS]) {
    for (int u = 0; u < PARTS; u++) {
        own_input[u] = load_part(round->bias, u), all[u] = (Lanes){0};
        for (int m = 0; m < COMPONENTS; m++) sums[m][u] = (Lanes){0};
    }
    add_matrix_product(own, round->own, own_input);
}

/* One round, for rows from `begin` to `end`: points (count, 3), unit normals (count, 3), states (count, WIDTH) and
 * messages (count, WIDTH) from those before it, the neighbors (count, neighbor_count) and `scale` (count), by which
 * offsets are divided. The last round writes no states and messages. */
FAST int z2p_refine_normals(int round_index, const float *points, const float *normals, const float *state,
                            const float *messages, const int *neighbors, const float *scale, int begin, int end,
                            int neighbor_count, float *points_after, float *normals_after, float *state_after,
                            float *messages_after) {
    const Round *round = NORMAL_GNN_WEIGHTS.rounds + round_index;
    float share = 1 / (float)neighbor_count;
    for (int i = begin; i < end; i++) {
        const float *p = points + 3 * (size_t)i, *n = normals + 3 * (size_t)i, *own = state + (size_t)i * WIDTH;
        const int *row = neighbors + (size_t)i * neighbor_count;
        Lanes own_input[PARTS], all[PARTS], sums[COMPONENTS][PARTS];
        begin_point(round, own, own_input, all, sums);
        for (int first = 0; first < neighbor_count; first += BATCH) {
            float components[COMPONENTS][BATCH], features[FEATURES][BATCH];
            Lanes hidden[BATCH][PARTS];
            int count = neighbor_count - first < BATCH ? neighbor_count - first : BATCH;
            measure_neighbors(points, normals, p, n, row + first, count, 1 / scale[i], components, features);
            hidden_activations(round, own_input, messages, row + first, count, features, hidden);
            aggregate(hidden, count, components, all, sums);
        }
        float refined[3], shift = share * scale[i] * dot_units(round->output[3], sums[HEIGHT]);
        for (int a = 0; a < 3; a++)
            refined[a] = n[a] + share * (dot_units(round->output[0], sums[ALIGNED_NORMAL + a]) +
                                         dot_units(round->output[1], sums[OFFSET_BY_HEIGHT + a]) +
                                         dot_units(round->output[2], sums[OFFSET_BY_OTHER_HEIGHT + a]));
        float length = sqrtf(dot(refined, refined));
        for (int a = 0; a < 3; a++) {
            points_after[3 * (size_t)i + a] = p[a] + shift * n[a];
            normals_after[3 * (size_t)i + a] = length > 1e-6f ? refined[a] / length : n[a];
        }
        if (round_index + 1 == ROUNDS) continue; /* last round: no outgoing messages */
        for (int u = 0; u < PARTS; u++) all[u] *= share;
        update_state(round, own, all, state_after + (size_t)i * WIDTH, messages_after + (size_t)i * WIDTH);
    }
    return 1;
}
