"""Data augmentation: a fresh cloud for each render (random or even, with holes and noise), and mirrored scenes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from z2p_core.config import TrainConfig
from z2p_core.meshes.synthetic_noise import add_noise
from z2p_core.rotations import random_rotation
from z2p_renderer.storage.shards import Record

CANDIDATES_PER_POINT = 8
"""Candidates from the pool per point of an even cloud; of those in a cell the one nearest to its centre is taken."""
MAX_HOLES = 8
"""Largest number of holes in one cloud."""
HOLE_POINTS = (3, 8)
"""Fewest and most points that a hole removes: it is two to three spacings wide. A wider gap looks like an
opening of the object, so the network must leave it open."""
CELL_SIZE_STEPS = 2
"""Corrections of the cell size; on a surface the number of occupied cells falls with the square of the size."""


def draw_training_cloud(pool: np.ndarray, config: TrainConfig, rng: np.random.Generator) -> np.ndarray:
    """Training cloud (N, 3) float32: distinct points of the pool (P, 3), with noise of random amplitude.

    N is log-uniform over `config.points`. A share `config.even` of the clouds is evenly spaced (N is then approximate),
    and a share `config.holes` has holes.
    """
    low, high = (min(count, len(pool)) for count in config.points)
    count = min(round(float(np.exp(rng.uniform(np.log(low), np.log(high))))), len(pool))
    if config.even and rng.uniform() < config.even:
        cloud = sample_evenly(pool, count, rng)
    else:
        cloud = pool[rng.choice(len(pool), count, replace=False, shuffle=False)]
    if config.holes and rng.uniform() < config.holes:
        cloud = remove_patches(cloud, rng)
    amplitude = float(rng.uniform(0.0, config.noise_scale))
    return add_noise(cloud, config.noise, amplitude, rng)


def remove_patches(cloud: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """The cloud (N, 3) without the nearest neighbours of 1 to `MAX_HOLES` of its points, like a scan's dropouts."""
    for _ in range(int(rng.integers(1, MAX_HOLES + 1))):
        removed = min(round(float(np.exp(rng.uniform(*np.log(HOLE_POINTS))))), len(cloud) // 20)
        squared_distance = ((cloud - cloud[rng.integers(len(cloud))]) ** 2).sum(axis=1)
        cloud = cloud[np.sort(np.argpartition(squared_distance, removed)[removed:])]
    return cloud


def sample_evenly(pool: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
    """About `count` evenly spaced points (N, 3) of the pool: one in each cell of a randomly rotated grid."""
    pool = pool[rng.choice(len(pool), min(CANDIDATES_PER_POINT * count, len(pool)), replace=False, shuffle=False)]
    rotated = pool @ random_rotation(rng).astype(pool.dtype)
    rotated = rotated - rotated.min(axis=0)
    cell = float(np.ptp(rotated, axis=0).max()) / max(np.sqrt(count / 2), 1)
    for _ in range(CELL_SIZE_STEPS):
        cell *= float(np.sqrt(len(np.unique(_cell_indices(rotated, cell))) / count))
    offset = ((rotated / cell % 1 - 0.5) ** 2).sum(axis=1)
    order = np.argsort(offset)
    _, first = np.unique(_cell_indices(rotated, cell)[order], return_index=True)
    even: np.ndarray = pool[order[first]]
    return even


def mirror_record(record: Record) -> Record:
    """The record mirrored left to right: images, light and settings. The caller mirrors its points (x to -x)."""
    radius, azimuth, elevation = record.scene.light
    return Record(
        rgba=record.rgba[:, ::-1],
        coverage=record.coverage[:, ::-1],
        settings=record.mirrored_settings,
        mirrored_settings=record.settings,
        scene=replace(record.scene, light=(radius, -azimuth, elevation)),
        texture=record.texture,
    )


def _cell_indices(points: np.ndarray, side: float) -> np.ndarray:
    """Flat cell index (N,) int64 of each point (N, 3) with coordinates of 0 or more, in a grid of cells of `side`."""
    cells = (points / side).astype(np.int64)
    indices: np.ndarray = np.ravel_multi_index(tuple(cells.T), tuple(cells.max(axis=0) + 1))
    return indices
