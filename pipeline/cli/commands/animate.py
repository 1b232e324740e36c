"""`z2p animate`: point clouds to loops, an object that turns or a light that goes around it."""

from __future__ import annotations

import sys
import time
import warnings
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from z2p_renderer.pipeline.cli.errors import is_debugging
from z2p_renderer.pipeline.cli.options.controls import CONTROL_SETTINGS_KEY, InferenceCommand
from z2p_renderer.pipeline.cli.options.inputs import find_input_scans
from z2p_renderer.pipeline.cli.options.param_types import FileFormat, FiniteRange, OutputPath, is_output_folder
from z2p_renderer.pipeline.cli.options.pictures import (
    check_view_options,
    check_writable,
    look_from_options,
    parse_columns,
    picture_options,
)
from z2p_renderer.pipeline.cli.progress import describe_points, note_if_opaque, scan_label

if TYPE_CHECKING:  # at run time these wait until the options have been read: they are slow to import
    from z2p_renderer.pipeline.inference.batch import Task
    from z2p_renderer.pipeline.inference.look import Look
    from z2p_renderer.pipeline.inference.weight_selection import AnyRenderer
    from z2p_renderer.pipeline.outputs.animation import Motion


@click.command(cls=InferenceCommand, context_settings={"show_default": True})
@click.argument("inputs", nargs=-1, required=True, metavar="INPUT...")
@click.option("--output", "-o", default="pictures", type=OutputPath(), metavar="OUT",
              help="Folder for the loops; or, for one cloud, the loop itself (.webp, .gif, .mp4).")
@click.option("--format", "format_", default="webp", type=FileFormat(["webp", "gif", "mp4"], {}),
              help="Of loops in a folder. WebP keeps the transparency; MP4 needs the extra 'video'.")
@click.option("--motion", default="turn", type=click.Choice(["turn", "light"]),
              help="turn: the object, once around; light: the light, from side to side and back.")
@click.option("--frames", default=48, type=click.IntRange(2, 720), metavar="N", help="Frames of the loop.")
@click.option("--fps", default=24.0, type=FiniteRange(1, 60), metavar="N",
              help="Frames a second; a GIF has at most 50.")
@click.option("--steady", default=1, type=click.IntRange(1, 9), metavar="N",
              help="Pictures that each frame is the mean of: little smoother, N times slower.")
@picture_options
@click.option("--overwrite", is_flag=True,
              help="Make again what is there; it is skipped otherwise, but for one named loop whose settings have "
              "changed.")
@click.option("--quiet", "-q", is_flag=True, help="Tell of failures only.")
@click.pass_context
def animate(ctx: click.Context, inputs: tuple[str, ...], output: Path, **options: Any) -> None:
    """Turn point clouds into loops: turntables and light sweeps.

    \b
    z2p animate bunny.ply -o bunny.webp
    z2p animate scans/ -o loops --format gif --background white --resolution 320
    z2p animate bunny.ply -o light.mp4 --motion light --frames 96

    Exit status: 0 all made or there before, 1 some files failed (the others are done), 2 wrong usage.
    """
    with warnings.catch_warnings():
        if not is_debugging():
            warnings.simplefilter("ignore")  # libraries' remarks would bury the one line a file gets
        failed = _run(ctx, inputs, output, options)
    ctx.exit(1 if failed else 0)


def _run(ctx: click.Context, inputs: tuple[str, ...], output: Path, options: dict[str, Any]) -> bool:
    """True when a file failed."""
    columns = parse_columns(options)
    values = ctx.meta.get(CONTROL_SETTINGS_KEY, {})
    check_view_options(ctx, values, options)
    scans = find_input_scans(ctx, inputs, options, columns is not None)
    from z2p_renderer.pipeline.inference.batch import fault_message
    from z2p_renderer.pipeline.inference.weight_selection import load_renderer
    from z2p_renderer.pipeline.outputs.animation import Motion
    from z2p_renderer.storage.files.printable_names import printable

    renderer = load_renderer(options["weights"], values, engine=options["engine"])
    look = look_from_options(renderer, values, options)
    motion = Motion(options["motion"], options["frames"], options["steady"])
    failed = False
    for task in _plan(ctx, scans, inputs, output, options):
        started, name = time.perf_counter(), scan_label(task.scan)
        try:
            loop = _Loop(task, look.written_as(task.output.suffix.lower()), motion, options["fps"], columns)
            kept = None if options["overwrite"] or not task.output.exists() else loop.told_if_kept(renderer)
            if kept is not None:
                other = f", {kept}" if kept else ""
                told = f"skipped: {name}: {printable(task.output)} is there already{other}; --overwrite makes it again"
            else:
                how = loop.write(renderer, options["quiet"])
                told = (f"rendered: {name} -> {printable(task.output)} ({motion.frames} frames, "
                        f"{time.perf_counter() - started:.1f} s; {how})")
        except Exception as error:  # whatever a file brings up, the other files go on
            failed = True
            click.echo(f"failed: {name}: {fault_message(error, task.scan)}", err=True)
            continue
        if not options["quiet"]:
            click.echo(told, err=True)
    return failed


@dataclass(frozen=True)
class _Loop:
    """One file on its way to its loop."""

    task: Task
    look: Look
    motion: Motion
    rate: float
    """Frames a second."""
    columns: tuple[str, ...] | None

    @property
    def moves(self) -> dict[str, Any]:
        """The motion, for the record."""
        return {**asdict(self.motion), "fps": self.rate}

    @cached_property
    def source(self) -> dict[str, Any]:
        """The cloud, for the record."""
        from z2p_renderer.pipeline.inference.batch import describe_source

        return describe_source(self.task.scan, self.task.output, 0, self.columns)

    def told_if_kept(self, renderer: AnyRenderer) -> str | None:
        """What to say of the loop that is there and stays; None where it is to be made anew.

        Raises:
            PictureError: it shows another cloud.
        """
        from z2p_renderer.pipeline.outputs.existing_outputs import kept_output_note

        return kept_output_note(self.task.output, self.source, self.look, renderer, self.moves, self.task.single)

    def write(self, renderer: AnyRenderer, quiet: bool) -> str:
        """Write the loop of the file's only cloud; what is told of the cloud and of how it stands."""
        from z2p_core.interfaces import ScanError
        from z2p_renderer.pipeline.inference.render_scan import build_record
        from z2p_renderer.pipeline.outputs.animation import draw_opening, render_frames
        from z2p_renderer.storage.images.animations import write_animation
        from z2p_renderer.storage.scans.clouds import format_suffix, read_clouds

        clouds, suffix = read_clouds(self.task.scan, self.columns), format_suffix(self.task.scan)
        if len(clouds) > 1:
            raise ScanError(f"holds {len(clouds)} clouds, a loop shows one; save it alone")
        [cloud], silent = clouds, quiet or not sys.stderr.isatty()
        first = draw_opening(renderer, cloud, suffix, self.look)
        frames = render_frames(first, cloud, suffix, self.look, self.motion)
        if not silent:
            from tqdm import tqdm

            frames = tqdm(frames, total=self.motion.frames, unit="frame", file=sys.stderr, leave=False)
        drawn = list(frames)
        made_by = {**build_record(first, self.look, self.source), "motion": self.moves}
        write_animation(drawn, self.task.output, self.rate, self.look.background, made_by)
        read = describe_points(len(cloud.points), cloud.total or 0, cloud.dropped, cloud.repeated)
        return "; ".join(filter(None, (read, cloud.note, first.placement.description, first.weights_reason)))


def _plan(
    ctx: click.Context, scans: list[Path], inputs: tuple[str, ...], output: Path, options: dict[str, Any]
) -> list[Task]:
    """The tasks, once it is sure that their loops can be written."""
    from z2p_renderer.pipeline.inference.batch import Task, plan_outputs
    from z2p_renderer.storage.images.animations import ANIMATION_SUFFIXES, check_animation_suffix
    from z2p_renderer.storage.images.image_files import FORMATS as PICTURES

    alone = output.suffix.lower() in ANIMATION_SUFFIXES and not is_output_folder(ctx, output)
    suffix = output.suffix.lower() if alone else f".{options['format_']}"
    if alone and len(scans) > 1:
        raise click.UsageError(f"--output {output} names one loop, but {len(scans)} scans match; give a folder", ctx)
    if not alone and output.suffix.lower() in PICTURES and not is_output_folder(ctx, output):
        raise click.UsageError(f"--output {output}: expected a folder, or a loop named {', '.join(ANIMATION_SUFFIXES)}; still "
                               "pictures are made by z2p run-inference", ctx)  # fmt: skip
    check_animation_suffix(suffix)
    check_writable(output.parent if alone else output)
    if options["background"] == "transparent" and not options["quiet"]:
        note_if_opaque(suffix)
    if alone:
        return [Task(scans[0], output, single=True)]
    return plan_outputs(scans, [Path(text) for text in inputs if Path(text).is_dir()], output, options["recursive"],
                        suffix)  # fmt: skip
