"""Numbers that float32 has rounded far from the origin are told, and regular grids there are not."""

from __future__ import annotations

import numpy as np
import pytest

from z2p_renderer.pipeline.placement.hints import float32_step

RNG = np.random.default_rng(0)
FAR = np.array([665_000.0, 5_648_000.0, 240.0])


def as_float32(points: np.ndarray) -> np.ndarray:
    return points.astype(np.float32).astype(np.float64)


def test_a_cloud_that_float32_has_rounded_is_told_its_step() -> None:
    for size in (0.5, 5, 50):
        assert float32_step(as_float32(FAR + size * RNG.random((4000, 3)))) == 0.5
    assert float32_step(FAR + RNG.random((4000, 3))) == 0  # float64
    assert float32_step(as_float32(FAR + 5000 * RNG.random((4000, 3)))) == 0  # it does not show


@pytest.mark.parametrize("step", [0.5, 1.0, 2.0])
def test_a_raster_there_has_lost_nothing(step: float) -> None:
    row, column = np.mgrid[:60, :50]
    heights = np.stack([column * step, row * step, 9 * np.sin(row / 9)], -1).reshape(-1, 3)
    assert float32_step(as_float32(FAR + heights)) == 0
    assert float32_step(as_float32(FAR + RNG.permutation(heights)[:2000])) == 0


def test_voxels_there_have_lost_nothing() -> None:
    voxels = np.stack(np.meshgrid(*[np.arange(20.0)] * 3), -1).reshape(-1, 3)
    assert float32_step(np.round(FAR) + voxels[RNG.random(len(voxels)) < 0.3]) == 0
