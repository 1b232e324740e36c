"""Scans on disk: finds them, reads them through the reader plugins, and passes on only points that can be used."""

from __future__ import annotations

import os
import re
import stat
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from z2p_core import registry
from z2p_core.colmap_model import is_part, is_points
from z2p_core.geographic import local_metres
from z2p_core.interfaces import MEMORY_A_BYTE, RawCloud, Reader, ScanError, Sensor
from z2p_renderer.storage.foreign import is_unread_cloud, told_by_content, told_by_suffix
from z2p_renderer.storage.incoming import is_no_sweep, is_prose, unpacked
from z2p_renderer.storage.memory import free_memory
from z2p_renderer.storage.meshes import Mesh, calls_for_smooth, check_openable, read_mesh, write_cloud, write_mesh
from z2p_renderer.storage.names import printable
from z2p_renderer.storage.repeats import distinct

__all__ = ["Mesh", "Scan", "calls_for_smooth", "find_scans", "format_suffix", "read_clouds", "read_each",
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
        reader = _reader(path)
        reader.columns = columns
        check_openable(path)
        free = free_memory()
        with unpacked(path, None if free is None else free // MEMORY_A_BYTE) as plain:
            if told := told_by_content(plain, plain.suffix.lower()):
                raise ScanError(told)
            _check_memory(reader, plain, free)
            clouds = _clouds(reader, plain)
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


def readable_suffixes() -> dict[str, str]:
    """Suffix, lower-case with its dot -> name of the reader that takes it; readers that fail to load are left out."""
    return {suffix: names[0] for suffix, names in sorted(_claims()[0].items())}


def format_suffix(path: Path) -> str:
    """Suffix that tells a file's format, lower-case with its dot: that before .gz, if it is gzip'd."""
    inner = path.with_suffix("") if path.suffix.lower() == ".gz" else path
    return inner.suffix.lower()


def reader_of(path: Path) -> type[Reader]:
    """The reader that takes a file of that name.

    Raises:
        ScanError: none does, or two do.
    """
    return type(_reader(path))


def find_scans(
    inputs: Sequence[str], recursive: bool, passed_over: Callable[[Path], None] = lambda path: None, named: bool = False
) -> list[Path]:
    """The files that the inputs stand for, in the inputs' order, each once.

    A file stands for itself. A folder stands for the readable files in it, sorted by name; with `recursive`, for those
    below it too. Anything else is a glob pattern. Hidden files and links to folders are left out of folders and globs:
    what such a link leads to is either found anyway or lies outside. So is prose: a folder's .txt or .csv that does not
    begin with numbers or their names (which the user may have `named`), and so are clouds in a format that stays
    unread; `passed_over` is told of each.

    Raises:
        ScanError: an input is empty, is a URL or matches nothing, or a folder or pattern holds no readable file.
    """
    found: dict[str, Path] = {}
    for text in inputs:
        if not text:
            raise ScanError("expected a file, folder or pattern, got ''; is the variable empty that should hold it?")
        if re.match(r"[A-Za-z][A-Za-z0-9+.-]*://", text):
            raise ScanError(f"{text!r} is a URL; z2p reads local files only, so download it first")
        try:
            paths = _expand(text, recursive, passed_over, named)
        except ScanError:
            raise
        except (OSError, ValueError) as error:
            reason = getattr(error, "strerror", None) or error
            raise ScanError(f"{printable(Path(text))}: cannot be searched ({reason})") from error
        for path in paths:
            found.setdefault(os.path.abspath(path), path)  # noqa: PTH100 - Path.resolve would join links to one file
    return list(found.values())


def _expand(text: str, recursive: bool, passed_over: Callable[[Path], None], named: bool) -> list[Path]:
    """The files behind one input."""
    path = Path(text)
    if path.is_dir():
        name, candidates = f"folder {printable(path)}", list(_walk(path)) if recursive else _children(path)
    elif path.exists() or path.is_symlink():
        return [path]
    elif any(sign in text for sign in "*?["):
        name, candidates = f"pattern {text!r}", _glob(path)
    else:
        raise ScanError(f"{printable(path)}: no such file or folder; check the path")
    suffixes = readable_suffixes()
    paths = []
    for candidate in candidates:
        if is_part(candidate) and any(is_points(other) and other.parent == candidate.parent for other in candidates):
            continue  # a model's cameras and pictures, of which the reader of its points knows
        if format_suffix(candidate) not in suffixes:
            if is_unread_cloud(candidate):
                passed_over(candidate)
        elif is_prose(candidate, named) or is_no_sweep(candidate, named):
            passed_over(candidate)
        else:
            paths.append(candidate)
    if not paths:
        first = next(filter(is_unread_cloud, candidates), None)
        unread = f"; {first.name} {told_by_suffix(first)}" if first else ""
        advice = "" if recursive or not path.is_dir() else "; --recursive looks into its folders too"
        raise ScanError(f"{name} holds no point cloud; readable: {', '.join(suffixes)}{unread}{advice}")
    return paths


def _children(folder: Path) -> list[Path]:
    return sorted(path for path in folder.iterdir() if not path.name.startswith(".") and not path.is_dir())


def _walk(root: Path) -> Iterator[Path]:
    """Files below the folder in a fixed order; links to folders are not followed, so no link can loop or lead out."""

    def refuse(error: OSError) -> None:
        raise error

    for folder, folders, _ in os.walk(root, onerror=refuse, followlinks=False):
        folders[:] = sorted(name for name in folders if not name.startswith("."))
        yield from _children(Path(folder))


def _glob(pattern: Path) -> list[Path]:
    """Files that match; ``**`` does not follow links to folders."""
    parts = pattern.parts
    first = next(index for index, part in enumerate(parts) if any(sign in part for sign in "*?["))
    root = Path(*parts[:first])
    matches = root.glob(str(Path(*parts[first:])))
    visible = (path for path in matches if not any(part.startswith(".") for part in path.relative_to(root).parts))
    return sorted(path for path in visible if not path.is_dir())


def _claims() -> tuple[dict[str, list[str]], list[str]]:
    """Suffix -> names of the readers that claim it, and what is wrong with the readers that fail to load."""
    claims: dict[str, list[str]] = {}
    faults = []
    for name in registry.names("readers"):
        try:
            plugin = registry.load("readers", name)
        except registry.PluginError as error:
            faults.append(str(error))
            continue
        for suffix in plugin.suffixes:
            claims.setdefault(suffix, []).append(name)
    return claims, faults


def _check_memory(reader: Reader, path: Path, free: int | None) -> None:
    """Raises ScanError when the file will not fit, rather than let the system end the whole run."""
    needed = reader.memory(path)
    if free is not None and needed > free:
        raise ScanError(f"would take about {needed / 1e9:.1f} GB of memory, and {free / 1e9:.1f} GB are free; thin it "
                        "out first, a million points are plenty for a picture")


def _reader(path: Path) -> Reader:
    suffix = format_suffix(path)
    claims, faults = _claims()
    names = claims.get(suffix, [])
    if not names:
        if told := told_by_suffix(path) or told_by_content(path, suffix):
            raise ScanError(told)
        broken = f" ({'; '.join(faults)})" if faults else ""
        raise ScanError(f"no reader for {suffix or 'a file without suffix'!r}; readable: "
                        f"{', '.join(sorted(claims))}{broken}")
    if len(names) > 1:
        raise ScanError(f"{suffix} is claimed by the readers {' and '.join(names)}; uninstall one of them")
    return registry.load("readers", names[0])()


def _clouds(reader: Reader, path: Path) -> list[RawCloud]:
    """What the reader gives; a stranger's reader that fails in its own way must not end the batch."""
    try:
        given = [cloud if isinstance(cloud, RawCloud) else RawCloud(cloud) for cloud in reader.read(path)]
        clouds = [replace(cloud, points=np.asarray(cloud.points, dtype=np.float64)) for cloud in given]
    except ScanError:
        raise
    except Exception as error:  # named, chained and passed on as this file's failure
        reason = " ".join(str(error).split())[:160]
        raise ScanError(f"the reader {reader.name!r} failed ({type(error).__name__}: {reason})") from error
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
    if not (points != points[0]).any():
        raise ScanError(f"{where}all {len(points)} points are at one place; there is nothing to see")
    once = distinct(points)
    repeated, note = len(points) - len(once), raw.note
    if raw.sensor is None:
        once, degrees = local_metres(once)
        note = "; ".join(filter(None, (note, degrees)))
    return Scan(once, dropped, label, raw.sensor, raw.total, repeated, note, raw.up, raw.up_reason,
                raw.up_certain, raw.upward, raw.seen_from)
