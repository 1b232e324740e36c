"""Points of an E57 file: the scans of a laser scanner, all in one cloud."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from z2p_core.install_advice import install_advice
from z2p_core.interfaces import MEMORY_A_POINT, Reader, ScanError
from z2p_renderer.plugins.readers.late import late


class E57(Reader):
    """ASTM E2807 (pye57, an extra); colours and intensities are left out."""

    name = "e57"
    version = "1"
    packages = ("pye57",)
    suffixes = (".e57",)

    def memory(self, path: Path) -> int:
        """As many points as the scans promise, which may be packed far tighter than in other formats."""
        file = _opened(path)
        try:
            return MEMORY_A_POINT * sum(_count(file, index) for index in range(file.scan_count))
        finally:
            file.close()

    def is_fragile(self, path: Path) -> bool:
        """Its library is written in C++, and believes much of what a file says."""
        return True

    def read(self, path: Path) -> list[np.ndarray]:
        """All scans of the file in its common axes, one cloud (N, 3) float64; points marked invalid are left out.

        Raises:
            ScanError: no E57 file, a damaged one, one without points, or pye57 is not installed.
        """
        file = _opened(path)
        try:
            parts = [file.read_scan(index, ignore_missing_fields=True) for index in range(file.scan_count)]
        except Exception as error:  # the library raises whatever its parsing stumbles over
            raise _unreadable(error) from error
        finally:
            file.close()
        axes = ("cartesianX", "cartesianY", "cartesianZ")
        clouds = [np.column_stack([part[axis] for axis in axes]).astype(np.float64) for part in parts]
        return [np.concatenate([np.empty((0, 3)), *clouds])]


def _opened(path: Path) -> Any:
    try:
        pye57 = late("pye57")
    except ImportError:
        raise ScanError(f"reading .e57 needs an extra; {install_advice('e57')}") from None
    try:
        return pye57.E57(str(path))
    except Exception as error:  # as above
        raise _unreadable(error) from error


def _count(file: Any, index: int) -> int:
    try:
        return int(file.get_header(index).point_count)
    except Exception as error:  # as above
        raise _unreadable(error) from error


def _unreadable(error: Exception) -> ScanError:
    reason = " ".join(str(error).split())[:160] or type(error).__name__
    return ScanError(f"the E57 file cannot be read ({reason}); export it again")
