"""Points of a PCD file: ascii, binary and binary_compressed; organised clouds row by row."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from z2p_core.errors.messages import error_reason
from z2p_core.formats.row_subsampling import BLOCK_BYTES, ThinnedRows
from z2p_core.interfaces import MEMORY_A_CHARACTER, MEMORY_A_POINT, RawCloud, Reader, ScanError, Sensor
from z2p_core.rotations import quaternion_rotations
from z2p_renderer.plugins.readers._helpers.length_check import (
    MAX_TRAILING_BYTES,
    check_trailing_bytes,
    trailing_bytes_note,
)
from z2p_renderer.plugins.readers._helpers.point_fields import ArrayFields, plan_arrays
from z2p_renderer.plugins.readers._pcd.binary import read_packed, read_rows, row_dtype, stack_float64

_MAX_HEADER_BYTES = 1 << 16
_MAX_LZF_RATIO = 100
"""LZF expands 3 bytes to at most 264; a larger compression ratio in a header is false."""
_FIELD_TYPES = frozenset({"F4", "F8", *(kind + size for kind in "IU" for size in "1248")})
"""Valid combinations of TYPE and SIZE."""
_BLOCK_CHARACTERS = 1 << 22
"""Text that is parsed at a time."""
_PAGE_BYTES = 4096
"""Older versions of the Point Cloud Library pad binary files with zeros to whole memory pages of this size."""


class Pcd(Reader):
    """Point Cloud Library files (python-neo-lzf unpacks them)."""

    name = "pcd"
    version = "7"
    takes_columns = False
    packages = ("python-neo-lzf",)
    suffixes = (".pcd",)

    def memory(self, path: Path) -> int:
        """As many points as the header promises, beside the file itself; text takes far more."""
        with path.open("rb") as file:
            head = file.read(_MAX_HEADER_BYTES)
        try:
            header = _parse_header(head)
        except ScanError:
            return 0  # read reports the error
        size = path.stat().st_size
        if header.data == "ascii":
            points = min(header.points, size, 2 * self.max_rows)
            return points * MEMORY_A_POINT + min(size, 2 * _BLOCK_CHARACTERS) * MEMORY_A_CHARACTER
        plausible = min(header.points, _MAX_LZF_RATIO * size)  # read refuses a false count
        unpacked = size + plausible * header.row_bytes if header.data != "binary" else min(size, 2 * BLOCK_BYTES)
        return unpacked + min(plausible, self.max_rows) * MEMORY_A_POINT

    def read(self, path: Path) -> list[RawCloud | np.ndarray]:
        """The file's points, one cloud (N, 3) float64; pixels without depth stay in as NaN rows.

        The sensor stood at the VIEWPOINT, unless that is the identity, which every writer puts there; then it stood at
        the origin if the cloud is organised (a depth picture of several rows), and else nowhere known.

        Raises:
            ScanError: no PCD file, no x, y, z, or a header that promises another size than the file has.
        """
        with path.open("rb") as file:
            header = _parse_header(file.read(_MAX_HEADER_BYTES))
        if header.points == 0:
            return [np.empty((0, 3))]
        pose = _parse_viewpoint(header)
        note = trailing_bytes_note(_check_size(header, path))
        plan = plan_arrays(header.widths, self.wants)
        points, columns = (_load_ascii if header.data == "ascii" else _load_binary)(header, path, plan, self.max_rows)
        sensor = None if pose is None else _turn_to_points(pose, points)
        total = header.points if len(points) < header.points else None
        return [plan.fill(RawCloud(points, sensor, total, note), columns)]


@dataclass(frozen=True)
class _Header:
    entries: dict[str, list[str]]
    points: int
    numbers_per_row: int
    row_bytes: int
    data: str
    size: int
    given: dict[str, str]
    """Of each field but x, y, z and padding, its name in the file and that by which it is read."""

    @property
    def widths(self) -> dict[str, int]:
        """Numbers of each of these fields, by its name in the file."""
        return {name: int(self.entries["COUNT"][self.entries["FIELDS"].index(key)]) for name, key in self.given.items()}


def _parse_header(blob: bytes) -> _Header:
    """Parses the header as far as the file's size can be checked before the library allocates memory.

    Raises:
        ScanError: a line is missing or makes no sense.
    """
    entries, size = _read_entries(blob)
    shown = entries["FIELDS"]
    names, given = _normalize_fields(entries)
    try:
        sizes, counts = ([int(word) for word in entries[key]] for key in ("SIZE", "COUNT"))
        width, height, points = (int(entries[key][0]) for key in ("WIDTH", "HEIGHT", "POINTS"))
        row_bytes = sum(size * count for size, count in zip(sizes, counts, strict=True))
        if min(*sizes, *counts) < 1:
            raise ValueError("a field without bytes, or less than none")
    except ValueError as error:
        raise ScanError("the PCD header's numbers cannot be read; export the file again") from error
    if not len(names) == len(sizes) == len(entries["TYPE"]) == len(counts) or min(width, height, points) < 0:
        raise ScanError("the PCD header's FIELDS, SIZE, TYPE and COUNT do not go together; export the file again")
    if any(names.count(axis) != 1 or counts[names.index(axis)] != 1 for axis in "xyz"):
        raise ScanError(f"the PCD file needs the fields x, y and z once each, got {' '.join(shown)}; export it again")
    _check_field_types(names, entries)
    if width * height != points:
        raise ScanError(f"the PCD header says WIDTH {width} x HEIGHT {height} but POINTS {points}; mend the header")
    return _Header(entries, points, sum(counts), row_bytes, entries["DATA"][0].lower(), size, given)


def _read_entries(blob: bytes) -> tuple[dict[str, list[str]], int]:
    """The words of each header line by its keyword, COUNT included, and the size of the header in bytes.

    Raises:
        ScanError: a line is missing.
    """
    entries: dict[str, list[str]] = {}
    size = 0
    for line in blob[:_MAX_HEADER_BYTES].splitlines(keepends=True):
        size += len(line)
        words = line.decode("utf-8", errors="replace").split()
        if words and not words[0].startswith("#"):
            entries[words[0].upper()] = words[1:]
        if "DATA" in entries:
            break
    missing = [key for key in ("FIELDS", "SIZE", "TYPE", "WIDTH", "HEIGHT", "POINTS", "DATA") if not entries.get(key)]
    if missing:
        raise ScanError(f"expected a PCD header, its lines {', '.join(missing)} are missing; export the file again")
    entries.setdefault("COUNT", ["1"] * len(entries["FIELDS"]))
    return entries, size


def _check_field_types(names: list[str], entries: dict[str, list[str]]) -> None:
    """Raises ScanError if a field has a combination of TYPE and SIZE that PCD does not define."""
    for name, kind, each in zip(names, entries["TYPE"], entries["SIZE"], strict=True):
        if kind + each not in _FIELD_TYPES:
            raise ScanError(
                f"the PCD field {name} has TYPE {kind} and SIZE {each}, expected F of 4 or 8 bytes, or I "
                "or U of 1, 2, 4 or 8; export the file again"
            )


def _normalize_fields(entries: dict[str, list[str]]) -> tuple[list[str], dict[str, str]]:
    """Gives each field of the header a unique name, in place; returns these, and by their given names all but x, y, z.

    Fields of COUNT 0, which take no bytes, are removed, as PCL's reader does. Axes may be capitals in the file, and
    several padding fields may share the name ``_``.
    """
    keys = ("FIELDS", "SIZE", "TYPE", "COUNT")
    if len({len(entries[key]) for key in keys}) == 1:
        rows = [row for row in zip(*(entries[key] for key in keys), strict=True) if row[3] != "0"]
        entries.update({key: [row[index] for row in rows] for index, key in enumerate(keys)})
    given = names = entries["FIELDS"]
    if set(names).isdisjoint("xyz"):
        names = [name.lower() if name in ("X", "Y", "Z") else name for name in names]
    unique = [name if name in ("x", "y", "z") else f"field{index}" for index, name in enumerate(names)]
    entries["FIELDS"] = unique
    shown = {name: key for name, key in zip(given, unique, strict=True) if key not in ("x", "y", "z") and name != "_"}
    return unique, shown


def _parse_viewpoint(header: _Header) -> Sensor | None:
    """The sensor's pose in the header; None if the header gives none.

    Raises:
        ScanError: a VIEWPOINT that is no position and rotation.
    """
    words = header.entries.get("VIEWPOINT", ["0", "0", "0", "1", "0", "0", "0"])
    try:
        numbers = np.array([float(word) for word in words])
    except ValueError:
        numbers = np.empty(0)
    if numbers.shape != (7,) or not np.isfinite(numbers).all():
        raise ScanError(f"expected the PCD VIEWPOINT as tx ty tz qw qx qy qz, got {' '.join(words)!r}; mend the header")
    position, quaternion = numbers[:3], numbers[3:]
    length = float(np.linalg.norm(quaternion))
    turn = quaternion / length if length > 0 else np.array([1.0, 0.0, 0.0, 0.0])  # no rotation at all: left unset
    if int(header.entries["HEIGHT"][0]) <= 1 and not position.any() and abs(turn[0]) > 1 - 1e-9:
        return None
    return Sensor(position, quaternion_rotations(turn[None])[0])


def _turn_to_points(sensor: Sensor, points: np.ndarray) -> Sensor:
    """The sensor, facing its points: PCD does not define whether it looks along +Z (OpenCV) or -Z (OpenGL).

    If its points lie behind it, its axes are OpenGL's; a half turn about its X axis makes them OpenCV's.
    """
    ahead = (points[np.isfinite(points).all(1)] - sensor.position) @ sensor.rotation[:, 2]
    if len(ahead) and (ahead < 0).mean() > 0.98:
        return replace(sensor, rotation=sensor.rotation * [1.0, -1.0, -1.0])
    return sensor


def _check_size(header: _Header, path: Path) -> int:
    """The number of trailing bytes behind binary points.

    Raises:
        ScanError: the file's size does not fit what its header promises.
    """
    full, size = header.points * header.row_bytes, path.stat().st_size - header.size
    promise = f"the PCD header promises {header.points} points of {header.row_bytes} bytes ({header.data})"
    match header.data:
        case "ascii":
            fits = size >= header.points * header.numbers_per_row * 2 - 1
        case "binary":  # a field that the header has lost is a byte a point at least
            if full < size < full + _PAGE_BYTES and not any(_read_part(path, header.size + full, size - full)):
                return 0
            return check_trailing_bytes(promise, full, size, min(header.points - 1, MAX_TRAILING_BYTES))
        case "binary_compressed" | "binaryscompressed":
            packed, unpacked = struct.unpack("<II", _read_part(path, header.size, 8)) if size >= 8 else (0, 0)
            fits = 0 < packed <= size - 8 and unpacked == full and unpacked <= _MAX_LZF_RATIO * packed
        case _:
            raise ScanError(f"PCD data is ascii, binary or binary_compressed, got {header.data!r}; export it again")
    if not fits:
        raise ScanError(
            f"{promise}, which {size} bytes do not hold; the file is cut short or its header is wrong: export it again"
        )
    return 0


def _read_part(path: Path, start: int, size: int) -> bytes:
    with path.open("rb") as file:
        file.seek(start)
        return file.read(size)


def _load_binary(
    header: _Header, path: Path, plan: ArrayFields, max_rows: int
) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Points (M, 3) float64, and the planned fields, of a file whose size has been checked; very many are subsampled.

    Raises:
        ScanError: the packed data are damaged.
    """
    entries = header.entries
    kinds = [kind.lower() + size for kind, size in zip(entries["TYPE"], entries["SIZE"], strict=True)]
    row = row_dtype(entries["FIELDS"], kinds, [int(word) for word in entries["COUNT"]])
    wanted = [*"xyz", *(header.given[name] for name in plan.arrays)]
    read = read_rows if header.data == "binary" else read_packed
    try:
        columns = read(path, header.size, row, header.points, wanted, np.random.default_rng(0), max_rows)
    except Exception as error:  # the library raises errors of any type on damaged files
        raise ScanError(f"the PCD points cannot be read ({error_reason(error)}); export the file again") from error
    points = stack_float64([columns[axis] for axis in "xyz"])
    return points, {name: columns[header.given[name]] for name in plan.arrays}


def _load_ascii(
    header: _Header, path: Path, plan: ArrayFields, max_rows: int
) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Points (N, 3) float64, and the planned fields, of rows of numbers, read in blocks of lines.

    Raises:
        ScanError: another number of rows than promised, or a row with other numbers.
    """
    names = [*"xyz", *(header.given[name] for name in plan.arrays)]
    counts = [int(word) for word in header.entries["COUNT"]]
    starts = np.cumsum([0, *counts])
    where = {name: header.entries["FIELDS"].index(name) for name in names}
    spans = {name: range(starts[field], starts[field + 1]) for name, field in where.items()}
    columns = [column for span in spans.values() for column in span]
    table = _parse_rows(header, path, columns, max_rows)
    ends = np.cumsum([len(span) for span in spans.values()])
    parts = dict(zip(names, np.split(table, ends[:-1], axis=1), strict=True))
    fields = {name: _typed(header, where[header.given[name]], parts[header.given[name]]) for name in plan.arrays}
    return np.ascontiguousarray(table[:, :3]), fields


def _parse_rows(header: _Header, path: Path, columns: Sequence[int], max_rows: int) -> np.ndarray:
    """Numbers (M, len(columns)) float64 of those columns of the rows, of at most `max_rows`."""
    parts, came = ThinnedRows(len(columns), max_rows, header.points), 0
    with path.open("rb") as file:
        file.seek(header.size)
        while lines := file.readlines(_BLOCK_CHARACTERS):
            rows = [line for line in lines if line.strip()]
            if rows:
                parts.add(_parse_block(header, rows, columns, came))
            came += len(rows)
    if came != header.points:
        raise ScanError(f"the PCD header promises {header.points} points, {came} lines came; export it again")
    return parts.table()


def _parse_block(header: _Header, rows: list[bytes], columns: Sequence[int], before: int) -> np.ndarray:
    """Numbers of some rows, of which `before` others come first in the file."""
    try:
        table = np.loadtxt(rows, np.float64, comments=None, ndmin=2)
        if table.shape[1] == header.numbers_per_row:
            return table[:, list(columns)]
    except ValueError:
        pass  # the error below names the row, if it is one of another length
    words = [row.split() for row in rows]
    for number, row in enumerate(words, start=before + 1):
        if len(row) != header.numbers_per_row:
            raise ScanError(
                f"PCD point {number}: expected {header.numbers_per_row} numbers, got {len(row)}; export it again"
            )
    try:
        return np.array([[float(row[column]) for column in columns] for row in words])
    except ValueError as error:
        raise ScanError(f"the PCD points cannot be read ({error}); export the file again") from error


def _typed(header: _Header, field: int, values: np.ndarray) -> np.ndarray:
    """The values (N, C) of a field, (N,) if it has one component; integers of the text are made such again."""
    values = values[:, 0] if values.shape[1] == 1 else values
    kind = np.dtype(header.entries["TYPE"][field].lower() + header.entries["SIZE"][field])
    if kind.kind in "iu" and np.isfinite(values).all():
        limits = np.iinfo(kind)
        values = np.clip(values, float(limits.min), float(limits.max)).astype(kind)
    return values
