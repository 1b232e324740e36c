"""No-data values are detected, and plausible coordinates are not."""

from __future__ import annotations

import numpy as np
import pytest

from z2p_core.formats.tables.missing_values import measured_mask

CLOUD = np.random.default_rng(1).normal((448_000.0, 5_538_000.0, 300.0), 1.0, (200, 3))


@pytest.mark.parametrize("mark", [-9999.0, -99999.0, 1e30, -1e38, 9999.0, -2147483648.0, -32768.0])
def test_no_data_values_are_detected_per_axis(mark: float) -> None:
    points = CLOUD.copy()
    points[5:9, 2], points[20] = mark, mark
    kept = measured_mask(points)
    assert kept is not None and np.array_equal(np.flatnonzero(~kept), [5, 6, 7, 8, 20])


@pytest.mark.parametrize("points", [
    CLOUD, CLOUD - CLOUD.mean(0), np.column_stack([np.linspace(-9999, 9999, 300), *np.zeros((2, 300))]),
    1e4 * np.sign(CLOUD - CLOUD.mean(0)), np.array([[-9999.0, 0, 0], [1, 0, 0]]),
])  # fmt: skip
def test_usual_coordinates_are_no_no_data_values(points: np.ndarray) -> None:
    assert measured_mask(points) is None
