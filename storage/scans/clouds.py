"""Reads scans through the reader plugins and keeps the points that can be drawn."""

from __future__ import annotations

import stat
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from z2p_core.formats.geographic import metres_from_degrees
from z2p_core.formats.tables.missing_values import measured_mask
from z2p_core.interfaces import MEMORY_A_BYTE, RawCloud, Reader, ScanError, Sensor
from z2p_core.linalg import bounding_box
from z2p_renderer.storage.files.printable_names import printable
from z2p_renderer.storage.meshes import Mesh, check_openable, read_mesh, write_cloud, write_mesh
from z2p_renderer.storage.scans.duplicate_points import drop_duplicates
from z2p_renderer.storage.scans.find_scans import find_scans
from z2p_renderer.storage.scans.isolated_reading import can_read_in_subprocess, failure_message, read_in_subprocess
from z2p_renderer.storage.scans.memory_limit import free_memory
from z2p_renderer.storage.scans.reader_choice import format_suffix, readable_suffixes, reader_for
from z2p_renderer.storage.scans.silenced_libraries import quiet
from z2p_renderer.storage.scans.unpack import unpacked_file
from z2p_renderer.storage.scans.unsupported_formats import advice_by_content
from z2p_renderer.storage.scans.up_hints import with_up_hints

__all__ = ["Mesh", "PointFields", "Scan", "find_scans", "format_suffix", "read_clouds", "read_each",
           "read_mesh", "readable_suffixes", "scan_from_raw", "usable", "write_cloud", "write_mesh"]  # fmt: skip

MIN_POINTS = 3
"""A scan needs at least this many finite points."""
MAX_COORDINATE = float(np.finfo(np.float32).max)
"""Coordinates of this magnitude or more are invalid: raster formats write such values for missing measurements."""


@dataclass(frozen=True)
class PointFields:
    """What else a file has of each point; duplicates of points are included. See the same names of `RawCloud`."""

    points: np.ndarray
    """(K, 3) float64, finite, in the units and axes of `Scan.points`."""
    values: Mapping[str, np.ndarray] = field(default_factory=dict)
    """(K,) or (K, 3) by name, of any numeric type, in the order of `points`."""
    names: tuple[str, ...] = ()
    """All names that the file has, read or not."""
    class_names: Mapping[str, Mapping[int, str]] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    color_kind: str = ""


@dataclass(frozen=True)
class Scan:
    """One cloud: points (N, 3) float64, finite, in the file's own units."""

    points: np.ndarray
    dropped: int
    """How many rows were left out because a coordinate was not finite."""
    label: str
    """Empty, or ``[3]`` for the fourth cloud of a batch file."""
    sensor: Sensor | None = None
    """The sensor's pose, if the file gives it."""
    total: int | None = None
    """How many points the file has, if `points` are a subsample of them."""
    repeated: int = 0
    """How many finite rows were left out as duplicates or fill values."""
    note: str = ""
    """What the reader assumed or left out, in words."""
    up: str = ""
    """The file's up axis, if known, and why; see `RawCloud` for this and the fields below."""
    up_reason: str = ""
    up_certain: bool = True
    upward: np.ndarray | None = None
    seen_from: np.ndarray | None = None
    fields: PointFields | None = None
    """What else is known of the points; None where only they were given."""


def read_clouds(
    path: Path, columns: tuple[str, ...] | None = None, wanted: Collection[str] | None = ("rgb",),
    max_rows: int | None = None,
) -> list[Scan]:  # fmt: skip
    """Reads all clouds of a file: one, or those of a batch. The suffix, in any case, selects the reader.

    A .gz file is unpacked on the way. `columns` names the columns of a text file, `wanted` the fields that are needed
    beside x, y and z (None for all), `max_rows` how many points are kept of a large file.

    Raises:
        ScanError: there is no such file or no reader for its suffix, the file is damaged or too large for the free
            memory, or a cloud has fewer than three finite points or all at one place. The message is one line that
            names the file.
    """
    scans = []
    for scan in read_each(path, columns, wanted, max_rows):
        if isinstance(scan, ScanError):
            raise scan
        scans.append(scan)
    return scans


def read_each(
    path: Path, columns: tuple[str, ...] | None = None, wanted: Collection[str] | None = ("rgb",),
    max_rows: int | None = None,
) -> list[Scan | ScanError]:  # fmt: skip
    """Reads all clouds of a file like `read_clouds`, but returns the error of an unusable cloud in its place.

    Raises:
        ScanError: the file as a whole cannot be read.
    """
    try:
        if stat.S_ISDIR(_mode(path)):
            raise ScanError("expected a file, got a folder; name one in it, or give the folder to z2p run-inference")
        reader = reader_for(path)
        reader.columns, reader.wanted = columns, wanted
        reader.max_rows = max_rows or reader.max_rows
        check_openable(path)
        free = free_memory()
        with unpacked_file(path, None if free is None else free // MEMORY_A_BYTE) as plain:
            if advice := advice_by_content(plain, plain.suffix.lower()):
                raise ScanError(advice)
            _check_memory(reader, plain, free)
            clouds = with_up_hints(_run_reader(reader, plain, free), plain, path)
        if columns and not reader.takes_columns:
            ignored = f"--columns ignored, which {format_suffix(path)} files do not take"
            clouds = [replace(cloud, note="; ".join(filter(None, [cloud.note, ignored]))) for cloud in clouds]
        labels = [f"[{index}]" for index in range(len(clouds))] if len(clouds) > 1 else [""]
        return [_scan_or_error(cloud, label, path) for cloud, label in zip(clouds, labels, strict=True)]
    except ScanError as error:
        raise ScanError(f"{printable(path)}: {error}") from error


def usable(points: np.ndarray, label: str = "") -> Scan:
    """Makes a scan from points (N, 3) as `read_clouds` does from a file's; `label` names it within its batch.

    Raises:
        ScanError: there are fewer than three finite points, or all are at one place.
    """
    return scan_from_raw(RawCloud(np.asarray(points, dtype=np.float64)), label)


def scan_from_raw(raw: RawCloud, label: str) -> Scan:
    """The scan of a cloud: without invalid, duplicate and fill rows, in metres if it was in degrees.

    `label` names it within its batch.

    Raises:
        ScanError: there are fewer than three finite points, or all are at one place.
    """
    cloud = raw.points
    where = f"cloud {label}: " if label else ""
    if len(cloud) == 0:
        raise ScanError(f"{where}the cloud is empty; expected at least {MIN_POINTS} points")
    points, fields, dropped = cloud, dict(raw.fields), 0
    if not _are_all_finite(cloud):
        finite = (np.abs(cloud) < MAX_COORDINATE).all(axis=1)
        dropped = int(len(cloud) - finite.sum())
        points, fields = cloud[finite], _select_rows(fields, finite)
    if len(points) == 0:
        raise ScanError(f"{where}none of the {len(cloud)} points is a place: each has nan, infinity or a number above "
                        f"{MAX_COORDINATE:.1e}; the scan holds no measurement")
    if len(points) < MIN_POINTS:
        raise ScanError(f"{where}expected at least {MIN_POINTS} finite points, got {len(points)} of {len(cloud)}")
    points, fields, missing_note = _drop_missing(points, fields)
    if np.array_equal(*bounding_box(points)):
        raise ScanError(f"{where}all {len(points)} points are at one place; there is nothing to see")
    metres, degrees_note = metres_from_degrees(points) if raw.sensor is None else (points, "")
    if metres is not points and not (raw.up and raw.up_certain):
        raw = replace(raw, up="+Z", up_reason="z is a height above places on the globe",
                      up_certain=True)
    points = metres
    unique = drop_duplicates(points)
    note = "; ".join(filter(None, (raw.note, missing_note, degrees_note)))
    return Scan(unique, dropped, label, raw.sensor, raw.total, len(points) - len(unique), note, raw.up, raw.up_reason,
                raw.up_certain, raw.upward, raw.seen_from, _point_fields(raw, points, fields))


def reader_of(path: Path) -> type[Reader]:
    """The class of the reader for a file of that name.

    Raises:
        ScanError: no reader claims its suffix, or several do.
    """
    return type(reader_for(path))


def _check_memory(reader: Reader, path: Path, free: int | None) -> None:
    """Raises ScanError if the file will not fit into memory: otherwise the system would kill the whole run."""
    with quiet():
        needed = reader.memory(path)
    if free is not None and needed > free:
        raise ScanError(f"would take about {needed / 1e9:.1f} GB of memory, and {free / 1e9:.1f} GB are free; thin it "
                        "out first, a million points are plenty for a picture")


def _run_reader(reader: Reader, path: Path, free: int | None) -> list[RawCloud]:
    """Runs the reader. Whatever a third-party reader raises becomes a ScanError, so that it cannot end the batch."""
    try:
        if can_read_in_subprocess(reader) and reader.is_fragile(path):
            needed = 2 * reader.memory(path)
            raw_clouds = read_in_subprocess(reader, path, needed if free is None else min(needed, free))
        else:
            with quiet():
                raw_clouds = [cloud if isinstance(cloud, RawCloud) else RawCloud(cloud) for cloud in reader.read(path)]
        clouds = [replace(cloud, points=np.asarray(cloud.points, dtype=np.float64)) for cloud in raw_clouds]
    except ScanError:
        raise
    except Exception as error:  # named, chained and passed on as this file's failure
        raise ScanError(failure_message(reader.name, error)) from error
    if any(cloud.points.ndim != 2 or cloud.points.shape[1] != 3 for cloud in clouds):
        shapes = ", ".join(str(cloud.points.shape) for cloud in clouds[:3])
        raise ScanError(f"the reader {reader.name!r} gave arrays {shapes}, expected (N, 3); its plugin is broken")
    for cloud in clouds:
        _check_field_lengths(cloud, reader)
    if not clouds:
        raise ScanError("the file holds no cloud")
    return clouds


def _check_field_lengths(cloud: RawCloud, reader: Reader) -> None:
    """Raises ScanError if a field of a reader's cloud has not one row for each point."""
    for name, values in cloud.fields.items():
        expected = (len(cloud.points), 3) if name in ("rgb", "normal") else (len(cloud.points),)
        if values.shape != expected:
            raise ScanError(f"the reader {reader.name!r} gave the field {name!r} as {values.shape}, expected "
                            f"{expected}; its plugin is broken")


def _mode(path: Path) -> int:
    """The mode of a file; 0 if it cannot be read."""
    try:
        return path.stat().st_mode
    except (OSError, ValueError):
        return 0


def _scan_or_error(raw: RawCloud, label: str, path: Path) -> Scan | ScanError:
    try:
        return scan_from_raw(raw, label)
    except ScanError as error:
        return ScanError(f"{printable(path)}: {error}")


def _point_fields(raw: RawCloud, points: np.ndarray, fields: dict[str, np.ndarray]) -> PointFields | None:
    """The fields of the points (N, 3) that are left of a cloud; None if its file has none."""
    names = tuple(raw.field_names) or tuple(fields)
    if not names:
        return None
    return PointFields(points, fields, names, raw.class_names, raw.units, raw.color_kind)


def _are_all_finite(cloud: np.ndarray) -> bool:
    """Whether all coordinates of points (N, 3), N >= 1, are numbers below `MAX_COORDINATE`."""
    low, high = bounding_box(cloud)
    return bool((low > -MAX_COORDINATE).all() and (high < MAX_COORDINATE).all())  # nan compares as False


def _select_rows(fields: Mapping[str, np.ndarray], kept: np.ndarray) -> dict[str, np.ndarray]:
    return {name: values[kept] for name, values in fields.items()}


def _drop_missing(
    points: np.ndarray, fields: dict[str, np.ndarray]
) -> tuple[np.ndarray, dict[str, np.ndarray], str]:
    """Removes the points that a no-data value marks as missing, with their fields; and the note for the user."""
    kept = measured_mask(points)
    if kept is None or kept.sum() < MIN_POINTS:
        return points, fields, ""
    left_out = len(points) - int(kept.sum())
    note = f"{left_out} points left out that say -9999 or the like for no measurement"
    return points[kept], _select_rows(fields, kept), note
