"""Lone points about a lidar tile go, and nothing of a thing does, however thin."""

from __future__ import annotations

import numpy as np
import pytest
from made_clouds import box, chair, lamppost, moved, sphere

from z2p_core.placement.isolated_points import non_isolated_mask

RNG = np.random.default_rng(0)


def tile(side: float = 200.0) -> np.ndarray:
    x, y = RNG.uniform(0, side, (2, 20_000))
    return np.column_stack([x, y, 10 * np.sin(x / 60) * np.cos(y / 45)])


def strewn(count: int, low: float, high: float, side: float = 200.0) -> np.ndarray:
    return np.column_stack([RNG.uniform(0, side, (count, 2)), RNG.uniform(low, high, count)])


@pytest.mark.parametrize("share", [0.001, 0.01, 0.03])
@pytest.mark.parametrize(("low", "high"), [(60, 400), (500, 3000), (-300, -40), (-2000, 3000)])
def test_what_is_strewn_above_and_below_a_tile_goes(share: float, low: float, high: float) -> None:
    ground = tile()
    points = np.vstack([ground, strewn(int(share * len(ground)), low, high)])
    kept = non_isolated_mask(points)
    assert kept[: len(ground)].all()
    assert np.ptp(points[kept][:, 2]) < 80  # a slab as high as a tree or two above the ground
    order = RNG.permutation(len(points))
    assert np.array_equal(non_isolated_mask(points[order]), kept[order])


MAST = np.column_stack([RNG.normal(100, 0.2, (300, 2)), RNG.uniform(0, 150, 300)])
BUST = np.vstack([moved(sphere(40_000), 0, 0, 1.0), moved(box(400, 0.3, 0.3, 1.2), 0, 0, -1.2)])
WHOLE = {"ball": sphere(5000), "chair": chair(1500), "lamppost": lamppost(2000), "mast": np.vstack([tile(), MAST]),
         "coarse plinth": BUST, "solid": RNG.normal(size=(20_000, 3)), "plane": tile() * [1, 1, 0],
         "two clusters": np.vstack([sphere(3000), moved(sphere(200) * 0.2, 5, 0, 0)])}  # fmt: skip


@pytest.mark.parametrize("name", WHOLE)
def test_parts_of_a_thing_stay(name: str) -> None:
    assert non_isolated_mask(WHOLE[name]).all()
