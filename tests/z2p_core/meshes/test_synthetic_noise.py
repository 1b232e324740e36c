"""Synthetic noise has its kind and scale, and is seeded."""

from __future__ import annotations

import numpy as np
import pytest

from z2p_core.meshes.synthetic_noise import add_noise

CLOUD = np.random.default_rng(1).normal(size=(20_000, 3)).astype(np.float32)


def moved(kind: str, scale: float, seed: int = 0) -> np.ndarray:
    return add_noise(CLOUD, kind, scale, np.random.default_rng(seed)) - CLOUD


@pytest.mark.parametrize(("kind", "scale"), [("none", 0.5), ("uniform", 0.0), ("gaussian", 0.0)])
def test_no_noise_gives_an_equal_copy(kind: str, scale: float) -> None:
    noisy = add_noise(CLOUD, kind, scale, np.random.default_rng(0))
    assert noisy is not CLOUD and np.array_equal(noisy, CLOUD)


def test_uniform_noise_fills_its_range_and_stays_inside() -> None:
    shift = moved("uniform", 0.02)
    assert np.abs(shift).max() < 0.02 + 1e-6
    assert shift.std() == pytest.approx(0.02 / np.sqrt(3), rel=0.02)


def test_gaussian_noise_has_its_standard_deviation() -> None:
    shift = moved("gaussian", 0.02)
    assert shift.std() == pytest.approx(0.02, rel=0.02)
    assert np.abs(shift).max() > 0.05


@pytest.mark.parametrize("kind", ["uniform", "gaussian"])
def test_noise_is_seeded_and_keeps_the_dtype(kind: str) -> None:
    assert np.array_equal(moved(kind, 0.1, 3), moved(kind, 0.1, 3))
    assert not np.array_equal(moved(kind, 0.1, 3), moved(kind, 0.1, 4))
    for dtype in (np.float32, np.float64):
        assert add_noise(CLOUD.astype(dtype), kind, 0.1, np.random.default_rng(0)).dtype == dtype


def test_wrong_kind_and_scale_are_clear_errors() -> None:
    with pytest.raises(ValueError, match="expected one of none, uniform, gaussian, got 'gausian'"):
        moved("gausian", 0.1)
    for scale in (-1.0, float("nan"), float("inf")):
        with pytest.raises(ValueError, match="noise scale: expected"):
            moved("uniform", scale)
