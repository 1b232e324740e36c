/* Textures of surfels (see disc_texture.h), fitted to the colors of the points around each: where these have two
 * colors, a curve between both; elsewhere a gradient.
 *
 * The curve is the boundary of a logistic regression with the terms of a second-order polynomial, so neighboring
 * discs find nearly the same one. The gradient is a moving least squares fit of first order, limited to the colors
 * around. */

#include <math.h>
#include <stddef.h>

#include "common/lanes.h"
#include "common/vec3.h"
#include "surfels/disc_texture.h"

#define NEIGHBORS 16               /* nearest points that a texture is fitted to, at most; a multiple of LANES */
#define GRADIENT_NEIGHBORS 9       /* of them those that a gradient is fitted to */
#define WINDOW_RADII 1.2f          /* standard deviation of the Gaussian weights of neighbors, in the disc's radius */
#define MIN_CONTRAST 1e-4f         /* of the neighbors' colors, below which the texture is one color */
#define GRADIENT_REGULARIZATION 0.01f
#define RANDOM_SHARE 0.3f          /* of the colors' variance that a gradient explains by chance: it does not count */
#define FULL_SHARE 0.7f            /* from which on it counts in full */
#define MIN_TWO_COLORS_DISTANCE 0.02f /* between two colors, in square roots of albedo */
#define MAX_SPREAD_OF_COLORS 0.22f /* standard deviation about two colors over their distance, above which they are not
                                     two but part of a gradient */
#define FULL_SPREAD_OF_COLORS 0.14f /* below which they are two in full */
#define CLUSTER_ROUNDS 2
#define NEWTON_ROUNDS 5
#define MIN_CURVATURE_OF_LOSS 0.01f
#define SLOPE_REGULARIZATION 0.005f /* of the curve's linear terms, in the regression's loss */
#define BEND_REGULARIZATION 0.07f  /* of its quadratic terms */
#define OFFSET_REGULARIZATION 1e-3f
#define MIN_PIVOT 1e-12f

/* A disc's neighbors: positions in its tangent plane in units of its radius, weights, 0 for unused ones, and
 * albedos with their square roots and least and greatest values. */
typedef struct {
    float s[NEIGHBORS], t[NEIGHBORS], weight[NEIGHBORS], color[3][NEIGHBORS], root[3][NEIGHBORS], low[3], high[3];
    int count;
} Neighborhood;

INLINE float sum_lanes(Lanes a) {
    return ((a[0] + a[4]) + (a[1] + a[5])) + ((a[2] + a[6]) + (a[3] + a[7]));
}

INLINE float sum_products(const float *a, const float *b) {
    Lanes sum = {0};
    for (int j = 0; j < NEIGHBORS; j += LANES) sum += load_lanes(a + j) * load_lanes(b + j);
    return sum_lanes(sum);
}

INLINE float sum_values(const float *a) {
    Lanes sum = {0};
    for (int j = 0; j < NEIGHBORS; j += LANES) sum += load_lanes(a + j);
    return sum_lanes(sum);
}

/* Gathers the neighbors of disc i; returns 0 if they all have one color. */
INLINE int gather_neighbors(const float *centers, const float *normals, const float *albedo, const int *row, int count,
                            int i, float radius, Neighborhood *near) {
    const float *p = centers + 3 * (size_t)i, *n = normals + 3 * (size_t)i;
    float u[3], v[3], offset[3][NEIGHBORS], facing[NEIGHBORS], scale = 1 / radius, contrast = 0;
    tangent_basis(n, u, v);
    near->count = count < NEIGHBORS ? count : NEIGHBORS;
    for (int a = 0; a < 3; a++) near->low[a] = near->high[a] = albedo[3 * (size_t)i + a];
    for (int j = 0; j < NEIGHBORS; j++) {
        size_t other = 3 * (size_t)row[j < near->count ? j : near->count - 1];
        for (int a = 0; a < 3; a++) {
            float value = albedo[other + a];
            offset[a][j] = (centers[other + a] - p[a]) * scale;
            near->color[a][j] = value;
            near->low[a] = smaller(near->low[a], value), near->high[a] = larger(near->high[a], value);
        }
        facing[j] = j < near->count ? larger(dot(normals + other, n), 0) : 0;
    }
    for (int a = 0; a < 3; a++) contrast = larger(contrast, near->high[a] - near->low[a]);
    if (contrast < MIN_CONTRAST) return 0;
    for (int j = 0; j < NEIGHBORS; j++) {
        float x = offset[0][j], y = offset[1][j], z = offset[2][j];
        near->s[j] = x * u[0] + y * u[1] + z * u[2];
        near->t[j] = x * v[0] + y * v[1] + z * v[2];
        near->weight[j] = facing[j] * facing[j] *
                          exp_fast((x * x + y * y + z * z) * (-0.5f / (WINDOW_RADII * WINDOW_RADII)));
    }
    for (int a = 0; a < 3; a++)
        for (int j = 0; j < NEIGHBORS; j++) near->root[a][j] = sqrtf(larger(near->color[a][j], 0));
    return 1;
}

/* Writes a texture with this color at the center and a gradient, which counts by the share of the colors' variance that
 * it explains, and whose colors at the rim are not beyond those of the neighbors. */
INLINE void fit_gradient(const Neighborhood *near, const float *own, float *texture) {
    int count = near->count < GRADIENT_NEIGHBORS ? near->count : GRADIENT_NEIGHBORS;
    float ss = GRADIENT_REGULARIZATION, st = 0, tt = GRADIENT_REGULARIZATION, total = 0, explained = 0;
    for (int j = 0; j < count; j++) {
        float w = near->weight[j], s = near->s[j], t = near->t[j];
        ss += w * s * s, st += w * s * t, tt += w * t * t;
    }
    float inverse = 1 / (ss * tt - st * st), *along_s = texture + 3, *along_t = texture + 6;
    for (int a = 0; a < 3; a++) {
        float sy = 0, ty = 0, yy = 0, range = smaller(near->high[a] - own[a], own[a] - near->low[a]);
        for (int j = 0; j < count; j++) {
            float w = near->weight[j], y = near->color[a][j] - own[a];
            sy += w * near->s[j] * y, ty += w * near->t[j] * y, yy += w * y * y;
        }
        along_s[a] = (tt * sy - st * ty) * inverse, along_t[a] = (ss * ty - st * sy) * inverse;
        total += yy;
        explained += 2 * (along_s[a] * sy + along_t[a] * ty) -
                     (along_s[a] * along_s[a] * (ss - GRADIENT_REGULARIZATION) + 2 * along_s[a] * along_t[a] * st +
                      along_t[a] * along_t[a] * (tt - GRADIENT_REGULARIZATION));
        float steepest = sqrtf(along_s[a] * along_s[a] + along_t[a] * along_t[a]);
        float limit = smaller(range / larger(steepest, 1e-9f), 1);
        along_s[a] *= limit, along_t[a] *= limit;
    }
    float share = (explained / larger(total, 1e-12f) - RANDOM_SHARE) / (FULL_SHARE - RANDOM_SHARE);
    share = smaller(larger(share, 0), 1);
    for (int a = 0; a < 3; a++) texture[a] = own[a], along_s[a] *= share, along_t[a] *= share;
}

/* Index of the neighbor whose color differs most from one. */
INLINE int farthest_color(const Neighborhood *near, const float *root) {
    float distance_sq[NEIGHBORS] = {0}, most = -1;
    int farthest = 0;
    for (int a = 0; a < 3; a++)
        for (int j = 0; j < NEIGHBORS; j++)
            distance_sq[j] += (near->root[a][j] - root[a]) * (near->root[a][j] - root[a]);
    for (int j = 0; j < near->count; j++)
        if (distance_sq[j] > most) most = distance_sq[j], farthest = j;
    return farthest;
}

/* Divides the neighbors into two groups by color (k-means): members[g][j] is 1 for those of group g, else 0.
 * Returns how far they have two colors, 0 to 1. */
INLINE float divide_by_color(const Neighborhood *near, float (*members)[NEIGHBORS]) {
    float mean[2][3], first[3], spread = 0, distance = 0;
    for (int a = 0; a < 3; a++) first[a] = near->root[a][0];
    for (int g = 0; g < 2; g++) {
        int farthest = farthest_color(near, g ? mean[0] : first);
        for (int a = 0; a < 3; a++) mean[g][a] = near->root[a][farthest];
    }
    for (int round = 0; round < CLUSTER_ROUNDS; round++) {
        float nearer[NEIGHBORS] = {0}; /* to the first mean than to the second one, if positive */
        for (int a = 0; a < 3; a++)
            for (int j = 0; j < NEIGHBORS; j++) {
                float to_second = near->root[a][j] - mean[1][a], to_first = near->root[a][j] - mean[0][a];
                nearer[j] += to_second * to_second - to_first * to_first;
            }
        for (int j = 0; j < NEIGHBORS; j++) {
            float used = j < near->count ? 1.0f : 0.0f;
            members[0][j] = nearer[j] > 0 ? used : 0;
            members[1][j] = nearer[j] > 0 ? 0 : used;
        }
        for (int g = 0; g < 2; g++) {
            float inverse = 1 / larger(sum_values(members[g]), 1);
            for (int a = 0; a < 3; a++) mean[g][a] = sum_products(members[g], near->root[a]) * inverse;
        }
    }
    for (int a = 0; a < 3; a++) {
        float off[NEIGHBORS]; /* from the mean of a neighbor's group */
        for (int j = 0; j < NEIGHBORS; j++) {
            float used = members[0][j] + members[1][j];
            off[j] = used * near->root[a][j] - members[0][j] * mean[0][a] - members[1][j] * mean[1][a];
        }
        distance += (mean[1][a] - mean[0][a]) * (mean[1][a] - mean[0][a]);
        spread += sum_products(off, off);
    }
    distance = sqrtf(distance), spread = sqrtf(spread / (float)near->count);
    if (distance < MIN_TWO_COLORS_DISTANCE) return 0;
    float share = (MAX_SPREAD_OF_COLORS - spread / distance) / (MAX_SPREAD_OF_COLORS - FULL_SPREAD_OF_COLORS);
    return smaller(larger(share, 0), 1);
}

/* Neighborhoods of up to LANES discs with two colors, one in each lane, whose curves are fitted together. */
typedef struct {
    float s[NEIGHBORS][LANES], t[NEIGHBORS][LANES], weight[NEIGHBORS][LANES], is_first[NEIGHBORS][LANES];
    float *curve[LANES]; /* where their coefficients go (CURVE_VALUES) */
    int count;
} Batch;

/* Solves a x = b in each lane, for symmetric positive definite matrices of which the lower triangle is read and
 * overwritten; x replaces b. */
INLINE void solve_cholesky(Lanes a[CURVE_VALUES][CURVE_VALUES], Lanes *b) {
    for (int i = 0; i < CURVE_VALUES; i++) {
        float pivot[LANES];
        for (int j = 0; j < i; j++) {
            for (int k = 0; k < j; k++) a[i][j] -= a[i][k] * a[j][k];
            a[i][j] *= a[j][j]; /* diagonal: inverse of the factor's */
            b[i] -= a[i][j] * b[j];
            a[i][i] -= a[i][j] * a[i][j];
        }
        memcpy(pivot, &a[i][i], sizeof pivot);
        for (int lane = 0; lane < LANES; lane++) pivot[lane] = 1 / sqrtf(larger(pivot[lane], MIN_PIVOT));
        a[i][i] = load_lanes(pivot);
        b[i] *= a[i][i];
    }
    for (int i = CURVE_VALUES - 1; i >= 0; i--) {
        for (int j = i + 1; j < CURVE_VALUES; j++) b[i] -= a[j][i] * b[j];
        b[i] *= a[i][i];
    }
}

/* A round of Newton's method: adds a step to the coefficients of the curves. */
INLINE void improve_curves(const Batch *batch, Lanes *curve) {
    static const float prior[CURVE_VALUES] = {OFFSET_REGULARIZATION, SLOPE_REGULARIZATION, SLOPE_REGULARIZATION,
                                              BEND_REGULARIZATION, BEND_REGULARIZATION, BEND_REGULARIZATION};
    Lanes matrix[CURVE_VALUES][CURVE_VALUES], step[CURVE_VALUES];
    for (int a = 0; a < CURVE_VALUES; a++) {
        step[a] = -prior[a] * curve[a];
        for (int b = 0; b <= a; b++) matrix[a][b] = (Lanes){0} + (a == b ? prior[a] : 0);
    }
    for (int j = 0; j < NEIGHBORS; j++) {
        Lanes s = load_lanes(batch->s[j]), t = load_lanes(batch->t[j]);
        Lanes term[CURVE_VALUES] = {(Lanes){0} + 1, s, t, s * s, s * t, t * t}, value = curve[0];
        float values[LANES], residual[LANES], second[LANES];
        for (int a = 1; a < CURVE_VALUES; a++) value += curve[a] * term[a];
        memcpy(values, &value, sizeof values);
        for (int lane = 0; lane < LANES; lane++) {
            float weight = batch->weight[j][lane], probability = 1 / (1 + exp_fast(-values[lane]));
            residual[lane] = weight * (batch->is_first[j][lane] - probability);
            second[lane] = weight * larger(probability * (1 - probability), MIN_CURVATURE_OF_LOSS);
        }
        Lanes difference = load_lanes(residual), curvature = load_lanes(second);
        for (int a = 0; a < CURVE_VALUES; a++) {
            Lanes weighted = curvature * term[a];
            for (int b = 0; b <= a; b++) matrix[a][b] += weighted * term[b];
            step[a] += difference * term[a];
        }
    }
    solve_cholesky(matrix, step);
    for (int a = 0; a < CURVE_VALUES; a++) curve[a] += step[a];
}

/* Writes the coefficients of the batch's curves, positive on the first group's side: logistic regressions by Newton's
 * method, with a Gaussian prior on the coefficients. Empties the batch. */
INLINE void fit_curves(Batch *batch) {
    Lanes curve[CURVE_VALUES];
    for (int a = 0; a < CURVE_VALUES; a++) curve[a] = (Lanes){0};
    for (int round = 0; round < NEWTON_ROUNDS; round++) improve_curves(batch, curve);
    for (int lane = 0; lane < batch->count; lane++)
        for (int a = 0; a < CURVE_VALUES; a++) batch->curve[lane][a] = curve[a][lane];
    batch->count = 0;
}

/* Adds a disc's neighborhood and first group to the batch, which has room for it. */
INLINE void add_to_batch(const Neighborhood *near, const float *is_first, float *curve, Batch *batch) {
    int lane = batch->count++;
    batch->curve[lane] = curve;
    for (int j = 0; j < NEIGHBORS; j++) {
        batch->s[j][lane] = near->s[j], batch->t[j][lane] = near->t[j];
        batch->weight[j][lane] = near->weight[j], batch->is_first[j][lane] = is_first[j];
    }
}

/* Adds two colors on either side of a curve to a texture that has a gradient, as far as the neighbors have two colors.
 * The curve is left to the batch. */
INLINE void fit_two_colors(const Neighborhood *near, float *texture, Batch *batch) {
    float members[2][NEIGHBORS], weights[2][NEIGHBORS], share = divide_by_color(near, members);
    if (!(share > 0)) return;
    for (int g = 0; g < 2; g++)
        for (int j = 0; j < NEIGHBORS; j++) weights[g][j] = members[g][j] * near->weight[j] + members[g][j] * 1e-6f;
    float first = 1 / sum_values(weights[0]), second = 1 / sum_values(weights[1]);
    for (int a = 0; a < 3; a++) {
        float color = sum_products(weights[0], near->color[a]) * first;
        float other = sum_products(weights[1], near->color[a]) * second;
        texture[a] += share * (0.5f * (color + other) - texture[a]);
        texture[3 + a] *= 1 - share, texture[6 + a] *= 1 - share;
        texture[9 + a] = share * 0.5f * (color - other);
    }
    add_to_batch(near, members[0], texture + 4 * TEXTURE_COLORS, batch);
}

/* For begin <= i < end: writes textures (count, TEXTURE_VALUES) of discs with these centers, unit normals and radii, of
 * offset + slope * albedo, each (count, 3). neighbors (count, neighbor_count) are indices of other discs, the nearest
 * first. */
FAST int z2p_fit_disc_textures(const float *centers, const float *normals, const float *radii, const int *neighbors,
                               const float *albedo, const float *offset, const float *slope, int begin, int end,
                               int neighbor_count, float *textures) {
    Batch batch = {.count = 0};
    for (int i = begin; i < end; i++) {
        float *texture = textures + TEXTURE_VALUES * (size_t)i;
        const float *own = albedo + 3 * (size_t)i;
        Neighborhood near;
        for (int k = 0; k < TEXTURE_VALUES; k++) texture[k] = k < TEXTURE_COLORS ? own[k] : 0;
        if (gather_neighbors(centers, normals, albedo, neighbors + (size_t)i * neighbor_count, neighbor_count, i,
                             radii[i], &near)) {
            fit_gradient(&near, own, texture);
            fit_two_colors(&near, texture, &batch);
            if (batch.count == LANES) fit_curves(&batch);
        }
        for (int k = 0; k < 4 * TEXTURE_COLORS; k++) texture[k] *= slope[3 * (size_t)i + k % TEXTURE_COLORS];
        for (int a = 0; a < TEXTURE_COLORS; a++) texture[a] += offset[3 * (size_t)i + a];
    }
    if (batch.count) fit_curves(&batch);
    return 1;
}
