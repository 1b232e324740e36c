"""Points of VTK's files: legacy .vtk in text or binary, and .vtp and .vtu in XML."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from z2p_core.interfaces import MEMORY_A_CHARACTER, RawCloud, Reader, ScanError
from z2p_renderer.plugins.readers._helpers.lazy_import import import_lazily
from z2p_renderer.plugins.readers._helpers.point_fields import Wants, only_bytes, plan_arrays
from z2p_renderer.plugins.readers._helpers.vtk_legacy_fields import NUMPY_TYPES, find_arrays, read_array

_POINTS_LINE = re.compile(rb"^[ \t]*POINTS[ \t]+(\d{1,15})[ \t]+(\w+)[ \t]*\r?\n", re.MULTILINE | re.IGNORECASE)
_DATASET_LINE = re.compile(rb"^[ \t]*DATASET[ \t]+(\w+)", re.MULTILINE | re.IGNORECASE)
_MAX_HEADER_BYTES = 4096
"""The kind of data set is named within this many bytes: after two lines and a word."""


class Vtk(Reader):
    """The Visualization Toolkit's poly data and unstructured grids; cells and their values are left out."""

    name = "vtk"
    version = "2"
    takes_columns = False
    suffixes = (".vtk", ".vtp", ".vtu")

    def memory(self, path: Path) -> int:
        """The file may be text, which is read as a whole."""
        return MEMORY_A_CHARACTER * path.stat().st_size

    def read(self, path: Path) -> list[RawCloud]:
        """The file's points, one cloud (N, 3) float64, also those that no cell uses.

        Raises:
            ScanError: no VTK file, one of a grid without points, or one that is cut short.
        """
        blob = path.read_bytes()
        if path.suffix.lower() == ".vtk":
            return [_read_legacy(blob, self.wants)]
        vtk_xml = import_lazily("z2p_renderer.plugins.readers._helpers.vtk_xml")  # the XML library is slow to import
        return [vtk_xml.cloud_of_xml(blob, self.wants)]


def _read_legacy(blob: bytes, wants: Wants) -> RawCloud:
    head = blob[:_MAX_HEADER_BYTES]
    if not head.startswith(b"# vtk DataFile"):
        raise ScanError("expected a VTK file, which begins with '# vtk DataFile'; this is another format under that "
                        "name")
    kind = _DATASET_LINE.search(head)
    encoding = [line.strip().upper() for line in head.split(b"\n", 3)[2:3]]
    if kind is None or encoding not in ([b"ASCII"], [b"BINARY"]):
        raise ScanError("expected ASCII or BINARY in the VTK file's third line and then DATASET; export it again")
    points_line = _POINTS_LINE.search(blob, kind.end())
    if points_line is None:
        raise ScanError(f"the VTK file holds a data set {kind[1].decode()} without POINTS; save it as poly data")
    count, name = int(points_line[1]), points_line[2].decode().lower()
    if name not in NUMPY_TYPES:
        raise ScanError(f"VTK points are float or double, got {name!r}; export the file again")
    binary, kind_of_points = encoding == [b"BINARY"], np.dtype(">" + NUMPY_TYPES[name])
    points = (_parse_binary if binary else _parse_text)(blob, points_line.end(), count, kind_of_points)
    behind = points_line.end() + (3 * count * kind_of_points.itemsize if binary else 0)
    arrays = {array.name: array for array in find_arrays(blob, behind, count, binary)}
    color = next((array.name for array in arrays.values() if array.is_color), "")
    color = color or only_bytes({name: (array.width, array.type) for name, array in arrays.items()})
    fields = plan_arrays({name: array.width for name, array in arrays.items()}, wants, color)
    values = {name: read_array(blob, arrays[name], count, binary) for name in fields.arrays}
    return fields.fill(RawCloud(points), values)


def _parse_binary(blob: bytes, start: int, count: int, kind: np.dtype) -> np.ndarray:
    if 3 * count * kind.itemsize > len(blob) - start:
        raise _truncated_error(count)
    return np.frombuffer(blob, kind, 3 * count, start).reshape(-1, 3).astype(np.float64)


def _parse_text(blob: bytes, start: int, count: int, kind: np.dtype) -> np.ndarray:
    if 6 * count - 1 > len(blob) - start:  # a digit and a blank each
        raise _truncated_error(count)
    words = blob[start:].split(None, 3 * count)[: 3 * count]
    try:
        numbers = np.array(words, dtype=np.float64)
    except ValueError as error:
        raise ScanError(f"the VTK points cannot be read ({str(error)[:80]}); export the file again") from error
    if len(numbers) != 3 * count:
        raise _truncated_error(count)
    return numbers.reshape(-1, 3)


def _truncated_error(count: int) -> ScanError:
    return ScanError(f"the VTK file promises {count} points, and ends before them; it is cut short: export it again")
