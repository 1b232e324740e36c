"""Many files to many pictures: names the outputs, renders file after file, and lets no bad file stop the others."""

from __future__ import annotations

import os
import sys
import time
import traceback
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import nullcontext
from dataclasses import dataclass, field, replace
from pathlib import Path
from threading import Lock
from typing import Any

from z2p_core.interfaces import ScanError, SettingError, Value
from z2p_core.parallel import core_count, without_second_core
from z2p_core.placement.viewpoint import Viewpoint
from z2p_renderer.pipeline.inference.look import Look
from z2p_renderer.pipeline.inference.render_scan import build_record, render_scan
from z2p_renderer.pipeline.inference.weight_selection import AnyRenderer
from z2p_renderer.pipeline.outputs.existing_outputs import kept_output_note
from z2p_renderer.pipeline.placement.placement_record import Placement
from z2p_renderer.storage.files.printable_names import printable, without_gz
from z2p_renderer.storage.images.image_files import PictureError, write_picture
from z2p_renderer.storage.results.fingerprints import file_digest
from z2p_renderer.storage.scans.clouds import Scan, format_suffix, read_each
from z2p_renderer.storage.scans.unpack import content_size, is_spooled

SWITCH_INTERVAL = 0.0003
"""Seconds that Python lets a thread go on while another waits: 0.005, as usual, are long beside kernels of 0.0002."""
LARGE_FILE_BYTES = 100_000_000
"""Bytes of a file's content from which on it is read and drawn while no other such file is."""


@dataclass(frozen=True)
class Task:
    """One scan file and the picture it becomes."""

    scan: Path
    output: Path
    """Of the only cloud; several clouds of one file become `<stem>_000.png`, `<stem>_001.png` ..."""
    single: bool = False
    """The user named the picture itself, so the file must hold one cloud, and other settings draw it again."""
    colors: tuple[Value, ...] = ()
    """Colours of its clouds in turn, in place of the look's; none leaves it that."""


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
    repeated: int = 0
    """Rows left out because they repeat others or stand for missing points."""
    total: int = 0
    """How many points the file has, if those read only stand for them."""
    note: str = ""
    """What its reader took for granted or left out, in words."""
    placements: list[Placement] = field(default_factory=list)
    """Of each picture that was drawn."""
    viewpoints: list[Viewpoint] = field(default_factory=list)
    """Of each picture that was drawn."""
    kept: str = ""
    """What a picture that was there before and stays shows otherwise than asked, in words."""
    weights: list[str] = field(default_factory=list)
    """Names of those that drew each picture."""
    choices: list[str] = field(default_factory=list)
    """Why they are not the usual ones, in words, for each picture."""
    seconds: float = 0.0
    error: str | None = None


def plan_outputs(
    scans: list[Path], folders: list[Path], out: Path, mirror: bool, suffix: str = ".png"
) -> list[Task]:
    """A task for each scan, each with a picture path of its own under `out`; the same input gives the same names.

    `<stem>.png`, or with another `suffix`; scans that share a stem keep theirs (`a.ply.png`, `a.pcd.png`), and if even
    the names are the same they are numbered (`a.ply.png`, `a.ply-2.png`). With `mirror` the sub folders of `folders`
    are kept.
    """
    places = [_sub_folder(scan, folders) if mirror else Path() for scan in scans]
    stems = Counter(zip(places, map(_stem, scans), strict=True))
    taken: set[Path] = set()
    tasks = []
    for sub_folder, scan in zip(places, scans, strict=True):
        stem = _stem(scan) if stems[sub_folder, _stem(scan)] == 1 else scan.name
        output, number = out / sub_folder / f"{stem}{suffix}", 1
        while output in taken:
            number += 1
            output = out / sub_folder / f"{scan.name}-{number}{suffix}"
        taken.add(output)
        tasks.append(Task(scan, output))
    return tasks


def render_files(
    tasks: list[Task], renderer: AnyRenderer, look: Look, overwrite: bool = False, jobs: int = 1,
    columns: tuple[str, ...] | None = None, drawn: Callable[[Path], None] = lambda path: None,
) -> Iterator[Outcome]:
    """One outcome a task, in order, as the files get done; `jobs` files at a time, each holding its own clouds only.

    Files of more than `LARGE_FILE_BYTES` bytes wait for one another, so that no two of them are in memory. `columns` names those
    of text files; `drawn` is told of every picture, for a file may hold thousands of clouds.
    """
    planned = frozenset(task.output for task in tasks)
    heavy = Lock()

    def work(task: Task) -> Outcome:
        with heavy if _is_heavy(task.scan) else nullcontext():
            return _File(task, renderer, look, overwrite, columns, drawn).render(planned)

    if jobs == 1:
        yield from map(work, tasks)
        return
    from concurrent.futures import ThreadPoolExecutor  # late: it cannot be imported once the main thread has ended

    pool = ThreadPoolExecutor(jobs)
    interval = sys.getswitchinterval()
    sys.setswitchinterval(SWITCH_INTERVAL)
    with without_second_core() if jobs >= core_count() else nullcontext():
        try:
            yield from pool.map(work, tasks)
        finally:  # an interrupt drops the files not yet begun
            pool.shutdown(cancel_futures=True)
            sys.setswitchinterval(interval)


def describe_source(
    scan: Path, output: Path, cloud: int = 0, columns: tuple[str, ...] | None = None
) -> dict[str, Any]:
    """Where a picture's cloud is, for its record: the file's name, digest and place beside the picture.

    `cloud` counts within the file. The path is relative to the picture, so that the two can move together; what came
    through standard input has none.
    """
    source = {"name": scan.name, "path": path_relative_to(scan, output), "sha256": file_digest(scan), "cloud": cloud}
    if columns is not None:
        source["columns"] = list(columns)
    return {**source, "path": None} if is_spooled(scan) else source


def path_relative_to(scan: Path, output: Path) -> str:
    """Where a scan lies, as seen from the folder of a picture."""
    path = os.path.relpath(os.path.abspath(scan), os.path.abspath(output.parent))  # noqa: PTH100 - keeps links
    return Path(path).as_posix()


def fault_message(error: Exception, scan: Path) -> str:
    """One line on why a file failed, without the file's name, which the caller says."""
    if os.environ.get("Z2P_DEBUG") == "1":
        traceback.print_exception(error)
    if isinstance(error, OSError) and error.strerror:
        return f"{error.strerror}: {printable(Path(error.filename))}" if error.filename else error.strerror
    if isinstance(error, MemoryError):
        return "not enough memory for this cloud; close other programs or thin it out"
    text = " ".join(str(error).split()).removeprefix(f"{printable(scan)}: ")
    text = text if text.isprintable() else ascii(text)[1:-1]
    return text if isinstance(error, ScanError | SettingError | PictureError) else f"{type(error).__name__}: {text}"


def _is_heavy(scan: Path) -> bool:
    try:
        return content_size(scan) > LARGE_FILE_BYTES
    except OSError:  # told when it is read
        return False


def _sub_folder(scan: Path, folders: list[Path]) -> Path:
    """Folder of `scan` relative to the first of `folders` that holds it, or none."""
    for folder in folders:
        if scan.is_relative_to(folder):
            return scan.relative_to(folder).parent
    return Path()


def _stem(scan: Path) -> str:
    """The file's name without its suffix, and without .gz."""
    return without_gz(scan).stem


class _File:
    """One file on its way to its pictures."""

    def __init__(
        self, task: Task, renderer: AnyRenderer, look: Look, overwrite: bool, columns: tuple[str, ...] | None,
        drawn: Callable[[Path], None],
    ) -> None:
        self.task, self.renderer, self.look, self.overwrite = task, renderer, look, overwrite
        self.columns, self.drawn = columns, drawn
        self.outcome = Outcome(task.scan, [task.output])
        self._source: dict[str, Any] = {}

    def render(self, planned: frozenset[Path]) -> Outcome:
        """What became of it; `planned` are the pictures of all files."""
        outcome, started = self.outcome, time.perf_counter()
        try:
            if not self._stays(self.task.output, 0):
                self._render_clouds(planned)
        except Exception as error:  # whatever a file or a stranger's reader brings up, the other files go on
            outcome.status, outcome.error = "failed", fault_message(error, self.task.scan)
        outcome.seconds = time.perf_counter() - started
        return outcome

    def _render_clouds(self, planned: frozenset[Path]) -> None:
        """Draws each cloud of the file; one that cannot be drawn leaves the others."""
        scans, outcome = read_each(self.task.scan, self.columns), self.outcome
        _count(scans, outcome)
        if len(scans) > 1:
            outcome.outputs = _batch_outputs(self.task, len(scans), planned)
        faults = []
        for cloud, (scan, output) in enumerate(zip(scans, outcome.outputs, strict=True)):
            try:
                if self._stays(output, cloud):
                    continue
                if isinstance(scan, ScanError):
                    faults.append(fault_message(scan, self.task.scan))
                    continue
                self._render_cloud(scan, cloud, output)
                outcome.status = "ok"
            except Exception as error:  # as above
                where = f"cloud {scan.label}: " if isinstance(scan, Scan) and scan.label else ""
                faults.append(where + fault_message(error, self.task.scan))
        if faults:
            outcome.status = "failed"
            outcome.error = faults[0] + (f" (and {len(faults) - 1} more clouds failed)" if len(faults) > 1 else "")

    def _stays(self, output: Path, cloud: int) -> bool:
        """Whether a picture is there that is left as it is; what it shows otherwise than asked is noted.

        Raises:
            PictureError: it shows another cloud.
        """
        if self.overwrite or not output.exists():
            return False
        source, look = self._source_of(output, cloud), self._look_at(cloud)
        told = kept_output_note(output, source, look, self.renderer, named=self.task.single)
        self.outcome.kept = told or self.outcome.kept
        return told is not None

    def _render_cloud(self, scan: Scan, cloud: int, output: Path) -> None:
        look, outcome = self._look_at(cloud), self.outcome
        rendered = render_scan(self.renderer, scan, format_suffix(self.task.scan), look)
        write_picture(rendered.picture, output, look.background, build_record(rendered, look, self._source_of(output, cloud)))
        outcome.placements.append(rendered.placement)
        outcome.viewpoints.append(rendered.viewpoint)
        outcome.weights.append(rendered.renderer.weights["name"])
        outcome.choices.append(rendered.weights_reason)
        self.drawn(output)

    def _look_at(self, cloud: int) -> Look:
        colors, look = self.task.colors, self.look.written_as(self.task.output.suffix.lower())
        return replace(look, values={**look.values, "color": colors[cloud % len(colors)]}) if colors else look

    def _source_of(self, output: Path, cloud: int) -> dict[str, Any]:
        if not self._source:  # once a file, for its digest takes time
            self._source.update(describe_source(self.task.scan, output, columns=self.columns))
        return {**self._source, "cloud": cloud}


def _count(scans: list[Scan | ScanError], outcome: Outcome) -> None:
    """Fills in what was read."""
    good = [scan for scan in scans if isinstance(scan, Scan)]
    outcome.points = sum(len(scan.points) for scan in good)
    outcome.dropped, outcome.repeated = (sum(getattr(scan, name) for scan in good) for name in ("dropped", "repeated"))
    outcome.total = sum(scan.total or 0 for scan in good)
    outcome.note = "; ".join(dict.fromkeys(scan.note for scan in good if scan.note))


def _batch_outputs(task: Task, count: int, planned: frozenset[Path]) -> list[Path]:
    """Numbered pictures for the clouds of one file; with the file's full name if another file's picture is in the way.

    Raises:
        ScanError: the user named one picture.
    """
    if task.single:
        raise ScanError(f"holds {count} clouds, but --output names one picture; give a folder")
    digits = max(3, len(str(count - 1)))
    for stem in (task.output.stem, task.scan.name):
        outputs = [task.output.parent / f"{stem}_{index:0{digits}d}{task.output.suffix}" for index in range(count)]
        if planned.isdisjoint(outputs):
            break
    return outputs
