"""Flicker counts changes that are wrong, and nothing else."""

from __future__ import annotations

import numpy as np
import pytest

from z2p_core.quality.flicker import flicker


def test_flicker_counts_wrong_changes_and_nothing_else() -> None:
    rng = np.random.default_rng(0)
    truth = rng.integers(0, 200, size=(5, 8, 8, 4)).astype(np.uint8)
    truth[..., 3] = 255
    mask = np.ones((5, 8, 8), bool)
    assert flicker(truth, truth, mask) == 0
    assert flicker(truth + np.array([9, 9, 9, 0], np.uint8), truth, mask) == pytest.approx(0, abs=1e-4)
    noisy = truth.copy()
    noisy[::2, ..., :3] += 10  # every second frame is brighter
    assert flicker(noisy, truth, mask) == pytest.approx(10, abs=0.01)
    assert flicker(noisy, truth, mask & (np.arange(8) < 4)) == pytest.approx(10, abs=0.01)
