"""Recognizes scans of whole rooms, by their floor, ceiling and walls."""

from __future__ import annotations

import numpy as np

from z2p_core.linalg import bounding_box

ROOM_SLAB_SHARE = 0.12
"""Thickness of a room's floor and ceiling, as a share of the height."""
MIN_ROOM_COVERAGE = 0.35
"""Smallest share of the footprint that floor and ceiling each cover."""
MAX_ROOM_MIDDLE_COVERAGE = 0.8
"""Largest share of the footprint that a room's walls and furniture cover half way up."""
ROOM_HEIGHT_METRES = (1.9, 12.0)
"""Range of a room's height."""
MIN_ROOM_BREADTH_METRES = 2.5
"""Smallest narrower side of a room."""


def is_room(points: np.ndarray) -> bool:
    """Whether points (N, 3), +Z up, look like a room in metres: a floor and a ceiling, and a person fits between.

    A solid object fills the middle of its height, and a ring has no floor at its centre.
    """
    low, high = bounding_box(points)
    if (high - low)[2] < ROOM_HEIGHT_METRES[0]:  # a fast test, which most objects fail
        return False
    low, high = np.quantile(points, [0.002, 0.998], axis=0)
    breadth, height = float((high - low)[:2].min()), float((high - low)[2])
    lowest, highest = ROOM_HEIGHT_METRES
    if not lowest <= height <= highest or breadth < max(MIN_ROOM_BREADTH_METRES, height / 2):
        return False
    cell = np.clip((points[:, :2] - low[:2]) / (high - low)[:2] * 20, 0, 19.999).astype(np.int64)
    footprint = cell[:, 0] * 20 + cell[:, 1]
    taken = len(np.unique(footprint))
    level = (points[:, 2] - low[2]) / height
    slabs = (level < ROOM_SLAB_SHARE, level > 1 - ROOM_SLAB_SHARE, np.abs(level - 0.5) < ROOM_SLAB_SHARE)
    floor, ceiling, middle = (len(np.unique(footprint[slab])) for slab in slabs)
    centre = np.median(np.unique(cell, axis=0), axis=0)
    central = (np.abs(cell - centre) <= 1.5).all(1).any()
    covered = min(floor, ceiling) >= MIN_ROOM_COVERAGE * taken
    return bool(central) and covered and middle <= MAX_ROOM_MIDDLE_COVERAGE * taken
