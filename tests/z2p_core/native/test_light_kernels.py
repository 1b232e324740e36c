"""Kernels of direct and indirect light against plain geometry: light samples, sheets and floors."""

import math

import numpy as np
import pytest
from point_shapes import sphere_of, square_of

from z2p_core import native
from z2p_core.camera import Camera
from z2p_core.shading.microfacet import fresnel_dielectric, smith_lambda, specular_directions

UP, DOWN = np.float32([0, 0, 1]), np.float32([0, 0, -1])


def lit(points, normals, *samples_and_sizes, casters=None):
    """Irradiance of points that cast their own shadows, with shadow map cells of two thirds of their spacing."""
    spacing = samples_and_sizes[-2]
    own = native.ShadowCasters(points, np.arange(len(points)), spacing / 1.5)
    return native.direct_lighting(points, normals, casters or own, *samples_and_sizes)


def test_irradiance_falls_with_distance_and_angle():
    points = np.float32([[0, 0, 0], [0.5, 0, -1], [3, 0, 0]])
    light_at = np.float32([[0, 0, 3]])
    light = lit(points, np.tile(UP, (3, 1)), light_at, DOWN[None], np.float32([9.0]), 0.01, 4.0)
    # both cosines count: off its axis the light is weaker, and it arrives slanting
    np.testing.assert_allclose(light[0], [1.0, 9 * 16 / 16.25**2, 9 / 18 * 0.5], rtol=1e-5)
    assert not light[1].any()
    away = lit(points, np.tile(DOWN, (3, 1)), light_at, DOWN[None], np.float32([9.0]), 0.01, 4.0)
    np.testing.assert_array_equal(away, light[::-1])  # the other side is lit


def test_more_points_than_shadow_maps_can_number_are_refused():
    points = np.zeros((native.MAX_LIT_POINTS + 1, 3), np.float32)
    with pytest.raises(ValueError, match="at most 65535 points to light, got 65536"):
        lit(points, points, np.float32([[0, 0, 3]]), DOWN[None], np.float32([1.0]), 0.01, 1.0)


def test_a_sheet_shadows_what_lies_below_it_but_not_itself():
    spacing = 0.6 / math.sqrt(4000)
    sheet = square_of(4000, 0.3, 0.5)
    below, beside = square_of(200, 0.1, -0.5, seed=1), square_of(200, 0.1, -0.5, seed=2) + np.float32([0.9, 0, 0])
    points = np.concatenate([sheet, below, beside])
    light_at = np.float32([[0, 0, 3.5]])
    light = lit(
        points, np.tile(UP, (len(points), 1)), light_at, DOWN[None], np.float32([1.0]), spacing, 1.5
    )[0] > 0  # fmt: skip
    assert light[:4000].mean() == 1.0 and light[4200:].mean() == 1.0
    assert light[4000:4200].mean() < 0.06  # the sheet is random points, and has a gap here and there


def test_a_slanting_plane_does_not_shadow_itself():
    rng, count = np.random.default_rng(0), 5000
    flat = rng.uniform(-0.7, 0.7, (count, 2))
    points = np.column_stack([flat, 2.0 * flat[:, 0]]).astype(np.float32) * np.float32(0.5)
    normal = np.float32([-2, 0, 1]) / math.sqrt(5)
    spacing = 0.7 * math.sqrt(math.sqrt(5) / count)
    light_at = np.float32([[0, -1.5, 3.0]])
    axis = -light_at / np.linalg.norm(light_at)
    light = lit(points, np.tile(normal, (count, 1)), light_at, axis, np.float32([1.0]), spacing, 1.3)[0]
    assert (light > 0).mean() > 0.99


def floor_under(light_at=(0, 0, 3), power=10.0, sky=1.0, height=-0.8, half=2.0):
    return native.Floor(height, half, np.tile(np.float32(light_at), (4, 1)), DOWN, power, sky, 0.5)


def light_on(floor, place):
    """Radiance of a white floor under the light at a place (2,)."""
    to_light = floor.light_positions[0] - [*place, floor.height]
    return floor.light_power * (to_light[2] / np.linalg.norm(to_light)) ** 2 / (to_light @ to_light) / math.pi


DARK, NOTHING = np.zeros((16, 16), np.float32), np.zeros((16, 16), np.float32)
"""Radiance of a cloud without light, and occlusion of a reflection that is not hidden."""


def specular_albedo(n_dot_v, alpha=0.25, ior=1.5):
    """Directional albedo of a dielectric GGX surface, and the mean reflected direction, by numerical integration."""
    n_dot_l, azimuth = np.meshgrid((np.arange(1500) + 0.5) / 1500, (np.arange(600) + 0.5) / 600 * 2 * math.pi)
    sine = np.sqrt(1 - n_dot_l**2)
    light_dir = np.stack([sine * np.cos(azimuth), sine * np.sin(azimuth), n_dot_l], -1)
    view_dir = np.array([math.sqrt(1 - n_dot_v**2), 0, n_dot_v])
    half = (light_dir + view_dir) / np.linalg.norm(light_dir + view_dir, axis=-1, keepdims=True)
    distribution = alpha**2 / (math.pi * (half[..., 2] ** 2 * (alpha**2 - 1) + 1) ** 2)
    masking = 1 / (1 + smith_lambda(n_dot_l, alpha) + smith_lambda(np.array(n_dot_v), alpha))
    fresnel = fresnel_dielectric((half * view_dir).sum(-1), ior)
    reflected = distribution * fresnel * masking / (4 * n_dot_v) * 2 * math.pi / n_dot_l.size
    return reflected.sum(), (reflected[..., None] * light_dir).sum((0, 1)) / reflected.sum()


def test_the_floors_shadow_is_drawn_where_it_projects():
    camera, floor, side = Camera(96, 64, 35.0), floor_under(), 400
    occlusion = np.zeros((side, side), np.float32)
    place = np.array([0.6, -0.4])
    column, row = ((place + floor.half_size) / (2 * floor.half_size) * side).astype(int)
    occlusion[row - 8 : row + 8, column - 8 : column + 8] = 1.0
    alpha = np.full((64, 96), np.nan, np.float32)
    native.floor_shadow(occlusion, np.zeros_like(occlusion), NOTHING, DARK, floor, camera, alpha)
    (x, y), _ = (part[0] for part in camera.project(np.array([[*place, floor.height]])))
    center = np.average(np.argwhere(alpha > 0) + 0.5, axis=0, weights=alpha[alpha > 0])
    assert center[::-1] == pytest.approx([x, y], abs=0.5)
    light = light_on(floor, place)
    to_camera = camera.position - [*place, floor.height]
    specular = specular_albedo(to_camera[2] / np.linalg.norm(to_camera))[0]
    diffuse = floor.albedo * (1 - specular)
    assert alpha.max() == pytest.approx(diffuse * light / (diffuse * (light + 1.0) + specular), rel=0.02)
    full = np.ones_like(occlusion)
    low = np.empty((32, 32), np.float32)
    native.floor_shadow(full, full, full, DARK, floor, Camera(32, 32, 0.0), low)
    assert not low[:16].any() and low[-1].max() == pytest.approx(1.0)  # nothing above the horizon


@pytest.mark.parametrize("below", [0.0, 1e-7, -1e-7, 1e-3, -0.5])
def test_a_floor_at_the_cameras_height_is_not_visible(below):  # a row of pixels would see one line of it
    full, alpha = np.ones((100, 100), np.float32), np.full((32, 32), np.nan, np.float32)
    native.floor_shadow(*[full] * 3, DARK, floor_under(height=-below), Camera(32, 32, 0.0), alpha)
    assert ((alpha >= 0) & (alpha <= 1 + 1e-5)).all() and (below > 0 or not alpha.any())


def test_light_from_the_cloud_brightens_the_floors_shadow():
    camera, floor = Camera(64, 64, 60.0), floor_under(power=0.0)
    hidden, none = np.full((100, 100), 0.5, np.float32), np.zeros((100, 100), np.float32)
    alphas = []
    for irradiance in (0.0, 0.25, 0.75):
        alpha = np.empty((64, 64), np.float32)
        native.floor_shadow(none, hidden, hidden, np.full((16, 16), irradiance, np.float32), floor, camera, alpha)
        alphas.append(alpha[32, 32])
    assert alphas == pytest.approx([0.5, 0.375, 0.125])  # what hides half of the sky sends light itself


@pytest.mark.parametrize("elevation", [8.0, 20.0, 50.0, 80.0])
def test_the_floors_reflection_is_that_of_ggx(elevation):
    camera, floor = Camera(65, 65, elevation), floor_under(power=0.0, height=0.0)
    reflected, alpha = np.ones((64, 64), np.float32), np.empty((65, 65), np.float32)
    native.floor_shadow(*[np.full_like(reflected, 1e-9)] * 2, reflected, DARK, floor, camera, alpha)
    specular, mean = specular_albedo(math.sin(math.radians(elevation)))
    assert alpha[32, 32] == pytest.approx(specular / (specular + floor.albedo * (1 - specular)), abs=0.008)
    directions = specular_directions(math.sin(math.radians(elevation)), 0.5, 1.5, 64)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1, rtol=1e-6)
    assert directions.mean(0) == pytest.approx(mean, abs=0.1)
    assert directions[:, 2].mean() == pytest.approx(mean[2], abs=0.03)


AXES = np.float32([[0, 0, 1], [1, 0, 0], [0, 0.6, 0.8]])


def test_first_visible_is_the_nearest_sheet_on_both_sides():
    """Three sheets one above the other: each sees the one next to it only."""
    heights, count = (0.6, 0.0, -0.5), 3000
    points = np.concatenate([square_of(count, 0.4, height, seed) for seed, height in enumerate(heights)])
    visible = native.first_visible(points, np.tile(UP, (3 * count, 1)), AXES, 0.8 / math.sqrt(count), 1.0)
    assert visible.shape == (6, 3 * count) and visible.dtype == np.int32
    inner = (np.abs(points[:, :2]) < 0.35).all(1)
    sheet = np.repeat([0, 1, 2], count)
    seen_above, seen_below = (np.where(row >= 0, sheet[row], -1) for row in visible[:2])
    for number, (above, below) in enumerate([(-1, 1), (0, 2), (1, -1)]):
        of_it = inner & (sheet == number)
        assert (seen_above[of_it] == above).mean() > 0.97 and (seen_below[of_it] == below).mean() > 0.97
    shift = points[visible[0]] - points
    assert np.abs(shift[visible[0] >= 0][:, :2]).max() < 3 * 0.8 / math.sqrt(count)


def test_a_sphere_sees_its_far_side_only_inwards():
    points = sphere_of(5000, radius=0.8)
    visible = native.first_visible(points, points / 0.8, AXES[:1], math.sqrt(4 * math.pi * 0.64 / 5000), 0.85)
    upper, lower = points[:, 2] > 0.3, points[:, 2] < -0.3
    assert (visible[0][upper] < 0).mean() > 0.99 and (visible[1][lower] < 0).mean() > 0.99
    across = visible[0][lower]
    assert (across >= 0).mean() > 0.99 and (points[across[across >= 0], 2] > 0.2).mean() > 0.99


def all_around(count=400):
    """Unit axes (A, 3) over the upper half of the sphere."""
    height = (np.arange(count) + 0.5) / count
    angle = np.arange(count) * math.pi * (3 - math.sqrt(5))
    side = np.sqrt(1 - height**2)
    return np.column_stack([side * np.cos(angle), side * np.sin(angle), height]).astype(np.float32)


def test_an_open_point_gathers_the_sky_and_the_floor():
    axes, floor, none = all_around(), floor_under(power=0.0, sky=0.7, half=9.0), np.zeros((8, 8), np.float32)
    normals = np.float32([[0, 0, 1], [0, 0, -1], [1, 0, 0]])
    free = np.full((2 * len(axes), 3), -1, np.int32)
    points, direct = np.zeros((3, 3)), np.zeros((2, 3))
    light = native.gather_environment(points, normals, axes, free, direct, floor, none, none)
    np.testing.assert_allclose(light[0], [0.7, 0.35, 0.525], rtol=0.02)  # the floor sends half of the sky's light back
    np.testing.assert_allclose(light[1], [0.35, 0.7, 0.525], rtol=0.02)
    dark = native.gather_environment(points, normals, axes, free, direct, floor, none, np.ones_like(none))
    assert dark[0, 1] < 0.1 * light[0, 1] and dark[0, 0] == light[0, 0]  # a floor that sees no sky gives none


def test_points_light_each_other_with_their_visible_side():
    axes, floor, none = all_around(), floor_under(), np.zeros((8, 8), np.float32)
    visible = np.full((2 * len(axes), 2), -1, np.int32)
    visible[::2, 0] = 1  # all that the first point sees above is the second
    light = np.float32([[0, 3.0], [0, 5.0]])
    for down, expected in ((DOWN, 3.0), (UP, 5.0)):
        indirect = native.gather_indirect(np.zeros((2, 3)), np.stack([UP, down]), axes, visible, light, floor, none)
        assert indirect[0] == pytest.approx([expected, 0], rel=0.02) and not indirect[1].any()


def test_an_irradiated_floor_lights_what_faces_it():
    axes, floor = all_around(), floor_under(half=9.0)
    irradiance, light = np.full((8, 8), 2.0, np.float32), np.zeros((2, 2), np.float32)
    free = np.full((2 * len(axes), 2), -1, np.int32)
    indirect = native.gather_indirect(np.zeros((2, 3)), np.stack([UP, DOWN]), axes, free, light, floor, irradiance)
    np.testing.assert_allclose(indirect, [[0, 2 * floor.albedo], [2 * floor.albedo, 0]], rtol=0.06)


def test_parallel_gathering_equals_that_of_each_point():
    """Rows are shared between two cores; the answer is the same."""
    points, axes, floor = sphere_of(3000, radius=0.8), AXES, floor_under()
    visible = native.first_visible(points, points / 0.8, axes, math.sqrt(4 * math.pi * 0.64 / 3000), 0.85)
    light, none = np.ones((2, 3000), np.float32), np.zeros((8, 8), np.float32)
    together = native.gather_indirect(points, points / 0.8, axes, visible, light, floor, none)
    for one in (0, 1499, 1500, 2999):
        seen = np.where(visible[:, one] >= 0, 1, -1).astype(np.int32)
        pair, facing = points[[one, visible[:, one].max()]], points[[one, visible[:, one].max()]] / 0.8
        if (seen < 0).all():
            assert not together[:, one].any()
            continue
        alone = native.gather_indirect(pair, facing, axes, np.stack([seen, seen], 1), light[:, :2], floor, none)
        np.testing.assert_allclose(together[:, one], alone[:, 0], rtol=1e-5)


def test_three_colors_are_gathered_as_each_alone():
    points, axes, floor = np.vstack([sphere_of(800, radius=0.4), sphere_of(400, radius=0.8)]), AXES, floor_under()
    normals = points / np.linalg.norm(points, axis=1, keepdims=True)
    light = np.random.default_rng(0).random((2, 1200, 3))
    visible = native.first_visible(points, normals, axes, 0.05, 1.0)
    seen = native.floor_visibility(points, normals, axes, floor, 32)
    irradiance = native.floor_colors(light, seen, 32)
    indirect = native.gather_colors(points, normals, axes, visible, light, floor, irradiance)
    for channel in range(3):
        grey = np.float32(light[..., channel])
        np.testing.assert_allclose(irradiance[..., channel], native.floor_irradiance(grey, seen, 32), rtol=1e-5)
        alone = native.gather_indirect(points, normals, axes, visible, grey, floor, irradiance[..., channel])
        np.testing.assert_allclose(indirect[:, channel], alone[0], rtol=1e-4, atol=1e-6)


def test_a_sheet_of_random_points_lets_no_light_through():
    """Its points lie up to three spacings apart, and yet it has no hole."""
    count = 3000
    sheet, below = square_of(count, 0.4, 0.5), square_of(1000, 0.2, -0.5, seed=1)
    points, up = np.concatenate([sheet, below]), np.tile(UP, (count + 1000, 1))
    spacing, light_at = 0.8 / math.sqrt(count), np.float32([[0, 0, 3.5]])
    light = lit(points, up, light_at, DOWN[None], np.float32([1.0]), spacing, 1.5)
    visible = native.first_visible(points, up, AXES[:1], spacing, 1.0)
    assert not light[0, count:].any() and (visible[0, count:] >= 0).all()
    assert (light[0, :count] > 0).all() and (visible[0, :count] < 0).all()


def test_the_floor_sees_the_lower_side_of_what_is_above_it():
    floor = floor_under(half=2.0)
    sheet = np.concatenate([square_of(20_000, 0.5, 0.0), square_of(20_000, 0.5, 0.4, seed=1)])
    light = np.float32([[1.0], [2.0]]) * np.ones((1, 40_000), np.float32)
    light[:, 20_000:] *= 10  # the upper sheet, which the lower one hides
    seen = native.floor_visibility(sheet, np.tile(UP, (40_000, 1)), UP[None], floor, 32)
    irradiance = native.floor_irradiance(light, seen, 32)
    assert (irradiance[14:18, 14:18] == 2.0).all() and not irradiance[:10, :10].any()
    cells = seen[0, 0, : np.flatnonzero(seen[0, 0] < 0)[0]]
    assert np.bincount(cells).max() == 1  # each cell sees one point first


def test_floor_visibility_can_hold_every_point():
    points = np.float32([[x, y, 0] for x in (-1, 0, 1) for y in (-1, 0, 1)])
    normals = np.tile(UP, (9, 1)) * np.float32([1, -1, 1, -1, 1, -1, 1, -1, 1])[:, None]
    seen = native.floor_visibility(points, normals, UP[None], floor_under(half=2.0), 32)
    assert sorted(seen[0, 1] % 9) == list(range(9)) and len(set(seen[0, 0])) == 9
    facing_up = np.sort(seen[0, 1]) // 9  # seen from below, so from behind
    np.testing.assert_array_equal(facing_up, [0] * 4 + [1] * 5)
