"""Points of an E57 file: the scans of a laser scanner, all in one cloud."""

from __future__ import annotations

import re
import struct
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from z2p_core.errors.install_advice import install_advice
from z2p_core.errors.messages import error_reason
from z2p_core.formats.row_subsampling import BLOCK_BYTES
from z2p_core.interfaces import MEMORY_A_POINT, RawCloud, Reader, ScanError
from z2p_renderer.plugins.readers._helpers.lazy_import import import_lazily
from z2p_renderer.plugins.readers._helpers.point_fields import BLACK_NOTE, UNUSABLE_NOTE, FieldPlan, plan_fields

_HEADER_BYTES, _CHECKSUM_BYTES, _MAX_DESCRIPTION_BYTES = 48, 4, 1 << 26
"""Size of the header and of the checksum of a page, and the largest description that is read."""
_POINT_COUNT = re.compile(rb'<points\b[^>]*\brecordCount="(\d{1,15})"')


class E57(Reader):
    """ASTM E2807 (pye57, an extra)."""

    name = "e57"
    version = "4"
    takes_columns = False
    packages = ("pye57",)
    suffixes = (".e57",)

    def memory(self, path: Path) -> int:
        """Memory for the points that the scans promise, which may be compressed far more than in other formats.

        The library is not used for it: it would run in this process.
        """
        counts = _POINT_COUNT.findall(_read_description(path))
        count = sum(map(int, counts))
        return MEMORY_A_POINT * count if count <= self.max_rows else MEMORY_A_POINT * self.max_rows + 2 * BLOCK_BYTES

    def is_fragile(self, path: Path) -> bool:
        """Every file: the library is written in C++ and hardly checks a file's contents."""
        return True

    def read(self, path: Path) -> list[RawCloud]:
        """All scans of the file in its common axes, one cloud (N, 3) float64; points marked invalid are left out.

        Raises:
            ScanError: no E57 file, a damaged one, one without points, or pye57 is not installed.
        """
        file = _open(path)
        scans = import_lazily("z2p_renderer.plugins.readers._helpers.e57_scans")
        try:
            names = scans.attribute_names(file)
            plan = plan_fields([name.removeprefix("nor:") for name in names], self.wants)
            wanted = [names[column] for column in plan.columns]
            count = sum(file.get_header(index).point_count for index in range(file.scan_count))
            step, rng = max(count / self.max_rows, 1.0), np.random.default_rng(0)
            parts = [_Part(*scans.read_scan(file, index, wanted, step, rng)) for index in range(file.scan_count)]
            if "rgb" in plan.needed:
                for index, part in enumerate(parts):
                    if set(scans.COLORS) <= part.values.keys():
                        part.colors, part.color_kind = scans.scan_colors(file, index, part.values)
        except Exception as error:  # the library raises errors of any type on damaged files
            raise _unreadable_error(error) from error
        finally:
            file.close()
        cloud = replace(_joined(parts, plan, names), total=count if step > 1 else None)
        return [replace(cloud, units={name: unit for name, unit in scans.UNITS.items() if name in cloud.field_names})]


@dataclass
class _Part:
    """The points of one scan, and what it has of each."""

    points: np.ndarray
    values: dict[str, np.ndarray]
    colors: np.ndarray | None = None
    color_kind: str = ""


def _joined(parts: list[_Part], plan: FieldPlan, names: list[str]) -> RawCloud:
    """One cloud of all scans; NaN where a scan does not have what another has."""
    cloud = RawCloud(np.concatenate([np.empty((0, 3)), *(part.points for part in parts)]))
    others = {names[column] for name in plan.needed if name != "rgb" for column in plan.columns_of[name]}
    columns = {names.index(name): np.concatenate([np.empty(0), *(_column(part, name) for part in parts)])
               if len(parts) != 1 else _column(parts[0], name) for name in others}  # fmt: skip
    scalars = replace(plan, needed=tuple(name for name in plan.needed if name != "rgb"))
    cloud = scalars.fill(cloud, columns)
    if "rgb" not in plan.needed:
        return cloud
    colors = np.concatenate([np.empty((0, 3), np.float32), *(_colors(part) for part in parts)])
    if len(colors) and np.nan_to_num(colors).any():
        kinds = dict.fromkeys(part.color_kind for part in parts if part.color_kind)
        return replace(cloud, fields={"rgb": colors, **cloud.fields}, color_kind=", ".join(kinds))
    note = "" if not len(colors) else BLACK_NOTE if np.isfinite(colors).any() else UNUSABLE_NOTE
    return replace(cloud, field_names=tuple(name for name in cloud.field_names if name != "rgb"), note=note)


def _column(part: _Part, name: str) -> np.ndarray:
    return part.values[name] if name in part.values else np.full(len(part.points), np.nan)


def _colors(part: _Part) -> np.ndarray:
    return np.full(part.points.shape, np.nan, np.float32) if part.colors is None else part.colors


def _open(path: Path) -> Any:
    try:
        pye57 = import_lazily("pye57")
    except ImportError:
        raise ScanError(f"reading .e57 needs an extra; {install_advice('e57')}") from None
    try:
        return pye57.E57(str(path))
    except Exception as error:  # as above
        raise _unreadable_error(error) from error


def _read_description(path: Path) -> bytes:
    """The XML description of the file, without the checksums at the ends of its pages; empty if it has none."""
    with path.open("rb") as file:
        magic, start, length, page = struct.unpack("<8s16xQQQ", file.read(_HEADER_BYTES).ljust(_HEADER_BYTES, b"\0"))
        sane = _CHECKSUM_BYTES < page <= _MAX_DESCRIPTION_BYTES and length <= _MAX_DESCRIPTION_BYTES
        sane = sane and start < path.stat().st_size
        if magic != b"ASTM-E57" or not sane:
            return b""
        file.seek(start - start % page)
        pages = file.read((start % page + length) * page // (page - _CHECKSUM_BYTES) + page)
    content = b"".join(pages[begin : begin + page - _CHECKSUM_BYTES] for begin in range(0, len(pages), page))
    return content[start % page :][:length]


def _unreadable_error(error: Exception) -> ScanError:
    return ScanError(f"the E57 file cannot be read ({error_reason(error)}); export it again")
