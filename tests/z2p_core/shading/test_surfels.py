"""Which holes discs close, and which they leave open."""

import numpy as np
import pytest

from z2p_core.shading.surfels import make_surfels
from z2p_core.surface.normals import estimate_surface

SPACING = 0.02
HOLE = 2.4 * SPACING
"""Radius of a hole that discs may close."""


def discs_of(cloud: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Middles and radii of the discs of its points, and of those in holes."""
    found = estimate_surface(np.float32(cloud))
    further, radii = make_surfels(found, max(float(np.median(found.spacing)), 1e-3))
    count = len(found.points)
    for values in (further.points, further.spacing, further.normals, further.neighbor_spacing, further.neighbors):
        assert len(values) == len(radii)
    np.testing.assert_allclose(np.linalg.norm(further.normals, axis=1), 1, atol=1e-4)
    assert (further.neighbors < count).all()  # no disc in a hole counts as another's neighbour
    return further.points[:count], radii[:count], further.points[count:], radii[count:]


def random_sheet(rng: np.random.Generator, bent: float = 0.0) -> np.ndarray:
    """A square from -0.5 to 0.5, bent along X by so much in its middle."""
    places = rng.uniform(-0.5, 0.5, (int(1 / SPACING**2), 2))
    return np.column_stack([places, bent * np.cos(np.pi * places[:, 0])])


def covered(places: np.ndarray, points: np.ndarray, radii: np.ndarray) -> float:
    """Share of the places (M, 2) that lie within discs."""
    share: float = (np.linalg.norm(places[:, None] - points[:, :2], axis=2) < radii).any(1).mean()
    return share


def without(cloud: np.ndarray, radius: float) -> np.ndarray:
    return cloud[np.hypot(cloud[:, 0], cloud[:, 1]) > radius]


@pytest.mark.parametrize("bent", [0.0, 0.2])
def test_most_small_holes_are_closed_in_the_surface(bent):
    """Where a hole's rim is thin on one side, it stays; for that is how the gap between two things looks."""
    closed = 0
    for seed in range(12):
        rng = np.random.default_rng(seed)
        points, radii, middles, wide = discs_of(without(random_sheet(rng, bent), HOLE))
        in_hole = np.hypot(middles[:, 0], middles[:, 1]) < HOLE
        closed += in_hole.any()
        if not in_hole.any():
            continue
        assert np.abs(middles[in_hole, 2] - bent).max() < 0.6 * SPACING
        turn, share = rng.uniform(0, 2 * np.pi, 500), np.sqrt(rng.random(500)) * HOLE
        places = np.column_stack([share * np.cos(turn), share * np.sin(turn)])
        assert covered(places, points, radii) < 0.97  # there was something to close
        assert covered(places, np.concatenate([points, middles]), np.concatenate([radii, wide])) > 0.97
    assert closed >= 8


@pytest.mark.parametrize("seed", range(3))
def test_large_holes_stay_open(seed):
    _, _, middles, radii = discs_of(without(random_sheet(np.random.default_rng(seed)), 6 * SPACING))
    assert (np.hypot(middles[:, 0], middles[:, 1]) - radii > 3.5 * SPACING).all()


@pytest.mark.parametrize("seed", range(3))
def test_no_surfel_is_added_beyond_a_border(seed):
    _, _, middles, _ = discs_of(random_sheet(np.random.default_rng(seed)))
    assert (np.abs(middles[:, :2]) < 0.5).all()


def test_the_gap_between_two_slats_stays_open():
    """As wide as a hole that is closed, but open at both ends."""
    within = 0
    for seed in range(12):
        sheet = random_sheet(np.random.default_rng(seed))
        _, _, middles, _ = discs_of(sheet[np.abs(sheet[:, 0]) > HOLE])
        within += (np.abs(middles[:, 0]) < HOLE).sum()
    assert within <= 6  # by chance, over 600 spacings


def test_an_even_cloud_has_no_holes():
    x, y = np.mgrid[:50, :50].reshape(2, -1) * SPACING
    _, _, middles, _ = discs_of(np.column_stack([x, y, 0 * x]))
    assert not len(middles)


@pytest.mark.parametrize("count", [1, 2, 5, 20])
def test_smallest_clouds_have_a_surfel_for_each_point(count):
    points, radii, _, _ = discs_of(np.random.default_rng(0).random((count, 3)))
    assert len(points) == count and (radii > 0).all() and np.isfinite(radii).all()


@pytest.mark.parametrize("seed", range(4))
def test_duplicate_points_give_finite_surfels(seed):
    """Where so many lie in one place, their spacing is 0."""
    rng = np.random.default_rng(seed)
    cloud = np.round(rng.normal(size=(2_000, 3)) * 3) / 8
    with np.errstate(all="raise"):
        _, radii, middles, wide = discs_of(cloud)
    assert np.isfinite(radii).all() and np.isfinite(middles).all() and np.isfinite(wide).all()
