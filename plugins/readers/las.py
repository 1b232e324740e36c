"""Points of LAS and LAZ files, in real-world coordinates."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from z2p_core.interfaces import Reader, ScanError

_CHUNK = 1_000_000
"""Points unpacked at a time: a header that lies about its count costs one chunk, not the machine's memory."""


class Las(Reader):
    """Airborne and terrestrial laser scans (laspy, lazrs)."""

    name = "las"
    version = "1"
    suffixes = (".las", ".laz")

    def read(self, path: Path) -> list[np.ndarray]:
        """The file's points, one cloud (N, 3) float64, scale and offset applied in float64 (UTM keeps its digits).

        Raises:
            ScanError: no LAS file, or fewer points than its header promises.
        """
        if path.stat().st_size == 0:
            return [np.empty((0, 3))]
        try:
            return [_read(path)]
        except ScanError:
            raise
        except Exception as error:  # laspy and lazrs raise whatever their parsing stumbles over
            raise _unreadable(error) from error
        except BaseException as error:
            if type(error).__name__ != "PanicException":  # lazrs' way to fail on a damaged file, no Exception
                raise
            raise _unreadable(error) from error


def _read(path: Path) -> np.ndarray:
    import laspy

    with laspy.open(path) as reader:
        header = reader.header
        count, row = header.point_count, header.point_format.size
        body = path.stat().st_size - header.offset_to_point_data
        if body < 0 or (not header.are_points_compressed and count * row > body):
            raise ScanError(f"the LAS header promises {count} points of {row} bytes, {max(body, 0)} bytes follow it; "
                            "the file is cut short or its header is wrong: export it again")
        chunks = [np.column_stack([chunk.x, chunk.y, chunk.z]) for chunk in reader.chunk_iterator(_CHUNK)]
    points = np.concatenate([np.empty((0, 3)), *chunks])
    if len(points) != count:
        raise ScanError(f"the LAS header promises {count} points, {len(points)} came; export the file again")
    return points


def _unreadable(error: BaseException) -> ScanError:
    return ScanError(f"the LAS file cannot be read ({' '.join(str(error).split())[:160]}); export it again")
