"""Points of LAS and LAZ files in real-world coordinates, without those that are marked as noise."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from z2p_core.errors.messages import error_reason
from z2p_core.formats.geographic import project_degrees
from z2p_core.formats.row_subsampling import MAX_ROWS
from z2p_core.interfaces import MEMORY_A_POINT, RawCloud, Reader, ScanError
from z2p_renderer.plugins.readers._helpers.las_dimensions import (
    class_names,
    dimension_units,
    dimension_values,
    selected_dimensions,
)
from z2p_renderer.plugins.readers._helpers.las_header import check_records, promised_points
from z2p_renderer.plugins.readers._helpers.lazy_import import import_lazily
from z2p_renderer.plugins.readers._helpers.point_fields import FieldPlan, Wants, plan_fields

_CHUNK_POINTS = 1_000_000
"""Points that are unpacked at a time: a header with a false count costs one chunk, not all memory."""
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
    version = "3"
    takes_columns = False
    packages = ("laspy", "lazrs")
    suffixes = (".las", ".laz")

    def memory(self, path: Path) -> int:
        """Memory for the points that the header promises, which may be compressed far more than in other formats."""
        count = promised_points(path)
        return min(count, MAX_ROWS) * MEMORY_A_POINT + min(count, _CHUNK_POINTS) * _UNPACKED_POINT_BYTES

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
            return [_read_points(path, self.wants)]
        except (ScanError, ImportError):
            raise
        except Exception as error:  # laspy and lazrs raise errors of any type
            raise _unreadable_error(error) from error
        except BaseException as error:
            if type(error).__name__ != "PanicException":  # raised by lazrs on damaged files; no Exception
                raise
            raise _unreadable_error(error) from error


@dataclass
class _ChunkTotals:
    """Points and counts that are collected from the chunks of a file."""

    parts: list[np.ndarray] = field(default_factory=lambda: [np.empty((0, 3))])
    points_read: int = 0
    noise: int = 0
    withheld: int = 0
    unmeasured: int = 0
    columns: dict[int, list[np.ndarray]] = field(default_factory=dict)
    """The parts of each column that is needed, by its index among the file's dimensions."""

    @property
    def note(self) -> str:
        """The note for the user."""
        parts = (
            f"{self.noise} points of noise (classes 7 and 18) left out" if self.noise else "",
            f"{self.withheld} withheld points left out" if self.withheld else "",
            f"{self.unmeasured} points that stand for no measurement left out" if self.unmeasured else "",
        )
        return "; ".join(filter(None, parts))


def _read_points(path: Path, wants: Wants) -> RawCloud:
    laspy = import_lazily("laspy")
    single = laspy.LazBackend.Lazrs  # the parallel one believes the chunk sizes of a damaged file, and aborts on them
    with laspy.open(path, laz_backend=single) as reader:
        selection = selected_dimensions(laspy, reader.header.point_format.dimension_names, wants)
    with laspy.open(path, laz_backend=single, decompression_selection=selection) as reader:
        header = reader.header
        count, row = header.point_count, header.point_format.size
        body = path.stat().st_size - header.offset_to_point_data
        if body < 0 or (not header.are_points_compressed and count * row > body):
            raise ScanError(
                f"the LAS header promises {count} points of {row} bytes, {max(body, 0)} bytes follow it; "
                "the file is cut short or its header is wrong: export it again"
            )
        names = list(header.point_format.dimension_names)
        plan = plan_fields(names, wants, [names.index(axis) for axis in "XYZ"])
        step = -(-count // MAX_ROWS) if count else 1
        totals = _ChunkTotals(columns={column: [] for column in plan.columns})
        rng = np.random.default_rng(0)
        for chunk in reader.chunk_iterator(_chunk_points(step)):
            rows = _add_chunk(chunk, totals, step, rng)
            for column, parts in totals.columns.items():
                parts.append(dimension_values(chunk, names[column])[rows])
        degrees = _is_in_degrees(header)
    points = np.concatenate(totals.parts)
    if totals.points_read != count:
        raise ScanError(f"the LAS header promises {count} points, {totals.points_read} came; export the file again")
    points, degrees_note = project_degrees(points) if degrees else (points, "")
    note = "; ".join(filter(None, (totals.note, degrees_note)))
    cloud = RawCloud(
        points,
        total=count if step > 1 else None,
        note=note,
        units=dimension_units(names),
        class_names=class_names(legacy=header.point_format.id < 6),
    )
    return _with_fields(cloud, plan, totals)


def _with_fields(cloud: RawCloud, plan: FieldPlan, totals: _ChunkTotals) -> RawCloud:
    """The cloud with the fields that are needed, of the columns that were collected."""
    columns = {column: np.concatenate(parts) if parts else np.empty(0) for column, parts in totals.columns.items()}
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


def _add_chunk(chunk: Any, totals: _ChunkTotals, step: int, rng: np.random.Generator) -> np.ndarray:
    """Adds the valid points of a chunk, one at random of every `step`, and returns their indices in it."""
    totals.points_read += len(chunk)
    raw = [np.asarray(chunk[axis]) for axis in "XYZ"]
    kept = np.ones(len(chunk), dtype=bool)
    classes = np.asarray(chunk.classification)
    noise = np.logical_or.reduce([classes == code for code in _NOISE_CLASSES])
    withheld = np.asarray(chunk.withheld).astype(bool) & ~noise
    unmeasured = np.logical_or.reduce([column == value for column in raw for value in _INVALID_INTEGERS
                                       if value in (column.min(), column.max())] or [~kept])  # fmt: skip
    at_offset = (raw[0] == 0) & (raw[1] == 0) & (raw[2] == 0)
    if at_offset.sum() >= _MIN_UNMEASURED_AT_OFFSET:
        unmeasured |= at_offset
    if not (noise | withheld).all():  # a file of noise alone is drawn
        totals.noise += int(noise.sum())
        totals.withheld += int(withheld.sum())
        kept &= ~noise & ~withheld
    totals.unmeasured += int((unmeasured & kept).sum())
    kept &= ~unmeasured
    rows = np.flatnonzero(kept)
    if step > 1:
        start = np.arange(0, len(rows), step)
        rows = rows[start + (rng.random(len(start)) * np.minimum(step, len(rows) - start)).astype(np.int64)]
    points = np.empty((len(rows), 3))
    for axis, column in enumerate(raw):
        points[:, axis] = column[rows] * chunk.scales[axis] + chunk.offsets[axis]
    totals.parts.append(points)
    return rows


def _chunk_points(step: int) -> int:
    """Points of a chunk: a whole number of runs of `step`, of each of which one point is kept."""
    return max(_CHUNK_POINTS // step, 1) * step


def _unreadable_error(error: BaseException) -> ScanError:
    return ScanError(f"the LAS file cannot be read ({error_reason(error)}); export it again")
