"""Clouds as scanners and samplers draw them from meshes: evenly, unevenly, from one side, clean and noisy."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from z2p_core.placement.bounding_sphere import bounding_sphere
from z2p_renderer.storage.meshes import read_mesh

MIN_POINTS = 800
"""Fewest points of a cloud."""
MAX_POINTS = 7000
"""Most points of a cloud."""
MAX_NOISE_TO_SPACING = 0.55
"""Standard deviation of the noise at most, in spacings of an even cloud on a sphere."""
CLEAN_SHARE = 0.3
"""Share of the clouds that have no noise."""

Shape = tuple[np.ndarray, np.ndarray]
"""Vertices in the unit sphere (V, 3) and faces (F, 3)."""


def read_shape(path: Path) -> Shape:
    """That of a mesh."""
    mesh = read_mesh(path)
    return bounding_sphere(mesh.vertices).normalise(mesh.vertices), np.asarray(mesh.faces)


def sample_scan(shape: Shape, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points (N, 3) on the shape as a sampler or a scanner might draw them, its normals there, and the noisy points."""
    count = int(math.exp(rng.uniform(math.log(MIN_POINTS), math.log(MAX_POINTS))))
    towards = rng.normal(size=3)
    towards /= np.linalg.norm(towards)
    kind = rng.choice(["random", "random", "uneven", "even", "from one side"])
    if kind == "uneven":
        points, normals = sample_shape(shape, 6 * count, rng)
        dense = np.exp(rng.uniform(0.3, 2.0) * (points @ towards))
        kept = rng.choice(len(points), count, replace=False, p=dense / dense.sum())
    elif kind == "even":
        points, normals = sample_shape(shape, 12 * count, rng)
        cells = np.floor(points / (0.9 * math.sqrt(6 / count)) + rng.random(3)).astype(np.int64)
        kept = np.unique(cells, axis=0, return_index=True)[1]
    elif kind == "from one side":
        points, normals = sample_shape(shape, 60_000, rng)
        kept = visible_indices(points, towards, min(int(math.sqrt(2.2 * count)), 150), rng)
        kept = kept[rng.random(len(kept)) >= rng.choice([0.0, 0.1])]  # sensors miss some
    else:
        points, normals = sample_shape(shape, count, rng)
        kept = np.arange(count)
    points, normals = points[kept], normals[kept]
    clean = rng.random() < CLEAN_SHARE
    noise = 0.0 if clean else scanner_noise(points, towards if kind == "from one side" else None, rng)
    return points, normals, (points + noise).astype(np.float32)


def scanner_noise(points: np.ndarray, towards: np.ndarray | None, rng: np.random.Generator) -> np.ndarray:
    """Noise (N, 3) of points (N, 3): to every side; or, of a depth camera, mostly the way that it looks."""
    spacing = math.sqrt(6 / len(points))
    size = MAX_NOISE_TO_SPACING * rng.random() ** 1.3 * spacing
    if towards is None or rng.random() < 0.3:
        noise = size * rng.normal(size=points.shape)
    else:
        depth = rng.normal(size=len(points))
        if rng.random() < 0.5:  # stereo matches patches of pixels, so neighbours err together
            depth += rng.uniform(0.3, 1.0) * smooth_random_field(points, rng.uniform(0.7, 2.5) * spacing, rng)
        if rng.random() < 0.2:  # and knows whole steps of disparity alone
            step, straight = rng.uniform(0.2, 1.0) * spacing, points @ towards
            depth += (np.round(straight / step) * step - straight) / (1.4 * size)
        noise = 1.4 * size * depth[:, None] * towards
    if rng.random() < 0.25:
        noise *= np.abs(rng.normal(size=(len(points), 1)))  # with some far off
    return noise


def smooth_random_field(points: np.ndarray, length: float, rng: np.random.Generator) -> np.ndarray:
    """A smooth random field (N,) at points (N, 3), of variance 1, that is like itself over that length."""
    waves, phases = rng.normal(size=(3, 64)) / length, rng.uniform(0, 2 * math.pi, 64)
    field: np.ndarray = math.sqrt(2 / 64) * np.cos(points @ waves + phases).sum(1)
    return field


def sample_shape(shape: Shape, count: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Random points (count, 3) on a shape, and its normals there, which `z2p_core.meshes.triangle_sampling` lacks."""
    vertices, faces = shape
    corners = vertices[faces]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    sizes = np.linalg.norm(across, axis=1)
    chosen = rng.choice(len(faces), count, p=sizes / sizes.sum())
    root, along = np.sqrt(rng.random((count, 1))), rng.random((count, 1))
    first, second, third = corners[chosen].transpose(1, 0, 2)
    points = (1 - root) * first + root * (1 - along) * second + root * along * third
    return points, across[chosen] / sizes[chosen, None]


def visible_indices(points: np.ndarray, towards: np.ndarray, side: int, rng: np.random.Generator) -> np.ndarray:
    """Rows of the points that a depth camera of side x side pixels sees, which looks along `towards`."""
    right = np.cross(towards, rng.normal(size=3))
    right /= np.linalg.norm(right)
    axes = np.stack([right, np.cross(towards, right)], 1)
    pixels = np.floor((points @ axes + 1) / 2 * side).astype(np.int64) @ [side, 1]
    nearest = np.argsort(points @ towards)
    return nearest[np.unique(pixels[nearest], return_index=True)[1]]
