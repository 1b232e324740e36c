"""The surfel G-buffer: geometry, light and shadow lie where they do in the scene, and each setting affects its own."""

import gc
from dataclasses import replace

import numpy as np
import pytest

from z2p_core.camera import DEPTH_RANGE, DISTANCE, Camera
from z2p_core.images import linear_from_srgb
from z2p_core.parallel import without_second_core
from z2p_core.scene import SceneDescription
from z2p_core.shading.channels import RADIANCE_RGB, GBufferChannel
from z2p_core.surface.subsampling import subsample_hashed
from z2p_renderer.plugins.gbuffers import surfels
from z2p_renderer.plugins.gbuffers.glossy import Glossy
from z2p_renderer.plugins.gbuffers.surfels import Surfels

CAMERA = Camera(96, 96)
COVERAGE, DENSITY, DEPTH, RIGHT, DOWN, GREY, RED, GREEN, BLUE, SHADOW = GBufferChannel


def sphere_of(count=4000, radius=0.6):
    points = np.random.default_rng(0).normal(size=(count, 3))
    return (radius * points / np.linalg.norm(points, axis=1, keepdims=True)).astype(np.float32)


SCENE = SceneDescription(material={"Base Color": (0.5, 0.25, 0.0, 1.0)})


def test_a_sphere_is_covered_and_its_normals_point_outwards():
    picture = Surfels().draw(sphere_of(), CAMERA, SCENE)
    pixel, _ = CAMERA.project(np.zeros((1, 3)))
    rows, columns = np.mgrid[:96, :96] + 0.5
    reach = np.hypot(columns - pixel[0, 0], rows - pixel[0, 1])
    edge = CAMERA.focal * np.tan(np.arcsin(0.6 / DISTANCE))
    assert picture[COVERAGE][reach < edge - 2].mean() > 0.995 and not picture[COVERAGE][reach > edge + 2].any()
    inner = reach < 0.7 * edge
    assert np.abs(picture[RIGHT] - (columns - pixel[0, 0]) / edge)[inner].mean() < 0.06
    assert np.abs(picture[DOWN] - (rows - pixel[0, 1]) / edge)[inner].mean() < 0.06
    assert picture[DEPTH][48, 48] == pytest.approx((DEPTH_RANGE[1] - 3.0) / 2, abs=0.02)


@pytest.mark.parametrize("side", [5, 96, 257])
def test_one_core_and_two_draw_the_same(side):
    cloud = np.concatenate([sphere_of(4000, 0.6), sphere_of(3000, 0.3) + np.float32([0.2, -0.7, 0.1])])
    camera = Camera(side, side)
    shared = Surfels().draw(cloud, camera, SCENE)
    with without_second_core():
        np.testing.assert_array_equal(Surfels().draw(cloud, camera, SCENE), shared)


@pytest.mark.parametrize("kind", [Surfels, Glossy])
def test_drawing_leaves_no_reference_cycles(kind):
    kind().draw(sphere_of(), CAMERA, SCENE)  # fills the caches
    gc.collect()
    gc.disable()
    try:
        kind().draw(sphere_of(), CAMERA, SCENE)
        assert gc.collect() == 0
    finally:
        gc.enable()


def reconciled(count, off, shadow=0.0):
    """Features of a sphere, and the change of an image that differs from them by `off` in color, `shadow` in alpha."""
    features = Surfels().draw(sphere_of(count), CAMERA, SCENE)
    alpha = np.where(features[COVERAGE] > 0, features[COVERAGE], features[SHADOW] + np.float32(shadow))
    picture = np.concatenate([features[RADIANCE_RGB] + np.float32(off), alpha[None]])
    before = picture.copy()
    Surfels().reconcile(picture, features, count)
    return features, picture - before


@pytest.mark.parametrize(("count", "off"), [(40_000, 0.01), (40_000, -0.02), (4000, 0.01)])
def test_dense_clouds_blend_the_image_towards_surfel_colors(count, off):
    features, moved = reconciled(count, off)
    covered = features[COVERAGE] == 1
    share = -moved[:3, covered] / off
    assert covered.sum() > 500 and share.min() > 0.05 and share.max() <= surfels.MAX_BLEND_SHARE + 1e-3
    assert np.ptp(share) < 1e-3 and not moved[3].any() and not moved[:, features[COVERAGE] < 0.9].any()


def test_blend_share_grows_with_density_from_zero():
    results = [reconciled(count, 0.01) for count in (200, 4000, 10_000, 40_000)]
    shares = [np.abs(moved[:3, features[COVERAGE] == 1]).max() for features, moved in results]
    assert shares[0] == 0 < shares[1] < shares[2] <= shares[3] + 1e-6


def test_large_differences_are_blended_by_a_limited_shift():
    near, far = (np.abs(reconciled(40_000, off)[1]).max() for off in (surfels.MAX_COLOR_SHIFT, 0.3))
    assert far == pytest.approx(near, rel=1e-3)


@pytest.mark.parametrize("count", [200, 4000])
def test_shadow_alpha_blends_towards_the_cast_one_if_close(count):
    features, moved = reconciled(count, 0.0, shadow=0.02)
    off = features[COVERAGE] == 0
    np.testing.assert_allclose(moved[3, off], -surfels.SHADOW_BLEND_SHARE * 0.02, atol=1e-6)
    assert not moved[3, features[COVERAGE] > 0.1].any() and not moved[:3, off].any()
    assert not reconciled(count, 0.0, shadow=2.1 * surfels.MAX_SHADOW_SHIFT)[1][3, off].any()


def test_light_and_shadow_lie_on_opposite_sides():
    left, right = (
        Surfels().draw(sphere_of(), CAMERA, replace(SCENE, light=(3.6, azimuth, 40.0))) for azimuth in (-70.0, 70.0)
    )
    half = np.s_[:, :48], np.s_[:, 48:]
    assert left[GREY][half[0]].sum() > 1.2 * left[GREY][half[1]].sum()
    assert right[GREY][half[1]].sum() > 1.2 * right[GREY][half[0]].sum()
    assert left[SHADOW][half[1]].sum() > 1.5 * left[SHADOW][half[0]].sum()
    assert right[SHADOW][half[0]].sum() > 1.5 * right[SHADOW][half[1]].sum()
    assert left[SHADOW].min() >= 0 and left[SHADOW].max() <= 1


def test_base_color_affects_only_the_rgb_channels():
    picture = Surfels().draw(sphere_of(), CAMERA, SCENE)
    seen = picture[COVERAGE] > 0
    assert not picture[BLUE].any() and (picture[RED][seen] > picture[GREEN][seen]).all()
    grey = Surfels().draw(sphere_of(), CAMERA, replace(SCENE, material={}))
    for channel in (COVERAGE, DENSITY, DEPTH, RIGHT, DOWN, GREY):
        np.testing.assert_array_equal(picture[channel], grey[channel])
    np.testing.assert_array_equal(grey[RED], grey[BLUE])


def test_bright_surfaces_light_themselves_and_the_floor():
    cave = sphere_of(8000)
    cave = cave[cave[:, 1] > -0.2]  # a bowl, open to the viewer
    dark, bright = (
        Surfels().draw(cave, CAMERA, replace(SCENE, material={"Base Color": (x, x, x, 1.0)})) for x in (0.1, 0.9)
    )
    seen = dark[COVERAGE] > 0.9
    ratio = linear_from_srgb(bright[RED][seen]) / linear_from_srgb(dark[RED][seen])
    assert np.median(ratio) > 9 * 1.15
    shadowed = (dark[SHADOW] > 0.05) & (dark[COVERAGE] == 0)
    assert (bright[SHADOW] - dark[SHADOW])[shadowed].mean() < -0.005


def test_random_gaps_are_closed_and_large_holes_stay_open():
    rng = np.random.default_rng(1)
    spacing = 1.2 / np.sqrt(3000)
    sheet = np.column_stack([rng.uniform(-0.6, 0.6, 3000), np.zeros(3000), rng.uniform(-0.6, 0.6, 3000)])
    away = np.hypot(sheet[:, 0], sheet[:, 2])
    closed = Surfels().draw(sheet.astype(np.float32), CAMERA, SCENE)[COVERAGE]
    torn = Surfels().draw(sheet[away > 4.5 * spacing].astype(np.float32), CAMERA, SCENE)[COVERAGE]
    (column, row), _ = (projected[0] for projected in CAMERA.project(np.zeros((1, 3))))
    rows, columns = np.mgrid[:96, :96] + 0.5
    reach = np.hypot(columns - column, rows - row) * DISTANCE / CAMERA.focal  # in world units, nearly
    assert (closed[(reach < 0.5)] > 0.5).mean() > 0.997
    assert not torn[reach < 2.5 * spacing].any()
    assert (torn[(reach > 5.5 * spacing) & (reach < 0.5)] > 0.5).mean() > 0.99


def test_a_small_hole_is_closed_and_looks_like_its_rim():
    rng = np.random.default_rng(1)
    spacing = 1.2 / np.sqrt(3000)
    sheet = np.column_stack([rng.uniform(-0.6, 0.6, 3000), np.zeros(3000), rng.uniform(-0.6, 0.6, 3000)])
    sheet = sheet[np.hypot(sheet[:, 0], sheet[:, 2]) > 2.5 * spacing]
    picture = Surfels().draw(sheet.astype(np.float32), CAMERA, SCENE)
    (column, row), _ = (projected[0] for projected in CAMERA.project(np.zeros((1, 3))))
    rows, columns = np.mgrid[:96, :96] + 0.5
    reach = np.hypot(columns - column, rows - row) * DISTANCE / CAMERA.focal
    hole, around = reach < 2 * spacing, (reach > 3 * spacing) & (reach < 8 * spacing)
    assert picture[COVERAGE][hole].min() > 0.9
    for channel in (DEPTH, RIGHT, DOWN, GREY, RED):
        assert picture[channel][hole].mean() == pytest.approx(picture[channel][around].mean(), abs=0.03)


def test_density_is_about_a_third_at_the_border_of_a_sheet():
    rng = np.random.default_rng(0)
    wall = np.column_stack([rng.uniform(-0.6, 0.6, 6000), np.zeros(6000), rng.uniform(-0.6, 0.6, 6000)])
    camera = Camera(512, 512, 0.0)
    picture = Surfels().draw(wall.astype(np.float32), camera, SCENE)
    border = 0.6 / DISTANCE * camera.focal
    rows, columns = np.mgrid[:512, :512] + 0.5 - 256
    at_border = (np.abs(rows) < border - 12) & (np.abs(np.abs(columns) - border) < 0.7)
    within = (np.abs(rows) < border - 12) & (np.abs(columns) < border - 12)
    assert picture[DENSITY][at_border].mean() == pytest.approx(0.3, abs=0.1) and picture[DENSITY][within].mean() > 0.75


def test_floor_touches_the_lowest_point_by_default():
    cloud = sphere_of()
    lowest = float(cloud[:, 2].min())
    floors = (None, lowest, lowest - 0.3)
    resting, given, deep = (Surfels().draw(cloud, CAMERA, replace(SCENE, floor=floor)) for floor in floors)
    np.testing.assert_array_equal(resting, given)
    assert np.array_equal(resting[:GREY], deep[:GREY]) and not np.array_equal(resting[SHADOW], deep[SHADOW])


def test_noise_has_little_effect_on_shading():
    clean = Surfels().draw(sphere_of(6000), CAMERA, SCENE)
    rng = np.random.default_rng(1)
    cloud = (sphere_of(6000) + rng.normal(0, 0.012, (6000, 3))).astype(np.float32)
    noisy = Surfels().draw(cloud, CAMERA, SCENE)
    inner = clean[COVERAGE] > 0.99
    assert np.abs(noisy[RIGHT] - clean[RIGHT])[inner].mean() < 0.045  # 0.088 with as many neighbours as for a clean one
    assert np.abs(noisy[GREY] - clean[GREY])[inner].mean() < 0.013  # 0.025


def test_two_points_face_the_camera():
    picture = Surfels().draw(np.float32([[0, 0, 0], [0.1, 0, 0.1]]), CAMERA, SCENE)
    assert picture[COVERAGE].max() > 0.9 and np.isfinite(picture).all()


@pytest.mark.parametrize("along", [(0, 0, 1), (1, 0, 0), (0.5, 0.5, 0.7)])
def test_a_line_of_points_is_visible_from_any_side(along):
    line = np.linspace(-0.6, 0.6, 300)[:, None] * np.float32(along)
    picture = Surfels().draw(line, CAMERA, SCENE)
    ends, _ = CAMERA.project(line[[0, -1]])
    assert picture[COVERAGE].sum() > 0.5 * np.linalg.norm(ends[1] - ends[0])


def test_large_clouds_are_subsampled_evenly_in_any_order():
    cloud = sphere_of(100_000)
    kept = subsample_hashed(cloud, 20_000)
    assert len(kept) == pytest.approx(20_000, rel=0.03) and np.abs(kept.mean(0)).max() < 0.02
    reversed_kept = subsample_hashed(cloud[::-1], 20_000)
    np.testing.assert_array_equal(np.sort(kept, axis=0), np.sort(reversed_kept, axis=0))
    assert subsample_hashed(kept, 40_000) is kept


def test_sparse_parts_are_closed_and_single_points_stay_dots():
    dense, sparse = sphere_of(8000, 0.4) - np.float32([0.45, 0, 0]), sphere_of(300, 0.4) + np.float32([0.45, 0, 0])
    alone = Surfels().draw(sparse, CAMERA, SCENE)[COVERAGE]
    together = Surfels().draw(np.vstack([dense, sparse]), CAMERA, SCENE)[COVERAGE]
    inside = alone[:, 52:] > 0.9
    assert inside.sum() > 300 and (together[:, 52:][inside] > 0.9).mean() > 0.97
    stray = np.float32([[0.45, 0, 0.5]])
    dot = Surfels().draw(np.vstack([dense, stray]), CAMERA, SCENE)[COVERAGE][:, 52:]
    assert (dot > 0.5).sum() < 12


def test_large_images_have_finer_steps_in_penumbrae(monkeypatch):
    """Each light sample casts a shadow of its own of a thin pole; more samples make the steps finer."""
    height = np.random.default_rng(0).uniform(-0.95, 0.95, 1500)
    turn = np.random.default_rng(1).uniform(0, 2 * np.pi, 1500)
    pole = np.column_stack([0.02 * np.cos(turn), 0.02 * np.sin(turn), height]).astype(np.float32)
    scene = SceneDescription(light=(3.5, -60.0, 40.0))
    fine = Surfels().draw(pole, Camera(800, 800), scene)[SHADOW]
    monkeypatch.setattr(surfels, "light_sample_sets", lambda camera: 1)
    coarse = Surfels().draw(pole, Camera(800, 800), scene)[SHADOW]
    assert fine.sum() == pytest.approx(coarse.sum(), rel=0.02)
    steps = [np.abs(np.diff(shadow[:, 500:], axis=0)).sum() for shadow in (fine, coarse)]
    assert steps[0] < 0.8 * steps[1]


def test_outside_the_crop_the_faint_cast_shadow_is_shown():
    features = Surfels().draw(sphere_of(4000), CAMERA, SCENE)
    outside = Surfels().elsewhere(features, 4000)
    assert outside is not None
    mask, floor = outside
    assert (mask[features[COVERAGE] > 0] > 0).all()
    assert (mask[features[SHADOW] > surfels.NETWORK_SHADOW_ALPHA] > 0).all()
    left = mask == 0
    assert features[SHADOW][left].max() > 0.02 and left.mean() > 0.3
    assert not floor[:3].any() and np.array_equal(floor[3], features[SHADOW])
    assert Surfels().elsewhere(features, 400) is None  # the cast shadow of so few points has gaps
