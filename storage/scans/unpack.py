"""Scans that are no plain files: gzip'd ones and standard input, in a temporary file while they are read."""

from __future__ import annotations

import gzip
import re
import shutil
import tempfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

import numpy as np

from z2p_core.formats.arrays.non_point_arrays import pose_array_kind
from z2p_core.formats.colmap_files import counts_points
from z2p_core.formats.headerless_floats import SAMPLE_NUMBERS, fitting_forms
from z2p_core.formats.raw_lidar import WITH_RING, could_be_measured
from z2p_core.formats.tables.camera_poses import name_poses, pose_kind
from z2p_core.formats.tables.header_lines import (
    column_names,
    is_comment,
    is_count,
    is_missing,
    is_number,
    is_row,
    plain_exponents,
    text_encoding,
    without_comment,
)
from z2p_core.interfaces import ScanError
from z2p_renderer.storage.scans.silenced_libraries import quiet

STDIN_STEM = "stdin"
MAGIC = (
    (b"ply", ".ply"), (b"# .PCD", ".pcd"), (b"VERSION", ".pcd"), (b"\x93NUMPY", ".npy"), (b"PK\x03\x04", ".npz"),
    (b"LASF", ".las"), (b"ASTM-E57", ".e57"), (b"glTF", ".glb"), (b"# vtk DataFile", ".vtk"),
    (b"\x89HDF\r\n\x1a\n", ".h5"),
)  # fmt: skip
"""First bytes -> suffix."""
_OFF = re.compile(r"(ST)?C?N?4?n?OFF(?![A-Za-z])")
"""How OFF files begin; the letters before tell what stands beside a vertex."""
_STL_HEAD, _STL_TRIANGLE, _MOST_STRAY = 84, 50, 16
"""Bytes of a binary STL file's header and of each triangle, and how many may follow."""
PREFIX = "z2p-stdin-"
"""Of the temporary folder that keeps standard input."""
_STEP = 1 << 20
_PACKED, _PACKED_TIMES = (".laz", ".npz", ".e57"), 8
"""Suffixes of files that may be packed, and how many times as large they may be then."""
_LARGEST_POSES = 1 << 20
"""Bytes of a file of poses at the most, which is some thousands of them."""
_HEAD = 4096
"""Bytes at the head of a text that tell what it is."""
_SWEEP_ROWS = 1000
"""Rows at the head of a .bin file that tell whether it is a sweep."""


def spool(stream: BinaryIO, folder: Path) -> Path:
    """File ``stdin.<suffix>`` in the folder that holds all of a stream; its format is told by its first bytes.

    Text that says nothing else of itself counts as ``.txt``, which takes any columns.

    Raises:
        ScanError: nothing comes, or what begins like gzip is not.
    """
    head = stream.read(_STEP)
    if not head:
        raise ScanError("standard input is empty; pipe a scan into it, as in: cat scan.ply | z2p run-inference -")
    zipped = head.startswith(b"\x1f\x8b")
    try:
        start = zlib.decompressobj(31).decompress(head, _STEP) if zipped else head
    except zlib.error as error:
        raise ScanError(f"standard input begins like a gzip file, and is none ({error}); send it again") from error
    path = folder / STDIN_STEM
    with path.open("wb") as file:
        file.write(head)
        shutil.copyfileobj(stream, file, _STEP)
    suffix = suffix_of(start, _unpacked_size(path) if zipped else path.stat().st_size)
    return path.rename(folder / f"{STDIN_STEM}{suffix}{'.gz' if zipped else ''}")


def content_size(path: Path) -> int:
    """Bytes of what a scan holds, about: a packed one tells it, or is taken for one packed well.

    Raises:
        OSError: it cannot be read.
    """
    size = path.stat().st_size
    if path.suffix.lower() == ".gz":
        return max(size, _unpacked_size(path))
    return size * (_PACKED_TIMES if path.suffix.lower() in _PACKED else 1)


def _unpacked_size(path: Path) -> int:
    """Bytes of a gzip file's content, as its last four say; more than 4 GB count from 0 again."""
    with path.open("rb") as file:
        file.seek(max(path.stat().st_size - 4, 0))
        return int.from_bytes(file.read(), "little")


def is_spooled(path: Path) -> bool:
    """Whether a file is what `spool` keeps of standard input."""
    return path.name.startswith(f"{STDIN_STEM}.") and path.parent.name.startswith(PREFIX)


def suffix_of(head: bytes, size: int) -> str:
    """Suffix of the format that a file of `size` bytes belongs to, by its first ones."""
    for magic, suffix in MAGIC:
        if head.startswith(magic):
            return suffix
    if b"<VTKFile" in head[:400]:
        return ".vtp" if b"PolyData" in head[:400] else ".vtu"
    if head.lstrip()[:5].lower() == b"solid":
        return ".stl"
    if len(head) >= _STL_HEAD:  # a binary STL says no more of itself than how many triangles make its length
        triangles = int.from_bytes(head[_STL_HEAD - 4 : _STL_HEAD], "little")
        if 0 <= size - _STL_HEAD - _STL_TRIANGLE * triangles <= _MOST_STRAY:
            return ".stl"
    lines = _told_lines(head)
    if lines and _OFF.match(lines[0]):
        return ".off"
    return ".obj" if any(line.split()[0] == "v" for line in lines[:200]) else ".txt"


def is_prose(path: Path, named: bool = False) -> bool:
    """Whether a .txt or .csv file begins with neither three numbers nor the names x, y and z: a note, not a scan.

    So do lists of poses and matrices of cameras count, which data sets keep beside their scans, in .npy too. Where
    the user has `named` its columns, one line may stand before the numbers, and words beside them.
    """
    if path.suffix.lower() == ".npy":
        return _is_pose_array(path)
    if path.suffix.lower() not in (".txt", ".csv") or not path.is_file():  # opening a pipe would wait for ever
        return False
    try:
        with path.open("rb") as file:
            head = file.read(_HEAD)
    except OSError:
        return False  # the reader says what is wrong
    lines = _told_lines(head)
    first = _first_row(lines)
    if ways := next(filter(None, map(column_names, lines[: first + 1])), None):
        return not named and any(map(name_poses, ways))
    rows = lines[first:]
    if named and rows and not is_row(rows[0]):
        rows = rows[1:]
    words = re.split(r"[;,\s]+", rows[0].strip(";,")) if rows else []
    numbers = sum(is_number(word) or is_missing(word) for word in words)
    if numbers < 3 or (numbers < len(words) and not named):
        return True
    return not named and _holds_poses(rows[: -1 if len(head) == _HEAD else None])


def _is_pose_array(path: Path) -> bool:
    """Whether a .npy file, not too large for it, holds matrices of cameras."""
    try:
        if not path.is_file() or path.stat().st_size > _LARGEST_POSES:
            return False
        with quiet():
            array = np.load(path, allow_pickle=False)
        return array.dtype.kind == "f" and array.ndim in (2, 3) and bool(pose_array_kind(array))
    except Exception:  # numpy raises whatever its parsing stumbles over, and the reader says what is wrong
        return False


def _holds_poses(rows: list[str]) -> bool:
    """Whether rows, none of them cut short, are those of a camera's way or matrix."""
    cells = [[cell.strip("\"'") for cell in re.split(r"[;,\s]+", row.strip(";, "))] for row in rows]
    if not cells or len({len(row) for row in cells}) > 1 or not all(is_number(cell) for row in cells for cell in row):
        return False
    return bool(pose_kind(np.array([[float(plain_exponents(cell)) for cell in row] for row in cells])))


def is_no_sweep(path: Path, named: bool = False) -> bool:
    """Whether a .bin file is other than a car's lidar sweep: weights of a network, a buffer of a glTF file.

    Where the user has `named` its columns, it is what they say.
    """
    if named or path.suffix.lower() != ".bin" or not path.is_file():
        return False
    try:
        return not _looks_like_sweep(path)
    except OSError:
        return False  # the reader says what is wrong


def _looks_like_sweep(path: Path) -> bool:
    """Whether a file begins as rows of points do, a lidar's or others, or as COLMAP's points."""
    size = path.stat().st_size
    with path.open("rb") as file:
        if counts_points(file.read(8), size):
            return True
    if path.name.lower().endswith(".pcd.bin"):
        rows = np.fromfile(path, "<f4", count=_SWEEP_ROWS * len(WITH_RING))
        whole = size and not size % (4 * len(WITH_RING))
        return bool(whole) and could_be_measured(rows.reshape(-1, len(WITH_RING)))
    return bool(fitting_forms(np.fromfile(path, "<f4", count=SAMPLE_NUMBERS), size))


def _told_lines(head: bytes) -> list[str]:
    """Lines of a text's first bytes that hold something, without what ``#`` begins."""
    text = head.decode(text_encoding(head), errors="replace")
    return [line for line in (without_comment(line).strip() for line in text.splitlines()) if line]


def _first_row(lines: list[str]) -> int:
    """Index of the first line that is no comment and no count of the rows."""
    first = next((index for index, line in enumerate(lines) if not is_comment(line)), len(lines))
    return first + any(map(is_count, lines[first : first + 1]))


@contextmanager
def unpacked(path: Path, largest: int | None) -> Iterator[Path]:
    """The path itself, or while the context lasts a temporary file with the content of a .gz, unpacked step by step.

    Raises:
        ScanError: it is no gzip file, is cut short, or would unpack to more than `largest` bytes (None: no limit).
    """
    if path.suffix.lower() != ".gz":
        yield path
        return
    with tempfile.TemporaryDirectory(prefix="z2p-") as folder:
        inner = Path(folder) / Path(path.name).with_suffix("").name
        _unpack(path, inner, largest)
        yield inner


def _unpack(path: Path, inner: Path, largest: int | None) -> None:
    size = 0
    try:
        with gzip.open(path) as packed, inner.open("wb") as file:
            while step := packed.read(_STEP):
                size += len(step)
                if largest is not None and size > largest:
                    raise ScanError(f"unpacks to more than {largest / 1e9:.1f} GB, which do not fit into memory; "
                                    "thin the scan out first")
                file.write(step)
    except (EOFError, zlib.error, gzip.BadGzipFile) as error:
        raise ScanError(f"cannot be unpacked ({error}); the file is damaged or cut short: fetch it again") from error
