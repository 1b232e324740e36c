"""Clouds sampled from meshes as scanners and samplers do: even, uneven, from one side, clean and noisy."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from z2p_core.placement.bounding_sphere import bounding_sphere
from z2p_renderer.storage.meshes import read_mesh

MIN_POINTS = 800
"""Points of a cloud at least, before some are dropped as a sensor would."""
MAX_POINTS = 7000
"""Points of a cloud at most."""
MAX_NOISE_TO_SPACING = 0.55
"""Standard deviation of the noise at most, in spacings of an even cloud on a sphere."""
CLEAN_SHARE = 0.3
"""Share of the clouds that have no noise."""

Shape = tuple[np.ndarray, np.ndarray]
"""Vertices in the unit sphere (V, 3) and faces (F, 3)."""


def read_shape(path: Path) -> Shape:
    """The shape of a mesh file."""
    mesh = read_mesh(path)
    return bounding_sphere(mesh.vertices).normalise(mesh.vertices), np.asarray(mesh.faces)


def sample_scan(shape: Shape, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points (N, 3) on the shape as a sampler or scanner has them, normals (N, 3) there, and the points with noise."""
    count = int(math.exp(rng.uniform(math.log(MIN_POINTS), math.log(MAX_POINTS))))
    view_dir = rng.normal(size=3)
    view_dir /= np.linalg.norm(view_dir)
    kind = rng.choice(["random", "random", "uneven", "even", "from one side"])
    if kind == "uneven":
        points, normals = sample_shape(shape, 6 * count, rng)
        dense = np.exp(rng.uniform(0.3, 2.0) * (points @ view_dir))
        kept = rng.choice(len(points), count, replace=False, p=dense / dense.sum())
    elif kind == "even":
        points, normals = sample_shape(shape, 12 * count, rng)
        cells = np.floor(points / (0.9 * math.sqrt(6 / count)) + rng.random(3)).astype(np.int64)
        kept = np.unique(cells, axis=0, return_index=True)[1]
    elif kind == "from one side":
        points, normals = sample_shape(shape, 60_000, rng)
        kept = visible_indices(points, view_dir, min(int(math.sqrt(2.2 * count)), 150), rng)
        kept = kept[rng.random(len(kept)) >= rng.choice([0.0, 0.1])]  # sensors miss some points
    else:
        points, normals = sample_shape(shape, count, rng)
        kept = np.arange(count)
    points, normals = points[kept], normals[kept]
    clean = rng.random() < CLEAN_SHARE
    noise = 0.0 if clean else scanner_noise(points, view_dir if kind == "from one side" else None, rng)
    return points, normals, (points + noise).astype(np.float32)


def scanner_noise(points: np.ndarray, view_dir: np.ndarray | None, rng: np.random.Generator) -> np.ndarray:
    """Noise (N, 3) of points (N, 3): isotropic; or, of a depth camera, mostly along its viewing direction (3,)."""
    spacing = math.sqrt(6 / len(points))
    size = MAX_NOISE_TO_SPACING * rng.random() ** 1.3 * spacing
    if view_dir is None or rng.random() < 0.3:
        noise = size * rng.normal(size=points.shape)
    else:
        depth = rng.normal(size=len(points))
        if rng.random() < 0.5:  # stereo matches patches of pixels, so errors of neighbors are correlated
            depth += rng.uniform(0.3, 1.0) * smooth_random_field(points, rng.uniform(0.7, 2.5) * spacing, rng)
        if rng.random() < 0.2:  # disparity is quantized
            step, depth_along_view = rng.uniform(0.2, 1.0) * spacing, points @ view_dir
            depth += (np.round(depth_along_view / step) * step - depth_along_view) / (1.4 * size)
        noise = 1.4 * size * depth[:, None] * view_dir
    if rng.random() < 0.25:
        noise *= np.abs(rng.normal(size=(len(points), 1)))  # heavy tails
    return noise


def smooth_random_field(points: np.ndarray, length: float, rng: np.random.Generator) -> np.ndarray:
    """A smooth random field (N,) at points (N, 3), of variance 1, with that correlation length."""
    waves, phases = rng.normal(size=(3, 64)) / length, rng.uniform(0, 2 * math.pi, 64)
    field: np.ndarray = math.sqrt(2 / 64) * np.cos(points @ waves + phases).sum(1)
    return field


def sample_shape(shape: Shape, count: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Random points (count, 3) on a shape, and normals (count, 3), which `z2p_core.meshes.triangle_sampling` lacks."""
    vertices, faces = shape
    corners = vertices[faces]
    crosses = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    double_areas = np.linalg.norm(crosses, axis=1)
    chosen = rng.choice(len(faces), count, p=double_areas / double_areas.sum())
    root, along = np.sqrt(rng.random((count, 1))), rng.random((count, 1))
    first, second, third = corners[chosen].transpose(1, 0, 2)
    points = (1 - root) * first + root * (1 - along) * second + root * along * third
    return points, crosses[chosen] / double_areas[chosen, None]


def visible_indices(points: np.ndarray, view_dir: np.ndarray, side: int, rng: np.random.Generator) -> np.ndarray:
    """Indices of the points that an orthographic depth camera of side x side pixels sees along `view_dir`."""
    right = np.cross(view_dir, rng.normal(size=3))
    right /= np.linalg.norm(right)
    axes = np.stack([right, np.cross(view_dir, right)], 1)
    pixels = np.floor((points @ axes + 1) / 2 * side).astype(np.int64) @ [side, 1]
    nearest = np.argsort(points @ view_dir)
    return nearest[np.unique(pixels[nearest], return_index=True)[1]]
