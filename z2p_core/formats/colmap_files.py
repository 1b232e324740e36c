"""What the files of a COLMAP model are called, and what tells its points from other files of the same suffix."""

from __future__ import annotations

import struct
from pathlib import PurePath

POINTS_STEM = "points3d"
"""Stem of the file that holds a model's points, lower-case; its suffix is .bin or .txt."""
OTHER_STEMS = frozenset({"cameras", "images", "frames", "rigs", "project"})
"""Stems of the files beside it."""
SUFFIXES = (".bin", ".txt", ".ini")
LEAST_POINT_BYTES = 51
"""Bytes of a point that no picture shows."""
_MOST_POINT_BYTES = 1000 * LEAST_POINT_BYTES
"""Bytes of a point that very many do."""


def counts_points(head: bytes, size: int) -> bool:
    """Whether a file of `size` bytes that begins so counts points of COLMAP's, as many as may fill it."""
    if len(head) < 8 or size < 8 + LEAST_POINT_BYTES:
        return False
    (count,) = struct.unpack_from("<Q", head)
    return 0 < count * LEAST_POINT_BYTES <= size - 8 <= count * _MOST_POINT_BYTES


def is_points(path: PurePath) -> bool:
    """Whether a file is called as a model's points are."""
    return path.stem.lower() == POINTS_STEM and path.suffix.lower() in SUFFIXES


def is_part(path: PurePath) -> bool:
    """Whether a file is called as the other parts of a model are."""
    return path.stem.lower() in OTHER_STEMS and path.suffix.lower() in SUFFIXES
