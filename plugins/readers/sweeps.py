"""Points of a .bin file: rows of float32 without a header, as KITTI and nuScenes keep sweeps of a car's lidar."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from z2p_core.interfaces import Reader, ScanError
from z2p_core.lidar_rows import WITH_RING, could_be_measured, usual_columns


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
        size = path.stat().st_size
        names = self.columns or usual_columns(path, size)
        row = 4 * len(names)
        if size % row:
            raise ScanError(f"expected rows of float32 {' '.join(names)}, {row} bytes each, got {size} bytes; name the "
                            f"columns that it has, as in --columns {','.join(WITH_RING)}")
        table = np.fromfile(path, "<f4").reshape(-1, len(names))
        if not self.columns and not could_be_measured(table):
            raise ScanError(f"expected rows of float32 {' '.join(names)} as KITTI and nuScenes write them, got numbers "
                            "that no lidar measures; if it holds points, name its columns, as in "
                            f"--columns {','.join(WITH_RING)}")
        return [table[:, [names.index(axis) for axis in "xyz"]].astype(np.float64)]
