"""The smallest sphere around an object, in float64, which is scaled to the unit sphere of the world."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Sphere:
    """Bounding sphere in the object's own units; `normalise` maps it to the unit sphere."""

    centre: tuple[float, float, float]
    radius: float

    def normalise(self, points: np.ndarray) -> np.ndarray:
        """Points (N, 3) float32 in the unit sphere, from points (N, 3) in the object's units; float64 inside."""
        return ((points.astype(np.float64) - np.array(self.centre)) / self.radius).astype(np.float32)


def bounding_sphere(points: np.ndarray, tolerance: float = 1e-9) -> Sphere:
    """Smallest sphere around finite points (N, 3), N >= 1; radius 0 when they all coincide.

    Active set: the exact ball of a handful of points, to which the farthest outsider is added until none is left. Such
    a point is always on the next ball (Welzl, Smallest enclosing disks, balls and ellipsoids, 1991).
    """
    points = np.asarray(points, dtype=np.float64)
    origin = points[0]
    points = points - origin  # UTM coordinates: keep the digits for the shape
    scale = float(np.abs(points).max())
    if scale == 0.0:
        return Sphere(tuple(origin.tolist()), 0.0)
    points = points / scale
    support = points[[int(np.argmax(_distances(points, np.zeros(3))))]]
    centre, radius = support[0], 0.0
    for _ in range(200):
        distance = _distances(points, centre)
        farthest = int(np.argmax(distance))
        if distance[farthest] <= radius * (1 + tolerance) + 1e-12:
            break
        support, centre, radius = _ball_of_few(np.vstack([support, points[farthest]]))
    radius = float(_distances(points, centre).max())
    return Sphere(tuple((centre * scale + origin).tolist()), radius * scale)


def _distances(points: np.ndarray, centre: np.ndarray) -> np.ndarray:
    """Of points (N, 3) from a centre (3,): (N,). Three times as quick as a sum along so short a row."""
    offset = points - centre  # not by z2p_core.linalg: renders would have to be made again whenever that changes
    distances: np.ndarray = np.sqrt(np.einsum("na,na->n", offset, offset))
    return distances


def _ball_of_few(points: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Smallest ball of at most five points, the last of which is on it: (points on it, centre, radius).

    Tries every subset of two to four that holds the last.
    """
    from itertools import combinations

    best: tuple[np.ndarray, np.ndarray, float] | None = None
    last = len(points) - 1
    for size in (1, 2, 3):
        for chosen in combinations(range(last), size):
            subset = points[[*chosen, last]]
            centre = _circumcentre(subset)
            if centre is None:
                continue
            radius = float(np.linalg.norm(subset[0] - centre))
            reach = float(np.linalg.norm(points - centre, axis=1).max())
            if reach <= radius * (1 + 1e-10) + 1e-13 and (best is None or radius < best[2]):
                best = (subset, centre, radius)
    if best is None:  # numerically degenerate: fall back on the widest pair
        gaps = np.linalg.norm(points[:, None] - points[None], axis=2)
        i, j = np.unravel_index(int(gaps.argmax()), gaps.shape)
        best = (points[[i, j]], (points[i] + points[j]) / 2, float(gaps[i, j]) / 2)
    return best


def _circumcentre(points: np.ndarray) -> np.ndarray | None:
    """Centre of the smallest sphere through 2 to 4 points, or None when they are degenerate."""
    edges = points[1:] - points[0]
    gram = edges @ edges.T
    try:
        weights = np.linalg.solve(2 * gram, np.diag(gram))
    except np.linalg.LinAlgError:
        return None
    return points[0] + weights @ edges
