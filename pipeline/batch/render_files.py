"""Renders many files to many pictures, one after another or several at a time; no bad file stops the others."""

from __future__ import annotations

import os
import sys
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import nullcontext
from dataclasses import dataclass, field, replace
from pathlib import Path
from threading import Lock
from typing import Any

from z2p_core.coloring.options import ColorOptions
from z2p_core.interfaces import ScanError, SettingError
from z2p_core.parallel import core_count, without_second_core
from z2p_core.pinhole import PinholeCamera
from z2p_core.placement.viewpoint import Viewpoint
from z2p_renderer.pipeline.batch.existing_outputs import kept_output_note
from z2p_renderer.pipeline.batch.tasks import Task, numbered_outputs
from z2p_renderer.pipeline.coloring.fields import read_scans
from z2p_renderer.pipeline.inference.documents import write_document
from z2p_renderer.pipeline.inference.look import Look
from z2p_renderer.pipeline.inference.render_scan import build_record, render_scan, with_common_scale
from z2p_renderer.pipeline.inference.scan_source import describe_source
from z2p_renderer.pipeline.inference.weight_selection import AnyRenderer
from z2p_renderer.pipeline.placement.placement_record import Placement
from z2p_renderer.storage.files.printable_names import printable
from z2p_renderer.storage.images.image_files import PictureError, write_picture
from z2p_renderer.storage.images.pass_files import pass_paths, write_passes
from z2p_renderer.storage.scans.clouds import Scan, format_suffix
from z2p_renderer.storage.scans.unpack import content_size

SWITCH_INTERVAL_SECONDS = 0.0003
"""How long Python lets a thread run while another waits, in seconds. Kernels take 0.0002, so its default of 0.005 would
leave a core idle."""
LARGE_FILE_BYTES = 100_000_000
"""Size of a file's content above which only one such file at a time is read and rendered."""


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
    """One for each rendered picture."""
    viewpoints: list[Viewpoint] = field(default_factory=list)
    """One for each rendered picture."""
    pinholes: list[PinholeCamera] = field(default_factory=list)
    """One for each picture that was rendered with a camera in the data's units."""
    kept: str = ""
    """How a picture that is kept differs from the settings, in words."""
    weights: list[str] = field(default_factory=list)
    """Names of the weights, for each rendered picture."""
    choices: list[str] = field(default_factory=list)
    """Why these weights were selected instead of the default ones, in words; one for each rendered picture."""
    colors: list[str] = field(default_factory=list)
    """What colors the points, in words, for each rendered picture; empty where all have one color."""
    seconds: float = 0.0
    error: str | None = None


def render_files(
    tasks: list[Task], renderer: AnyRenderer, look: Look, overwrite: bool = False, jobs: int = 1,
    columns: tuple[str, ...] | None = None, on_picture: Callable[[Path], None] = lambda path: None,
    pass_format: str = "npy",
) -> Iterator[Outcome]:
    """One outcome for each task, in order, as soon as its file is complete.

    Args:
        tasks: the files and their pictures.
        renderer: renders all of them.
        look: the settings of all pictures.
        overwrite: render pictures again that exist already.
        jobs: number of files that are rendered at the same time. Of those larger than `LARGE_FILE_BYTES` only one at a
            time is in memory.
        columns: names of the columns of text files.
        on_picture: called with the path of each written picture, as a file may hold thousands of clouds.
        pass_format: format of the passes that the look asks for.
    """
    planned = frozenset(task.output for task in tasks)
    large_file_lock, reads = Lock(), _Reads(columns, look.color_options)

    def work(task: Task) -> Outcome:
        with large_file_lock if _is_large(task.scan) else nullcontext():
            return _FileJob(task, renderer, look, overwrite, columns, on_picture, pass_format, reads).render(planned)

    if jobs == 1:
        yield from map(work, tasks)
        return
    from concurrent.futures import ThreadPoolExecutor  # late: it cannot be imported once the main thread has ended

    pool = ThreadPoolExecutor(jobs)
    interval = sys.getswitchinterval()
    sys.setswitchinterval(SWITCH_INTERVAL_SECONDS)
    with without_second_core() if jobs >= core_count() else nullcontext():
        try:
            yield from pool.map(work, tasks)
        finally:  # an interrupt drops the files not yet begun
            pool.shutdown(cancel_futures=True)
            sys.setswitchinterval(interval)


def describe_failure(error: Exception, scan: Path) -> str:
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


def _is_large(scan: Path) -> bool:
    try:
        return content_size(scan) > LARGE_FILE_BYTES
    except OSError:  # reading it will report the error
        return False


class _Reads:
    """Reads files for the tasks of a run; of several cameras' tasks for one file, the first one reads it."""

    def __init__(self, columns: tuple[str, ...] | None, options: ColorOptions) -> None:
        self._columns, self._options = columns, options
        self._lock = Lock()
        self._is_of: tuple[Path, int] | None = None
        self._scans: list[Scan | ScanError] = []

    def read(self, task: Task, max_rows: int) -> list[Scan | ScanError]:
        """The clouds of the task's file, as of `read_scans`."""
        if task.camera is None:
            return read_scans(task.scan, self._columns, self._options, max_rows)
        with self._lock:
            if self._is_of != (task.scan, max_rows):
                self._is_of, self._scans = None, []  # free before the next is read
                self._scans = read_scans(task.scan, self._columns, self._options, max_rows)
                self._is_of = (task.scan, max_rows)
            return self._scans


class _FileJob:
    """Renders one file's clouds to their pictures, and records the outcome."""

    def __init__(
        self, task: Task, renderer: AnyRenderer, look: Look, overwrite: bool, columns: tuple[str, ...] | None,
        on_picture: Callable[[Path], None], pass_format: str, reads: _Reads,
    ) -> None:  # fmt: skip
        self.task, self.renderer, self.look, self.overwrite = task, renderer, look, overwrite
        self.columns, self.on_picture, self.pass_format = columns, on_picture, pass_format
        self.outcome, self._reads = Outcome(task.scan, [task.output]), reads
        self._source: dict[str, Any] = {}

    def render(self, planned: frozenset[Path]) -> Outcome:
        """The outcome; `planned` are the pictures of all files, whose names must not be taken."""
        outcome, started = self.outcome, time.perf_counter()
        try:
            if not self._is_kept(self.task.output, 0):
                self._render_clouds(planned)
        except Exception as error:  # whatever a file or a reader plugin raises, the other files go on
            outcome.status, outcome.error = "failed", describe_failure(error, self.task.scan)
        outcome.seconds = time.perf_counter() - started
        return outcome

    def _render_clouds(self, planned: frozenset[Path]) -> None:
        """Renders each cloud of the file; if one fails, the others are still rendered."""
        outcome = self.outcome
        scans = list(self._reads.read(self.task, self._look_of(0).max_rows))
        _count_points(scans, outcome)
        if len(scans) > 1:
            outcome.outputs = numbered_outputs(self.task, len(scans), planned)
            if self.look.color_options.needs_common_scale:
                suffix = format_suffix(self.task.scan)
                clouds = [(scan, suffix) for scan in scans if isinstance(scan, Scan)]
                self.look, _ = with_common_scale(self.renderer, clouds, self.look)
        faults = []
        for cloud, (scan, output) in enumerate(zip(scans, outcome.outputs, strict=True)):
            try:
                if self._is_kept(output, cloud):
                    continue
                if isinstance(scan, ScanError):
                    faults.append(describe_failure(scan, self.task.scan))
                    continue
                self._render_cloud(scan, cloud, output)
                outcome.status = "ok"
            except Exception as error:  # as above
                where = f"cloud {scan.label}: " if isinstance(scan, Scan) and scan.label else ""
                faults.append(where + describe_failure(error, self.task.scan))
        if faults:
            outcome.status = "failed"
            outcome.error = faults[0] + (f" (and {len(faults) - 1} more clouds failed)" if len(faults) > 1 else "")

    def _is_kept(self, output: Path, cloud: int) -> bool:
        """Whether a picture exists that is kept as it is; how it differs from the settings is noted in the outcome.

        Raises:
            PictureError: it shows another cloud.
        """
        if self.overwrite or not output.exists():
            return False
        source, look = self._source_of(output, cloud), self._look_of(cloud)
        note = kept_output_note(output, source, look, self.renderer, named=self.task.single)
        self.outcome.kept = note or self.outcome.kept
        paths = pass_paths(output, look.passes, self.pass_format) if look.passes else []
        return note is not None and all(path.is_file() for path in paths)

    def _render_cloud(self, scan: Scan, cloud: int, output: Path) -> None:
        look, outcome = self._look_of(cloud), self.outcome
        rendered = render_scan(self.renderer, scan, format_suffix(self.task.scan), look)
        record = build_record(rendered, look, self._source_of(output, cloud))
        if look.is_document:
            write_document(rendered, look, record, output)
        else:
            write_picture(rendered.picture, output, look.background, record, look.dpi)
        if rendered.pass_camera is not None:
            write_passes(rendered.passes, rendered.pass_camera, output, self.pass_format)
        outcome.placements.append(rendered.placement)
        outcome.viewpoints.append(rendered.viewpoint)
        if rendered.pinhole is not None:
            outcome.pinholes.append(rendered.pinhole)
        outcome.weights.append(rendered.renderer.weights["name"])
        outcome.choices.append(rendered.weights_reason)
        outcome.colors.append("" if rendered.coloring is None else rendered.coloring.description)
        self.on_picture(output)

    def _look_of(self, cloud: int) -> Look:
        colors, look = self.task.colors, self.look.written_as(self.task.output.suffix.lower())
        if self.task.camera is not None:
            look = look.taken_by(self.task.camera)
        return replace(look, values={**look.values, "color": colors[cloud % len(colors)]}) if colors else look

    def _source_of(self, output: Path, cloud: int) -> dict[str, Any]:
        if not self._source:  # once a file, for its digest takes time
            self._source.update(describe_source(self.task.scan, output, columns=self.columns))
        return {**self._source, "cloud": cloud}


def _count_points(scans: list[Scan | ScanError], outcome: Outcome) -> None:
    """Sums up the points of all clouds of a file in its outcome."""
    good = [scan for scan in scans if isinstance(scan, Scan)]
    outcome.points = sum(len(scan.points) for scan in good)
    outcome.dropped, outcome.repeated = (sum(getattr(scan, name) for scan in good) for name in ("dropped", "repeated"))
    outcome.total = sum(scan.total or 0 for scan in good)
    outcome.note = "; ".join(dict.fromkeys(scan.note for scan in good if scan.note))
