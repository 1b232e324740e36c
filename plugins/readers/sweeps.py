"""Points of a .bin file: rows of float32 without a header, as KITTI and nuScenes keep sweeps of a car's lidar."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from z2p_core.interfaces import Reader, ScanError

_USUAL = ("x", "y", "z", "intensity")
_WITH_RING = (*_USUAL, "ring")
"""nuScenes adds which of the lidar's beams it was."""
_FARTHEST, _BRIGHTEST = 2000.0, 65535.0
"""Metres that a lidar sees at the most, and the largest intensity that one writes."""


class Sweeps(Reader):
    """Rows of little-endian float32: x y z intensity, in a .pcd.bin x y z intensity ring, or what --columns names."""

    name = "sweeps"
    version = "1"
    suffixes = (".bin",)

    def read(self, path: Path) -> list[np.ndarray]:
        """One cloud (N, 3) float64.

        Nothing in such a file says what it is: unless the user names the columns, what no lidar could have measured is
        refused, for other programs call other things .bin too.

        Raises:
            ScanError: no whole rows, or numbers that are no sweep.
        """
        names = self.columns or _columns(path)
        size, row = path.stat().st_size, 4 * len(names)
        if size % row:
            raise ScanError(f"expected rows of float32 {' '.join(names)}, {row} bytes each, got {size} bytes; name the "
                            f"columns that it has, as in --columns {','.join(_WITH_RING)}")
        table = np.fromfile(path, "<f4").reshape(-1, len(names))
        if not self.columns and not _is_sweep(table):
            raise ScanError(f"expected rows of float32 {' '.join(names)} as KITTI and nuScenes write them, got numbers "
                            "that no lidar measures; if it holds points, name its columns, as in "
                            f"--columns {','.join(_WITH_RING)}")
        return [table[:, [names.index(axis) for axis in "xyz"]].astype(np.float64)]


def _columns(path: Path) -> Sequence[str]:
    """What nobody names: told by the file's name and size."""
    if path.name.lower().endswith(".pcd.bin"):
        return _WITH_RING
    size = path.stat().st_size
    return _WITH_RING if size % (4 * len(_USUAL)) and not size % (4 * len(_WITH_RING)) else _USUAL


def _is_sweep(table: np.ndarray) -> bool:
    """Whether the rows could be a lidar's: near, finite, and as bright as numbers from 0 on."""
    with np.errstate(invalid="ignore"):
        near = np.abs(table[:, :3]) <= _FARTHEST
        lit = (table[:, 3] >= 0) & (table[:, 3] <= _BRIGHTEST)
    denormal = (table != 0) & (np.abs(table) < np.finfo(np.float32).tiny)  # what small integers look like as float32
    return bool(near.all() and lit.all() and not denormal.any())
