"""Grid sampling: one point for each voxel that the surface passes through, as from a voxelised scan."""

from __future__ import annotations

import numpy as np

from z2p_core.interfaces import Sampler
from z2p_core.meshes.triangle_sampling import sample_uniform

DENSITY = 16
"""Dense points for each point asked for: enough that nearly every voxel the surface crosses holds one."""
STEPS = 24
"""Halvings of the voxel size's range."""


class Grid(Sampler):
    """In each voxel the dense point nearest to its centre; the voxel size is the one that gives `count` points."""

    name = "grid"
    version = "1"

    def sample(self, vertices: np.ndarray, faces: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
        """Points (count, 3) float64; where no voxel size gives exactly `count`, the few too many go at random.

        Raises:
            ScanError: no triangle has an area above 0.
        """
        dense = sample_uniform(vertices, faces, count * DENSITY, rng)
        chosen = _nearest_to_centres(dense, _voxel_size(dense, count))
        if len(chosen) > count:
            chosen = np.sort(rng.choice(chosen, count, replace=False))
        elif len(chosen) < count:  # coordinates so coarse that dense points coincide
            rest = np.setdiff1d(np.arange(len(dense)), chosen)
            chosen = np.concatenate([chosen, rng.choice(rest, count - len(chosen), replace=False)])
        return dense[chosen]


def _voxel_size(dense: np.ndarray, count: int) -> float:
    """Largest side found, in the points' unit, at which at least `count` voxels are occupied."""
    high = 2 * float(np.ptp(dense, axis=0).max())  # one voxel holds all
    low = high / 2**20
    for _ in range(STEPS):
        middle = float(np.sqrt(low * high))
        occupied = len(np.unique(_voxels(dense, middle)))
        if occupied == count:
            return middle
        low, high = (middle, high) if occupied > count else (low, middle)
    return low


def _voxels(dense: np.ndarray, size: float) -> np.ndarray:
    """Number (N,) int64 of each point's voxel."""
    places = ((dense - dense.min(axis=0)) / size).astype(np.int64)
    return np.ravel_multi_index(tuple(places.T), tuple(places.max(axis=0) + 1))


def _nearest_to_centres(dense: np.ndarray, size: float) -> np.ndarray:
    """Indices of one point a voxel, the nearest to the voxel's centre."""
    offset = (dense - dense.min(axis=0)) / size
    distance = ((offset - np.floor(offset) - 0.5) ** 2).sum(axis=1)
    voxels = _voxels(dense, size)
    order = np.lexsort((distance, voxels))
    first = np.ones(len(order), dtype=bool)
    first[1:] = voxels[order][1:] != voxels[order][:-1]
    return order[first]
