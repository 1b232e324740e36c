/* Draws balls and the shadow on the floor. Input: balls in camera and world coordinates and the light on them; output:
 * an image in linear light. A pixel has n x n samples; at each the nearest ball is exact. Every ball is shaded once in a
 * pixel, where its samples lie on average. */

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "balls/ball_light.h"

#define MAX_SIDE_SAMPLES 4
#define MAX_DIRECTIONS 128
#define SHADED_SHARE 0.5f          /* share of the light that a ball takes from a place which it covers whole */
#define LATTICE 4                  /* pixels between those at which the floor's light is computed where it varies little */
#define LATTICE_TOLERANCE 0.06f    /* difference of hidden light between neighboring ones up to which it does */

/* The camera, and which rows to draw. Mirrored by z2p_core/native/balls.py. */
typedef struct {
    float rotation[3][3], position[3]; /* world to camera: rows right, down, forward */
    float focal[2], center[2]; /* focal lengths and principal point in pixels */
    int orthographic; /* rays are parallel, and focal lengths are pixels of a world unit */
    int width, height, first_row, last_row, side_samples;
    float filter[4]; /* weights of a pixel's samples along a side */
    float near_depth;
    float relight; /* share of the light that falls on the balls' colors, 0 to 1 */
    float floor_albedo;
    int draws_floor; /* 0 where the camera is below it */
} BallView;

/* Draws into ids and depths (rows * n, width * n) the balls (count, 4), in camera coordinates, that the samples of rows
 * [first, last) show. */
INLINE void draw_ids(const float *balls, int count, const BallView *view, int first, int last, int *ids, float *depths) {
    int n = view->side_samples, width = view->width * n, top_row = first * n, bottom_row = last * n;
    float focal_x = view->focal[0] * (float)n, focal_y = view->focal[1] * (float)n;
    float middle_x = view->center[0] * (float)n, middle_y = view->center[1] * (float)n;
    size_t room = (size_t)width * (bottom_row - top_row);
    memset(ids, -1, sizeof(int) * room);
    for (size_t i = 0; i < room; i++) depths[i] = INFINITY;
    for (int b = 0; b < count; b++) {
        float x = balls[4 * (size_t)b], y = balls[4 * (size_t)b + 1], z = balls[4 * (size_t)b + 2];
        float radius = balls[4 * (size_t)b + 3], in_front = z * z - radius * radius;
        if (!(z - radius > view->near_depth)) continue;
        float reach_y = radius * sqrtf(y * y + in_front), reach_x = radius * sqrtf(x * x + in_front);
        if (view->orthographic) {
            in_front = z;
            reach_x = reach_y = radius * z;
        }
        int top = (int)ceilf(larger((y * z - reach_y) / in_front * focal_y + middle_y - 0.5f, (float)top_row));
        int bottom =
            (int)floorf(smaller((y * z + reach_y) / in_front * focal_y + middle_y - 0.5f, (float)bottom_row - 1));
        if (top > bottom) continue;
        int left = (int)ceilf(larger((x * z - reach_x) / in_front * focal_x + middle_x - 0.5f, 0));
        int right = (int)floorf(smaller((x * z + reach_x) / in_front * focal_x + middle_x - 0.5f, (float)width - 1));
        for (int v = top; v <= bottom; v++) {
            float ry = ((float)v + 0.5f - middle_y) / focal_y, yz = y * ry + z, length_yz = ry * ry + 1;
            size_t row = (size_t)(v - top_row) * width;
            int *restrict id = ids + row;
            float *restrict depth = depths + row;
            for (int u = left; view->orthographic && u <= right; u++) {
                float dx = ((float)u + 0.5f - middle_x) / focal_x - x, dy = ry - y;
                float chord_sq = radius * radius - (dx * dx + dy * dy), t = z - sqrtf(larger(chord_sq, 0));
                int nearer = (chord_sq > 0) & (t < depth[u]);
                depth[u] = nearer ? t : depth[u];
                id[u] = nearer ? b : id[u];
            }
            for (int u = left; !view->orthographic && u <= right; u++) {
                float rx = ((float)u + 0.5f - middle_x) / focal_x, length_sq = rx * rx + length_yz;
                float along = (x * rx + yz) / length_sq;
                float ax = x - along * rx, ay = y - along * ry, az = z - along;
                float chord_sq = radius * radius - (ax * ax + ay * ay + az * az);
                float t = along - sqrtf(larger(chord_sq, 0) / length_sq);
                int nearer = (chord_sq > 0) & (t < depth[u]);
                depth[u] = nearer ? t : depth[u];
                id[u] = nearer ? b : id[u];
            }
        }
    }
}

/* Marks the balls (count, 4) that the view's rows show in `visible` (count). */
FAST int z2p_mark_visible_balls(const float *balls, int count, const BallView *view, uint8_t *visible) {
    int n = view->side_samples, rows = view->last_row - view->first_row;
    size_t room = (size_t)view->width * n * n * rows;
    int *ids = malloc(sizeof(int) * room);
    float *depths = malloc(sizeof(float) * room);
    int enough = ids && depths;
    if (enough) {
        draw_ids(balls, count, view, view->first_row, view->last_row, ids, depths);
        for (size_t i = 0; i < room; i++)
            if (ids[i] >= 0) visible[ids[i]] = 1;
    }
    free(ids);
    free(depths);
    return enough;
}

/* What shading reads, besides the tree and the scene. V balls are visible. */
typedef struct {
    const int *visible_index, *nearest, *far_index; /* (count); (V, room); (V) */
    const float *directions, *far_radiance;         /* (K, 3); (F, K, 3) */
    const float *light, *albedo;                    /* (groups, LIGHT_VALUES); (count, 3) */
    int room, direction_count, group_bits;
} Around;

/* How much darker a place on a ball is than the ball's light says, which holds for its center, because the other ball
 * `own` is in front of it: the share of what the place sees beside `own`, over the same share for the center. */
INLINE float contact_factor(const float *center, float radius, const float *normal, const float *own, float own_radius) {
    float to_own[3], from_place[3];
    for (int a = 0; a < 3; a++) {
        to_own[a] = own[a] - center[a];
        from_place[a] = to_own[a] - radius * normal[a];
    }
    float far_sq = dot(to_own, to_own), near_sq = dot(from_place, from_place), area = own_radius * own_radius;
    float from_center = larger(dot(normal, to_own), 0) / sqrtf(far_sq) * smaller(area / far_sq, 1);
    float from_surface = larger(dot(normal, from_place), 0) / sqrtf(near_sq) * smaller(area / near_sq, 1);
    return smaller((1 - SHADED_SHARE * from_surface) / (1 - SHADED_SHARE * from_center), 1);
}

/* Radiance (3) of white at p with normal n on ball b, from all directions but the area light's: balls that are near
 * are intersected from p itself; for what is farther, the ball's center stands for p. */
INLINE void surrounding_light(const float *tree, const Around *around, int b, const float *p, const float *n,
                              float *light) {
    int count = around->direction_count, visible = around->visible_index[b];
    const int *nearest = around->nearest + (size_t)visible * around->room;
    const float *far = around->far_radiance + 3 * (size_t)around->far_index[visible] * count;
    const float *restrict dx = around->directions, *restrict dy = dx + count, *restrict dz = dy + count;
    float own[3], own_radius;
    get_ball(tree, b, own, &own_radius);
    float distance[MAX_DIRECTIONS], cosine[MAX_DIRECTIONS];
    int hit[MAX_DIRECTIONS];
    for (int d = 0; d < count; d++) {
        distance[d] = INFINITY;
        hit[d] = -1;
        cosine[d] = dx[d] * n[0] + dy[d] * n[1] + dz[d] * n[2];
    }
    for (int k = 0; k < around->room && nearest[k] >= 0; k++) {
        float c[3], radius;
        get_ball(tree, nearest[k], c, &radius);
        float x = c[0] - p[0], y = c[1] - p[1], z = c[2] - p[2];
        if (x * n[0] + y * n[1] + z * n[2] + radius <= 0) continue; /* below the horizon */
        float tangent_sq = x * x + y * y + z * z - radius * radius;
        for (int d = 0; d < count; d++) {
            float along = x * dx[d] + y * dy[d] + z * dz[d], chord_sq = along * along - tangent_sq;
            float t = along - sqrtf(larger(chord_sq, 0));
            int nearer = (chord_sq > 0) & (along > 0) & (t < distance[d]);
            distance[d] = nearer ? t : distance[d];
            hit[d] = nearer ? k : hit[d];
        }
    }
    float sum[3] = {0, 0, 0}, total = 0;
    for (int d = 0; d < count; d++) {
        if (!(cosine[d] > 0)) continue;
        float radiance[3] = {far[3 * d], far[3 * d + 1], far[3 * d + 2]};
        if (hit[d] >= 0) {
            int other = nearest[hit[d]];
            float c[3], radius, normal[3] = {p[0] + distance[d] * dx[d], p[1] + distance[d] * dy[d],
                                             p[2] + distance[d] * dz[d]};
            get_ball(tree, other, c, &radius);
            for (int a = 0; a < 3; a++) normal[a] = (normal[a] - c[a]) / radius;
            ball_radiance(around->light + LIGHT_VALUES * (size_t)(other >> around->group_bits),
                          around->albedo + 3 * (size_t)other, normal, radiance);
            float crowded = contact_factor(c, radius, normal, own, own_radius);
            for (int a = 0; a < 3; a++) radiance[a] *= crowded;
        }
        total += cosine[d];
        for (int c = 0; c < 3; c++) sum[c] += cosine[d] * radiance[c];
    }
    for (int c = 0; c < 3; c++) light[c] = sum[c] / larger(total, 1e-6f);
}

/* A grid (side, side, channels) over the floor, linear between cell centers and 0 outside. */
INLINE float floor_value(const BallScene *scene, const float *grid, int stride, float x, float y) {
    float to_cells = (float)scene->floor_side / (2 * scene->floor_half_size), last = (float)scene->floor_side - 1;
    float column = (x + scene->floor_half_size) * to_cells - 0.5f, row = (y + scene->floor_half_size) * to_cells - 0.5f;
    if (!(column >= 0 && row >= 0 && column < last && row < last)) return 0;
    int i = (int)column, j = (int)row;
    float s = column - (float)i, t = row - (float)j;
    const float *at = grid + stride * ((size_t)j * scene->floor_side + i), *below = at + stride * scene->floor_side;
    return (at[0] * (1 - s) + at[stride] * s) * (1 - t) + (below[0] * (1 - s) + below[stride] * s) * t;
}

/* Directional albedo of the specular lobe of the floor's material, as in lighting/floor_shadow.c. */
INLINE float floor_specular_albedo(float n_dot_v) {
    float grazing = 1 - n_dot_v, grazing_sq = grazing * grazing;
    return 0.0368f + grazing_sq * (0.1133f + 0.073f * grazing_sq * grazing);
}

/* The floor at a pixel: whether it is there, the area light on it, unhidden and hidden, and where it is. */
typedef struct {
    float there, light, hidden, x, y, n_dot_v;
} FloorPixel;

INLINE FloorPixel see_floor(const BallScene *scene, const BallView *view, float column, float row) {
    const float *rotation = view->rotation[0];
    float rx = (column - view->center[0]) / view->focal[0], ry = (row - view->center[1]) / view->focal[1];
    float ray[3], origin[3];
    for (int a = 0; a < 3; a++) {
        float across = rotation[a] * rx + rotation[3 + a] * ry;
        ray[a] = (view->orthographic ? 0 : across) + rotation[6 + a];
        origin[a] = view->position[a] + (view->orthographic ? across : 0);
    }
    FloorPixel floor = {0, 0, 0, 0, 0, 0};
    if (!view->draws_floor || !(ray[2] < -1e-4f)) return floor;
    float t = (scene->floor_height - origin[2]) / ray[2];
    floor.x = origin[0] + t * ray[0];
    floor.y = origin[1] + t * ray[1];
    floor.n_dot_v = -ray[2] / sqrtf(dot(ray, ray));
    floor.there = fabsf(floor.x) < scene->floor_half_size && fabsf(floor.y) < scene->floor_half_size;
    return floor;
}

INLINE FloorPixel light_floor(const float *tree, const BallLevels *levels, const BallScene *scene, const BallView *view,
                              float column, float row) {
    FloorPixel floor = see_floor(scene, view, column, row);
    if (!floor.there) return floor;
    float p[3] = {floor.x, floor.y, scene->floor_height}, up[3] = {0, 0, 1};
    float left = direct_light(tree, levels, scene, p, up, &floor.light);
    floor.hidden = floor.light > 0 ? 1 - left / floor.light : 0;
    return floor;
}

/* Share of the floor's radiance that is missing at a pixel: the alpha of its shadow. Grids: `hidden` (2, side, side),
 * the shares of the sky and of the mirrored sky that balls hide, and `sent` (2, side, side), the light that they send
 * instead. */
INLINE float floor_alpha(const BallScene *scene, const BallView *view, const FloorPixel *floor, const float *hidden,
                         const float *sent) {
    if (!floor->there) return 0;
    size_t cells = (size_t)scene->floor_side * scene->floor_side;
    float lost = scene->sky_radiance * floor_value(scene, hidden, 1, floor->x, floor->y)
        - floor_value(scene, sent, 1, floor->x, floor->y);
    float lost_mirrored = scene->sky_radiance * floor_value(scene, hidden + cells, 1, floor->x, floor->y)
        - floor_value(scene, sent + cells, 1, floor->x, floor->y);
    float specular = floor_specular_albedo(floor->n_dot_v), diffuse = view->floor_albedo * (1 - specular);
    float missing = diffuse * (floor->light * floor->hidden + lost) + specular * lost_mirrored;
    float all = diffuse * (floor->light + scene->sky_radiance) + specular * scene->sky_radiance;
    return smaller(larger(missing / all, 0), 1);
}

/* Draws the shadow's alpha into rows [first, last) of alpha (height, width). `nodes` is as large as two lines of the
 * lattice. */
INLINE void draw_floor(const float *tree, const BallLevels *levels, const BallScene *scene, const BallView *view,
                       const float *hidden, const float *sent, FloorPixel *nodes, float *alpha) {
    int columns = (view->width + LATTICE - 1) / LATTICE + 1;
    for (int v = view->first_row; v < view->last_row; v += LATTICE) {
        for (int j = 0; j < 2; j++)
            for (int i = 0; i < columns; i++)
                nodes[j * columns + i] = j == 0 && v > view->first_row
                    ? nodes[columns + i]
                    : light_floor(tree, levels, scene, view, (float)(i * LATTICE) + 0.5f,
                                  (float)(v + j * LATTICE) + 0.5f);
        for (int i = 0; i + 1 < columns; i++) {
            const FloorPixel *a = nodes + i, *b = a + 1, *c = a + columns, *d = c + 1;
            float least = smaller(smaller(a->hidden, b->hidden), smaller(c->hidden, d->hidden));
            float most = larger(larger(a->hidden, b->hidden), larger(c->hidden, d->hidden));
            int is_even = (a->there + b->there + c->there + d->there == 4) & (most - least < LATTICE_TOLERANCE);
            for (int y = 0; y < LATTICE && v + y < view->last_row; y++)
                for (int x = 0; x < LATTICE && i * LATTICE + x < view->width; x++) {
                    float column = (float)(i * LATTICE + x) + 0.5f, row = (float)(v + y) + 0.5f;
                    float s = (float)x / LATTICE, t = (float)y / LATTICE;
                    FloorPixel floor;
                    if (is_even) {
                        floor = see_floor(scene, view, column, row);
                        floor.hidden = (a->hidden * (1 - s) + b->hidden * s) * (1 - t)
                            + (c->hidden * (1 - s) + d->hidden * s) * t;
                        floor.light = (a->light * (1 - s) + b->light * s) * (1 - t)
                            + (c->light * (1 - s) + d->light * s) * t;
                    } else {
                        floor = light_floor(tree, levels, scene, view, column, row);
                    }
                    alpha[(size_t)(v + y) * view->width + i * LATTICE + x] =
                        floor_alpha(scene, view, &floor, hidden, sent);
                }
        }
    }
}

/* The part of one ball in a pixel: the weight of its samples, and the mean of their places in camera coordinates. */
typedef struct {
    int ball;
    float weight, place[3];
} Fragment;

/* Collects the fragments of the pixel whose first sample is at ids and depths; returns their number. */
INLINE int collect_fragments(const BallView *view, const int *ids, const float *depths, int column, int row,
                             Fragment *fragments) {
    int n = view->side_samples, count = 0;
    float focal_x = view->focal[0] * (float)n, focal_y = view->focal[1] * (float)n;
    float middle_x = view->center[0] * (float)n, middle_y = view->center[1] * (float)n;
    for (int y = 0; y < n; y++)
        for (int x = 0; x < n; x++) {
            size_t at = (size_t)y * view->width * n + x;
            if (ids[at] < 0) continue;
            int k = 0;
            while (k < count && fragments[k].ball != ids[at]) k++;
            if (k == count) {
                Fragment empty = {ids[at], 0, {0, 0, 0}};
                fragments[count++] = empty;
            }
            float weight = view->filter[x] * view->filter[y], depth = weight * depths[at];
            float spread = view->orthographic ? weight : depth;
            fragments[k].weight += weight;
            fragments[k].place[0] += spread * ((float)(column * n + x) + 0.5f - middle_x) / focal_x;
            fragments[k].place[1] += spread * ((float)(row * n + y) + 0.5f - middle_y) / focal_y;
            fragments[k].place[2] += depth;
        }
    return count;
}

/* Radiance (3) of a fragment. */
INLINE void shade_fragment(const float *tree, const BallLevels *levels, const BallScene *scene, const BallView *view,
                           const Around *around, const Fragment *fragment, float *radiance) {
    const float *rotation = view->rotation[0], *albedo = around->albedo + 3 * (size_t)fragment->ball;
    float center[3], radius, p[3], n[3], unhidden, light[3];
    get_ball(tree, fragment->ball, center, &radius);
    for (int a = 0; a < 3; a++)
        n[a] = (rotation[a] * fragment->place[0] + rotation[3 + a] * fragment->place[1]
                + rotation[6 + a] * fragment->place[2]) / fragment->weight + view->position[a] - center[a];
    normalize(n);
    for (int a = 0; a < 3; a++) p[a] = center[a] + radius * n[a];
    float direct = direct_light(tree, levels, scene, p, n, &unhidden);
    surrounding_light(tree, around, fragment->ball, p, n, light);
    for (int c = 0; c < 3; c++)
        radiance[c] = albedo[c] * (view->relight * (direct + light[c]) + 1 - view->relight);
}

/* Draws the view's rows into image (4, height, width): premultiplied linear color and alpha. `balls` (count, 4) are in
 * camera coordinates; what else there is, see Around, `floor_alpha` and `ball_tree.h`; directions are (3, K). */
FAST int z2p_draw_balls(const float *tree, const BallLevels *levels, const BallScene *scene, const BallView *view,
                        const float *balls, int count, const int *visible_index, const int *nearest, int room,
                        const int *far_index, const float *directions, int direction_count, const float *far_radiance,
                        const float *light, int group_bits, const float *albedo, const float *hidden, const float *sent,
                        float *image) {
    int n = view->side_samples, width = view->width, rows = view->last_row - view->first_row;
    size_t samples = (size_t)width * n * n * rows, plane = (size_t)width * view->height;
    int *ids = malloc(sizeof(int) * samples);
    float *depths = malloc(sizeof(float) * samples);
    FloorPixel *nodes = malloc(sizeof(FloorPixel) * 2 * (size_t)(width / LATTICE + 3));
    int enough = ids && depths && nodes;
    Around around = {visible_index, nearest, far_index, directions, far_radiance, light, albedo,
                     room, direction_count, group_bits};
    if (enough) {
        draw_ids(balls, count, view, view->first_row, view->last_row, ids, depths);
        draw_floor(tree, levels, scene, view, hidden, sent, nodes, image + 3 * plane);
        for (int v = view->first_row; v < view->last_row; v++)
            for (int u = 0; u < width; u++) {
                Fragment fragments[MAX_SIDE_SAMPLES * MAX_SIDE_SAMPLES];
                size_t first = (size_t)(v - view->first_row) * n * width * n + (size_t)u * n;
                int found = collect_fragments(view, ids + first, depths + first, u, v, fragments);
                float color[3] = {0, 0, 0}, radiance[3], covered = 0;
                for (int k = 0; k < found; k++) {
                    shade_fragment(tree, levels, scene, view, &around, fragments + k, radiance);
                    covered += fragments[k].weight;
                    for (int c = 0; c < 3; c++) color[c] += fragments[k].weight * radiance[c];
                }
                float *out = image + (size_t)v * width + u;
                for (int c = 0; c < 3; c++) out[c * plane] = color[c];
                out[3 * plane] = smaller(covered + (1 - covered) * out[3 * plane], 1);
            }
    }
    free(ids);
    free(depths);
    free(nodes);
    return enough;
}
