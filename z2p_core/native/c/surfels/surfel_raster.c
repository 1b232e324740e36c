/* Rasterization of surfels: discs in the tangent planes of points, visible where they are nearest and blended with
 * those just behind. Input: points, normals, radii, clip planes and six features per surfel, in camera axes, and
 * optionally a texture of each; output: coverage, density, depth and the averaged features and textures per pixel.
 *
 * Two passes over a supersampled image (after Zwicker et al., "Surface Splatting", 2001): the first finds the nearest
 * depth of every sample, the second sums weights, depths and features of the surfels near it. */

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "surfels/disc_projection.h"
#include "surfels/disc_texture.h"
#include "common/simd.h"

#define SAMPLES_PER_SIDE 2        /* of a pixel; resolve_rows() and add_pairs() rely on two */
#define SUMS_PER_SAMPLE 8         /* weight, depth and six features, each in a line of its own per row of samples */
#define TEXTURED_SUMS (SUMS_PER_SAMPLE + TEXTURE_COLORS) /* and the texture's colors, if there is one */
#define BAND_PIXEL_ROWS 8         /* rows of pixels that are summed at a time: the sums stay in the core's cache */
#define RESOLVE_PIXELS 64         /* pixels of a row that are resolved at a time */
#define CLIPPED_WEIGHT 0.02f      /* weight factor beyond clip planes: negligible, but visible where nothing else is */
#define OCCLUDED_DEPTH_RADII 1.0f /* a disc whose center lies so far behind the nearest surface is dropped */

/* Image size, focal lengths and principal point in pixels (orthographic: pixels per world unit), and what the weights
 * mean; see z2p_rasterize_surfels. Mirrored by z2p_core/native/surfels.py. */
typedef struct {
    int width, height, first_row, last_row, orthographic;
    float focal_x, focal_y, center_x, center_y, near_plane;
    float blend_depth_radii, coverage_gain, full_weight, opaque_weight, near_depth, far_depth;
} RasterSettings;

/* Projects all surfels; returns how many discs may be visible, and the box of whole pixels, in samples, around them. */
INLINE int project_discs(const float *points, const float *normals, const float *radii, const float *planes, int count,
                         float blend_depth_radii, const Viewport *view, Disc *discs, Box *box) {
    int disc_count = 0;
    *box = (Box){view->width, view->height, 0, 0};
    for (int i = 0; i < count; i++) {
        Disc *disc = discs + disc_count;
        Box bounds;
        if (!project_disc(disc, points + 3 * (size_t)i, normals + 3 * (size_t)i, radii[i],
                          planes + 4 * MAX_CLIP_PLANES * (size_t)i, view, &bounds)) continue;
        disc->point = i;
        disc->radius = radii[i], disc->blend_depth = blend_depth_radii * radii[i];
        disc_count++;
        if (bounds.left < box->left) box->left = bounds.left;
        if (bounds.right > box->right) box->right = bounds.right;
        if (bounds.top < box->top) box->top = bounds.top;
        if (bounds.bottom > box->bottom) box->bottom = bounds.bottom;
    }
    box->left -= box->left % SAMPLES_PER_SIDE, box->top -= box->top % SAMPLES_PER_SIDE;
    box->right += -box->right & (SAMPLES_PER_SIDE - 1), box->bottom += -box->bottom & (SAMPLES_PER_SIDE - 1);
    return disc_count;
}

/* Depth test of a row: lowers nearest depths to the disc's where it covers a sample and no plane clips it. */
INLINE void lower_nearest_depths(const Row *row, int plane_count, float opaque_weight, float *nearest) {
    Lanes x = first_lanes(row), depth, inside;
    Masks clipped;
    for (int i = row->left; i <= row->right; i += LANES, x += (float)LANES) {
        Masks passes = evaluate_row(row, plane_count, x, &depth, &inside, &clipped) & ~clipped;
        passes &= inside > opaque_weight;
        Lanes known = load_lanes(nearest + i);
        passes &= depth < known;
        known = (Lanes)((passes & (Masks)depth) | (~passes & (Masks)known));
        memcpy(nearest + i, &known, sizeof known);
    }
}

/* Whether a disc's center lies well behind the nearest surface found so far. Such discs are dropped as a whole: their
 * rims would otherwise show through gaps in the surface before them. */
INLINE int is_occluded(const Disc *disc, const float *nearest, int stride, const Box *box) {
    float x = disc->x, y = disc->y;
    if (!(x >= (float)box->left && x < (float)box->right && y >= (float)box->top && y < (float)box->bottom)) return 0;
    float front = nearest[(size_t)((int)y - box->top) * stride + (int)x - box->left];
    return disc->depth > front + OCCLUDED_DEPTH_RADII * disc->radius;
}

/* First pass: writes the nearest depth of every sample of the box, beginning with the nearer half of the discs, and
 * removes occluded discs; returns how many are left. */
INLINE int find_nearest_depths(Disc *discs, int disc_count, float opaque_weight, const Viewport *view,
                               const Box *box, int stride,
                               float *nearest) {
    float mean_depth = 0;
    Row row;
    for (int i = 0; i < disc_count; i++) mean_depth += discs[i].depth / (float)disc_count;
    for (int far_half = 0; far_half < 2; far_half++)
        for (int i = 0; i < disc_count; i++) {
            const Disc *disc = discs + i;
            if ((disc->depth > mean_depth) != far_half || is_occluded(disc, nearest, stride, box)) continue;
            for (int y = disc->top; y < disc->bottom; y++)
                if (intersect_row(disc, y, view, &row))
                    lower_nearest_depths(&row, disc->plane_count, opaque_weight,
                                         nearest + (size_t)(y - box->top) * stride - box->left);
        }
    int kept = 0;
    for (int i = 0; i < disc_count; i++)
        if (!is_occluded(discs + i, nearest, stride, box)) discs[kept++] = discs[i];
    return kept;
}

/* Adds a disc's row to the sums, lines `stride` apart, of the samples where it lies at most blend_depth behind the
 * nearest surface. Samples beyond its rim, up to whole LANES, get weight 0. `texture` may be NULL. */
INLINE void add_row(const Row *row, const Disc *disc, const float *nearest, const float *features,
                    const TextureRow *texture, int stride, float *sums) {
    Lanes x = first_lanes(row), depth, inside;
    Masks clipped;
    for (int i = row->left; i <= row->right; i += LANES, x += (float)LANES) {
        Masks blends = evaluate_row(row, disc->plane_count, x, &depth, &inside, &clipped);
        blends &= depth <= load_lanes(nearest + i) + disc->blend_depth;
        Lanes weight = where(blends, inside + 1e-3f);
        weight = where(~clipped, weight) + where(clipped, weight * CLIPPED_WEIGHT);
        float *line = sums + i;
        for (int c = 0; c < SUMS_PER_SAMPLE; c++, line += stride) {
            Lanes sum = load_lanes(line);
            sum += c == 0 ? weight : c == 1 ? weight * depth : weight * features[c - 2];
            memcpy(line, &sum, sizeof sum);
        }
        if (!texture) continue;
        Lanes side = texture_side(texture, x);
        for (int c = 0; c < TEXTURE_COLORS; c++, line += stride) {
            Lanes sum = load_lanes(line) + weight * texture_color(texture, c, x, side);
            memcpy(line, &sum, sizeof sum);
        }
    }
}

/* Second pass, for the rows of samples [top, bottom): adds all discs, and their textures unless these are NULL, to the
 * `lines` sums of each sample. `nearest` begins at row `top`. */
INLINE void add_band(const Disc *discs, int disc_count, const float *features, const ScreenTexture *textures,
                     const Viewport *view, const float *nearest, int stride, int lines, int top, int bottom,
                     float *sums) {
    Row row;
    TextureRow texture;
    for (int i = 0; i < disc_count; i++) {
        const Disc *disc = discs + i;
        int first = disc->top > top ? disc->top : top, last = disc->bottom < bottom ? disc->bottom : bottom;
        for (int y = first; y < last; y++) {
            if (!intersect_row(disc, y, view, &row)) continue;
            if (textures) texture = texture_row(textures + i, (float)y + 0.5f - disc->y);
            add_row(&row, disc, nearest + (size_t)(y - top) * stride,
                    features + (size_t)disc->point * (SUMS_PER_SAMPLE - 2), textures ? &texture : NULL, stride,
                    sums + (size_t)(y - top) * lines * stride);
        }
    }
}

/* pixels[x] = samples[2 x] + samples[2 x + 1]: the horizontal sum, once samples above each other have been added. */
INLINE void add_pairs(const float *samples, int count, float *pixels) {
    for (int x = 0; x < count; x++) pixels[x] = samples[2 * x] + samples[2 * x + 1];
}

/* Resolves samples to pixels: turns the `lines` sums of `high` rows of `wide` pixels into the image's planes (9,
 * height, width), coverage, density, depth and features, and those of the texture's colors. A plane has `plane`
 * pixels. */
INLINE void resolve_rows(const float *sums, int stride, int lines, int wide, int high, size_t plane,
                         const RasterSettings *settings, float *image, float *colors) {
    int width = settings->width;
    float gain = settings->coverage_gain, full = settings->full_weight, far = settings->far_depth;
    float depth_scale = 1 / (far - settings->near_depth);
    float share[2][2 * RESOLVE_PIXELS]; /* coverage / weight of the samples of both rows: normalizes weighted sums */
    float samples[2 * RESOLVE_PIXELS], dense[2 * RESOLVE_PIXELS], inverse[RESOLVE_PIXELS];
    for (int y = 0; y < high; y++)
        for (int first = 0; first < wide; first += RESOLVE_PIXELS) {
            const float *upper = sums + (size_t)2 * y * lines * stride + 2 * first;
            const float *lower = upper + (size_t)lines * stride;
            float *row = image + (size_t)y * width + first;
            int count = wide - first < RESOLVE_PIXELS ? wide - first : RESOLVE_PIXELS;
            for (int x = 0; x < 2 * count; x++) {
                float upper_coverage = 1 - exp_fast(-gain * upper[x]), lower_coverage = 1 - exp_fast(-gain * lower[x]);
                float upper_weight = upper[x] > full ? full : upper[x];
                float lower_weight = lower[x] > full ? full : lower[x];
                share[0][x] = upper[x] > 0 ? upper_coverage / upper[x] : 0;
                share[1][x] = lower[x] > 0 ? lower_coverage / lower[x] : 0;
                samples[x] = upper_coverage + lower_coverage;
                dense[x] = upper_coverage * upper_weight + lower_coverage * lower_weight;
            }
            add_pairs(samples, count, row);
            add_pairs(dense, count, row + plane);
            for (int x = 0; x < count; x++) {
                inverse[x] = row[x] > 0 ? 1 / row[x] : 0;
                row[x] *= 0.25f;
                row[plane + x] *= inverse[x] / full;
            }
            for (int c = 1; c < lines; c++) {
                const float *above = upper + (size_t)c * stride, *below = lower + (size_t)c * stride;
                float *out = row + (size_t)(c + 1) * plane;
                if (c >= SUMS_PER_SAMPLE)
                    out = colors + (size_t)(c - SUMS_PER_SAMPLE) * plane + (size_t)y * width + first;
                for (int x = 0; x < 2 * count; x++) samples[x] = above[x] * share[0][x] + below[x] * share[1][x];
                add_pairs(samples, count, out);
                for (int x = 0; x < count; x++) out[x] *= inverse[x];
            }
            for (int x = 0; x < count; x++) {
                float *depth = row + 2 * plane + x, nearness = inverse[x] > 0 ? (far - *depth) * depth_scale : 0;
                *depth = nearness < 0 ? 0 : nearness > 1 ? 1 : nearness;
            }
        }
}

/* Both passes over the discs in the box, whose `nearest` depths are still unknown; `textures` and `colors` may be NULL.
 * `sums` has room for a band. */
INLINE void draw_discs(Disc *discs, int disc_count, const float *normals, const float *features, const float *textures,
                       const Viewport *view, const RasterSettings *settings, const Box *box, int stride, int lines,
                       float *nearest, float *sums, ScreenTexture *on_screen, float *image, float *colors) {
    int wide = box->right - box->left, width = settings->width;
    size_t plane = (size_t)width * settings->height;
    size_t band_sums = (size_t)stride * lines * BAND_PIXEL_ROWS * SAMPLES_PER_SIDE;
    disc_count = find_nearest_depths(discs, disc_count, settings->opaque_weight, view, box, stride, nearest);
    for (int i = 0; textures && i < disc_count; i++)
        on_screen[i] = project_texture(discs + i, normals + 3 * (size_t)discs[i].point,
                                       textures + TEXTURE_VALUES * (size_t)discs[i].point, view);
    for (int top = box->top; top < box->bottom; top += BAND_PIXEL_ROWS * SAMPLES_PER_SIDE) {
        int bottom = top + BAND_PIXEL_ROWS * SAMPLES_PER_SIDE;
        if (bottom > box->bottom) bottom = box->bottom;
        size_t first_pixel = (size_t)(top / SAMPLES_PER_SIDE) * width + box->left / SAMPLES_PER_SIDE;
        memset(sums, 0, sizeof(float) * band_sums);
        add_band(discs, disc_count, features, textures ? on_screen : NULL, view,
                 nearest + (size_t)(top - box->top) * stride - box->left, stride, lines, top, bottom, sums - box->left);
        resolve_rows(sums, stride, lines, wide / SAMPLES_PER_SIDE, (bottom - top) / SAMPLES_PER_SIDE, plane, settings,
                     image + first_pixel, textures ? colors + first_pixel : NULL);
    }
}

/* Draws rows [first_row, last_row) of image (9, height, width), overwriting what is there; 0 where there is no disc:
 *   0     coverage: mean over the pixel's samples of 1 - exp(-coverage_gain w), w the sum of weights
 *   1     density: w / full_weight, at most 1
 *   2     depth: 1 at near_depth, 0 at far_depth
 *   3..8  features
 * Planes 1 to 8 are means over the samples, weighted by their coverage. A disc's weight falls from 1 at its center to 0
 * at its rim; it counts where it lies at most blend_depth_radii of its radius behind the nearest surface.
 * points and normals (count, 3), the latter facing the camera, and clip planes (count, MAX_CLIP_PLANES, 4) are in
 * camera axes; radii (count); features (count, 6). Unless textures (count, TEXTURE_VALUES) are NULL, colors (3, height,
 * width) receive their means, as features. */
FAST int z2p_rasterize_surfels(const float *points, const float *normals, const float *radii, const float *clip_planes,
                               const float *features, const float *textures, int count,
                               const RasterSettings *settings, float *image, float *colors) {
    Disc *discs = malloc(sizeof(Disc) * ((size_t)count + 1));
    if (!discs) return 0;
    int width = settings->width, height = settings->height, first = settings->first_row, last = settings->last_row;
    size_t plane = (size_t)width * height;
    for (int c = 0; c <= SUMS_PER_SAMPLE; c++)
        memset(image + c * plane + (size_t)first * width, 0, sizeof(float) * (size_t)(last - first) * width);
    for (int c = 0; textures && c < TEXTURE_COLORS; c++)
        memset(colors + c * plane + (size_t)first * width, 0, sizeof(float) * (size_t)(last - first) * width);
    Viewport view = {settings->focal_x * SAMPLES_PER_SIDE, settings->focal_y * SAMPLES_PER_SIDE,
                     settings->center_x * SAMPLES_PER_SIDE, settings->center_y * SAMPLES_PER_SIDE,
                     settings->near_plane, settings->orthographic, width * SAMPLES_PER_SIDE,
                     height * SAMPLES_PER_SIDE, first * SAMPLES_PER_SIDE, last * SAMPLES_PER_SIDE};
    Box box;
    int disc_count =
        project_discs(points, normals, radii, clip_planes, count, settings->blend_depth_radii, &view, discs, &box);
    if (!disc_count) { free(discs); return 1; }
    int wide = box.right - box.left, high = box.bottom - box.top, lines = textures ? TEXTURED_SUMS : SUMS_PER_SAMPLE;
    int stride = wide + LANES; /* rows are evaluated in whole lanes */
    size_t samples = (size_t)stride * high;
    float *nearest = malloc(sizeof(float) * samples);
    float *sums = malloc(sizeof(float) * (size_t)stride * lines * BAND_PIXEL_ROWS * SAMPLES_PER_SIDE);
    ScreenTexture *on_screen = textures ? malloc(sizeof(ScreenTexture) * (size_t)disc_count) : NULL;
    int allocated = nearest && sums && (on_screen || !textures);
    for (size_t i = 0; allocated && i < samples; i++) nearest[i] = INFINITY;
    if (allocated && textures) /* constants, so that each case is compiled for itself */
        draw_discs(discs, disc_count, normals, features, textures, &view, settings, &box, stride, TEXTURED_SUMS,
                   nearest, sums, on_screen, image, colors);
    else if (allocated)
        draw_discs(discs, disc_count, normals, features, NULL, &view, settings, &box, stride, SUMS_PER_SAMPLE, nearest,
                   sums, NULL, image, NULL);
    free(discs); free(nearest); free(sums); free(on_screen);
    return allocated;
}
