"""Synthetic shapes lie in the unit sphere, are closed where they should be, and have the documented dimensions."""

from __future__ import annotations

import numpy as np
import pytest

from z2p_renderer.pipeline.evaluation.paper.cases.synthetic_shapes import (
    BALL_RADIUS,
    BUMP_SLOPE,
    PLATE_SIZE,
    harmonic_ball,
    objects_on_floor,
    parallel_plates,
    tilted_sheet,
)
from z2p_renderer.storage.meshes import Mesh

SHAPES = {
    "ball": harmonic_ball(0),
    "bumps": harmonic_ball(16),
    "plates": parallel_plates(0.1),
    "solid": parallel_plates(0.1, solid=True),
    "open sheet": tilted_sheet(0.0),
    "sheet": tilted_sheet(0.05),
    "scene": objects_on_floor(4),
}


def open_edges(mesh: Mesh) -> int:
    edges = np.sort(np.concatenate([mesh.faces[:, [i, (i + 1) % 3]] for i in range(3)]), axis=1)
    return int((np.unique(edges, axis=0, return_counts=True)[1] != 2).sum())


@pytest.mark.parametrize("name", SHAPES)
def test_shape_lies_in_the_unit_sphere(name: str) -> None:
    mesh = SHAPES[name]
    assert np.isfinite(mesh.vertices).all() and np.linalg.norm(mesh.vertices, axis=1).max() <= 1 + 1e-6
    assert mesh.faces.min() == 0 and mesh.faces.max() == len(mesh.vertices) - 1


@pytest.mark.parametrize("name", ["ball", "bumps", "plates", "solid", "sheet"])
def test_shape_is_closed(name: str) -> None:
    assert open_edges(SHAPES[name]) == 0


def test_an_open_sheet_has_a_rim() -> None:
    assert open_edges(SHAPES["open sheet"]) == 4 * 60


@pytest.mark.parametrize("degree", [4, 16, 64])
def test_bump_height_falls_with_the_harmonic_degree(degree: int) -> None:
    mesh = harmonic_ball(degree)
    reach = np.linalg.norm(mesh.vertices, axis=1) * (1 + BUMP_SLOPE / 4) / BALL_RADIUS - 1
    assert reach.max() == pytest.approx(BUMP_SLOPE / degree, rel=0.05) == -reach.min()
    height = mesh.vertices[:, 2] / np.linalg.norm(mesh.vertices, axis=1)
    ring = np.abs(height) < 0.02  # near the equator the order gives the waves, where the degree is even there
    around = np.argsort(np.arctan2(mesh.vertices[ring, 1], mesh.vertices[ring, 0]))
    waves = np.abs(np.fft.rfft(reach[ring][around]))
    assert np.argmax(waves[1:]) + 1 in {degree // 2 * times for times in range(1, 8)}


def test_plates_have_their_distance_and_the_solid_has_no_gap() -> None:
    for distance in (0.4, 0.025):
        left, right = np.split(np.sort(np.unique(np.round(parallel_plates(distance).vertices[:, 0], 9))), 2)
        assert right.min() - left.max() == pytest.approx(distance)
        block = parallel_plates(distance, solid=True).vertices
        assert np.ptp(block[:, 0]) == pytest.approx(distance + 2 * PLATE_SIZE[0])


def test_a_scene_has_its_objects_on_one_floor() -> None:
    one, four = objects_on_floor(1), objects_on_floor(4)
    assert len(four.faces) > 2 * len(one.faces)
    assert np.ptp(four.vertices[:, 2]) < np.ptp(one.vertices[:, 2])  # each is smaller in the frame
