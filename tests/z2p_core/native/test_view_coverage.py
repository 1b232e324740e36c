"""Cells that a cloud covers in a view, against drawing its points as dots."""

import numpy as np
import pytest

from z2p_core import native


@pytest.mark.parametrize("count", [2, 30, 5000])
def test_coverage_counts_the_cells_of_3x3_dots(count):
    rng = np.random.default_rng(count)
    points = rng.normal(size=(count, 3)).astype(np.float32) * (1.0, 0.6, 0.3)
    points /= np.sqrt((points**2).sum(1).max())
    turns, elevation, side = np.array([0.0, 1.0, -2.5]), 0.4, 20
    covered, breadth = native.projected_coverage(points, turns, elevation, side)
    for view, angle in enumerate(turns):
        across = np.cos(angle) * points[:, 0] - np.sin(angle) * points[:, 1]
        forward = np.sin(angle) * points[:, 0] + np.cos(angle) * points[:, 1]
        up = forward * np.sin(elevation) + points[:, 2] * np.cos(elevation)
        column, row = (((axis + 1) * (side - 1) / 2).astype(int) + 1 for axis in (across, up))
        dots = np.zeros((side + 2, side + 2), bool)
        for x in (-1, 0, 1):
            for y in (-1, 0, 1):
                dots[column + x, row + y] = True
        assert abs(covered[view] - dots[1:-1, 1:-1].sum()) <= 3  # a point at a cell's border may fall either way
        assert breadth[view] == pytest.approx(np.ptp(across), rel=1e-5)
