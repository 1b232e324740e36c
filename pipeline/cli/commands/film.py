"""`z2p film`: a series of point clouds, such as a training run or a moving scan, to one film."""

from __future__ import annotations

import sys
import time
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from z2p_core.interfaces import Value
from z2p_renderer.pipeline.cli.errors import ExitStatus, is_debugging
from z2p_renderer.pipeline.cli.options.coloring import color_options, color_options_from
from z2p_renderer.pipeline.cli.options.controls import CONTROL_SETTINGS_KEY, InferenceCommand
from z2p_renderer.pipeline.cli.options.inputs import find_input_scans
from z2p_renderer.pipeline.cli.options.param_types import FiniteRange, OutputPath, is_output_folder
from z2p_renderer.pipeline.cli.options.pictures import (
    check_view_options,
    check_writable,
    look_from_options,
    parse_columns,
    picture_options,
)
from z2p_renderer.pipeline.cli.progress import note_if_opaque

if TYPE_CHECKING:  # slow to import: imported at run time only when the options have been read
    from z2p_renderer.pipeline.inference.look import Look
    from z2p_renderer.pipeline.outputs.film import Film


class Reference(click.ParamType):
    """``first``, ``last`` or the number of a cloud, from 1 on; as an index, -1 for the last."""

    name = "first|last|N"

    def get_metavar(self, param: click.Parameter, ctx: click.Context) -> str:
        """The name as it is, which click would write in capitals."""
        return self.name

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> int:
        if isinstance(value, int):
            return value
        if value in ("first", "last"):
            return 0 if value == "first" else -1
        if not (value.isdecimal() and int(value) > 0):
            self.fail(f"expected first, last, or the number of a cloud from 1 on, got {value!r}", param, ctx)
        return int(value) - 1


@click.command(cls=InferenceCommand, context_settings={"show_default": True})
@click.argument("inputs", nargs=-1, required=True, metavar="INPUT...")
@click.option(
    "--output",
    "-o",
    default="film.webp",
    type=OutputPath(file=True),
    metavar="FILE",
    help="The film: .webp, .gif, .apng or, with the extra 'video', .mp4.",
)
@click.option(
    "--fps", default=24.0, type=FiniteRange(1, 60), metavar="N", help="Frames per second; a GIF has at most 50."
)
@click.option(
    "--hold", default=1, type=click.IntRange(1, 1000), metavar="N", help="Number of frames that show each cloud itself."
)
@click.option(
    "--blend",
    default=0,
    type=click.IntRange(0, 240),
    metavar="N",
    help="Number of frames between one cloud and the next.",
)
@click.option(
    "--blend-by",
    default="auto",
    type=click.Choice(["auto", "points", "pictures"]),
    help="What blends. points: each point moves in a straight line to the one of the same number; pictures: "
    "they fade; auto: points where two clouds hold the same ones in the same order, else pictures.",
)
@click.option(
    "--turns",
    default=0.0,
    type=FiniteRange(-100, 100),
    metavar="N",
    help="How often the object turns in front of the camera during the film.",
)
@click.option("--loop", "closes", is_flag=True, help="Blend the last cloud into the first again.")
@click.option(
    "--reference",
    default="first",
    type=Reference(),
    help="The cloud by which the up axis and the view are chosen: last for what begins as noise.",
)
@click.option("--frame", "frame_of", default="all", type=click.Choice(["all", "reference"]),
              help="all: every cloud fits; reference: that cloud fills the picture, others may reach beyond it.")
@picture_options
@color_options
@click.option("--overwrite", is_flag=True, help="Replace a film of that name.")
@click.option("--quiet", "-q", is_flag=True, help="Report failures only.")
@click.pass_context
def film(ctx: click.Context, inputs: tuple[str, ...], output: Path, **options: Any) -> None:
    """Turn a series of point clouds, one frame or more for each, into one film.

    \b
    z2p film "run/step_*.npy" -o run.mp4 --hold 2 --blend 4
    z2p film samples.npz -o samples.webp --blend 8 --turns 1 --reference last
    z2p film scans/ -o scan.gif --fps 10 --background white

    Camera, scale, floor, weights, resolution of the network and scale of colours are chosen once for the whole film.
    Files come in the order in which they are named, those of a folder or pattern by the numbers in their names; a
    file that holds several clouds stands for as many steps.

    What it cannot do: points that appear, vanish or change their order are not followed, pictures fade then; each
    frame is drawn by itself, so that a surface flickers a little where points are few.

    Exit status: 0 made, 1 some files were left out, 2 wrong usage or no film.
    """
    with warnings.catch_warnings():
        if not is_debugging():
            warnings.simplefilter("ignore")  # warnings of libraries would bury the lines of progress
        failed = _run(ctx, inputs, output, ctx.meta.get(CONTROL_SETTINGS_KEY, {}), options)
    ctx.exit(ExitStatus.SOME_FAILED if failed else ExitStatus.DONE)


def _run(
    ctx: click.Context, inputs: tuple[str, ...], output: Path, controls: dict[str, Value], options: dict[str, Any]
) -> bool:
    """Makes the film; returns True if files were left out of it."""
    columns = parse_columns(options)
    check_view_options(ctx, controls, options)
    colors = color_options_from(ctx, controls, options)
    files = _files_in_order(ctx, inputs, options, columns is not None)
    _check_output(ctx, output, files, options)
    from z2p_renderer.pipeline.inference.weight_selection import load_renderer
    from z2p_renderer.pipeline.outputs.film import FilmPlan, plan_film
    from z2p_renderer.pipeline.outputs.series import series_of_files

    started, failures = time.perf_counter(), []

    def report(line: str) -> None:
        failures.append(line)
        click.echo(f"failed: {line}; left out of the film", err=True)

    renderer = load_renderer(options["weights"], controls, engine=options["engine"])
    look = look_from_options(renderer, controls, options, colors).written_as(output.suffix.lower())
    plan = FilmPlan(options["hold"], options["blend"], options["blend_by"], options["turns"], options["closes"],
                    options["reference"], options["frame_of"] == "reference")  # fmt: skip
    series = series_of_files(files, columns, colors, report)
    planned = plan_film(series, renderer, look, plan)
    if not options["quiet"]:
        lines = [f"one frame for {len(series)} clouds: {planned.description}", *planned.notes]
        click.echo("\n".join(lines), err=True)
    _write(planned, output, look, options["fps"], files, columns, options["quiet"])
    if not options["quiet"]:
        seconds = time.perf_counter() - started
        click.echo(
            f"rendered: {len(series)} clouds -> {output} ({planned.frame_count} frames, {seconds:.1f} s)", err=True
        )
    return bool(failures)


def _files_in_order(
    ctx: click.Context, inputs: tuple[str, ...], options: dict[str, Any], named: bool
) -> list[Path]:  # fmt: skip
    """The files that the inputs stand for, in the order of the film."""
    from z2p_renderer.pipeline.outputs.series import natural_order

    groups = [natural_order(find_input_scans(ctx, (text,), options, named)) for text in inputs]
    files = [file for group in groups for file in group]
    if len(inputs) > 2 and list(inputs) == sorted(inputs):  # a shell's pattern, in the order of the alphabet
        return natural_order(files)
    return files


def _check_output(ctx: click.Context, output: Path, files: list[Path], options: dict[str, Any]) -> None:
    """Makes sure beforehand that the film can be written.

    Raises:
        click.UsageError: it is a folder, a scan of this run, or there already.
        PictureError: its suffix is of another format, or lacks its extra.
    """
    from z2p_renderer.storage.files.printable_names import path_exists, printable
    from z2p_renderer.storage.images.animations import check_animation_suffix

    if is_output_folder(ctx, output):
        raise click.UsageError(f"--output {output}: expected the film's name, got a folder's", ctx)
    check_animation_suffix(output.suffix.lower())
    check_writable(output.parent)
    if path_exists(output) and not options["overwrite"]:
        raise click.UsageError(f"--output {printable(output)} is there already; --overwrite replaces it", ctx)
    if any(output.absolute() == file.absolute() for file in files):
        raise click.UsageError(f"--output {output} is one of the scans; choose another name", ctx)
    if options["background"] == "transparent" and not options["quiet"]:
        note_if_opaque(output.suffix.lower())


def _write(
    film: Film, output: Path, look: Look, fps: float, files: list[Path], columns: tuple[str, ...] | None, quiet: bool
) -> None:
    """Draws and writes the film, with a bar on a terminal."""
    from z2p_renderer.pipeline.inference.render_scan import build_record
    from z2p_renderer.pipeline.inference.scan_source import describe_source
    from z2p_renderer.pipeline.outputs.film import film_record
    from z2p_renderer.storage.images.animations import write_animation

    frames = film.frames()
    if not quiet and sys.stderr.isatty():
        from tqdm import tqdm

        frames = tqdm(frames, total=film.frame_count, unit="frame", file=sys.stderr, leave=False)
    group, cloud = film.series.places[film.plan.reference]
    record = build_record(film.opening, film.look, describe_source(files[group], output, cloud, columns))
    write_animation(frames, output, fps, look.background, film_record(record, film, fps))
