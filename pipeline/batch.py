"""Many files to many pictures: names the outputs, renders file after file, and lets no bad file stop the others."""

from __future__ import annotations

import io
import os
import threading
import time
import traceback
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from PIL import Image

from pipeline.infer import Renderer
from pipeline.placing import Placing, Stance, place
from storage.clouds import Scan, read_clouds, shown
from z2p_core.images import bytes_from_unit, composite, unit_from_bytes
from z2p_core.interfaces import ScanError, Value

Color = tuple[float, float, float]


@dataclass(frozen=True)
class Look:
    """How every picture of a run looks."""

    values: dict[str, Value] = field(default_factory=dict)
    """Control -> value; the sliders' defaults for the others."""
    placing: Placing = field(default_factory=Placing)
    width: int = 512
    height: int = 512
    background: Color | None = None
    """sRGB in [0, 1]; None keeps the picture transparent."""


@dataclass(frozen=True)
class Task:
    """One scan file and the picture it becomes."""

    scan: Path
    output: Path
    """Of the only cloud; several clouds of one file become `<stem>_000.png`, `<stem>_001.png` ..."""
    single: bool = False
    """The user named the picture itself, so the file must hold one cloud."""


@dataclass
class Outcome:
    """What became of one file."""

    scan: Path
    outputs: list[Path]
    status: str = "skipped"
    """``ok``, ``skipped`` (every picture was there before) or ``failed`` (any of its clouds did)."""
    points: int = 0
    dropped: int = 0
    """Rows left out because they were not finite."""
    stances: list[Stance] = field(default_factory=list)
    """Of each picture that was drawn."""
    seconds: float = 0.0
    error: str | None = None


def plan_outputs(scans: list[Path], folders: list[Path], out: Path, mirror: bool) -> list[Task]:
    """A task for each scan, each with a picture path of its own under `out`; the same input gives the same names.

    `<stem>.png`; scans that share a stem keep their suffix (`a.ply.png`, `a.pcd.png`), and if even the names are the
    same they are numbered (`a.ply.png`, `a.ply-2.png`). With `mirror` the sub folders of `folders` are kept.
    """
    places = [_sub_folder(scan, folders) if mirror else Path() for scan in scans]
    stems = Counter(zip(places, (scan.stem for scan in scans), strict=True))
    taken: set[Path] = set()
    tasks = []
    for sub_folder, scan in zip(places, scans, strict=True):
        stem = scan.stem if stems[sub_folder, scan.stem] == 1 else scan.name
        output, number = out / sub_folder / f"{stem}.png", 1
        while output in taken:
            number += 1
            output = out / sub_folder / f"{scan.name}-{number}.png"
        taken.add(output)
        tasks.append(Task(scan, output))
    return tasks


def render_files(
    tasks: list[Task], renderer: Renderer, look: Look, overwrite: bool = False, jobs: int = 1
) -> Iterator[Outcome]:
    """One outcome a task, in order, as the files get done; `jobs` files at a time, each holding its own clouds only."""
    planned = frozenset(task.output for task in tasks)

    def work(task: Task) -> Outcome:
        return _render_file(task, renderer, look, overwrite, planned)

    if jobs == 1:
        yield from map(work, tasks)
        return
    pool = ThreadPoolExecutor(jobs)
    try:
        yield from pool.map(work, tasks)
    finally:  # an interrupt drops the files not yet begun
        pool.shutdown(cancel_futures=True)


def write_picture(picture: np.ndarray, path: Path, background: Color | None = None) -> None:
    """PNG of a straight RGBA picture (H, W, 4) uint8 at `path`, whole or not at all; opaque RGB over a background."""
    if background is not None:
        picture = bytes_from_unit(composite(unit_from_bytes(picture), background))
    encoded = io.BytesIO()
    Image.fromarray(picture).save(encoded, format="PNG", compress_level=4)
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.parent / f".z2p-{os.getpid()}-{threading.get_ident()}.part"
    try:
        partial.write_bytes(encoded.getbuffer())
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)


def _sub_folder(scan: Path, folders: list[Path]) -> Path:
    """Folder of `scan` relative to the first of `folders` that holds it, or none."""
    for folder in folders:
        if scan.is_relative_to(folder):
            return scan.relative_to(folder).parent
    return Path()


def _render_file(task: Task, renderer: Renderer, look: Look, overwrite: bool, planned: frozenset[Path]) -> Outcome:
    outcome = Outcome(task.scan, [task.output])
    elevation, free = _elevation(renderer, look.values)

    def draw(scan: Scan, output: Path) -> None:
        placed = place(scan, task.scan.suffix.lower(), look.placing, elevation, free)
        wished = placed.stance.elevation
        values = look.values if wished is None else {**look.values, "elevation": (wished,)}
        write_picture(renderer.render(placed.cloud, values, look.width, look.height), output, look.background)
        outcome.stances.append(placed.stance)

    started = time.perf_counter()
    try:
        if overwrite or not task.output.exists():
            _render_clouds(task, outcome, draw, overwrite, planned)
    except Exception as error:  # whatever a file or a stranger's reader brings up, the other files go on
        outcome.status, outcome.error = "failed", _told(error, task.scan)
    outcome.seconds = time.perf_counter() - started
    return outcome


def _elevation(renderer: Renderer, values: dict[str, Value]) -> tuple[float, tuple[float, float] | None]:
    """The camera's elevation, degrees, and the range in which a view may choose another: None when it is settled."""
    if renderer.fixed_elevation is not None:
        return renderer.fixed_elevation, None
    slider = renderer.controls["elevation"].slider
    settled = "elevation" in values
    return renderer.settings(values)["elevation"][0], None if settled else (slider.low[0], slider.high[0])


def _render_clouds(
    task: Task, outcome: Outcome, draw: Callable[[Scan, Path], None], overwrite: bool, planned: frozenset[Path]
) -> None:
    """Fill in `outcome` while drawing each cloud of the file; a cloud that cannot be drawn leaves the others."""
    scans = read_clouds(task.scan)
    outcome.points = sum(len(scan.points) for scan in scans)
    outcome.dropped = sum(scan.dropped for scan in scans)
    if len(scans) > 1:
        outcome.outputs = _batch_outputs(task, len(scans), planned)
    faults = []
    for scan, output in zip(scans, outcome.outputs, strict=True):
        if not overwrite and output.exists():
            continue
        try:
            draw(scan, output)
            outcome.status = "ok"
        except Exception as error:  # as above
            faults.append(f"cloud {scan.label}: {_told(error, task.scan)}" if scan.label else _told(error, task.scan))
    if faults:
        outcome.status = "failed"
        outcome.error = faults[0] + (f" (and {len(faults) - 1} more clouds failed)" if len(faults) > 1 else "")


def _batch_outputs(task: Task, count: int, planned: frozenset[Path]) -> list[Path]:
    """Numbered pictures for the clouds of one file; with the file's full name if another file's picture is in the way.

    Raises:
        ScanError: the user named one picture.
    """
    if task.single:
        raise ScanError(f"holds {count} clouds, but --output names one picture; give a folder")
    digits = max(3, len(str(count - 1)))
    for stem in (task.output.name.removesuffix(".png"), task.scan.name):
        outputs = [task.output.parent / f"{stem}_{index:0{digits}d}.png" for index in range(count)]
        if planned.isdisjoint(outputs):
            break
    return outputs


def _told(error: Exception, scan: Path) -> str:
    """One line on why a file failed, without the file's name, which the caller says."""
    if os.environ.get("Z2P_DEBUG") == "1":
        traceback.print_exception(error)
    if isinstance(error, OSError) and error.strerror:
        return f"{error.strerror}: {shown(Path(error.filename))}" if error.filename else error.strerror
    if isinstance(error, MemoryError):
        return "not enough memory for this cloud; close other programs or thin it out"
    text = " ".join(str(error).split()).removeprefix(f"{shown(scan)}: ")
    text = text if text.isprintable() else ascii(text)[1:-1]
    return text if isinstance(error, ScanError) else f"{type(error).__name__}: {text}"
