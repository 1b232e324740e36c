"""What makes more of the same renders: a fresh cloud for each, random or even, and the scene seen in a mirror."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from z2p_core.config import TrainConfig
from z2p_core.meshes.synthetic_noise import add_noise
from z2p_core.rotations import random_rotation
from z2p_renderer.storage.shards import Record

CANDIDATES_PER_POINT = 8
"""Points of the pool for each point of an even cloud, to take the one nearest to its cell's centre."""
MAX_HOLES, HOLE_POINTS = 8, (3, 8)
"""Holes of a cloud that has some, and points that each takes away: two to three spacings across. What is wider is a
hole of the thing itself for all that a cloud tells, and stays open."""
CELL_SIZE_STEPS = 2
"""Corrections of the cells' size: on a surface their number goes with its square."""


def draw_training_cloud(pool: np.ndarray, config: TrainConfig, rng: np.random.Generator) -> np.ndarray:
    """Points (N, 3) float32 of the pool, none twice, with noise of random amplitude; N is log-uniform over `points`.

    The share `even` of the clouds is spread evenly, and N is then what comes nearest; the share `holes` has some.
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
    """The points (N, 3) without the nearest ones to some of them, as where a scanner got no echo."""
    for _ in range(int(rng.integers(1, MAX_HOLES + 1))):
        lost = min(round(float(np.exp(rng.uniform(*np.log(HOLE_POINTS))))), len(cloud) // 20)
        away = ((cloud - cloud[rng.integers(len(cloud))]) ** 2).sum(axis=1)
        cloud = cloud[np.sort(np.argpartition(away, lost)[lost:])]
    return cloud


def sample_evenly(pool: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
    """About `count` points (N, 3) of the pool, one in each cell of a grid that is turned at random."""
    pool = pool[rng.choice(len(pool), min(CANDIDATES_PER_POINT * count, len(pool)), replace=False, shuffle=False)]
    turned = pool @ random_rotation(rng).astype(pool.dtype)
    turned = turned - turned.min(axis=0)
    cell = float(np.ptp(turned, axis=0).max()) / max(np.sqrt(count / 2), 1)
    for _ in range(CELL_SIZE_STEPS):
        cell *= float(np.sqrt(len(np.unique(_cell_indices(turned, cell))) / count))
    off_centre = ((turned / cell % 1 - 0.5) ** 2).sum(axis=1)
    order = np.argsort(off_centre)
    _, first = np.unique(_cell_indices(turned, cell)[order], return_index=True)
    even: np.ndarray = pool[order[first]]
    return even


def mirror_record(record: Record) -> Record:
    """The record with left and right exchanged: pictures, light and settings; its points are to follow (x to -x)."""
    radius, azimuth, elevation = record.scene.light
    return Record(
        rgba=record.rgba[:, ::-1],
        coverage=record.coverage[:, ::-1],
        settings=record.mirrored_settings,
        mirrored_settings=record.settings,
        scene=replace(record.scene, light=(radius, -azimuth, elevation)),
    )


def _cell_indices(points: np.ndarray, side: float) -> np.ndarray:
    """Number (N,) int64 of the cell of each point (N, 3), all of them from 0 up."""
    places = (points / side).astype(np.int64)
    numbers: np.ndarray = np.ravel_multi_index(tuple(places.T), tuple(places.max(axis=0) + 1))
    return numbers
