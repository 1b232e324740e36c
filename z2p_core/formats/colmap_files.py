"""File names of COLMAP models, and a test that tells their binary points from other .bin files."""

from __future__ import annotations

import struct
from pathlib import PurePath

POINTS_STEM = "points3d"
"""Stem of the file that holds a model's points, lower-case; its suffix is .bin or .txt."""
OTHER_STEMS = frozenset({"cameras", "images", "frames", "rigs", "project"})
"""Stems of the other files of a model."""
SUFFIXES = (".bin", ".txt", ".ini")
MIN_POINT_BYTES = 51
"""Size of a point with an empty track."""
_MAX_POINT_BYTES = 1000 * MIN_POINT_BYTES
"""Plausible limit of the mean size of a point; long tracks make points larger."""


def is_colmap_points_head(head: bytes, size: int) -> bool:
    """Whether the count at the beginning (`head`) of a file of `size` bytes fits a points3D.bin of that size."""
    if len(head) < 8 or size < 8 + MIN_POINT_BYTES:
        return False
    (count,) = struct.unpack_from("<Q", head)
    return 0 < count * MIN_POINT_BYTES <= size - 8 <= count * _MAX_POINT_BYTES


def is_colmap_points(path: PurePath) -> bool:
    """Whether a file has the name of a model's points."""
    return path.stem.lower() == POINTS_STEM and path.suffix.lower() in SUFFIXES


def is_colmap_part(path: PurePath) -> bool:
    """Whether a file has the name of another part of a model."""
    return path.stem.lower() in OTHER_STEMS and path.suffix.lower() in SUFFIXES
