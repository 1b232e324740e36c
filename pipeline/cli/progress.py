"""What is told of a run: a line or a bar on stderr for people, JSON lines on stdout for programs."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:  # at run time these wait until the options have been read: they are slow to import
    from z2p_renderer.pipeline.inference.batch import Outcome
    from z2p_renderer.pipeline.inference.look import Look
    from z2p_renderer.pipeline.inference.weight_selection import AnyRenderer


def settings_to_json(renderer: AnyRenderer, look: Look, options: dict[str, Any]) -> dict[str, Any]:
    """All that shaped the pictures, JSON-able."""
    controls = {name: list(value) for name, value in renderer.settings(look.values).items()}
    elevation = controls.get("elevation", [renderer.fixed_elevation])
    return {
        "weights": options["weights"],
        "controls": controls,
        "elevation": elevation[0],
        "up": look.placement_options.up,
        "view": options["view"],
        "azimuth": look.placement_options.azimuth,
        "keep_outliers": look.placement_options.keep_outliers,
        "cut_top": look.placement_options.cut_top,
        "smooth": look.placement_options.smooth,
        "resolution": [look.width, look.height],
        "background": "transparent" if look.background is None else list(look.background),
        "supersample": look.supersample,
        "fit": options["fit"],
        "margin": options["margin"],
        "load_camera": None if options["load_camera"] is None else str(options["load_camera"]),
    }


class Progress:
    """Bar on stderr, none off a terminal: files done, and pictures drawn, for one file may hold thousands."""

    def __init__(self, bar: Any = None) -> None:
        self.bar, self.pictures = bar, 0

    def drawn(self, picture: Path) -> None:
        """Counts one more picture."""
        self.pictures += 1
        if self.bar is None:
            return
        self.bar.set_postfix_str(f"{self.pictures} pictures", refresh=False)
        self.bar.update(0)


def open_progress(files: int, quiet: bool) -> Progress:
    """The bar for a run of so many files."""
    if quiet or not sys.stderr.isatty():
        return Progress()
    from tqdm import tqdm  # late: it takes as long as a file's reading

    return Progress(tqdm(total=files, unit="file", file=sys.stderr))


def report_outcomes(outcomes: Iterator[Outcome], progress: Progress, quiet: bool) -> Iterator[Outcome]:
    """The outcomes, each told on stderr as it passes, above the bar on a terminal: up and view are guessed aloud."""
    with nullcontext() if progress.bar is None else progress.bar as bar:
        for outcome in outcomes:
            if bar is not None:
                bar.write(_outcome_line(outcome), file=sys.stderr)
                bar.update()
            elif outcome.status == "failed" or not quiet:
                click.echo(_outcome_line(outcome), err=True)
            yield outcome


def note_if_opaque(suffix: str) -> None:
    """Says of a transparent picture that a file of that suffix puts white behind it, if so."""
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
    stances = list(dict.fromkeys(
        "; ".join(filter(None, (stance.description, choice)))
        for stance, choice in zip(outcome.placements, outcome.choices, strict=True)
    ))  # fmt: skip
    others = "; its other clouds otherwise" if len(stances) > 1 else ""
    return f"rendered: {name} -> {pictures} ({read}, {outcome.seconds:.2f} s{note}; {stances[0]}{others})"


def scan_label(scan: Path) -> str:
    """What a line calls a scan."""
    from z2p_renderer.storage.files.printable_names import printable
    from z2p_renderer.storage.scans.unpack import is_spooled

    return "standard input" if is_spooled(scan) else printable(scan)


def describe_points(points: int, total: int, dropped: int, repeated: int) -> str:
    """How many points were read, of how many that they stand for, and how many rows were left out."""
    told = f"{points} points" + (f" that stand for {total}" if total else "")
    told += f", {dropped} not finite dropped" if dropped else ""
    return told + (f", {repeated} repeated dropped" if repeated else "")


def outcome_to_json(outcome: Outcome, settings: dict[str, Any]) -> dict[str, Any]:
    """One file's JSON line; `output` is where the first of `outputs` belongs, the only one for most files.

    `settings` is what was asked of every picture, `stances` what became of up, view and elevation in each one drawn,
    `weights` the names of what drew it.
    """
    from z2p_renderer.storage.scans.unpack import is_spooled

    stances = [stance.to_json() for stance in outcome.placements]
    for stance in stances:
        stance["elevation"] = settings["elevation"] if stance["elevation"] is None else stance["elevation"]
    return {
        "input": "-" if is_spooled(outcome.scan) else str(outcome.scan),
        "output": str(outcome.outputs[0]),
        "outputs": [str(path) for path in outcome.outputs if path.is_file()],
        "status": outcome.status,
        "points": outcome.points,
        "dropped": outcome.dropped,
        "repeated": outcome.repeated,
        "total": outcome.total or outcome.points + outcome.dropped + outcome.repeated,
        "seconds": round(outcome.seconds, 4),
        "error": outcome.error,
        "note": outcome.note,
        "stances": stances,
        "weights": outcome.weights,
        "settings": settings,
    }
