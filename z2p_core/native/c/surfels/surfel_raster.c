/* Surfels: each point as a small disc in its tangent plane, drawn where the nearest ones are seen and blended there. */

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "surfels/disc_projection.h"
#include "common/simd.h"

#define SIDE 2 /* samples along a pixel's side; resolve() adds them up in pairs */
#define SUMS 8 /* for each sample, in as many lines a row: weight, depth and six features */
#define BAND 8 /* rows of pixels whose sums are kept at a time: they stay in the core's own cache */
#define ROW 64 /* pixels that are resolved at a time */
#define DOUBT 0.02f /* weight beyond a disc's end: it hides nothing there, but shows where nothing else does */
#define HIDDEN 1.0f /* radii that a disc's middle lies behind what is nearest there, from which on it is not drawn */

/* The discs that the picture may show, how many they are, and the box that holds them all. */
INLINE int place_all(const float *points, const float *normals, const float *radii, const float *clips, int count,
                     float slack, const View *view, Disc *discs, Box *box) {
    int placed = 0;
    *box = (Box){view->width, view->height, 0, 0};
    for (int i = 0; i < count; i++) {
        Disc *disc = discs + placed;
        Box reach;
        if (!place_disc(disc, points + 3 * (size_t)i, normals + 3 * (size_t)i, radii[i], clips + 4 * CLIPS * (size_t)i,
                        view, &reach)) continue;
        disc->point = i;
        disc->radius = radii[i], disc->behind = slack * radii[i];
        placed++;
        if (reach.left < box->left) box->left = reach.left;
        if (reach.right > box->right) box->right = reach.right;
        if (reach.top < box->top) box->top = reach.top;
        if (reach.bottom > box->bottom) box->bottom = reach.bottom;
    }
    box->left -= box->left % SIDE, box->top -= box->top % SIDE; /* to whole pixels */
    box->right += -box->right & (SIDE - 1), box->bottom += -box->bottom & (SIDE - 1);
    return placed;
}

/* Keeps the depth of what is nearest in a row of samples. */
INLINE void keep_nearest(const Row *row, int ends, float *nearest) {
    Lanes x = first_lanes(row), depth, inside;
    Masks over;
    for (int i = row->left; i <= row->right; i += LANES, x += (float)LANES) {
        Masks shows = meet(row, ends, x, &depth, &inside, &over) & ~over;
        Lanes known = lanes(nearest + i);
        shows &= depth < known;
        known = (Lanes)((shows & (Masks)depth) | (~shows & (Masks)known));
        memcpy(nearest + i, &known, sizeof known);
    }
}

/* Whether a disc's middle lies far behind what is seen there, as far as this strip of the picture knows. What is hidden so
 * is left out with its rim, which might show: that keeps gaps in what lies before it open. */
INLINE int hidden(const Disc *disc, const float *front, int stride, const Box *box) {
    float x = disc->x, y = disc->y;
    if (!(x >= (float)box->left && x < (float)box->right && y >= (float)box->top && y < (float)box->bottom)) return 0;
    return disc->depth > front[(size_t)((int)y - box->top) * stride + (int)x - box->left] + HIDDEN * disc->radius;
}

/* Keeps the depths of what is nearest in `front`, of the nearer half of the discs first, and leaves out those that are
 * hidden; how many are left. */
INLINE int find_front(Disc *discs, int placed, const View *view, const Box *box, int stride, float *front) {
    float middle = 0;
    Row row;
    for (int i = 0; i < placed; i++) middle += discs[i].depth / (float)placed;
    for (int farther = 0; farther < 2; farther++)
        for (int i = 0; i < placed; i++) {
            const Disc *disc = discs + i;
            if ((disc->depth > middle) != farther || hidden(disc, front, stride, box)) continue;
            for (int y = disc->top; y < disc->bottom; y++)
                if (cut_row(disc, y, view, &row))
                    keep_nearest(&row, disc->ends, front + (size_t)(y - box->top) * stride - box->left);
        }
    int left = 0;
    for (int i = 0; i < placed; i++)
        if (!hidden(discs + i, front, stride, box)) discs[left++] = discs[i];
    return left;
}

/* Adds a disc's row to the sums, lines `stride` apart, of those samples where it lies little enough behind the nearest.
 * What goes beyond its rim, to whole LANES, counts 0. */
INLINE void add_row(const Row *row, const Disc *disc, const float *nearest, const float *features, int stride,
                    float *sums) {
    Lanes x = first_lanes(row), depth, inside;
    Masks over;
    for (int i = row->left; i <= row->right; i += LANES, x += (float)LANES) {
        Masks shows = meet(row, disc->ends, x, &depth, &inside, &over);
        shows &= depth <= lanes(nearest + i) + disc->behind;
        Lanes weight = where(shows, inside + 1e-3f);
        weight = where(~over, weight) + where(over, weight * DOUBT);
        float *line = sums + i;
        for (int c = 0; c < SUMS; c++, line += stride) {
            Lanes sum = lanes(line);
            sum += c == 0 ? weight : c == 1 ? weight * depth : weight * features[c - 2];
            memcpy(line, &sum, sizeof sum);
        }
    }
}

/* Adds all discs to the sums of the rows of samples from `top` to `bottom` - 1, in front of which `nearest` lies. */
INLINE void add_band(const Disc *discs, int placed, const float *features, const View *view, const float *nearest,
                     int stride, int top, int bottom, float *sums) {
    Row row;
    for (int i = 0; i < placed; i++) {
        const Disc *disc = discs + i;
        int first = disc->top > top ? disc->top : top, last = disc->bottom < bottom ? disc->bottom : bottom;
        for (int y = first; y < last; y++)
            if (cut_row(disc, y, view, &row))
                add_row(&row, disc, nearest + (size_t)(y - top) * stride, features + (size_t)disc->point * (SUMS - 2),
                        stride, sums + (size_t)(y - top) * SUMS * stride);
    }
}

/* Sums of pairs: of what the samples of a row of pixels have, once those above each other are added up. */
INLINE void add_pairs(const float *samples, int count, float *pixels) {
    for (int x = 0; x < count; x++) pixels[x] = samples[2 * x] + samples[2 * x + 1];
}

/* Turns `high` rows of sums, two to a row of pixels, into the picture's planes (9, height, width): coverage, density,
 * depth and features. */
INLINE void resolve(const float *sums, int stride, int wide, int high, size_t plane, int width, float sure, float full,
                    float near, float far, float *picture) {
    float scale = 1 / (far - near), share[2][2 * ROW], samples[2 * ROW], dense[2 * ROW], inverse[ROW];
    for (int y = 0; y < high; y++)
        for (int first = 0; first < wide; first += ROW) {
            const float *upper = sums + (size_t)2 * y * SUMS * stride + 2 * first;
            const float *lower = upper + (size_t)SUMS * stride;
            float *row = picture + (size_t)y * width + first;
            int count = wide - first < ROW ? wide - first : ROW;
            for (int x = 0; x < 2 * count; x++) {
                float above = 1 - exp_fast(-sure * upper[x]), below = 1 - exp_fast(-sure * lower[x]);
                float thick = upper[x] > full ? full : upper[x], thin = lower[x] > full ? full : lower[x];
                share[0][x] = upper[x] > 0 ? above / upper[x] : 0;
                share[1][x] = lower[x] > 0 ? below / lower[x] : 0;
                samples[x] = above + below;
                dense[x] = above * thick + below * thin;
            }
            add_pairs(samples, count, row);
            add_pairs(dense, count, row + plane);
            for (int x = 0; x < count; x++) {
                inverse[x] = row[x] > 0 ? 1 / row[x] : 0;
                row[x] *= 0.25f;
                row[plane + x] *= inverse[x] / full;
            }
            for (int c = 1; c < SUMS; c++) {
                const float *up = upper + (size_t)c * stride, *low = lower + (size_t)c * stride;
                float *out = row + (size_t)(c + 1) * plane;
                for (int x = 0; x < 2 * count; x++) samples[x] = up[x] * share[0][x] + low[x] * share[1][x];
                add_pairs(samples, count, out);
                for (int x = 0; x < count; x++) out[x] *= inverse[x];
            }
            for (int x = 0; x < count; x++) {
                float *depth = row + 2 * plane + x, found = inverse[x] > 0 ? (far - *depth) * scale : 0;
                *depth = found < 0 ? 0 : found > 1 ? 1 : found;
            }
        }
}

/* Rows from `first` to `last` - 1 of picture (9, height, width), whatever is there before: coverage, the mean over a
 * pixel's samples of 1 - exp(-sure x weight); and means over the covered ones of density, weight / full up to 1, of
 * depth from 1 at `near` to 0 at `far`, and of six features, averaged over what the nearest surfels show; 0 where
 * there is none. Points and normals are in the camera's axes, normals facing it, and so are the planes `clips`
 * (count, CLIPS, 4) that nothing of a disc lies over; features (count, 6). A surfel counts where it lies at most
 * `slack` of its radius behind the nearest. */
FAST int z2p_surfels(const float *points, const float *normals, const float *radii, const float *clips,
                     const float *features, int count, float focal, int width, int height, int first, int last,
                     float slack, float sure, float full, float near, float far, float *picture) {
    Disc *discs = malloc(sizeof(Disc) * ((size_t)count + 1));
    if (!discs) return 0;
    size_t plane = (size_t)width * height;
    for (int c = 0; c <= SUMS; c++)
        memset(picture + c * plane + (size_t)first * width, 0, sizeof(float) * (size_t)(last - first) * width);
    View view = {focal * SIDE, width * SIDE, height * SIDE, first * SIDE, last * SIDE};
    Box box;
    int placed = place_all(points, normals, radii, clips, count, slack, &view, discs, &box);
    if (!placed) { free(discs); return 1; }
    int wide = box.right - box.left, high = box.bottom - box.top;
    int stride = wide + LANES; /* rows are met in whole lanes */
    size_t samples = (size_t)stride * high, kept = (size_t)stride * SUMS * BAND * SIDE;
    float *front = malloc(sizeof(float) * samples), *sums = malloc(sizeof(float) * kept);
    int fine = front && sums;
    for (size_t i = 0; fine && i < samples; i++) front[i] = INFINITY;
    if (fine) placed = find_front(discs, placed, &view, &box, stride, front);
    for (int top = box.top; fine && top < box.bottom; top += BAND * SIDE) {
        int bottom = top + BAND * SIDE < box.bottom ? top + BAND * SIDE : box.bottom;
        const float *nearest = front + (size_t)(top - box.top) * stride - box.left;
        memset(sums, 0, sizeof(float) * kept);
        add_band(discs, placed, features, &view, nearest, stride, top, bottom, sums - box.left);
        resolve(sums, stride, wide / SIDE, (bottom - top) / SIDE, plane, width, sure, full, near, far,
                picture + (size_t)(top / SIDE) * width + box.left / SIDE);
    }
    free(discs); free(front); free(sums);
    return fine;
}
