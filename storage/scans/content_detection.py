"""Recognizes the format of a file by its content, and files that share a suffix with scans but hold no points."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from z2p_core.formats.arrays.non_point_arrays import pose_array_kind
from z2p_core.formats.colmap_files import is_colmap_points_head
from z2p_core.formats.headerless_floats import SAMPLE_NUMBERS, matching_layouts
from z2p_core.formats.raw_lidar import NUSCENES_COLUMNS, is_plausible_sweep
from z2p_core.formats.tables.camera_poses import are_pose_names, pose_kind
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
from z2p_renderer.storage.scans.silenced_libraries import quiet

MAGIC_TO_SUFFIX = (
    (b"ply", ".ply"), (b"# .PCD", ".pcd"), (b"VERSION", ".pcd"), (b"\x93NUMPY", ".npy"), (b"PK\x03\x04", ".npz"),
    (b"LASF", ".las"), (b"ASTM-E57", ".e57"), (b"glTF", ".glb"), (b"# vtk DataFile", ".vtk"),
    (b"\x89HDF\r\n\x1a\n", ".h5"),
)  # fmt: skip
"""First bytes of a file -> suffix of its format."""
_OFF_HEADER = re.compile(r"(ST)?C?N?4?n?OFF(?![A-Za-z])")
"""The first line of an OFF file; the letters before OFF say which values follow each vertex."""
_STL_HEADER_BYTES, _STL_TRIANGLE_BYTES, _MAX_STL_TRAILING_BYTES = 84, 50, 16
"""Sizes in a binary STL file: its header, each triangle, and what may follow the triangles."""
_MAX_POSE_FILE_BYTES = 1 << 20
"""Larger .npy files are not checked for camera poses; this holds some thousands of poses."""
_HEAD_BYTES = 4096
"""Bytes at the beginning of a text file that decide whether it is prose."""
_MAX_SWEEP_SAMPLE_ROWS = 1000
"""Rows at the beginning of a .bin file that decide whether it is a lidar sweep."""


def suffix_of(head: bytes, size: int) -> str:
    """Suffix of the format of a file of `size` bytes, recognized by its first bytes."""
    for magic, suffix in MAGIC_TO_SUFFIX:
        if head.startswith(magic):
            return suffix
    if b"<VTKFile" in head[:400]:
        return ".vtp" if b"PolyData" in head[:400] else ".vtu"
    if head.lstrip()[:5].lower() == b"solid":
        return ".stl"
    if len(head) >= _STL_HEADER_BYTES:  # a binary STL has no magic bytes, but its triangle count fits its length
        triangles = int.from_bytes(head[_STL_HEADER_BYTES - 4 : _STL_HEADER_BYTES], "little")
        if 0 <= size - _STL_HEADER_BYTES - _STL_TRIANGLE_BYTES * triangles <= _MAX_STL_TRAILING_BYTES:
            return ".stl"
    lines = _content_lines(head)
    if lines and _OFF_HEADER.match(lines[0]):
        return ".off"
    return ".obj" if any(line.split()[0] == "v" for line in lines[:200]) else ".txt"


def is_prose(path: Path, named: bool = False) -> bool:
    """Whether a .txt or .csv file is no scan: it begins with neither three numbers nor the names x, y and z.

    Lists of camera poses and camera matrices (in .npy too), which data sets keep beside their scans, count as no scan.
    If the user has `named` the columns, one line may precede the numbers, and words may stand beside them.
    """
    if path.suffix.lower() == ".npy":
        return _is_pose_array(path)
    if path.suffix.lower() not in (".txt", ".csv") or not path.is_file():  # opening a pipe would block
        return False
    try:
        with path.open("rb") as file:
            head = file.read(_HEAD_BYTES)
    except OSError:
        return False  # the reader reports the error
    lines = _content_lines(head)
    first = _first_row(lines)
    if candidates := next(filter(None, map(column_names, lines[: first + 1])), None):
        return not named and any(map(are_pose_names, candidates))
    rows = lines[first:]
    if named and rows and not is_row(rows[0]):
        rows = rows[1:]
    words = re.split(r"[;,\s]+", rows[0].strip(";,")) if rows else []
    numbers = sum(is_number(word) or is_missing(word) for word in words)
    if numbers < 3 or (numbers < len(words) and not named):
        return True
    return not named and _holds_poses(rows[: -1 if len(head) == _HEAD_BYTES else None])


def _is_pose_array(path: Path) -> bool:
    """Whether a .npy file of moderate size holds camera matrices."""
    try:
        if not path.is_file() or path.stat().st_size > _MAX_POSE_FILE_BYTES:
            return False
        with quiet():
            array = np.load(path, allow_pickle=False)
        return array.dtype.kind == "f" and array.ndim in (2, 3) and bool(pose_array_kind(array))
    except Exception:  # numpy raises many kinds of errors on damaged files; the reader reports them
        return False


def _holds_poses(rows: list[str]) -> bool:
    """Whether complete rows of text are camera poses or a camera matrix."""
    cells = [[cell.strip("\"'") for cell in re.split(r"[;,\s]+", row.strip(";, "))] for row in rows]
    if not cells or len({len(row) for row in cells}) > 1 or not all(is_number(cell) for row in cells for cell in row):
        return False
    return bool(pose_kind(np.array([[float(plain_exponents(cell)) for cell in row] for row in cells])))


def is_unrelated_bin(path: Path, named: bool = False) -> bool:
    """Whether a .bin file holds no points: network weights or a glTF buffer, for example.

    False if the user has `named` its columns.
    """
    if named or path.suffix.lower() != ".bin" or not path.is_file():
        return False
    try:
        return not _looks_like_points(path)
    except OSError:
        return False  # the reader reports the error


def _looks_like_points(path: Path) -> bool:
    """Whether a .bin file begins like rows of float32 points or like the points of a COLMAP model."""
    size = path.stat().st_size
    with path.open("rb") as file:
        if is_colmap_points_head(file.read(8), size):
            return True
    if path.name.lower().endswith(".pcd.bin"):
        rows = np.fromfile(path, "<f4", count=_MAX_SWEEP_SAMPLE_ROWS * len(NUSCENES_COLUMNS))
        whole = size and not size % (4 * len(NUSCENES_COLUMNS))
        return bool(whole) and is_plausible_sweep(rows.reshape(-1, len(NUSCENES_COLUMNS)))
    return bool(matching_layouts(np.fromfile(path, "<f4", count=SAMPLE_NUMBERS), size))


def _content_lines(head: bytes) -> list[str]:
    """The nonempty lines of the first bytes of a text, without ``#`` comments."""
    text = head.decode(text_encoding(head), errors="replace")
    return [line for line in (without_comment(line).strip() for line in text.splitlines()) if line]


def _first_row(lines: list[str]) -> int:
    """Index of the first line that is neither a comment nor a row count."""
    first = next((index for index, line in enumerate(lines) if not is_comment(line)), len(lines))
    return first + any(map(is_count, lines[first : first + 1]))
