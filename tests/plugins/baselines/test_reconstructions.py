"""Baselines: each makes a mesh of a sphere's points, the same one every time, and says what it cannot use."""

from __future__ import annotations

import numpy as np
import pytest

from z2p_core import registry
from z2p_core.interfaces import ScanError

BUILT_IN = ("balls", "bpa", "hpr", "poisson", "splats")


def sphere(count: int = 600) -> np.ndarray:
    points = np.random.default_rng(3).normal(size=(count, 3))
    return points / np.linalg.norm(points, axis=1, keepdims=True)


def rebuild(name: str, cloud: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    vertices, faces = registry.load("baselines", name)().reconstruct(cloud, np.random.default_rng(0))
    return vertices, faces


def volume(vertices: np.ndarray, faces: np.ndarray) -> float:
    """Of a mesh that is wound one way; its sign tells which."""
    a, b, c = (vertices[faces[:, corner]] for corner in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)


@pytest.mark.slow
@pytest.mark.parametrize("name", BUILT_IN)
def test_a_mesh_lies_on_the_sphere_and_is_the_same_every_time(name: str) -> None:
    vertices, faces = rebuild(name, sphere())
    assert vertices.dtype == np.float64 and np.issubdtype(faces.dtype, np.integer)
    off = 0.1 if name == "splats" else 0.03  # a disc's rim stands off a curved surface
    assert np.abs(np.linalg.norm(vertices, axis=1) - 1).max() < off
    assert faces.min() == 0 and faces.max() == len(vertices) - 1
    again = rebuild(name, sphere())
    assert again[0].tobytes() == vertices.tobytes() and again[1].tobytes() == faces.tobytes()
    narrow = rebuild(name, sphere().astype(np.float32))
    assert len(narrow[1]) == pytest.approx(len(faces), rel=0.05)


@pytest.mark.parametrize("name", ["bpa", "poisson"])
def test_reconstructions_close_the_sphere(name: str) -> None:
    """Up to the trimmed vertices and a pinhole or two; a hole or a fold would cost volume."""
    assert abs(volume(*rebuild(name, sphere()))) == pytest.approx(4 / 3 * np.pi, rel=0.06)


def test_balls_are_centred_at_their_points() -> None:
    cloud = sphere(5)
    vertices, faces = rebuild("balls", cloud)
    each = vertices.reshape(5, -1, 3)
    assert each.mean(axis=1) == pytest.approx(cloud, abs=1e-9)
    assert np.linalg.norm(each - cloud[:, None], axis=2) == pytest.approx(0.014)
    assert volume(vertices, faces) == pytest.approx(5 * 4 / 3 * np.pi * 0.014**3, rel=0.15)
    assert (faces.reshape(5, -1) // each.shape[1] == np.arange(5)[:, None]).all()  # no triangle joins two balls


def test_splats_lie_flat_on_the_sphere_and_leave_few_holes() -> None:
    cloud = sphere(2000)
    vertices, faces = rebuild("splats", cloud)
    corners = vertices.reshape(len(cloud), 8, 3)
    assert corners.mean(axis=1) == pytest.approx(cloud, abs=0.002)
    normals = np.cross(corners[:, 0] - corners[:, 4], corners[:, 2] - corners[:, 6])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    assert np.quantile(np.abs((normals * cloud).sum(1)), 0.05) > 0.97  # along the radius, whichever way round
    reach = np.linalg.norm(corners - cloud[:, None], axis=2).mean(axis=1)
    covered = (np.linalg.norm(sphere(400)[:, None] - cloud[None], axis=2) < reach).any(axis=1)
    assert covered.mean() > 0.99
    assert (faces.reshape(len(cloud), -1) // 8 == np.arange(len(cloud))[:, None]).all()


def test_visible_triangles_are_the_near_side_alone() -> None:
    baseline, viewer = registry.load("baselines", "hpr")(), np.array([0.0, 0.0, 3.6])
    vertices, faces = baseline.reconstruct_for(sphere(2000), viewer, np.random.default_rng(0))
    middles = vertices[faces].mean(axis=1)
    assert middles[:, 2].min() > -0.1 and len(middles) > 500
    edges = np.linalg.norm(vertices[faces] - np.roll(vertices[faces], 1, axis=1), axis=2)
    assert edges.max() < 0.4  # no triangle spans the outline
    area = np.linalg.norm(np.cross(*(vertices[faces[:, k]] - vertices[faces[:, 0]] for k in (1, 2))), axis=1).sum() / 2
    assert area == pytest.approx(2 * np.pi * (1 - 1 / 3.6), rel=0.2)  # the cap that is seen from there


def test_steps_are_timed_as_they_run() -> None:
    for name, steps in (("bpa", ["normals"]), ("poisson", ["normals"]), ("splats", ["planes"]), ("hpr", [])):
        baseline = registry.load("baselines", name)()
        baseline.reconstruct(sphere(), np.random.default_rng(0))
        assert list(baseline.seconds) == steps and all(taken > 0 for taken in baseline.seconds.values())


def test_splats_of_a_plane_are_not_coplanar() -> None:
    """Discs in one plane would hide the light from each other, by nothing but rounding."""
    flat = np.random.default_rng(1).uniform(-1, 1, (300, 3)) * (1, 1, 0)
    vertices, _ = rebuild("splats", flat)
    heights = vertices.reshape(300, 8, 3)[:, :, 2]
    assert np.ptp(heights, axis=1).max() < 1e-9 < np.diff(np.sort(heights[:, 0])).min()


@pytest.mark.parametrize(
    ("name", "cloud", "message"),
    [
        ("balls", sphere()[:0], "at least 1 point"),
        ("bpa", sphere()[:3], "more than 16 points, got 3"),
        ("poisson", sphere()[:3], "more than 16 points, got 3"),
        ("splats", sphere()[:3], "more than 12 points, got 3"),
        ("splats", np.zeros((50, 3)), "at one place"),
        ("hpr", sphere()[:3], "5 points or more, got 3"),
        ("bpa", np.zeros((50, 3)), "at one place"),
        ("bpa", np.repeat(sphere(50), 2, axis=0), "all come twice"),
        ("poisson", sphere() * (1, 1, 0), "cannot be oriented"),
    ],
)
def test_unusable_clouds_are_clear_errors(name: str, cloud: np.ndarray, message: str) -> None:
    with pytest.raises(ScanError, match=message):
        rebuild(name, cloud)
