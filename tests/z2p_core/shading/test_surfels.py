"""Small holes are closed by surfels of their own; large holes, gaps and borders stay open."""

import numpy as np
import pytest

from z2p_core.shading.surfels import make_surfels
from z2p_core.surface.normals import estimate_surface

SPACING = 0.02
HOLE = 2.4 * SPACING
"""Radius of a hole that is small enough to be closed."""


def surfels_of(cloud: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Centers and radii of the surfels at the cloud's points, and of those in holes."""
    surface = estimate_surface(np.float32(cloud))
    surfels, radii = make_surfels(surface, max(float(np.median(surface.spacing)), 1e-3))
    count = len(surface.points)
    for values in (surfels.points, surfels.spacing, surfels.normals, surfels.neighbor_spacing, surfels.neighbors):
        assert len(values) == len(radii)
    np.testing.assert_allclose(np.linalg.norm(surfels.normals, axis=1), 1, atol=1e-4)
    assert (surfels.neighbors < count).all()  # surfels in holes are nobody's neighbors
    return surfels.points[:count], radii[:count], surfels.points[count:], radii[count:]


def random_sheet(rng: np.random.Generator, bent: float = 0.0) -> np.ndarray:
    """Random points of a square from -0.5 to 0.5, arched along X to the height `bent`."""
    places = rng.uniform(-0.5, 0.5, (int(1 / SPACING**2), 2))
    return np.column_stack([places, bent * np.cos(np.pi * places[:, 0])])


def covered(places: np.ndarray, points: np.ndarray, radii: np.ndarray) -> float:
    """Share of the positions (M, 2) that lie within discs."""
    share: float = (np.linalg.norm(places[:, None] - points[:, :2], axis=2) < radii).any(1).mean()
    return share


def without(cloud: np.ndarray, radius: float) -> np.ndarray:
    return cloud[np.hypot(cloud[:, 0], cloud[:, 1]) > radius]


@pytest.mark.parametrize("bent", [0.0, 0.2])
def test_most_small_holes_are_closed_in_the_surface(bent):
    """A hole whose rim is thin on one side stays open, since the gap between two objects looks like that."""
    closed = 0
    for seed in range(12):
        rng = np.random.default_rng(seed)
        points, radii, centers, wide = surfels_of(without(random_sheet(rng, bent), HOLE))
        in_hole = np.hypot(centers[:, 0], centers[:, 1]) < HOLE
        closed += in_hole.any()
        if not in_hole.any():
            continue
        assert np.abs(centers[in_hole, 2] - bent).max() < 0.6 * SPACING
        turn, share = rng.uniform(0, 2 * np.pi, 500), np.sqrt(rng.random(500)) * HOLE
        places = np.column_stack([share * np.cos(turn), share * np.sin(turn)])
        assert covered(places, points, radii) < 0.97  # there was something to close
        assert covered(places, np.concatenate([points, centers]), np.concatenate([radii, wide])) > 0.97
    assert closed >= 8


@pytest.mark.parametrize("seed", range(3))
def test_large_holes_stay_open(seed):
    _, _, centers, radii = surfels_of(without(random_sheet(np.random.default_rng(seed)), 6 * SPACING))
    assert (np.hypot(centers[:, 0], centers[:, 1]) - radii > 3.5 * SPACING).all()


@pytest.mark.parametrize("seed", range(3))
def test_no_surfel_is_added_beyond_a_border(seed):
    _, _, centers, _ = surfels_of(random_sheet(np.random.default_rng(seed)))
    assert (np.abs(centers[:, :2]) < 0.5).all()


def test_the_gap_between_two_slats_stays_open():
    """It is as wide as a hole that is closed, but open at both ends."""
    within = 0
    for seed in range(12):
        sheet = random_sheet(np.random.default_rng(seed))
        _, _, centers, _ = surfels_of(sheet[np.abs(sheet[:, 0]) > HOLE])
        within += (np.abs(centers[:, 0]) < HOLE).sum()
    assert within <= 6  # by chance, over 600 spacings


def test_an_even_cloud_has_no_holes():
    x, y = np.mgrid[:50, :50].reshape(2, -1) * SPACING
    _, _, centers, _ = surfels_of(np.column_stack([x, y, 0 * x]))
    assert not len(centers)


@pytest.mark.parametrize("count", [1, 2, 5, 20])
def test_smallest_clouds_have_a_surfel_for_each_point(count):
    points, radii, _, _ = surfels_of(np.random.default_rng(0).random((count, 3)))
    assert len(points) == count and (radii > 0).all() and np.isfinite(radii).all()


@pytest.mark.parametrize("seed", range(4))
def test_duplicate_points_give_finite_surfels(seed):
    """The spacing of duplicate points is 0."""
    rng = np.random.default_rng(seed)
    cloud = np.round(rng.normal(size=(2_000, 3)) * 3) / 8
    with np.errstate(all="raise"):
        _, radii, centers, wide = surfels_of(cloud)
    assert np.isfinite(radii).all() and np.isfinite(centers).all() and np.isfinite(wide).all()
