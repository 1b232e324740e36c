"""Samplers: exact count, on the surface, decided by the seed alone, and each as even as it says."""

from __future__ import annotations

import numpy as np
import pytest

from z2p_core import registry

SAMPLERS = ("uniform", "grid", "farthest", "poisson_disk")


def box(size: tuple[float, float, float] = (1.0, 2.0, 0.5)) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and triangles of an axis-aligned box from the origin."""
    vertices = np.array([(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=np.float64) * size
    quads = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
    faces = [corner for a, b, c, d in quads for corner in ((a, b, c), (a, c, d))]
    return vertices, np.array(faces)


def draw(name: str, count: int, seed: int = 0, mesh: tuple[np.ndarray, np.ndarray] | None = None) -> np.ndarray:
    vertices, faces = mesh or box()
    points: np.ndarray = registry.load("samplers", name)().sample(vertices, faces, count, np.random.default_rng(seed))
    return points


def gaps(points: np.ndarray) -> np.ndarray:
    """Distance from each point to its nearest neighbour."""
    distance = np.linalg.norm(points[:, None] - points[None], axis=2)
    np.fill_diagonal(distance, np.inf)
    return distance.min(axis=1)


@pytest.mark.parametrize("name", SAMPLERS)
@pytest.mark.parametrize("count", [1, 7, 500])
def test_exact_count_on_the_surface(name: str, count: int) -> None:
    points = draw(name, count)
    assert points.shape == (count, 3)
    assert points.dtype == np.float64
    off = np.minimum(np.abs(points), np.abs(points - (1.0, 2.0, 0.5))).min(axis=1)
    assert off.max() < 1e-12  # on one of the six planes ...
    assert (points > -1e-12).all() and (points < np.array([1.0, 2.0, 0.5]) + 1e-12).all()  # ... and within the box
    assert len(np.unique(points, axis=0)) == count


@pytest.mark.parametrize("name", SAMPLERS)
def test_same_seed_same_bytes(name: str) -> None:
    assert draw(name, 300, seed=5).tobytes() == draw(name, 300, seed=5).tobytes()
    assert draw(name, 300, seed=5).tobytes() != draw(name, 300, seed=6).tobytes()


@pytest.mark.parametrize("name", SAMPLERS)
def test_points_go_by_area_not_by_triangle(name: str) -> None:
    """A strip of which the left tenth is cut into many triangles gets a tenth of the points there."""
    steps = np.concatenate([np.linspace(0, 1, 200), [10.0]])
    vertices = np.array([(x, y, 0.0) for x in steps for y in (0.0, 1.0)])
    first = 2 * np.arange(200)[:, None]
    faces = np.vstack([first + np.array([0, 2, 1]), first + np.array([1, 2, 3])])
    points = draw(name, 1000, mesh=(vertices, faces))
    assert 0.07 < (points[:, 0] < 1).mean() < 0.13


@pytest.mark.parametrize("name", ["grid", "farthest", "poisson_disk"])
def test_even_samplers_leave_wider_gaps_than_uniform(name: str) -> None:
    uniform, even = gaps(draw("uniform", 600)), gaps(draw(name, 600))
    assert np.percentile(even, 5) > 2 * np.percentile(uniform, 5)


def test_grid_puts_one_point_in_a_voxel() -> None:
    """On a flat square that is aligned with the voxels, the points form rows."""
    square = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], dtype=float)
    points = draw("grid", 400, mesh=(square, np.array([(0, 1, 2), (0, 2, 3)])))
    rows = np.floor(points[:, 0] * 20)
    counts = np.bincount(rows.astype(int), minlength=20)
    assert np.abs(counts - 20).max() <= 8  # uniform sampling of 400 points spreads to about +-13
    assert gaps(points).min() > 0.2 / 20


@pytest.mark.parametrize("name", SAMPLERS)
def test_triangles_without_area_get_no_points(name: str) -> None:
    vertices, faces = box()
    far = np.array([(50.0, 0, 0), (60.0, 0, 0), (70.0, 0, 0)])  # in one line
    mesh = np.vstack([far, vertices]), np.vstack([[(0, 1, 2), (0, 0, 0)], faces + 3, [(0, 1, 2)]])
    assert draw(name, 400, mesh=mesh).max() <= 2.0


@pytest.mark.parametrize("name", SAMPLERS)
@pytest.mark.parametrize("faces", [np.zeros((0, 3), dtype=int), np.array([(0, 1, 2), (1, 1, 1)])])
def test_no_area_at_all_is_a_clear_error(name: str, faces: np.ndarray) -> None:
    vertices = np.array([(0.0, 0, 0), (1.0, 1, 1), (2.0, 2, 2)])
    with pytest.raises(ValueError, match=r"finite area above 0.*repair the mesh"):
        draw(name, 10, mesh=(vertices, faces))


def test_uniform_mean_and_spread_are_the_triangles() -> None:
    """Centroid and second moment of a uniform triangle are known: catches a missing square root."""
    corners = np.array([(0.0, 0, 0), (1.0, 0, 0), (0.0, 1, 0)])
    points = draw("uniform", 40_000, mesh=(corners, np.array([(0, 1, 2)])))
    assert points.mean(axis=0) == pytest.approx([1 / 3, 1 / 3, 0], abs=0.01)
    assert points[:, 0].var() == pytest.approx(1 / 18, rel=0.03)


def test_an_unknown_sampler_names_the_installed_ones() -> None:
    with pytest.raises(registry.PluginError, match=r"unknown sampler 'unifrom'.*poisson_disk"):
        registry.load("samplers", "unifrom")
