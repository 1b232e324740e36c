"""The kernels of light against plain geometry: lamps, sheets and floors whose answers are known."""

import math

import numpy as np
import pytest
from point_shapes import sphere_of, square_of

from z2p_core import native
from z2p_core.camera import Camera
from z2p_core.shading.microfacet import fresnel_dielectric, smith_lambda, specular_directions

UP, DOWN = np.float32([0, 0, 1]), np.float32([0, 0, -1])


def lit(points, normals, *lamps_and_sizes, casters=None):
    """Light on points that cast their own shadows, in cells of two thirds of their spacing."""
    spacing = lamps_and_sizes[-2]
    own = native.ShadowCasters(points, np.arange(len(points)), spacing / 1.5)
    return native.direct_lighting(points, normals, casters or own, *lamps_and_sizes)


def test_light_falls_with_distance_and_angle():
    points = np.float32([[0, 0, 0], [0.5, 0, -1], [3, 0, 0]])
    lamp = np.float32([[0, 0, 3]])
    light = lit(points, np.tile(UP, (3, 1)), lamp, DOWN[None], np.float32([9.0]), 0.01, 4.0)
    # both cosines count: beside the lamp's axis it shines weaker, and falls slanting
    np.testing.assert_allclose(light[0], [1.0, 9 * 16 / 16.25**2, 9 / 18 * 0.5], rtol=1e-5)
    assert not light[1].any()
    away = lit(points, np.tile(DOWN, (3, 1)), lamp, DOWN[None], np.float32([9.0]), 0.01, 4.0)
    np.testing.assert_array_equal(away, light[::-1])  # the side that is lit is told apart


def test_more_points_than_shadow_maps_can_number_are_refused():
    points = np.zeros((native.MAX_LIT_POINTS + 1, 3), np.float32)
    with pytest.raises(ValueError, match="at most 65535 points to light, got 65536"):
        lit(points, points, np.float32([[0, 0, 3]]), DOWN[None], np.float32([1.0]), 0.01, 1.0)


def test_a_sheet_hides_the_lamp_from_what_lies_below_it_and_not_itself():
    spacing = 0.6 / math.sqrt(4000)
    sheet = square_of(4000, 0.3, 0.5)
    below, beside = square_of(200, 0.1, -0.5, seed=1), square_of(200, 0.1, -0.5, seed=2) + np.float32([0.9, 0, 0])
    points = np.concatenate([sheet, below, beside])
    lamp = np.float32([[0, 0, 3.5]])
    light = lit(
        points, np.tile(UP, (len(points), 1)), lamp, DOWN[None], np.float32([1.0]), spacing, 1.5
    )[0] > 0  # fmt: skip
    assert light[:4000].mean() == 1.0 and light[4200:].mean() == 1.0
    assert light[4000:4200].mean() < 0.06  # the sheet is random points, and has a gap here and there


def test_a_slanting_plane_does_not_shade_itself():
    rng, count = np.random.default_rng(0), 5000
    flat = rng.uniform(-0.7, 0.7, (count, 2))
    points = np.column_stack([flat, 2.0 * flat[:, 0]]).astype(np.float32) * np.float32(0.5)
    normal = np.float32([-2, 0, 1]) / math.sqrt(5)
    spacing = 0.7 * math.sqrt(math.sqrt(5) / count)
    lamp = np.float32([[0, -1.5, 3.0]])
    light = lit(
        points, np.tile(normal, (count, 1)), lamp, -lamp / np.linalg.norm(lamp), np.float32([1.0]), spacing, 1.3
    )[0]  # fmt: skip
    assert (light > 0).mean() > 0.99


def floor_under(lamp=(0, 0, 3), power=10.0, sky=1.0, height=-0.8, half=2.0):
    return native.Floor(height, half, np.tile(np.float32(lamp), (4, 1)), DOWN, power, sky, 0.5)


def light_on(floor, place):
    """Radiance of a white floor under the lamp at a place (2,)."""
    away = floor.light_positions[0] - [*place, floor.height]
    return floor.light_power * (away[2] / np.linalg.norm(away)) ** 2 / (away @ away) / math.pi


DARK, NOTHING = np.zeros((16, 16), np.float32), np.zeros((16, 16), np.float32)
"""A cloud without light, and a floor that mirrors none of it."""


def albedo_of_gloss(cosine, alpha=0.25, index=1.5):
    """Share of even light that a GGX surface mirrors to a viewer, by summing over directions."""
    height, turn = np.meshgrid((np.arange(1500) + 0.5) / 1500, (np.arange(600) + 0.5) / 600 * 2 * math.pi)
    level = np.sqrt(1 - height**2)
    way = np.stack([level * np.cos(turn), level * np.sin(turn), height], -1)
    viewer = np.array([math.sqrt(1 - cosine**2), 0, cosine])
    middle = (way + viewer) / np.linalg.norm(way + viewer, axis=-1, keepdims=True)
    spread = alpha**2 / (math.pi * (middle[..., 2] ** 2 * (alpha**2 - 1) + 1) ** 2)
    shown = 1 / (1 + smith_lambda(height, alpha) + smith_lambda(np.array(cosine), alpha))
    each = spread * fresnel_dielectric((middle * viewer).sum(-1), index) * shown / (4 * cosine) * 2 * math.pi / height.size
    return each.sum(), (each[..., None] * way).sum((0, 1)) / each.sum()


def test_the_floors_shadow_lies_where_the_camera_sees_it():
    camera, floor, side = Camera(96, 64, 35.0), floor_under(), 400
    shade = np.zeros((side, side), np.float32)
    place = np.array([0.6, -0.4])
    column, row = ((place + floor.half_size) / (2 * floor.half_size) * side).astype(int)
    shade[row - 8 : row + 8, column - 8 : column + 8] = 1.0
    alpha = np.full((64, 96), np.nan, np.float32)
    native.floor_shadow(shade, np.zeros_like(shade), NOTHING, DARK, floor, camera, alpha)
    (x, y), _ = (part[0] for part in camera.project(np.array([[*place, floor.height]])))
    found = np.average(np.argwhere(alpha > 0) + 0.5, axis=0, weights=alpha[alpha > 0])
    assert found[::-1] == pytest.approx([x, y], abs=0.5)
    light = light_on(floor, place)
    towards = camera.position - [*place, floor.height]
    gloss = albedo_of_gloss(towards[2] / np.linalg.norm(towards))[0]
    matt = floor.albedo * (1 - gloss)
    assert alpha.max() == pytest.approx(matt * light / (matt * (light + 1.0) + gloss), rel=0.02)
    everywhere = np.ones_like(shade)
    low = np.empty((32, 32), np.float32)
    native.floor_shadow(everywhere, everywhere, everywhere, DARK, floor, Camera(32, 32, 0.0), low)
    assert not low[:16].any() and low[-1].max() == pytest.approx(1.0)  # nothing above the horizon


@pytest.mark.parametrize("below", [0.0, 1e-7, -1e-7, 1e-3, -0.5])
def test_a_floor_at_the_height_of_the_eye_is_not_seen(below):  # all of a row would lie in one place of it
    everywhere, alpha = np.ones((100, 100), np.float32), np.full((32, 32), np.nan, np.float32)
    native.floor_shadow(*[everywhere] * 3, DARK, floor_under(height=-below), Camera(32, 32, 0.0), alpha)
    assert ((alpha >= 0) & (alpha <= 1 + 1e-5)).all() and (below > 0 or not alpha.any())


def test_light_that_comes_back_thins_the_floors_shadow():
    camera, floor = Camera(64, 64, 60.0), floor_under(power=0.0)
    hidden, none = np.full((100, 100), 0.5, np.float32), np.zeros((100, 100), np.float32)
    alphas = []
    for glow in (0.0, 0.25, 0.75):
        alpha = np.empty((64, 64), np.float32)
        native.floor_shadow(none, hidden, hidden, np.full((16, 16), glow, np.float32), floor, camera, alpha)
        alphas.append(alpha[32, 32])
    assert alphas == pytest.approx([0.5, 0.375, 0.125])  # what hides half of the sky shines itself


@pytest.mark.parametrize("elevation", [8.0, 20.0, 50.0, 80.0])
def test_the_floor_mirrors_as_a_surface_of_ggx_does(elevation):
    camera, floor = Camera(65, 65, elevation), floor_under(power=0.0, height=0.0)
    mirrored, alpha = np.ones((64, 64), np.float32), np.empty((65, 65), np.float32)
    native.floor_shadow(*[np.full_like(mirrored, 1e-9)] * 2, mirrored, DARK, floor, camera, alpha)
    gloss, mean = albedo_of_gloss(math.sin(math.radians(elevation)))
    assert alpha[32, 32] == pytest.approx(gloss / (gloss + floor.albedo * (1 - gloss)), abs=0.008)
    ways = specular_directions(math.sin(math.radians(elevation)), 0.5, 1.5, 64)
    np.testing.assert_allclose(np.linalg.norm(ways, axis=1), 1, rtol=1e-6)
    assert ways.mean(0) == pytest.approx(mean, abs=0.1) and ways[:, 2].mean() == pytest.approx(mean[2], abs=0.03)


AXES = np.float32([[0, 0, 1], [1, 0, 0], [0, 0.6, 0.8]])


def test_points_see_the_nearest_others_along_an_axis_and_against_it():
    """Three sheets one above the other: each sees its neighbour, whatever lies beyond."""
    heights, count = (0.6, 0.0, -0.5), 3000
    points = np.concatenate([square_of(count, 0.4, height, seed) for seed, height in enumerate(heights)])
    hits = native.first_visible(points, np.tile(UP, (3 * count, 1)), AXES, 0.8 / math.sqrt(count), 1.0)
    assert hits.shape == (6, 3 * count) and hits.dtype == np.int32
    inner = (np.abs(points[:, :2]) < 0.35).all(1)
    sheet = np.repeat([0, 1, 2], count)
    seen_above, seen_below = (np.where(row >= 0, sheet[row], -1) for row in hits[:2])
    for number, (above, below) in enumerate([(-1, 1), (0, 2), (1, -1)]):
        of_it = inner & (sheet == number)
        assert (seen_above[of_it] == above).mean() > 0.97 and (seen_below[of_it] == below).mean() > 0.97
    shift = points[hits[0]] - points
    assert np.abs(shift[hits[0] >= 0][:, :2]).max() < 3 * 0.8 / math.sqrt(count)


def test_a_sphere_sees_nothing_outwards_and_its_other_side_inwards():
    points = sphere_of(5000, radius=0.8)
    hits = native.first_visible(points, points / 0.8, AXES[:1], math.sqrt(4 * math.pi * 0.64 / 5000), 0.85)
    upper, lower = points[:, 2] > 0.3, points[:, 2] < -0.3
    assert (hits[0][upper] < 0).mean() > 0.99 and (hits[1][lower] < 0).mean() > 0.99
    across = hits[0][lower]
    assert (across >= 0).mean() > 0.99 and (points[across[across >= 0], 2] > 0.2).mean() > 0.99


def all_around(count=400):
    """Unit axes (A, 3) over the upper half of the sphere."""
    height = (np.arange(count) + 0.5) / count
    angle = np.arange(count) * math.pi * (3 - math.sqrt(5))
    side = np.sqrt(1 - height**2)
    return np.column_stack([side * np.cos(angle), side * np.sin(angle), height]).astype(np.float32)


def test_an_open_point_gathers_the_sky_above_and_the_floor_below():
    axes, floor, none = all_around(), floor_under(power=0.0, sky=0.7, half=9.0), np.zeros((8, 8), np.float32)
    normals = np.float32([[0, 0, 1], [0, 0, -1], [1, 0, 0]])
    free = np.full((2 * len(axes), 3), -1, np.int32)
    points, direct = np.zeros((3, 3)), np.zeros((2, 3))
    light = native.gather_environment(points, normals, axes, free, direct, floor, none, none)
    np.testing.assert_allclose(light[0], [0.7, 0.35, 0.525], rtol=0.02)  # the floor sends half of the sky's light back
    np.testing.assert_allclose(light[1], [0.35, 0.7, 0.525], rtol=0.02)
    dark = native.gather_environment(points, normals, axes, free, direct, floor, none, np.ones_like(none))
    assert dark[0, 1] < 0.1 * light[0, 1] and dark[0, 0] == light[0, 0]  # a floor that sees no sky gives none


def test_points_light_each_other_with_the_side_that_they_show():
    axes, floor, none = all_around(), floor_under(), np.zeros((8, 8), np.float32)
    hits = np.full((2 * len(axes), 2), -1, np.int32)
    hits[::2, 0] = 1  # all that the first point sees above is the second
    light = np.float32([[0, 3.0], [0, 5.0]])
    for down, expected in ((DOWN, 3.0), (UP, 5.0)):
        bounced = native.gather_indirect(np.zeros((2, 3)), np.stack([UP, down]), axes, hits, light, floor, none)
        assert bounced[0] == pytest.approx([expected, 0], rel=0.02) and not bounced[1].any()


def test_a_glowing_floor_lights_what_looks_down_on_it():
    axes, floor = all_around(), floor_under(half=9.0)
    glow, light = np.full((8, 8), 2.0, np.float32), np.zeros((2, 2), np.float32)
    free = np.full((2 * len(axes), 2), -1, np.int32)
    bounced = native.gather_indirect(np.zeros((2, 3)), np.stack([UP, DOWN]), axes, free, light, floor, glow)
    np.testing.assert_allclose(bounced, [[0, 2 * floor.albedo], [2 * floor.albedo, 0]], rtol=0.06)


def test_many_points_gather_what_each_gathers_alone():
    """Rows are shared between two cores; the answer is the same."""
    points, axes, floor = sphere_of(3000, radius=0.8), AXES, floor_under()
    hits = native.first_visible(points, points / 0.8, axes, math.sqrt(4 * math.pi * 0.64 / 3000), 0.85)
    light, none = np.ones((2, 3000), np.float32), np.zeros((8, 8), np.float32)
    together = native.gather_indirect(points, points / 0.8, axes, hits, light, floor, none)
    for one in (0, 1499, 1500, 2999):
        seen = np.where(hits[:, one] >= 0, 1, -1).astype(np.int32)
        pair, facing = points[[one, hits[:, one].max()]], points[[one, hits[:, one].max()]] / 0.8
        if (seen < 0).all():
            assert not together[:, one].any()
            continue
        alone = native.gather_indirect(pair, facing, axes, np.stack([seen, seen], 1), light[:, :2], floor, none)
        np.testing.assert_allclose(together[:, one], alone[:, 0], rtol=1e-5)


def test_a_sheet_of_random_points_lets_no_light_through():
    """Its points lie up to three spacings apart, and yet it has no hole."""
    count = 3000
    sheet, below = square_of(count, 0.4, 0.5), square_of(1000, 0.2, -0.5, seed=1)
    points, up = np.concatenate([sheet, below]), np.tile(UP, (count + 1000, 1))
    spacing, lamp = 0.8 / math.sqrt(count), np.float32([[0, 0, 3.5]])
    light = lit(points, up, lamp, DOWN[None], np.float32([1.0]), spacing, 1.5)
    hits = native.first_visible(points, up, AXES[:1], spacing, 1.0)
    assert not light[0, count:].any() and (hits[0, count:] >= 0).all()
    assert (light[0, :count] > 0).all() and (hits[0, :count] < 0).all()


def test_the_floor_sees_the_lower_side_of_what_hangs_over_it():
    floor = floor_under(half=2.0)
    sheet = np.concatenate([square_of(20_000, 0.5, 0.0), square_of(20_000, 0.5, 0.4, seed=1)])
    light = np.float32([[1.0], [2.0]]) * np.ones((1, 40_000), np.float32)
    light[:, 20_000:] *= 10  # the upper sheet, which the lower one hides
    seen = native.floor_visibility(sheet, np.tile(UP, (40_000, 1)), UP[None], floor, 32)
    glow = native.floor_irradiance(light, seen, 32)
    assert (glow[14:18, 14:18] == 2.0).all() and not glow[:10, :10].any()
    cells = seen[0, 0, : np.flatnonzero(seen[0, 0] < 0)[0]]
    assert np.bincount(cells).max() == 1  # each cell sees one point first


def test_where_the_floor_sees_every_point_none_is_left_out():
    points = np.float32([[x, y, 0] for x in (-1, 0, 1) for y in (-1, 0, 1)])
    normals = np.tile(UP, (9, 1)) * np.float32([1, -1, 1, -1, 1, -1, 1, -1, 1])[:, None]
    seen = native.floor_visibility(points, normals, UP[None], floor_under(half=2.0), 32)
    assert sorted(seen[0, 1] % 9) == list(range(9)) and len(set(seen[0, 0])) == 9
    facing_up = np.sort(seen[0, 1]) // 9  # seen from below, so from behind
    np.testing.assert_array_equal(facing_up, [0] * 4 + [1] * 5)
