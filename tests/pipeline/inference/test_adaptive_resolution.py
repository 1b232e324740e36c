"""Pictures of sparse clouds are drawn small and enlarged; those of others are not touched."""

from __future__ import annotations

import numpy as np
import pytest

from z2p_core.camera import DISTANCE, Camera, turn
from z2p_core.surface.noise_level import median_spacing
from z2p_renderer.pipeline.inference.adaptive_resolution import (
    MIN_PIXELS_PER_SPACING,
    MIN_SHORTER_SIDE,
    REDUCTION_FACTORS,
    render_size,
    upsampled,
)
from z2p_renderer.pipeline.inference.renderer import Renderer


def sphere(count: int) -> np.ndarray:
    """Points (N, 3) float32 spread evenly over the unit sphere."""
    height = 1 - (2 * np.arange(count) + 1) / count
    angle = np.arange(count) * np.pi * (3 - np.sqrt(5))
    side = np.sqrt(1 - height**2)
    return np.column_stack([side * np.cos(angle), side * np.sin(angle), height]).astype(np.float32)


@pytest.mark.parametrize("count", [300, 1200, 20_000])
def test_spacing_is_the_side_of_a_points_share_of_the_surface(count: int) -> None:
    assert median_spacing(sphere(count)) == pytest.approx(np.sqrt(4 * np.pi / count), rel=0.1)


@pytest.mark.parametrize("side", [256, 512, 1024, 2048])
@pytest.mark.parametrize("count", [1, 2, 12, 60, 300, 1200, 5000, 20_000, 80_000])
def test_points_are_close_in_a_picture_that_is_drawn_smaller(count: int, side: int) -> None:
    """As close as the next step would not leave them, but not closer; unless it would become too small."""
    cloud = sphere(count)
    drawn, _ = render_size(cloud, side, side)
    apart = median_spacing(cloud) * Camera(side, side).focal / DISTANCE
    factor = side / drawn
    assert any(abs(side / step - drawn) <= 0.5 for step in (1, *REDUCTION_FACTORS))
    assert drawn == side or (apart / factor >= 0.99 * MIN_PIXELS_PER_SPACING and drawn >= MIN_SHORTER_SIDE)
    further = min((step for step in REDUCTION_FACTORS if step > factor + 0.1), default=None)
    assert further is None or apart / further < 1.01 * MIN_PIXELS_PER_SPACING or side / further < MIN_SHORTER_SIDE


def test_render_size_ignores_rotation_and_point_order() -> None:
    rng = np.random.default_rng(0)
    for count in (150, 700, 2500):
        cloud = rng.normal(size=(count, 3))
        cloud /= np.linalg.norm(cloud, axis=1, keepdims=True)
        sizes = {render_size((rng.permutation(cloud) @ turn(angle).T).astype(np.float32), 1024, 768)
                 for angle in np.linspace(0, 180, 9)}  # fmt: skip
        assert len(sizes) == 1


def test_a_dense_cloud_is_drawn_in_full() -> None:
    assert render_size(sphere(5000), 512, 512) == (512, 512)
    assert render_size(sphere(80_000), 1024, 768) == (1024, 768)


def test_the_shape_of_a_picture_stays() -> None:
    width, height = render_size(sphere(300), 1200, 900)
    assert (width, height) != (1200, 900)
    assert width / height == pytest.approx(4 / 3, abs=0.01)


@pytest.mark.parametrize("size", [(300, 200), (150, 100), (97, 61)])
def test_what_changes_little_survives(size: tuple[int, int]) -> None:
    width, height = size
    y, x = np.mgrid[:40, :60] + 0.5
    small = np.stack([x / 60, y / 40, np.cos(x / 9) * np.sin(y / 7), np.ones_like(x)]).astype(np.float32)
    large = upsampled(small, width, height)
    y, x = (np.mgrid[:height, :width] + 0.5) * np.array([40 / height, 60 / width])[:, None, None]
    expected = np.stack([x / 60, y / 40, np.cos(x / 9) * np.sin(y / 7), np.ones_like(x)])
    assert large.shape == (4, height, width)
    assert large.dtype == np.float32
    inside = (slice(None), slice(height // 8, -height // 8), slice(width // 8, -width // 8))
    assert np.abs(large - expected)[inside].max() < 0.01
    assert np.array_equal(large[3], np.ones((height, width)))


def test_a_picture_that_has_its_size_is_itself() -> None:
    picture = np.random.default_rng(0).random((4, 20, 30), dtype=np.float32)
    assert upsampled(picture, 30, 20) is picture


def test_a_sparse_clouds_picture_is_the_smaller_one_enlarged() -> None:
    renderer, cloud = Renderer("regular"), sphere(200)
    assert render_size(cloud, 300, 260) == (150, 130)
    picture, small = (renderer.render(cloud, None, *size).astype(float) for size in ((300, 260), (150, 130)))
    assert picture.shape == (260, 300, 4)
    halved = picture.reshape(130, 2, 150, 2, 4).mean((1, 3))
    assert np.abs(halved[..., 3] - small[..., 3]).mean() < 0.5
