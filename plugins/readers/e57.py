"""Points of an E57 file: the scans of a laser scanner, all in one cloud."""

from __future__ import annotations

import re
import struct
from pathlib import Path
from typing import Any

import numpy as np

from z2p_core.errors.install_advice import install_advice
from z2p_core.errors.messages import error_reason
from z2p_core.interfaces import MEMORY_A_POINT, RawCloud, Reader, ScanError
from z2p_renderer.plugins.readers._helpers.color_note import IGNORED_NOTE
from z2p_renderer.plugins.readers._helpers.lazy_import import import_lazily

_HEADER_BYTES, _CHECKSUM_BYTES, _MAX_DESCRIPTION_BYTES = 48, 4, 1 << 26
"""Size of the header and of the checksum of a page, and the largest description that is read."""
_POINT_COUNT = re.compile(rb'<points\b[^>]*\brecordCount="(\d{1,15})"')


class E57(Reader):
    """ASTM E2807 (pye57, an extra); colours and intensities are left out."""

    name = "e57"
    version = "2"
    takes_columns = False
    packages = ("pye57",)
    suffixes = (".e57",)

    def memory(self, path: Path) -> int:
        """Memory for the points that the scans promise, which may be compressed far more than in other formats.

        The library is not used for it: it would run in this process.
        """
        counts = _POINT_COUNT.findall(_read_description(path))
        return MEMORY_A_POINT * sum(map(int, counts))

    def is_fragile(self, path: Path) -> bool:
        """Every file: the library is written in C++ and hardly checks a file's contents."""
        return True

    def read(self, path: Path) -> list[RawCloud]:
        """All scans of the file in its common axes, one cloud (N, 3) float64; points marked invalid are left out.

        Raises:
            ScanError: no E57 file, a damaged one, one without points, or pye57 is not installed.
        """
        file = _open(path)
        try:
            coloured = any("colorRed" in file.get_header(index).point_fields for index in range(file.scan_count))
            parts = [file.read_scan(index, ignore_missing_fields=True) for index in range(file.scan_count)]
        except Exception as error:  # the library raises errors of any type on damaged files
            raise _unreadable_error(error) from error
        finally:
            file.close()
        axes = ("cartesianX", "cartesianY", "cartesianZ")
        clouds = [np.column_stack([part[axis] for axis in axes]).astype(np.float64) for part in parts]
        return [RawCloud(np.concatenate([np.empty((0, 3)), *clouds]), note=IGNORED_NOTE if coloured else "")]


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
