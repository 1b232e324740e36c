"""Features of a cloud's shape for each of its six axes, from which the axis that points up is predicted.

Objects stand on a flat side or on feet, are heavier below, and are symmetrical about upright planes; floors are level
and walls upright. Each such property is one number per axis (`axis_features`); the network in `feature_weights` scores
an axis by them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from z2p_core import native
from z2p_core.surface.subsampling import subsample_uniform
from z2p_core.up_axis.support_polygon import convex_hull, distance_inside, polygon_area

MAX_POINTS = 1500
"""Number of points to which a larger cloud is subsampled."""
MAX_MIRRORED_POINTS = 300
"""Number of points with which symmetries are tested, at most twice as many."""
NORMAL_NEIGHBORS = 12
"""Neighbors of a point, itself included, to which the plane of its normal is fitted."""
OUTLIER_SHARE = 0.003
"""Share of the points at either end of an axis that are ignored as outliers."""
GRID_CELLS = 20
"""Cells along each side of the grid in which mirrored points are looked up."""
MAX_DISTANCE_CELLS = 3
"""Distances to the nearest occupied cell are capped at this many cells."""
UPRIGHT_MIRRORS = 16
"""Number of planes through each axis in which a cloud is mirrored."""
MIN_EXTENT = 1e-300
"""Smallest extent of a cloud by which its coordinates can be divided without overflow."""
FLOOR_CELLS = 16
"""Largest number of cells along each side of the ground plan."""
FEATURE_NAMES = (
    "low mass", "low middle", "flat below", "level below", "held below", "feet's hull", "feet's share", "narrow feet",
    "taper", "cut below", "upright mirror", "level mirror", "turned alike", "level faces", "upright faces", "height",
    "height squared", "one layer", "level slab", "margin", "level above",
)  # fmt: skip
"""Names of the features, in the order of `axis_features`."""


def axis_features(points: np.ndarray) -> np.ndarray:
    """Features (6, F) float64 of the axes +X, -X, +Y, -Y, +Z, -Z, of finite points (N, 3).

    Most are in [0, 1], all in [-2, 4]. They do not depend on the cloud's size or position, nor on the order of points.
    """
    points = subsample_uniform(points, MAX_POINTS)
    low, high = np.quantile(points, [OUTLIER_SHARE, 1 - OUTLIER_SHARE], axis=0)
    size = max(float((high - low).max()), MIN_EXTENT)
    grid = native.NeighborGrid(np.clip((points - (low + high) / 2) / size, -0.55, 0.55).astype(np.float32))
    points, span = grid.points.astype(np.float64), np.maximum((high - low) / size, 1e-6)
    normals = np.abs(_normals(grid))
    alike = _symmetries(points)
    rows = []
    for axis in range(3):
        others = [(axis + 1) % 3, (axis + 2) % 3]
        plan, facing = GroundPlan.of(points[:, others]), normals[:, axis]
        height = math.log(span[axis] / math.sqrt(span[others[0]] * span[others[1]]))
        both_ends = {
            "upright mirror": alike[axis, 0], "level mirror": alike[axis, 1], "turned alike": alike[axis, 2],
            "level faces": (facing > 0.95).mean(), "upright faces": (facing < 0.15).mean(),
            "height": max(-2.0, min(2.0, height)), "height squared": min(height**2, 4.0),
            "one layer": plan.one_layer(points[:, axis]),
        }  # fmt: skip
        for sign in (1.0, -1.0):
            share = np.clip(0.5 + sign * points[:, axis] / span[axis], -0.05, 1.05)
            one_end = _end_features(plan, share, facing)
            rows.append([{**both_ends, **one_end}[name] for name in FEATURE_NAMES])
    return np.array(rows)


@dataclass(frozen=True)
class GroundPlan:
    """A cloud projected along an axis: its ground plan."""

    places: np.ndarray
    """Positions (N, 2) of the points, in the cloud's size."""
    middle: np.ndarray
    """Mean (2,) of the positions."""
    area: float
    """Area of their convex hull."""
    cell: np.ndarray
    """Index (N,) of each point's cell in a coarse grid."""
    taken: int
    """Number of occupied cells."""

    @classmethod
    def of(cls, places: np.ndarray) -> GroundPlan:
        """The plan of positions (N, 2)."""
        cells = max(4, min(FLOOR_CELLS, int(math.sqrt(len(places) / 4))))
        column, row = np.clip((places.T + 0.55) / 1.1 * cells, 0, cells - 1).astype(np.int64)
        cell = column * cells + row
        taken = int(np.count_nonzero(np.bincount(cell)))
        return cls(places, places.mean(0), max(polygon_area(convex_hull(places)), 1e-9), cell, taken)

    def covered(self, which: np.ndarray) -> float:
        """Share of the occupied cells that hold some of the points `which`, a mask (N,) bool."""
        return float(np.count_nonzero(np.bincount(self.cell[which]))) / self.taken

    def one_layer(self, height: np.ndarray) -> float:
        """Share of the cells of several points in which all have about one height, as in terrain seen from the air."""
        order = np.argsort(self.cell, kind="stable")
        starts = np.flatnonzero(np.diff(self.cell[order], prepend=-1))
        height = height[order]
        spread = np.maximum.reduceat(height, starts) - np.minimum.reduceat(height, starts)
        many = np.diff(np.append(starts, len(height))) > 1
        return float((spread[many] < 0.12).mean()) if many.any() else 0.0


def _normals(grid: native.NeighborGrid) -> np.ndarray:
    """Unit normals (N, 3), with either sign, of the planes through the neighbors of each of the grid's points."""
    all_indices = np.arange(len(grid.points), dtype=np.int32)
    neighbors, _ = grid.neighbors(all_indices, min(NORMAL_NEIGHBORS, len(all_indices)))
    return np.nan_to_num(native.fit_planes(grid.points, neighbors)[0])


def _end_features(plan: GroundPlan, share: np.ndarray, facing: np.ndarray) -> dict[str, float]:
    """The features that depend on which end of the axis is below, with the given end below.

    `share` (N,) is the height above that end, 0 to 1, and `facing` (N,) the normal's part along the axis, 0 to 1.
    """
    feet = convex_hull(plan.places[share < 0.04])
    held = distance_inside(plan.middle, feet) / math.sqrt(plan.area) if len(feet) > 2 else -0.3
    covered = plan.covered(share < 0.08)
    wide = polygon_area(convex_hull(plan.places[share < 0.12])) / plan.area
    below, above = (_breadth(plan.places[(share >= at) & (share < at + 1 / 3)]) for at in (0.0, 2 / 3))
    lowest, count = share[share < 0.5], len(share)
    slabs = np.bincount(np.clip((lowest * 20).astype(np.int64), 0, 9))
    level = facing > 0.9
    return {
        "low mass": 0.5 - float(share.sum()) / count,
        "low middle": 0.5 - float(np.median(share)),
        "flat below": (np.count_nonzero(share < 0.02) / count) ** 0.5,
        "level below": (np.count_nonzero((share < 0.05) & level) / count) ** 0.5,
        "level above": (np.count_nonzero((share > 0.9) & level) / count) ** 0.5,
        "held below": 1.0 if held > 0.03 else 0.0,
        "margin": max(-0.3, min(0.3, held)),
        "feet's hull": polygon_area(feet) / plan.area,
        "feet's share": covered,
        "narrow feet": max(0.0, wide - 2.0 * covered),
        "taper": max(-1.5, min(1.5, math.log((below + 0.02) / (above + 0.02)))),
        "cut below": np.count_nonzero(share < 0.01) / max(np.count_nonzero(share < 0.06), 1),
        "level slab": float(slabs.max()) / len(lowest) if len(lowest) else 0.0,
    }


def _breadth(places: np.ndarray) -> float:
    """Standard deviation of positions (N, 2); 0 for fewer than five."""
    return math.sqrt(float(places[:, 0].var() + places[:, 1].var())) if len(places) > 4 else 0.0


def _symmetries(points: np.ndarray) -> np.ndarray:
    """Symmetries (3, 3) in [0, 1] of each axis: about its best upright plane, about its level one, and of rotations.

    1 is exact, 0 none. The planes go through the mean of the occupied cells, so that density has no influence.
    """
    taken = np.zeros((GRID_CELLS, GRID_CELLS, GRID_CELLS), dtype=bool)
    taken.ravel()[_cell(*points.T)] = True
    away = _distances(taken)
    centre = (np.argwhere(taken).mean(0) + 0.5) / GRID_CELLS * 1.2 - 0.6
    some = points[:: max(1, len(points) // MAX_MIRRORED_POINTS)] - centre
    x, y, z = (sum(np.multiply.outer(row[:, part], some[:, part]) for part in range(3)) + centre[at]
               for at, row in enumerate(SYMMETRY_MATRICES.transpose(1, 0, 2)))  # fmt: skip
    alike = 1.0 - away[_cell(x, y, z)].mean(1).reshape(3, -1) / MAX_DISTANCE_CELLS
    upright, level, turned = np.split(alike, [UPRIGHT_MIRRORS, UPRIGHT_MIRRORS + 1], axis=1)
    return np.stack([upright.max(1), level[:, 0], turned.mean(1)], axis=1)


def _cell(x: np.ndarray, y: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Index of the cell of each position (x, y, z), in a grid of `GRID_CELLS` along each axis."""
    scale, last = GRID_CELLS / 1.2, GRID_CELLS - 1
    column, row, layer = (np.clip((part + 0.6) * scale, 0, last).astype(np.int64) for part in (x, y, z))
    return (column * GRID_CELLS + row) * GRID_CELLS + layer


def _distances(taken: np.ndarray) -> np.ndarray:
    """Distance of each cell to the nearest occupied one, in cells, at most `MAX_DISTANCE_CELLS`; flat.

    `taken` is the mask of occupied cells, with `GRID_CELLS` along each axis.
    """
    away = np.full(taken.shape, float(MAX_DISTANCE_CELLS))
    for step in range(MAX_DISTANCE_CELLS):
        away[taken & (away > step)] = step
        for axis in range(3):
            grown = np.moveaxis(taken.copy(), axis, 0)
            source = np.moveaxis(taken, axis, 0)
            grown[1:] |= source[:-1]
            grown[:-1] |= source[1:]
            taken = np.moveaxis(grown, 0, axis)
    return away.ravel()


def _symmetry_matrices() -> np.ndarray:
    """Matrices (60, 3, 3): for each axis reflections in its upright planes and its level one, and three rotations."""
    turns = np.arange(UPRIGHT_MIRRORS) * (math.pi / UPRIGHT_MIRRORS)
    matrices = []
    for axis in range(3):
        along, first, second = np.roll(np.eye(3), -axis, axis=0)
        planes = [math.cos(turn) * first + math.sin(turn) * second for turn in turns]
        matrices += [np.eye(3) - 2 * np.outer(normal, normal) for normal in [*planes, along]]
        for part in (4, 8, 3):
            cos, sin = math.cos(2 * math.pi / part), math.sin(2 * math.pi / part)
            cross = np.outer(second, first) - np.outer(first, second)
            matrices.append(np.outer(along, along) * (1 - cos) + cos * np.eye(3) + sin * cross)
    return np.array(matrices)


SYMMETRY_MATRICES = _symmetry_matrices()
"""Reflections and rotations of all three axes, with which symmetries are tested."""
