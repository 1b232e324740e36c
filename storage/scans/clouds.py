"""Scans on disk: reads them through the reader plugins, and passes on only points that can be used."""

from __future__ import annotations

import stat
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from z2p_core.formats.geographic import local_metres
from z2p_core.formats.tables.missing_values import measured
from z2p_core.interfaces import MEMORY_A_BYTE, RawCloud, Reader, ScanError, Sensor
from z2p_renderer.storage.files.printable_names import printable
from z2p_renderer.storage.meshes import Mesh, check_openable, read_mesh, write_cloud, write_mesh
from z2p_renderer.storage.scans.duplicate_points import drop_duplicates
from z2p_renderer.storage.scans.find_scans import find_scans
from z2p_renderer.storage.scans.isolated_reading import can_read_apart, failure_message, read_apart
from z2p_renderer.storage.scans.memory_limit import free_memory
from z2p_renderer.storage.scans.reader_choice import format_suffix, readable_suffixes, reader_for
from z2p_renderer.storage.scans.silenced_libraries import quiet
from z2p_renderer.storage.scans.unpack import unpacked
from z2p_renderer.storage.scans.unsupported_formats import advice_by_content
from z2p_renderer.storage.scans.up_hints import with_up_hints

__all__ = ["Mesh", "Scan", "find_scans", "format_suffix", "read_clouds", "read_each",
           "read_mesh", "readable_suffixes", "usable", "write_cloud", "write_mesh"]  # fmt: skip

FEWEST_POINTS = 3
LARGEST = float(np.finfo(np.float32).max)
"""What is as large, of either sign, is no coordinate: formats of rasters write it for what was not measured."""


@dataclass(frozen=True)
class Scan:
    """One cloud: points (N, 3) float64, finite, in the file's own units; `dropped` rows were not finite.

    `label` is empty, or ``[3]`` for the fourth cloud of a batch file. `repeated` rows more were left out, which repeat
    others or stand for missing points.
    """

    points: np.ndarray
    dropped: int
    label: str
    sensor: Sensor | None = None
    """Where the cloud was seen from, when the file tells."""
    total: int | None = None
    """How many points the file has, where those here only stand for them."""
    repeated: int = 0
    note: str = ""
    """What the reader took for granted or left out, in words."""
    up: str = ""
    """The file's axis that points up, where the file tells; see `RawCloud`."""
    up_reason: str = ""
    up_certain: bool = True
    upward: np.ndarray | None = None
    seen_from: np.ndarray | None = None


def read_clouds(path: Path, columns: tuple[str, ...] | None = None) -> list[Scan]:
    """The clouds of a file: one, or as many as its batch holds; the reader is found by the suffix, in either case.

    A .gz is unpacked on the way. `columns` names those of a text file.

    Raises:
        ScanError: no such file, no reader for its suffix, a file that is not of its format or too large for the free
            memory, or a cloud without three finite points at two places at least; one line that names the file.
    """
    scans = []
    for scan in read_each(path, columns):
        if isinstance(scan, ScanError):
            raise scan
        scans.append(scan)
    return scans


def read_each(path: Path, columns: tuple[str, ...] | None = None) -> list[Scan | ScanError]:
    """The clouds of a file as `read_clouds` gives them, but in place of one that shows nothing the error that says so.

    Raises:
        ScanError: the file as a whole cannot be read.
    """
    try:
        if stat.S_ISDIR(_mode(path)):
            raise ScanError("expected a file, got a folder; name one in it, or give the folder to z2p run-inference")
        reader = reader_for(path)
        reader.columns = columns
        check_openable(path)
        free = free_memory()
        with unpacked(path, None if free is None else free // MEMORY_A_BYTE) as plain:
            if told := advice_by_content(plain, plain.suffix.lower()):
                raise ScanError(told)
            _check_memory(reader, plain, free)
            clouds = with_up_hints(_clouds(reader, plain, free), plain, path)
        if columns and not reader.takes_columns:
            ignored = f"--columns ignored, which {format_suffix(path)} files do not take"
            clouds = [replace(cloud, note="; ".join(filter(None, [cloud.note, ignored]))) for cloud in clouds]
        labels = [f"[{index}]" for index in range(len(clouds))] if len(clouds) > 1 else [""]
        return [_scan_or_fault(cloud, label, path) for cloud, label in zip(clouds, labels, strict=True)]
    except ScanError as error:
        raise ScanError(f"{printable(path)}: {error}") from error


def usable(points: np.ndarray, label: str = "") -> Scan:
    """The finite rows of points (N, 3), as a scan in float64; `label` tells it from the others of its batch.

    Raises:
        ScanError: there are not three finite points at two places at least.
    """
    return _scan(RawCloud(np.asarray(points, dtype=np.float64)), label)


def reader_of(path: Path) -> type[Reader]:
    """The reader that takes a file of that name.

    Raises:
        ScanError: none does, or two do.
    """
    return type(reader_for(path))


def _check_memory(reader: Reader, path: Path, free: int | None) -> None:
    """Raises ScanError when the file will not fit, rather than let the system end the whole run."""
    with quiet():
        needed = reader.memory(path)
    if free is not None and needed > free:
        raise ScanError(f"would take about {needed / 1e9:.1f} GB of memory, and {free / 1e9:.1f} GB are free; thin it "
                        "out first, a million points are plenty for a picture")


def _clouds(reader: Reader, path: Path, free: int | None) -> list[RawCloud]:
    """What the reader gives; a stranger's reader that fails in its own way must not end the batch."""
    try:
        if can_read_apart(reader) and reader.is_fragile(path):
            needed = 2 * reader.memory(path)
            given = read_apart(reader, path, needed if free is None else min(needed, free))
        else:
            with quiet():
                given = [cloud if isinstance(cloud, RawCloud) else RawCloud(cloud) for cloud in reader.read(path)]
        clouds = [replace(cloud, points=np.asarray(cloud.points, dtype=np.float64)) for cloud in given]
    except ScanError:
        raise
    except Exception as error:  # named, chained and passed on as this file's failure
        raise ScanError(failure_message(reader.name, error)) from error
    if any(cloud.points.ndim != 2 or cloud.points.shape[1] != 3 for cloud in clouds):
        shapes = ", ".join(str(cloud.points.shape) for cloud in clouds[:3])
        raise ScanError(f"the reader {reader.name!r} gave arrays {shapes}, expected (N, 3); its plugin is broken")
    if not clouds:
        raise ScanError("the file holds no cloud")
    return clouds


def _mode(path: Path) -> int:
    """The file's mode, 0 where it cannot be told."""
    try:
        return path.stat().st_mode
    except (OSError, ValueError):
        return 0


def _scan_or_fault(raw: RawCloud, label: str, path: Path) -> Scan | ScanError:
    try:
        return _scan(raw, label)
    except ScanError as error:
        return ScanError(f"{printable(path)}: {error}")


def _scan(raw: RawCloud, label: str) -> Scan:
    """The usable part of a cloud, checked."""
    cloud = raw.points
    where = f"cloud {label}: " if label else ""
    if len(cloud) == 0:
        raise ScanError(f"{where}the cloud is empty; expected at least {FEWEST_POINTS} points")
    finite = (np.abs(cloud) < LARGEST).all(axis=1)
    dropped = int(len(cloud) - finite.sum())
    points = cloud[finite] if dropped else cloud
    if len(points) == 0:
        raise ScanError(f"{where}none of the {len(cloud)} points is a place: each has nan, infinity or a number above "
                        f"{LARGEST:.1e}; the scan holds no measurement")
    if len(points) < FEWEST_POINTS:
        raise ScanError(f"{where}expected at least {FEWEST_POINTS} finite points, got {len(points)} of {len(cloud)}")
    points, missing = _measured(points)
    if not (points != points[0]).any():
        raise ScanError(f"{where}all {len(points)} points are at one place; there is nothing to see")
    metres, degrees = local_metres(points) if raw.sensor is None else (points, "")
    if metres is not points and not (raw.up and raw.up_certain):
        raw = replace(raw, up="+Z", up_reason="z is a height above places on the globe",
                      up_certain=True)
    points = metres
    once, note = drop_duplicates(points), "; ".join(filter(None, (raw.note, missing, degrees)))
    return Scan(once, dropped, label, raw.sensor, raw.total, len(points) - len(once), note, raw.up, raw.up_reason,
                raw.up_certain, raw.upward, raw.seen_from)


def _measured(points: np.ndarray) -> tuple[np.ndarray, str]:
    """The points without those that say that nothing was measured, and a word of it."""
    kept = measured(points)
    if kept is None or kept.sum() < FEWEST_POINTS:
        return points, ""
    left_out = len(points) - int(kept.sum())
    return points[kept], f"{left_out} points left out that say -9999 or the like for no measurement"
