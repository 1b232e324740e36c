"""Points of LAS and LAZ files in real-world coordinates, without those that are marked as noise."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from z2p_core.errors.messages import error_reason
from z2p_core.formats.geographic import project_degrees
from z2p_core.formats.row_subsampling import stratified_rows
from z2p_core.interfaces import MEMORY_A_POINT, RawCloud, Reader, ScanError
from z2p_core.parallel import parallel_map
from z2p_renderer.plugins.readers._helpers.las_dimensions import (
    class_names,
    dimension_units,
    dimension_values,
    selected_dimensions,
)
from z2p_renderer.plugins.readers._helpers.las_header import check_records, packed_chunk_points, promised_points
from z2p_renderer.plugins.readers._helpers.lazy_import import import_lazily
from z2p_renderer.plugins.readers._helpers.point_fields import FieldPlan, Wants, plan_fields

_CHUNK_POINTS = 1_000_000
"""Points that are unpacked at a time: a header with a false count costs one chunk, not all memory."""
_MAX_POINTS_A_BYTE = 100
"""No packing holds more points in a byte: a header that promises more is false."""
_UNPACKED_POINT_BYTES = 200
"""Upper bound of the memory for a point of a chunk."""
_NOISE_CLASSES = (7, 18)
"""Classification codes of low and high noise in the LAS standard."""
_INVALID_INTEGERS = (-(2**31), 2**31 - 1)
"""Integer coordinates that writers store for NaN and for numbers that are too large."""
_GEOGRAPHIC_GEO_KEY = (1024, 2)
"""GeoTIFF key and value (GTModelTypeGeoKey, ModelTypeGeographic) of coordinates in degrees."""
_MIN_UNMEASURED_AT_OFFSET = 20
"""From this number of points exactly at the offset on, such points stand for missing measurements."""


class Las(Reader):
    """Airborne and terrestrial laser scans, COPC too (laspy, lazrs); noise and withheld points are left out."""

    name = "las"
    version = "4"
    takes_columns = False
    packages = ("laspy", "lazrs")
    suffixes = (".las", ".laz")

    def memory(self, path: Path) -> int:
        """Memory for the points that the header promises, which may be compressed far more than in other formats."""
        count = promised_points(path)
        return min(count, self.max_rows) * MEMORY_A_POINT + min(count, 2 * _CHUNK_POINTS) * _UNPACKED_POINT_BYTES

    def is_fragile(self, path: Path) -> bool:
        """Where points are packed: lazrs ends the process on some damaged chunks."""
        with path.open("rb") as file:
            head = file.read(105).ljust(105, b"\0")
        return head[:4] == b"LASF" and bool(head[104] & 0xC0)

    def read(self, path: Path) -> list[RawCloud | np.ndarray]:
        """The file's points, one cloud (N, 3) float64, scale and offset applied in float64 (UTM keeps its digits).

        Very large files are subsampled.

        Raises:
            ScanError: no LAS file, or fewer points than its header promises.
        """
        if path.stat().st_size == 0:
            return [np.empty((0, 3))]
        check_records(path)
        try:
            return [_read_points(path, self.wants, self.max_rows)]
        except (ScanError, ImportError):
            raise
        except Exception as error:  # laspy and lazrs raise errors of any type
            raise _unreadable_error(error) from error
        except BaseException as error:
            if type(error).__name__ != "PanicException":  # raised by lazrs on damaged files; no Exception
                raise
            raise _unreadable_error(error) from error


@dataclass(frozen=True)
class _Chunk:
    """What is kept of some consecutive points."""

    points: np.ndarray
    """(N, 3) float64."""
    at_offset: np.ndarray
    """Mask (N,) of the points exactly at the offset."""
    columns: dict[int, np.ndarray]
    """The values (N,) of each column that is needed, by its index among the file's dimensions."""
    points_read: int
    noise: int
    withheld: int
    unmeasured: int
    """How many points were left out, and why; of a chunk of noise alone, none of these was."""
    only_noise: bool
    """Whether all its points are noise or withheld; they are kept for a file of noise alone."""


def _note(chunks: Sequence[_Chunk], at_offset: int) -> str:
    """The note for the user on what was left out, also of `at_offset` points at the offset."""
    noise, withheld = (sum(getattr(chunk, name) for chunk in chunks) for name in ("noise", "withheld"))
    unmeasured = sum(chunk.unmeasured for chunk in chunks) + at_offset
    parts = (
        f"{noise} points of noise (classes 7 and 18) left out" if noise else "",
        f"{withheld} withheld points left out" if withheld else "",
        f"{unmeasured} points that stand for no measurement left out" if unmeasured else "",
    )
    return "; ".join(filter(None, parts))


def _read_points(path: Path, wants: Wants, max_rows: int) -> RawCloud:
    laspy = import_lazily("laspy")
    with _open(laspy, path) as reader:
        header = reader.header
        _check_length(path, header)
        names, count = list(header.point_format.dimension_names), header.point_count
        units, legacy, degrees = dimension_units(names), header.point_format.id < 6, _is_in_degrees(header)
        packed = packed_chunk_points(header)
    plan = plan_fields(names, wants, [names.index(axis) for axis in "XYZ"])
    step = max(count / max_rows, 1.0)
    size = -(-max(_CHUNK_POINTS, 1) // packed) * packed  # else the start of a packed chunk is unpacked twice
    selection = selected_dimensions(laspy, names, wants)
    needed = {column: names[column] for column in plan.columns}

    def read_chunk(start: int) -> _Chunk:
        with _open(laspy, path, selection) as reader:
            if start:
                reader.seek(start)
            return _valid_points(reader.read_points(min(size, count - start)), needed, step, start)

    chunks = [read_chunk(0)] if count else []
    came = chunks[0].points_read if chunks else 0
    if came == min(size, count) and count <= _MAX_POINTS_A_BYTE * path.stat().st_size:
        chunks += _both_cores([partial(read_chunk, start) for start in range(size, count, size)])
        came = sum(chunk.points_read for chunk in chunks)
    if came != count:
        raise ScanError(f"the LAS header promises {count} points, {came} came; export the file again")
    points, columns, note = _joined(chunks, plan)
    points, degrees_note = project_degrees(points) if degrees else (points, "")
    cloud = RawCloud(points, total=count if step > 1 else None, note="; ".join(filter(None, (note, degrees_note))),
                     units=units, class_names=class_names(legacy=legacy))  # fmt: skip
    return _with_fields(cloud, plan, columns)


def _open(laspy: Any, path: Path, selection: Any = None) -> Any:
    """A reader of the file. Its threads are ours: lazrs's own believe a damaged file's chunk sizes, and abort."""
    layers = {} if selection is None else {"decompression_selection": selection}
    return laspy.open(path, laz_backend=laspy.LazBackend.Lazrs, **layers)


def _check_length(path: Path, header: Any) -> None:
    """Raises ScanError if the file is too short for the points of its header."""
    count, row = header.point_count, header.point_format.size
    body = path.stat().st_size - header.offset_to_point_data
    if body < 0 or (not header.are_points_compressed and count * row > body):
        raise ScanError(f"the LAS header promises {count} points of {row} bytes, {max(body, 0)} bytes follow it; "
                        "the file is cut short or its header is wrong: export it again")


def _both_cores(works: Sequence[Callable[[], _Chunk]]) -> list[_Chunk]:
    """The chunks of these works; after an error, of any type, the others are not begun."""
    failures: list[BaseException] = []

    def guarded(work: Callable[[], _Chunk]) -> list[_Chunk]:
        try:
            return [] if failures else [work()]
        except BaseException as error:
            failures.append(error)
            return []

    chunks = [chunk for found in parallel_map([partial(guarded, work) for work in works]) for chunk in found]
    if failures:
        raise failures[0]
    return chunks


def _joined(chunks: Sequence[_Chunk], plan: FieldPlan) -> tuple[np.ndarray, dict[int, np.ndarray], str]:
    """Points (N, 3) of all chunks, their columns, and the note on what was left out."""
    good = [chunk for chunk in chunks if not chunk.only_noise] or list(chunks)  # a file of noise alone is drawn
    points = np.concatenate([np.empty((0, 3)), *(chunk.points for chunk in good)])
    columns = {column: np.concatenate([chunk.columns[column] for chunk in good]) if good else np.empty(0)
               for column in plan.columns}  # fmt: skip
    at_offset = np.concatenate([np.empty(0, bool), *(chunk.at_offset for chunk in good)])
    left_out = int(at_offset.sum())
    if left_out < _MIN_UNMEASURED_AT_OFFSET:
        left_out = 0
    else:
        points, columns = points[~at_offset], {column: values[~at_offset] for column, values in columns.items()}
    return points, columns, _note(good, left_out)


def _with_fields(cloud: RawCloud, plan: FieldPlan, columns: dict[int, np.ndarray]) -> RawCloud:
    """The cloud with the fields that are needed, of the columns that were collected."""
    color = plan.columns_of.get("rgb", ())
    if "rgb" in plan.needed and not any(columns[column].any() for column in color):
        plan = plan.without("rgb")  # most writers have a form with colors, and leave these 0
    return plan.fill(cloud, columns)


def _is_in_degrees(header: Any) -> bool:
    """Whether the header says that x and y are longitude and latitude, by keys of GeoTIFF's or in words."""
    for record in header.vlrs:
        if any((key.id, key.value_offset) == _GEOGRAPHIC_GEO_KEY for key in getattr(record, "geo_keys", ())):
            return True
        words = str(getattr(record, "string", ""))
        if "PROJC" not in words and any(kind in words for kind in ("GEOGCS", "GEOGCRS", "GEODCRS")):
            return True
    return False


def _valid_points(chunk: Any, needed: Mapping[int, str], step: float, start: int) -> _Chunk:
    """The valid points of laspy's records, one at random of every `step`, with the needed dimensions; `start` is the
    index of the first record in the file."""
    raw = [np.asarray(chunk[axis]) for axis in "XYZ"]
    classes = np.asarray(chunk.classification)
    noise = np.logical_or.reduce([classes == code for code in _NOISE_CLASSES])
    withheld = np.asarray(chunk.withheld).astype(bool) & ~noise
    unmeasured = _invalid_mask(raw)
    only_noise = bool((noise | withheld).all())
    kept = ~unmeasured if only_noise else ~(unmeasured | noise | withheld)
    rows = np.flatnonzero(kept)
    if step > 1:
        rows = rows[stratified_rows(len(rows), step, np.random.default_rng(start))]
    points = np.empty((len(rows), 3))
    for axis, column in enumerate(raw):
        points[:, axis] = column[rows] * chunk.scales[axis] + chunk.offsets[axis]
    at_offset = np.logical_and.reduce([column[rows] == 0 for column in raw])
    columns = {column: dimension_values(chunk, name)[rows] for column, name in needed.items()}
    counts = (0, 0) if only_noise else (int(noise.sum()), int(withheld.sum()))
    without = unmeasured if only_noise else unmeasured & ~(noise | withheld)
    return _Chunk(points, at_offset, columns, len(chunk), *counts, int(without.sum()), only_noise)


def _invalid_mask(raw: Sequence[np.ndarray]) -> np.ndarray:
    """Mask (N,) of the points with an integer coordinate that stands for none."""
    invalid = np.zeros(len(raw[0]), dtype=bool)
    for column in raw:
        for value in _INVALID_INTEGERS if len(column) else ():
            if value in (column.min(), column.max()):
                invalid |= column == value
    return invalid


def _unreadable_error(error: BaseException) -> ScanError:
    return ScanError(f"the LAS file cannot be read ({error_reason(error)}); export it again")
