"""What people see of a run on stderr: a line for each file, and a progress bar on a terminal."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:  # slow to import: imported at run time only when the options have been read
    from z2p_renderer.pipeline.batch.render_files import Outcome


class Progress:
    """Counts files and pictures (one file may hold thousands) on a bar on stderr; `bar` is None off a terminal."""

    def __init__(self, bar: Any = None) -> None:
        self.bar, self.pictures = bar, 0

    def count_picture(self, picture: Path) -> None:
        """Counts one more picture."""
        self.pictures += 1
        if self.bar is None:
            return
        self.bar.set_postfix_str(f"{self.pictures} pictures", refresh=False)
        self.bar.update(0)


def open_progress(files: int, quiet: bool) -> Progress:
    """The progress of a run of so many files; without a bar if `quiet`, or if stderr is not a terminal."""
    if quiet or not sys.stderr.isatty():
        return Progress()
    from tqdm import tqdm  # imported late: it takes as long as reading a file

    return Progress(tqdm(total=files, unit="file", file=sys.stderr))


def report_outcomes(outcomes: Iterator[Outcome], progress: Progress, quiet: bool) -> Iterator[Outcome]:
    """Passes the outcomes on, and prints a line for each on stderr, above the bar on a terminal."""
    with nullcontext() if progress.bar is None else progress.bar as bar:
        for outcome in outcomes:
            if bar is not None:
                bar.write(_outcome_line(outcome), file=sys.stderr)
                bar.update()
            elif outcome.status == "failed" or not quiet:
                click.echo(_outcome_line(outcome), err=True)
            yield outcome


def note_if_opaque(suffix: str) -> None:
    """Prints a note if files of that suffix hold no transparency, so that pictures get a white background."""
    from z2p_renderer.storage.images.image_files import OPAQUE_SUFFIXES

    if suffix in OPAQUE_SUFFIXES:
        kind = suffix[1:].upper().replace("JPG", "JPEG")
        click.echo(f"{kind} has no soft transparency: the background is white; choose another with --background",
                   err=True)


def _outcome_line(outcome: Outcome) -> str:
    from z2p_renderer.storage.files.printable_names import printable

    name, pictures = scan_label(outcome.scan), printable(outcome.outputs[0])
    if len(outcome.outputs) > 1:
        pictures += f" to {printable(Path(outcome.outputs[-1].name))}"
    if outcome.status == "failed":
        return f"failed: {name}: {outcome.error}"
    if outcome.status == "skipped":
        other = f", {outcome.kept}" if outcome.kept else ""
        return f"skipped: {name}: {pictures} is there already{other}; --overwrite renders it again"
    read = describe_points(outcome.points, outcome.total, outcome.dropped, outcome.repeated)
    note = f"; {outcome.note}" if outcome.note else ""
    reasons = list(dict.fromkeys(
        "; ".join(filter(None, (colors, placement.description, choice)))
        for colors, placement, choice in zip(outcome.colors, outcome.placements, outcome.choices, strict=True)
    ))  # fmt: skip
    others = "; its other clouds otherwise" if len(reasons) > 1 else ""
    return f"rendered: {name} -> {pictures} ({read}, {outcome.seconds:.2f} s{note}; {reasons[0]}{others})"


def scan_label(scan: Path) -> str:
    """The name of a scan in messages."""
    from z2p_renderer.storage.files.printable_names import printable
    from z2p_renderer.storage.scans.unpack import is_spooled

    return "standard input" if is_spooled(scan) else printable(scan)


def describe_points(points: int, total: int, dropped: int, repeated: int) -> str:
    """Number of points read, of the points that they are a sample of, and of rows left out, in words."""
    text = f"{points} points" + (f" that stand for {total}" if total else "")
    text += f", {dropped} not finite dropped" if dropped else ""
    return text + (f", {repeated} repeated dropped" if repeated else "")
