"""Noise of spheres, sheets and plates, whose standard deviation is known."""

import math

import numpy as np
import pytest
from point_shapes import sphere_of

from z2p_core import native
from z2p_core.surface.noise_level import (
    MAX_NEIGHBORS,
    MIN_NEIGHBORS,
    neighbor_count,
    noise_to_spacing,
    probe_indices,
    residual_noise,
)
from z2p_core.surface.normals import estimate_surface


def plate(count: int, thick: float, seed: int = 0) -> np.ndarray:
    """Both sides of a square plate, its thickness in spacings of either side."""
    rng = np.random.default_rng(seed)
    sides = np.where(rng.random(count) < 0.5, thick * math.sqrt(2 / count), 0.0)
    return np.column_stack([rng.random((count, 2)), sides]).astype(np.float32)


@pytest.mark.parametrize("scale", [0.0025, 0.005, 0.01, 0.02])
def test_noise_is_measured_on_a_sphere(scale):
    noise = np.random.default_rng(7).normal(0, scale, (6000, 3))
    cloud = (sphere_of(6000) + noise).astype(np.float32)
    assert estimate_surface(cloud).noise == pytest.approx(scale, rel=0.25)


def test_larger_noise_needs_more_neighbors():
    counts = [neighbor_count(noise) for noise in (0.0, 0.2, 0.4, 5.0)]
    assert counts[0] == MIN_NEIGHBORS and counts[-1] == MAX_NEIGHBORS and counts == sorted(set(counts))


@pytest.mark.parametrize("thick", [0.7, 1.0, 1.5])
def test_the_other_side_of_a_plate_does_not_count_as_noise(thick):
    cloud = plate(3000, thick)
    grid = native.NeighborGrid(cloud)
    query_indices = np.arange(0, 3000, 7, dtype=np.int32)
    neighbors, spacing = grid.neighbors(query_indices, MIN_NEIGHBORS)
    median_spacing = float(np.median(spacing))
    assert residual_noise(grid.points, neighbors) > 0.1 * median_spacing or thick == 1.5  # what planes alone measure
    assert noise_to_spacing(cloud) < 0.06


@pytest.mark.parametrize("sigma", [0.1, 0.25])
def test_noise_is_measured_on_a_sheet_and_on_a_plate(sigma):
    rng = np.random.default_rng(4)
    sheet = np.column_stack([rng.random((4000, 2)), sigma / math.sqrt(4000) * rng.normal(size=4000)])
    assert noise_to_spacing(sheet.astype(np.float32)) == pytest.approx(sigma, rel=0.25)
    noisy_plate = plate(4000, 3.0) + sigma / math.sqrt(2000) * rng.normal(size=(4000, 3)).astype(np.float32)
    assert noise_to_spacing(noisy_plate) == pytest.approx(sigma, rel=0.45)


@pytest.mark.parametrize("sigma", [0.1, 0.2])
@pytest.mark.parametrize("thick", [1.5, 1.8, 2.0])
def test_noise_of_a_plate_is_measured_where_planes_see_none(sigma, thick):
    """The other side is among the farther neighbors, which planes take for curvature."""
    rng = np.random.default_rng(4)
    cloud = plate(4000, thick) + sigma / math.sqrt(2000) * rng.normal(size=(4000, 3)).astype(np.float32)
    grid = native.NeighborGrid(cloud)
    neighbors, _ = grid.neighbors(probe_indices(4000), MIN_NEIGHBORS)
    assert residual_noise(grid.points, neighbors) == 0
    assert noise_to_spacing(cloud) == pytest.approx(sigma, rel=0.25)


def test_depth_steps_of_a_depth_camera_count_as_noise():
    """Pixels of a slanted wall, whose depths come in steps as large as their distance."""
    x, y = np.meshgrid(np.arange(60.0), np.arange(60.0))
    steps = np.round(0.37 * x + 0.21 * y)
    assert noise_to_spacing(np.column_stack([x.ravel(), y.ravel(), steps.ravel()]).astype(np.float32)) > 0.15


def test_a_thin_slab_holds_half_of_the_points():
    """Nine points within 0.02 of a tilted plane, seven far from it."""
    rng = np.random.default_rng(6)
    local = np.column_stack([rng.uniform(-1, 1, (16, 2)), rng.uniform(-0.02, 0.02, 16)])
    local[9:, 2] = rng.uniform(3, 4, 7)
    local[0] = 0
    rotation = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    points = (local @ rotation).astype(np.float32)
    neighbors = np.concatenate([[0], 1 + np.argsort((local[1:, :2] ** 2).sum(1))]).astype(np.int32)[None]
    widths, steep = native.fit_thin_slabs(points, np.zeros(1, np.int32), neighbors, 9)
    assert 0.005 < widths[0] < 0.06
    assert steep[0] == pytest.approx(7 / 16)
