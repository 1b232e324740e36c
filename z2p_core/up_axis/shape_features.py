"""What a cloud's shape says of each of its six axes: how likely it is that this one points up.

Things stand on something flat or on feet, are heavier below, and are symmetrical about upright planes; floors are level
and walls upright. Each such mark is one number for each axis (`axis_features`); `feature_weights` holds how
much each counts.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from z2p_core import native
from z2p_core.surface.subsampling import subsample_uniform
from z2p_core.up_axis.support_polygon import convex_hull, distance_inside, polygon_area

MAX_POINTS = 1500
"""Points that features are computed from at most."""
MAX_MIRRORED_POINTS = 300
"""Points that symmetries are tested with at most."""
NORMAL_NEIGHBORS = 12
OUTLIER_SHARE = 0.003
"""Share of the points beyond either end of an axis that may be strays."""
GRID_CELLS = 20
"""Cells along the widest side of the grid in which mirrored points are looked up."""
MAX_DISTANCE_CELLS = 3
"""Distances to the nearest taken cell are capped at this many cells."""
UPRIGHT_MIRRORS = 16
"""Upright planes of each axis in which a cloud is mirrored."""
MIN_EXTENT = 1e-300
"""Extent of a cloud whose places are still numbers when they are divided by it."""
FLOOR_CELLS = 16
"""Cells along each side of the ground plan, at most."""
FEATURE_NAMES = (
    "low mass", "low middle", "flat below", "level below", "held below", "feet's hull", "feet's share", "narrow feet",
    "taper", "cut below", "upright mirror", "level mirror", "turned alike", "level faces", "upright faces", "height",
    "height squared", "one layer", "level slab", "margin", "level above",
)  # fmt: skip
"""Names of the marks, as `axis_features` gives them."""


def axis_features(points: np.ndarray) -> np.ndarray:
    """The marks (6, M) of the axes +X, -X, +Y, -Y, +Z, -Z of finite points (N, 3), whatever their order.

    Each is about 0 to 1, and independent of the cloud's size and place.
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
        plan, facing = Plan.of(points[:, others]), normals[:, axis]
        height = math.log(span[axis] / math.sqrt(span[others[0]] * span[others[1]]))
        even = {
            "upright mirror": alike[axis, 0], "level mirror": alike[axis, 1], "turned alike": alike[axis, 2],
            "level faces": (facing > 0.95).mean(), "upright faces": (facing < 0.15).mean(),
            "height": max(-2.0, min(2.0, height)), "height squared": min(height**2, 4.0),
            "one layer": plan.one_layer(points[:, axis]),
        }  # fmt: skip
        for sign in (1.0, -1.0):
            share = np.clip(0.5 + sign * points[:, axis] / span[axis], -0.05, 1.05)
            odd = _standing(plan, share, facing)
            rows.append([{**even, **odd}[name] for name in FEATURE_NAMES])
    return np.array(rows)


@dataclass(frozen=True)
class Plan:
    """A cloud seen from above or below."""

    places: np.ndarray
    """(N, 2)."""
    middle: np.ndarray
    area: float
    """Of its hull."""
    cell: np.ndarray
    """Number (N,) of each point's cell of a coarse grid."""
    taken: int
    """Cells that hold a point."""

    @classmethod
    def of(cls, places: np.ndarray) -> Plan:
        """The plan of places (N, 2)."""
        cells = max(4, min(FLOOR_CELLS, int(math.sqrt(len(places) / 4))))
        column, row = np.clip((places.T + 0.55) / 1.1 * cells, 0, cells - 1).astype(np.int64)
        cell = column * cells + row
        taken = int(np.count_nonzero(np.bincount(cell)))
        return cls(places, places.mean(0), max(polygon_area(convex_hull(places)), 1e-9), cell, taken)

    def covered(self, which: np.ndarray) -> float:
        """Share of the taken cells that hold some of those points."""
        return float(np.count_nonzero(np.bincount(self.cell[which]))) / self.taken

    def one_layer(self, height: np.ndarray) -> float:
        """Share of the cells that hold one height alone, as land seen from the air does."""
        order = np.argsort(self.cell, kind="stable")
        starts = np.flatnonzero(np.diff(self.cell[order], prepend=-1))
        height = height[order]
        spread = np.maximum.reduceat(height, starts) - np.minimum.reduceat(height, starts)
        many = np.diff(np.append(starts, len(height))) > 1
        return float((spread[many] < 0.12).mean()) if many.any() else 0.0


def _normals(grid: native.NeighborGrid) -> np.ndarray:
    """Unit normals (N, 3) of either sign of the planes through the neighbours of each of the grid's points."""
    all_indices = np.arange(len(grid.points), dtype=np.int32)
    neighbors, _ = grid.neighbors(all_indices, min(NORMAL_NEIGHBORS, len(all_indices)))
    return np.nan_to_num(native.fit_planes(grid.points, neighbors)[0])


def _standing(plan: Plan, share: np.ndarray, facing: np.ndarray) -> dict[str, float]:
    """The marks of one end of an axis, taken for the lower one.

    `share` (N,) is the height from that end, 0 to 1, and `facing` (N,) how level the face is there.
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
    """Standard deviation of places (N, 2)."""
    return math.sqrt(float(places[:, 0].var() + places[:, 1].var())) if len(places) > 4 else 0.0


def _symmetries(points: np.ndarray) -> np.ndarray:
    """How alike a cloud is (3, 3), for each axis: mirrored in its best upright plane, in its level one, and turned.

    1 is exactly alike, 0 not at all. Mirrors go through the middle of the taken cells, so that density does not count.
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
    """Number of the cell of each place (x, y, z), of `GRID_CELLS` along each axis."""
    scale, last = GRID_CELLS / 1.2, GRID_CELLS - 1
    column, row, layer = (np.clip((part + 0.6) * scale, 0, last).astype(np.int64) for part in (x, y, z))
    return (column * GRID_CELLS + row) * GRID_CELLS + layer


def _distances(taken: np.ndarray) -> np.ndarray:
    """How many cells each of `GRID_CELLS` along each axis is away from one that is taken, at most
    `MAX_DISTANCE_CELLS`; flat."""
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
    """For each axis the mirrors (3, 3) in its upright planes and in its level one, and three turns about it."""
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
