"""Clouds of the report that no sampler draws: where they lie, how dense they are, what a depth camera cannot see."""

from __future__ import annotations

import numpy as np
import pytest

from z2p_core.camera import turn
from z2p_renderer.pipeline.evaluation.paper.cases.synthetic_scans import (
    SENSOR_AZIMUTH,
    inner_points,
    non_uniform,
    single_view,
)
from z2p_renderer.pipeline.evaluation.paper.cases.synthetic_shapes import harmonic_ball, tilted_sheet
from z2p_renderer.storage.meshes import Mesh

BALL = Mesh(*(lambda mesh: (mesh.vertices, mesh.faces))(harmonic_ball(0)), smooth=True)
RADIUS = float(np.linalg.norm(BALL.vertices, axis=1).mean())


def rng() -> np.random.Generator:
    return np.random.default_rng(1)


def test_non_uniform_cloud_is_denser_on_one_side() -> None:
    points = non_uniform(BALL, 3000, rng())
    assert points.shape == (3000, 3)
    assert np.linalg.norm(points, axis=1) == pytest.approx(RADIUS, rel=0.01)
    ends = (points[:, 0] > 0.8 * RADIUS).sum(), (points[:, 0] < -0.8 * RADIUS).sum()
    assert 4 < ends[0] / ends[1] < 12


def test_inner_points_are_inside_and_not_near_the_surface_alone() -> None:
    points = inner_points(BALL, 500, rng())
    reach = np.linalg.norm(points, axis=1) / RADIUS
    assert points.shape == (500, 3) and reach.max() <= 1.01
    assert (reach**3).mean() == pytest.approx(0.5, abs=0.06)  # even in the volume
    assert len(inner_points(BALL, 0, rng())) == 0
    assert inner_points(tilted_sheet(0.0), 200, rng()).shape == (200, 3)  # encloses nothing, and still gives points


@pytest.mark.parametrize("azimuth", [0.0, 70.0])
def test_a_depth_camera_sees_the_side_that_faces_it(azimuth: float) -> None:
    rotation = turn(azimuth)
    points = single_view(BALL, rotation, 20.0, "clean", 1500, rng())
    assert len(points) == 1500 and np.linalg.norm(points, axis=1) == pytest.approx(RADIUS, abs=0.003)
    angle = np.radians(20.0)
    towards = turn(SENSOR_AZIMUTH) @ np.array([0.0, -np.cos(angle), np.sin(angle)])
    facing = (points @ rotation.T) @ towards / RADIUS
    assert facing.min() > RADIUS / 3.6 - 0.02 and facing.max() > 0.98


def test_noise_moves_points_and_holes_leave_patches_empty() -> None:
    kinds = ("clean", "noise", "holes")
    clean, noisy, torn = (single_view(BALL, np.eye(3), 20.0, kind, 10**6, rng()) for kind in kinds)
    assert 0.001 < np.abs(np.linalg.norm(noisy, axis=1) - RADIUS).mean() < 0.01
    assert len(torn) < 0.9 * len(clean)
    with pytest.raises(ValueError, match="expected clean, noise or holes, got 'dirty'"):
        single_view(BALL, np.eye(3), 20.0, "dirty", 10, rng())


def test_the_same_generator_gives_the_same_bytes() -> None:
    for draw in (lambda: non_uniform(BALL, 300, rng()), lambda: inner_points(BALL, 100, rng()),
                 lambda: single_view(BALL, np.eye(3), 20.0, "holes", 400, rng())):  # fmt: skip
        assert draw().tobytes() == draw().tobytes()
