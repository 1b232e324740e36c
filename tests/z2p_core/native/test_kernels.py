"""The compiled kernels against plain geometry: spheres, planes and lamps whose answers are known."""

import gc
import math
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from z2p_core import native
from z2p_core.camera import Camera
from z2p_core.images import bytes_from_unit, straight_from_premultiplied
from z2p_core.native.source_digest import NOTE, digest, outdated

ROOT = Path(__file__).parents[3]

SURE, FULL, NEAR, FAR = 25.0, 2.0, 1.0, 6.0


def depth_of(drawn):
    return FAR - drawn[2] * (FAR - NEAR)


def surfels_of(points, normals, radius, camera, features=None, slack=2.0, clips=None):
    features = np.zeros((len(points), 6), np.float32) if features is None else features
    radii = np.full(len(points), radius, np.float32)
    drawn = np.zeros((9, camera.height, camera.width), np.float32)
    clips = nothing_ends(points) if clips is None else clips
    native.rasterize_surfels(points, normals, radii, clips, features, camera, slack, SURE, FULL, NEAR, FAR, drawn)
    return drawn


def nothing_ends(points):
    return np.tile(np.float32([0, 0, 0, math.inf]), (len(points), 4, 1))


TOWARDS = np.float32([0, 0, -1])


def test_a_disc_facing_the_camera_covers_its_area_at_its_depth():
    camera = Camera(128, 128)
    drawn = surfels_of(np.float32([[0.2, -0.1, 3.0]]), TOWARDS[None], 0.3, camera)
    covered = drawn[0] > 0
    area = math.pi * (0.3 * camera.focal / 3) ** 2
    assert drawn[0].sum() == pytest.approx(area * (1 - 1 / SURE), rel=0.01)  # its rim is in doubt
    np.testing.assert_allclose(depth_of(drawn)[covered], 3.0, rtol=1e-5)
    assert drawn[0].max() == pytest.approx(1) and not drawn[:, ~covered].any()
    rows, columns = np.nonzero(covered)
    assert columns.mean() + 0.5 == pytest.approx(64 + 0.2 * camera.focal / 3, abs=0.2)
    assert rows.mean() + 0.5 == pytest.approx(64 - 0.1 * camera.focal / 3, abs=0.2)


def test_a_tilted_disc_has_the_depth_of_its_plane():
    camera, normal = Camera(128, 128), np.float32([0.6, 0, -0.8])
    drawn = surfels_of(np.float32([[0, 0, 3.0]]), normal[None], 0.1, camera)
    rows, columns = np.nonzero(drawn[0] > 0.9)
    assert len(rows) > 50
    rays = np.stack([(columns + 0.5 - 64) / camera.focal, (rows + 0.5 - 64) / camera.focal, np.ones(len(rows))], 1)
    depth = depth_of(drawn)[rows, columns]
    np.testing.assert_allclose(depth * (rays @ normal), 3.0 * normal[2], rtol=1e-3)


def test_next_to_nothing_of_a_disc_lies_over_the_planes_that_end_it():
    camera, points = Camera(128, 128), np.float32([[0, 0, 3.0]])
    whole, clips = surfels_of(points, TOWARDS[None], 0.4, camera), nothing_ends(points)
    clips[0, 0] = 1, 0, 0, 0.1  # nothing of x > 0.1
    clips[0, 1] = 0, -1, 0, 0.0  # nor of y < 0
    drawn = surfels_of(points, TOWARDS[None], 0.4, camera, clips=clips)
    x = (np.arange(128) + 0.5 - 64) / camera.focal * 3.0
    left = (x <= 0.1) & (x[:, None] >= 0)
    np.testing.assert_array_equal(drawn[:, left], whole[:, left])
    beyond = ~left & (whole[1] > 0.2)
    assert (drawn[1, beyond] < 0.04 * whole[1, beyond]).all()  # next to nothing, of the same depth and colour
    np.testing.assert_allclose(drawn[2:, beyond], whole[2:, beyond], rtol=1e-5)


def test_what_lies_over_a_discs_end_hides_nothing_behind_it():
    camera, points = Camera(64, 64), np.float32([[0, 0, 2.5], [0, 0, 3.0]])
    features = np.float32([[1, 0, 0, 0, 0, 0], [0, 1, 0, 0, 0, 0]])
    clips = nothing_ends(points)
    clips[0, 0] = 1, 0, 0, -0.1  # the nearer disc only shows left of its middle
    drawn = surfels_of(points, np.tile(TOWARDS, (2, 1)), 0.3, camera, features, 0.5, clips)
    assert drawn[4, 32, 32] > 0.96 and depth_of(drawn)[32, 32] == pytest.approx(3.0, abs=0.02)


def test_the_nearest_disc_shows_and_touching_ones_blend():
    camera = Camera(64, 64)
    features = np.float32([[1, 0, 0, 0, 0, 0], [0, 1, 0, 0, 0, 0]])
    for gap, blended in ((0.05, True), (0.9, False)):
        points = np.float32([[0, 0, 3.0], [0, 0, 3.0 + gap]])
        for order in ([0, 1], [1, 0]):
            drawn = surfels_of(points[order], np.tile(TOWARDS, (2, 1)), 0.2, camera, features[order])
            assert (drawn[3, 32, 32] > 0, drawn[4, 32, 32] > 0) == (True, blended)
            assert drawn[3:5, 32, 32].sum() == pytest.approx(1)


def test_pixels_on_an_edge_are_covered_in_part_and_show_both_sides():
    """A near disc before a large far one: its colour's mean is its share of the area, and there is some in between."""
    camera, points = Camera(64, 64), np.float32([[0.013, 0.007, 2.0], [0, 0, 5.0]])
    features = np.float32([[1, 0, 0, 0, 0, 0], [0, 1, 0, 0, 0, 0]])
    radii = np.float32([0.2, 4.0])
    drawn = np.zeros((9, 64, 64), np.float32)
    facing, clips = np.tile(TOWARDS, (2, 1)), nothing_ends(points)
    native.rasterize_surfels(points, facing, radii, clips, features, camera, 0.5, 1e4, FULL, NEAR, FAR, drawn)
    np.testing.assert_allclose(drawn[0], 1, atol=1e-6)
    np.testing.assert_allclose(drawn[3] + drawn[4], 1, atol=1e-5)
    assert drawn[3].sum() == pytest.approx(math.pi * (0.2 * camera.focal / 2.0) ** 2, rel=0.02)
    assert set(np.round(4 * drawn[3], 3).ravel()) == {0, 1, 2, 3, 4}
    alone = surfels_of(points[:1], TOWARDS[None], 0.2, camera)
    np.testing.assert_array_equal(alone[0] > 0, drawn[3] > 0)


def test_density_is_the_weight_of_the_discs_over_that_of_a_full_surface():
    camera = Camera(64, 64)
    for count in (1, 2, 5):
        points = np.tile(np.float32([[0, 0, 3.0]]), (count, 1))
        drawn = surfels_of(points, np.tile(TOWARDS, (count, 1)), 0.5, camera)
        assert drawn[1, 32, 32] == pytest.approx(min(1.0, count / FULL), rel=0.02)  # each weighs 1 in its middle
        assert (drawn[1][drawn[0] == 0] == 0).all() and drawn[1].min() >= 0 and drawn[1].max() <= 1


def test_discs_outside_the_picture_or_behind_the_camera_draw_nothing():
    points = np.float32([[0, 0, -3], [9, 0, 3], [0, -9, 3], [0, 0, 0]])
    assert not surfels_of(points, np.tile(TOWARDS, (4, 1)), 0.3, Camera(64, 64)).any()


def test_discs_at_the_borders_are_cut_and_the_rest_of_them_is_as_in_a_larger_picture():
    """The right column and the last row take what rounding up to whole vectors would spill over."""
    rng = np.random.default_rng(0)
    points = np.column_stack([rng.uniform(-2, 2, (400, 2)), rng.uniform(2.5, 4, 400)]).astype(np.float32)
    normals = rng.normal(size=(400, 3))
    normals[:, 2] = -np.abs(normals[:, 2]) - 0.5
    normals = (normals / np.linalg.norm(normals, axis=1, keepdims=True)).astype(np.float32)
    features = rng.random((400, 6), np.float32)
    small, large = Camera(61, 61), Camera(161, 61)  # the same focal length, the small one in the large one's middle
    cut, whole = (surfels_of(points, normals, 0.12, camera, features) for camera in (small, large))
    other = np.abs(cut - whole[:, :, 50:111]).max(0) > 2e-5
    assert other.sum() <= 9  # where a rim just touches a sample, or not
    assert (cut[0, :, [0, -1]] > 0).any() and (cut[0, [0, -1]] > 0).any()


@pytest.mark.parametrize("shape", [(8, 64, 64), (9, 64, 63), (9, 64, 64)])
def test_kernels_draw_only_into_arrays_of_the_right_size_and_kind(shape):
    points, normals = np.float32([[0, 0, 3]]), TOWARDS[None]
    out = np.zeros(shape, np.float64 if shape == (9, 64, 64) else np.float32)
    with pytest.raises(ValueError, match=r"expected a contiguous float32 array \(9, 64, 64\)"):
        native.rasterize_surfels(
            points, normals, np.float32([1]), nothing_ends(points), np.zeros((1, 6)), Camera(64, 64), 1.0, 25.0, FULL,
            NEAR, FAR, out,
        )  # fmt: skip


@pytest.mark.parametrize("stride", [40, 52])
def test_intensity_is_the_exponential(stride):
    depth = np.random.default_rng(0).uniform(-10, 80, (30, stride)).astype(np.float32)[:, 3:40]
    depth[::3] = np.inf
    out = np.empty(depth.shape, np.float32)
    native.depth_to_intensity(depth, 2.6, 0.6, out)
    np.testing.assert_allclose(out, np.exp((2.6 - depth.astype(np.float64)) / 0.6), rtol=3e-5, atol=1e-37)
    near = np.linspace(2.6, 4.6, 1000, dtype=np.float32).reshape(10, 100)
    drawn = np.empty(near.shape, np.float32)
    native.depth_to_intensity(near, 2.6, 0.6, drawn)
    np.testing.assert_allclose(drawn, np.exp((2.6 - near) / np.float32(0.6)), rtol=1e-6)


def test_straight_bytes_are_those_of_plain_numpy():
    rng = np.random.default_rng(0)
    planes = rng.uniform(-0.1, 1.1, (4, 50, 61)).astype(np.float32)
    planes[:3] *= planes[3]
    planes[3, ::7], planes[3, 1::7] = 0, 1e-7
    expected = bytes_from_unit(straight_from_premultiplied(np.clip(planes, 0, 1).transpose(1, 2, 0)))
    found = native.to_straight_rgba8(planes)
    assert found.dtype == np.uint8 and found.shape == (50, 61, 4) and not found[::7].any()
    assert np.abs(found.astype(int) - expected).max() <= 1 and (found != expected).mean() < 1e-3
    odd = np.full((4, 2, 2), np.nan, np.float32)
    assert not native.to_straight_rgba8(odd).any()


@pytest.mark.parametrize("count", [2, 30, 5000])
def test_a_view_shows_the_cells_that_its_dots_cover(count):
    rng = np.random.default_rng(count)
    points = rng.normal(size=(count, 3)).astype(np.float32) * (1.0, 0.6, 0.3)
    points /= np.sqrt((points**2).sum(1).max())
    turns, elevation, side = np.array([0.0, 1.0, -2.5]), 0.4, 20
    covered, breadth = native.projected_coverage(points, turns, elevation, side)
    for view, angle in enumerate(turns):
        across = np.cos(angle) * points[:, 0] - np.sin(angle) * points[:, 1]
        back = np.sin(angle) * points[:, 0] + np.cos(angle) * points[:, 1]
        upwards = back * np.sin(elevation) + points[:, 2] * np.cos(elevation)
        column, row = (((axis + 1) * (side - 1) / 2).astype(int) + 1 for axis in (across, upwards))
        dots = np.zeros((side + 2, side + 2), bool)
        for x in (-1, 0, 1):
            for y in (-1, 0, 1):
                dots[column + x, row + y] = True
        assert abs(covered[view] - dots[1:-1, 1:-1].sum()) <= 3  # a point at a cell's border may fall either way
        assert breadth[view] == pytest.approx(np.ptp(across), rel=1e-5)


def test_kernels_of_other_c_files_are_known_by_the_note_beside_them(tmp_path):
    folder = tmp_path / "c" / "points"
    folder.mkdir(parents=True)
    (tmp_path / "build.py").write_text("FLAGS = []")
    (folder / "a.c").write_text("int a;")
    (folder / "a.h").write_text("int a;")
    assert not outdated(tmp_path)  # compiled before there were notes: nobody knows
    (tmp_path / NOTE).write_text(digest(tmp_path) + "\n")
    (tmp_path / "a.py").write_text("a = 1")
    assert not outdated(tmp_path)
    for change in ("int b;", "int  a;"):
        (folder / "a.h").write_text(change)
        assert outdated(tmp_path)
    (folder / "a.h").write_text("int a;")
    assert not outdated(tmp_path)
    (folder / "a.c").rename(folder / "b.c")
    assert outdated(tmp_path)
    (folder / "b.c").rename(folder / "a.c")
    (tmp_path / "build.py").write_text("FLAGS = ['-O0']")
    assert outdated(tmp_path)


@pytest.mark.slow  # compiles
def test_an_installation_notes_what_it_compiled(tmp_path):
    for path in ("pyproject.toml", "setup.py", "README.md", "LICENSE", "z2p_core"):
        copy = shutil.copytree if (ROOT / path).is_dir() else shutil.copy2
        copy(ROOT / path, tmp_path / path)
    for folder in ("pipeline", "plugins", "shims", "storage", "workflows", "z2p_renderer"):
        (tmp_path / folder).mkdir()
    (tmp_path / "z2p_core" / "native" / NOTE).unlink(missing_ok=True)
    command = [sys.executable, "setup.py", "-q", "build_ext", "--inplace"]
    subprocess.run(command, cwd=tmp_path, check=True, capture_output=True)
    native_files = tmp_path / "z2p_core" / "native"
    assert (native_files / NOTE).read_text().strip() == digest(native_files) and not outdated(native_files)


def test_a_picture_is_reconciled_with_colours_only_amid_what_both_show():
    rng = np.random.default_rng(0)
    picture = rng.uniform(0.2, 0.8, (4, 40, 50)).astype(np.float32)
    coverage, colors = rng.uniform(0.8, 1, (40, 50)).astype(np.float32), rng.random((3, 40, 50), np.float32)
    picture[3] = rng.uniform(0.9, 1, (40, 50))
    before = picture.copy()
    native.blend_towards(picture, coverage, colors, 0.5, 0.03)
    amid = np.clip(10 * coverage - 9, 0, 1) * np.clip(20 * before[3] - 19, 0, 1)
    off = np.clip(colors * before[3] - before[:3], -0.03, 0.03)
    np.testing.assert_allclose(picture[:3], before[:3] + 0.5 * amid * off, atol=1e-5)
    np.testing.assert_array_equal(picture[3], before[3])
    rim = (coverage <= 0.9) | (before[3] <= 0.95)
    assert 0.2 < rim.mean() < 0.9 and (picture[:, rim] == before[:, rim]).all()


def test_a_shadow_is_reconciled_only_beside_what_shows():
    rng = np.random.default_rng(0)
    alpha, shadow, coverage = rng.random((3, 40, 50), np.float32)
    coverage[:, :25] = 0
    before = alpha.copy()
    native.blend_shadow_towards(alpha, coverage, shadow, 0.5, 0.2)
    off = shadow - before
    beside = np.clip(1 - 10 * coverage, 0, 1) * np.clip(2 - np.abs(off) / 0.2, 0, 1)
    np.testing.assert_allclose(alpha, before + 0.5 * beside * off, atol=1e-5)
    assert (alpha[coverage > 0.1] == before[coverage > 0.1]).all() and (alpha != before).mean() > 0.2


def test_a_grid_refuses_what_is_no_number_and_nothing_else_is_raised(recwarn: pytest.WarningsRecorder) -> None:
    with pytest.raises(ValueError, match="finite points"):
        native.NeighborGrid(np.full((3, 3), np.nan, np.float32))
    gc.collect()
    assert not [one for one in recwarn if issubclass(one.category, pytest.PytestUnraisableExceptionWarning)]


@pytest.mark.parametrize("most", [1, 12, 64])
def test_neighbours_are_the_nearest_however_uneven_the_points(most: int) -> None:
    rng = np.random.default_rng(5)
    far = np.exp(rng.uniform(-7, 0, (4000, 1)))  # as around a scanner
    cloud = (far * rng.normal(size=(4000, 3))).astype(np.float32)
    grid = native.NeighborGrid(cloud)
    assert np.array_equal(grid.points, native.NeighborGrid(cloud[::-1]).points)
    asked, places = np.arange(4000, dtype=np.int32), rng.normal(size=(50, 3)).astype(np.float32)
    for rows, found in ((grid.points, grid.neighbors(asked, most)[0]), (places, grid.neighbors_of_positions(places, most))):
        away = ((rows[:, None].astype(float) - grid.points) ** 2).sum(2)
        nearest = np.sort(np.partition(away, most, axis=1)[:, :most], axis=1)
        np.testing.assert_allclose(np.take_along_axis(away, found, 1), nearest, rtol=1e-4)
        assert all(len(set(row)) == most for row in found.tolist())
