"""`z2p animate --grid`: the loops of several clouds side by side, as one film."""

from __future__ import annotations

import sys
import time
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from z2p_renderer.pipeline.cli.options.pictures import check_writable
from z2p_renderer.pipeline.cli.progress import note_if_opaque

if TYPE_CHECKING:
    from z2p_renderer.pipeline.inference.look import Look
    from z2p_renderer.pipeline.inference.weight_selection import AnyRenderer
    from z2p_renderer.pipeline.outputs.animation import Motion


def write_grid(
    ctx: click.Context, files: list[Path], output: Path, renderer: AnyRenderer, look: Look, motion: Motion,
    columns: tuple[str, ...] | None, options: dict[str, Any],
) -> bool:  # fmt: skip
    """Writes one film of all clouds of the files; returns True if some were left out.

    Raises:
        click.UsageError: the output is no film's name or there already, or the grid has too few cells.
        ScanError: no file can be read.
    """
    from z2p_renderer.pipeline.inference.render_scan import build_record
    from z2p_renderer.pipeline.inference.scan_source import describe_source
    from z2p_renderer.pipeline.outputs.series import series_of_files
    from z2p_renderer.pipeline.outputs.turning_grid import draw_openings, grid_frames
    from z2p_renderer.storage.images.animations import write_animation

    _check_output(ctx, output, options)
    started, failures = time.perf_counter(), []

    def report(line: str) -> None:
        failures.append(line)
        click.echo(f"failed: {line}; left out", err=True)

    series = series_of_files(files, columns, look.color_options, report)
    clouds = list(series.scans())
    across, down = options["grid"]
    if len(clouds) > across * down:
        raise click.UsageError(f"--grid {across}x{down} has {across * down} cells, but there are {len(clouds)} clouds",
                               ctx)  # fmt: skip
    look = look.written_as(output.suffix.lower())
    openings = draw_openings(clouds, [None] * len(clouds), renderer, look)
    frames = grid_frames(clouds, openings, motion, across)
    if not options["quiet"] and sys.stderr.isatty():
        from tqdm import tqdm

        frames = tqdm(frames, total=motion.frames, unit="frame", file=sys.stderr, leave=False)
    source = describe_source(files[series.places[0][0]], output, 0, columns)
    record = {**build_record(openings[0][0], look, source), "batch": len(clouds),
              "motion": {**asdict(motion), "fps": options["fps"]}}  # fmt: skip
    write_animation(frames, output, options["fps"], look.background, record)
    if not options["quiet"]:
        seconds = time.perf_counter() - started
        click.echo(f"rendered: {len(clouds)} clouds -> {output} ({motion.frames} frames, {seconds:.1f} s)", err=True)
    return bool(failures)


def _check_output(ctx: click.Context, output: Path, options: dict[str, Any]) -> None:
    from z2p_renderer.storage.files.printable_names import path_exists, printable
    from z2p_renderer.storage.images.animations import check_animation_suffix

    check_animation_suffix(output.suffix.lower())
    check_writable(output.parent)
    if path_exists(output) and not options["overwrite"]:
        raise click.UsageError(f"--output {printable(output)} is there already; --overwrite replaces it", ctx)
    if options["background"] == "transparent" and not options["quiet"]:
        note_if_opaque(output.suffix.lower())
