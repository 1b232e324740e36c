"""Passes: they agree with their camera, pixel by pixel, in the data's units."""

from __future__ import annotations

import numpy as np
import pytest

from z2p_core.interfaces import PointColors, SettingError
from z2p_core.pass_names import PASSES, parse_passes
from z2p_core.pinhole import PinholeCamera, aimed_camera
from z2p_core.placement.viewpoint import Viewpoint
from z2p_core.shading.passes import draw_passes

CENTRE, RADIUS = np.array([5e5, 4e6, 100.0]), 20.0
VIEWPOINT = Viewpoint((5e5, 4e6, 100.0), RADIUS, ((0.0, 1.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 0.0, 1.0)), 0.0)
GREY = np.array([0.2, 0.4, 0.6], np.float32)


def sphere(count: int = 6000) -> np.ndarray:
    """Evenly spread points (count, 3) on a sphere in the data's coordinates (a Fibonacci lattice)."""
    index = np.arange(count) + 0.5
    height, azimuth = 1 - 2 * index / count, np.pi * (1 + 5**0.5) * index
    across = np.sqrt(1 - height**2)
    return CENTRE + RADIUS * np.column_stack([across * np.cos(azimuth), across * np.sin(azimuth), height])


def camera_from(offset: tuple[float, float, float], scale: float | None = None) -> PinholeCamera:
    """A camera that looks at the sphere past its middle, in an oblong picture with an uneven principal point."""
    target = CENTRE + np.array([2.0, 1.0, 0.0])
    camera = aimed_camera(CENTRE + np.array(offset), target, np.array([0.1, 0.0, 1.0]), (200, 160), 40, scale)
    return PinholeCamera(200, 160, (camera.focal[0], 1.1 * camera.focal[1]), (97.3, 84.1), camera.rotation,
                         camera.translation, camera.orthographic)  # fmt: skip


CAMERAS = {
    "usual": camera_from((60, -40, 25)), "below": camera_from((40, 10, -50)), "above": camera_from((1, 2, 90)),
    "near": camera_from((18, -18, 6)), "orthographic": camera_from((60, -40, 25), 2.5),
}  # fmt: skip


@pytest.fixture(scope="module", params=CAMERAS)
def drawn(request: pytest.FixtureRequest) -> tuple[PinholeCamera, dict[str, np.ndarray]]:
    camera = CAMERAS[request.param]
    return camera, draw_passes(PASSES, VIEWPOINT.place(sphere()), VIEWPOINT, camera, GREY)


def front_of_sphere(camera: PinholeCamera) -> tuple[np.ndarray, np.ndarray]:
    """Depths (H, W) at which the rays through pixels meet the true sphere, and which do so well within its outline."""
    row, column = np.mgrid[: camera.height, : camera.width] + 0.5
    near, far = (
        camera.unproject(np.column_stack([column.ravel(), row.ravel()]), np.full(row.size, depth)) - CENTRE
        for depth in (1.0, 2.0)
    )
    ray = far - near
    a, b, c = (ray**2).sum(1), (near * ray).sum(1), (near**2).sum(1) - RADIUS**2
    root = b**2 - a * c
    depth = 1 + (-b - np.sqrt(np.maximum(root, 0))) / a
    return depth.reshape(row.shape), (root / a > 0.3 * RADIUS**2).reshape(row.shape)


def test_depth_is_that_of_the_true_surface(drawn: tuple[PinholeCamera, dict[str, np.ndarray]]) -> None:
    camera, passes = drawn
    truth, inside = front_of_sphere(camera)
    assert inside.sum() > 1000
    error = np.abs(passes["depth"] - truth)[inside]
    assert np.isfinite(error).all() and np.median(error) < 0.004 * RADIUS and error.max() < 0.05 * RADIUS


def test_a_point_lies_where_its_pixel_says(drawn: tuple[PinholeCamera, dict[str, np.ndarray]]) -> None:
    camera, passes = drawn
    seen = np.isfinite(passes["depth"])
    pixels, depth = camera.project(passes["position"][seen])
    row, column = np.nonzero(seen)
    np.testing.assert_allclose(pixels, np.column_stack([column, row]) + 0.5, atol=1e-3)
    np.testing.assert_allclose(depth, passes["depth"][seen], rtol=1e-5, atol=1e-4)
    np.testing.assert_allclose(np.linalg.norm(passes["position"][seen] - CENTRE, axis=1), RADIUS, rtol=0.05)


def test_projecting_a_point_finds_its_depth(drawn: tuple[PinholeCamera, dict[str, np.ndarray]]) -> None:
    camera, passes = drawn
    truth, inside = front_of_sphere(camera)
    pixels, depth = camera.project(sphere())
    column, row = np.floor(pixels).astype(int).T
    within = (column >= 0) & (row >= 0) & (column < camera.width) & (row < camera.height)
    column, row, depth = column[within], row[within], depth[within]
    front = inside[row, column] & (depth < truth[row, column] + 0.2 * RADIUS)
    assert front.sum() > 30
    assert np.median(np.abs(passes["depth"][row, column] - depth)[front]) < 0.02 * RADIUS


def test_normals_are_in_the_datas_axes(drawn: tuple[PinholeCamera, dict[str, np.ndarray]]) -> None:
    camera, passes = drawn
    _, inside = front_of_sphere(camera)
    outward = (passes["position"][inside] - CENTRE) / RADIUS
    assert np.median((passes["normal"][inside] * outward).sum(1)) > 0.99


def test_pixels_without_a_surface_have_no_numbers(drawn: tuple[PinholeCamera, dict[str, np.ndarray]]) -> None:
    _, passes = drawn
    empty = passes["alpha"] == 0
    assert all(np.isnan(passes[name][empty]).all() for name in ("depth", "normal", "albedo", "position"))
    assert (passes["trust"][empty] == 0).all() and passes["trust"].max() <= 1
    assert np.abs(passes["albedo"][~np.isnan(passes["depth"])] - GREY).max() < 1e-3


def test_a_bar_has_its_length_in_an_orthographic_picture() -> None:
    rng = np.random.default_rng(1)
    bar = CENTRE + rng.uniform(-0.5, 0.5, (8000, 3)) * (100.0, 10.0, 10.0)
    viewpoint = Viewpoint((5e5, 4e6, 100.0), 51.0, VIEWPOINT.rotation, 0.0)
    camera = aimed_camera(CENTRE + np.array([0, -300, 80]), CENTRE, np.array([0, 0, 1.0]), (500, 128), 40, 4.0)
    alpha = draw_passes(["alpha"], viewpoint.place(bar), viewpoint, camera, GREY)["alpha"]
    columns = np.flatnonzero((alpha > 0.5).sum(0) > 5)
    assert columns[-1] - columns[0] + 1 == pytest.approx(400, abs=8)


def test_the_colors_of_points_become_albedo() -> None:
    points = sphere()
    albedo = np.where(points[:, :1] > CENTRE[0], (0.9, 0.1, 0.1), (0.1, 0.1, 0.9)).astype(np.float32)
    cloud = VIEWPOINT.place(points)
    drawn = draw_passes(["albedo", "position"], cloud, VIEWPOINT, CAMERAS["above"], PointColors(cloud, albedo))
    right = drawn["position"][..., 0] > CENTRE[0] + 3
    assert np.abs(drawn["albedo"][right] - (0.9, 0.1, 0.1)).max() < 0.02


def test_sparse_places_are_trusted_less() -> None:
    points = sphere()
    thinned = points[(points[:, 0] > CENTRE[0]) | (np.arange(len(points)) % 12 == 0)]
    drawn = draw_passes(["trust", "position"], VIEWPOINT.place(thinned), VIEWPOINT, CAMERAS["above"], GREY)
    right = drawn["position"][..., 0] > CENTRE[0] + 4
    assert drawn["trust"][right].mean() > 0.8
    assert drawn["trust"][drawn["position"][..., 0] < CENTRE[0] - 4].mean() < drawn["trust"][right].mean() - 0.3


def test_names_of_passes() -> None:
    assert parse_passes("all") == PASSES
    assert parse_passes(" Depth,normal,depth") == ("depth", "normal")
    assert parse_passes(None) == ()
    with pytest.raises(SettingError, match="'dept'"):
        parse_passes(["dept"])
