"""`z2p animate`: point clouds to loops, in which the object turns or the light moves."""

from __future__ import annotations

import sys
import time
import warnings
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from z2p_core.interfaces import Value
from z2p_renderer.pipeline.cli.errors import ExitStatus, is_debugging
from z2p_renderer.pipeline.cli.options.cameras import read_own_cameras
from z2p_renderer.pipeline.cli.options.coloring import color_options, color_options_from
from z2p_renderer.pipeline.cli.options.controls import CONTROL_SETTINGS_KEY, InferenceCommand
from z2p_renderer.pipeline.cli.options.inputs import find_input_scans
from z2p_renderer.pipeline.cli.options.param_types import (
    FileFormat,
    FiniteRange,
    OutputPath,
    SheetGrid,
    is_output_folder,
)
from z2p_renderer.pipeline.cli.options.pictures import (
    check_view_options,
    check_writable,
    look_from_options,
    parse_columns,
    picture_options,
)
from z2p_renderer.pipeline.cli.progress import describe_points, note_if_opaque, scan_label

if TYPE_CHECKING:  # slow to import: imported at run time only when the options have been read
    from z2p_core.pinhole import AnyCamera
    from z2p_renderer.pipeline.batch.tasks import Task
    from z2p_renderer.pipeline.inference.look import Look
    from z2p_renderer.pipeline.inference.weight_selection import AnyRenderer
    from z2p_renderer.pipeline.outputs.animation import Motion
    from z2p_renderer.storage.scans.clouds import Scan


@click.command(cls=InferenceCommand, context_settings={"show_default": True})
@click.argument("inputs", nargs=-1, required=True, metavar="INPUT...")
@click.option("--output", "-o", default="pictures", type=OutputPath(), metavar="OUT",
              help="Folder for the loops; or, for one cloud, the loop itself (.webp, .gif, .mp4).")
@click.option("--format", "format_", default="webp", type=FileFormat(["webp", "gif", "mp4"], {}),
              help="Format of the loops in a folder. WebP keeps the transparency; MP4 needs the extra 'video'.")
@click.option("--motion", default="turn", type=click.Choice(["turn", "orbit", "light"]),
              help="turn: the object turns once around; orbit: the light turns with it, as if the camera went around; "
              "light: the light moves from side to side and back.")
@click.option("--frames", default=48, type=click.IntRange(2, 720), metavar="N", help="Number of frames.")
@click.option("--fps", default=24.0, type=FiniteRange(1, 60), metavar="N",
              help="Frames per second; a GIF has at most 50.")
@click.option("--steady", default=1, type=click.IntRange(1, 9), metavar="N",
              help="Number of pictures averaged into each frame: a little smoother, N times slower.")
@click.option("--grid", type=SheetGrid(), metavar="4x3",
              help="Make one film OUT, in which all clouds move side by side in so many columns and rows.")
@picture_options
@color_options
@click.option("--overwrite", is_flag=True,
              help="Make existing loops again. Otherwise they are skipped, except a single named loop whose settings "
              "have changed.")
@click.option("--quiet", "-q", is_flag=True, help="Report failures only.")
@click.pass_context
def animate(ctx: click.Context, inputs: tuple[str, ...], output: Path, **options: Any) -> None:
    """Turn point clouds into loops: turntables, orbits, light sweeps, and flights along a path of cameras.

    \b
    z2p animate bunny.ply -o bunny.webp
    z2p animate scans/ -o loops --format gif --background white --resolution 320
    z2p animate bunny.ply -o light.mp4 --motion light --frames 96
    z2p animate bunny.ply -o flight.mp4 --cameras transforms.json

    Exit status: 0 all made or already there, 1 some files failed (the others are done), 2 wrong usage.
    """
    with warnings.catch_warnings():
        if not is_debugging():
            warnings.simplefilter("ignore")  # warnings of libraries would bury the one line for each file
        failed = _run(ctx, inputs, output, ctx.meta.get(CONTROL_SETTINGS_KEY, {}), options)
    ctx.exit(ExitStatus.SOME_FAILED if failed else ExitStatus.DONE)


def _run(
    ctx: click.Context, inputs: tuple[str, ...], output: Path, controls: dict[str, Value], options: dict[str, Any]
) -> bool:
    """Makes all loops; returns True if one failed."""
    columns = parse_columns(options)
    options["own_cameras"] = read_own_cameras(ctx, options, always_sized=True)
    check_view_options(ctx, controls, options)
    colors = color_options_from(ctx, controls, options)
    scans = find_input_scans(ctx, inputs, options, columns is not None)
    from z2p_renderer.pipeline.batch.render_files import describe_failure
    from z2p_renderer.pipeline.coloring.common_scale import scans_of
    from z2p_renderer.pipeline.inference.render_scan import with_common_scale
    from z2p_renderer.pipeline.inference.weight_selection import load_renderer
    from z2p_renderer.pipeline.outputs.animation import Motion
    from z2p_renderer.pipeline.outputs.camera_path import check_path

    renderer = load_renderer(options["weights"], controls, engine=options["engine"])
    look = look_from_options(renderer, controls, options, colors)
    if len(scans) > 1 and colors.needs_common_scale:
        look, _ = with_common_scale(renderer, scans_of(scans, columns, colors), look)
    motion, cameras = Motion(options["motion"], options["frames"], options["steady"]), options["own_cameras"]
    if cameras is not None:
        check_path(cameras)
        motion = Motion("path", len(cameras))
    if options["grid"] is not None:
        from z2p_renderer.pipeline.cli.animate_grid import write_grid

        return write_grid(ctx, scans, output, renderer, look, motion, columns, options)
    has_failed = False
    for task in _plan(ctx, scans, inputs, output, options):
        try:
            loop = _Loop(task, look.written_as(task.output.suffix.lower()), motion, options["fps"], columns,
                         tuple(cameras or ()))
            line = loop.make(renderer, options["overwrite"], options["quiet"])
        except Exception as error:  # the other files are made whatever one of them raises
            has_failed = True
            click.echo(f"failed: {scan_label(task.scan)}: {describe_failure(error, task.scan)}", err=True)
            continue
        if not options["quiet"]:
            click.echo(line, err=True)
    return has_failed


def _plan(
    ctx: click.Context, scans: list[Path], inputs: tuple[str, ...], output: Path, options: dict[str, Any]
) -> list[Task]:
    """The tasks; makes sure beforehand that their loops can be written."""
    from z2p_renderer.pipeline.batch.tasks import Task, plan_outputs
    from z2p_renderer.storage.images.animations import ANIMATION_SUFFIXES, check_animation_suffix
    from z2p_renderer.storage.images.image_files import FORMATS

    is_folder = is_output_folder(ctx, output)
    is_loop = output.suffix.lower() in ANIMATION_SUFFIXES and not is_folder
    suffix = output.suffix.lower() if is_loop else f".{options['format_']}"
    if is_loop and len(scans) > 1:
        raise click.UsageError(f"--output {output} names one loop, but {len(scans)} scans match; give a folder", ctx)
    if not is_loop and output.suffix.lower() in FORMATS and not is_folder:
        raise click.UsageError(f"--output {output}: expected a folder, or a loop named "
                               f"{', '.join(ANIMATION_SUFFIXES)}; still pictures are made by z2p run-inference", ctx)
    check_animation_suffix(suffix)
    check_writable(output.parent if is_loop else output)
    if options["background"] == "transparent" and not options["quiet"]:
        note_if_opaque(suffix)
    if is_loop:
        return [Task(scans[0], output, single=True)]
    return plan_outputs(scans, [Path(text) for text in inputs if Path(text).is_dir()], output, options["recursive"],
                        suffix)  # fmt: skip


@dataclass(frozen=True)
class _Loop:
    """The loop of one file that is to be made."""

    task: Task
    look: Look
    motion: Motion
    fps: float
    columns: tuple[str, ...] | None
    cameras: tuple[AnyCamera, ...] = ()
    """A path of cameras, one a frame; empty for other motions."""

    def make(self, renderer: AnyRenderer, overwrite: bool, quiet: bool) -> str:
        """Writes the loop, unless one that fits is there already; returns the line to print.

        Raises:
            ScanError: the scan cannot be read, or holds several clouds.
            PictureError: the existing loop shows another cloud.
        """
        from z2p_renderer.storage.files.printable_names import printable

        started, name, output = time.perf_counter(), scan_label(self.task.scan), printable(self.task.output)
        note = None if overwrite or not self.task.output.exists() else self._kept_note(renderer)
        if note is not None:
            difference = f", {note}" if note else ""
            return f"skipped: {name}: {output} is there already{difference}; --overwrite makes it again"
        description = self._write(renderer, quiet)
        seconds = time.perf_counter() - started
        return f"rendered: {name} -> {output} ({self.motion.frames} frames, {seconds:.1f} s; {description})"

    def _kept_note(self, renderer: AnyRenderer) -> str | None:
        """How the existing loop differs from the settings, in words, if it is kept; None if it is to be made again."""
        from z2p_renderer.pipeline.batch.existing_outputs import kept_output_note

        source, single = self._source, self.task.single
        return kept_output_note(self.task.output, source, self.look, renderer, self._motion_record, single)

    def _write(self, renderer: AnyRenderer, quiet: bool) -> str:
        """Draws and writes the loop; returns what the reader and the placement found, in words."""
        from z2p_core.interfaces import ScanError
        from z2p_renderer.pipeline.inference.render_scan import build_record
        from z2p_renderer.pipeline.outputs.animation import draw_opening, render_frames
        from z2p_renderer.pipeline.outputs.camera_path import render_path
        from z2p_renderer.storage.images.animations import write_animation
        from z2p_renderer.storage.scans.clouds import format_suffix

        clouds, suffix = self._read(), format_suffix(self.task.scan)
        if len(clouds) > 1:
            raise ScanError(f"holds {len(clouds)} clouds, a loop shows one; save it alone")
        [cloud] = clouds
        opening = draw_opening(renderer, cloud, suffix, self.look)
        if self.cameras:
            frames = render_path(opening, cloud, suffix, self.look, self.cameras)
        else:
            frames = render_frames(opening, cloud, self.look, self.motion)
        if not quiet and sys.stderr.isatty():
            from tqdm import tqdm

            frames = tqdm(frames, total=self.motion.frames, unit="frame", file=sys.stderr, leave=False)
        record = {**build_record(opening, self.look, self._source), "motion": self._motion_record}
        write_animation(list(frames), self.task.output, self.fps, self.look.background, record)
        points = describe_points(len(cloud.points), cloud.total or 0, cloud.dropped, cloud.repeated)
        colors = "" if opening.coloring is None else opening.coloring.description
        placement = opening.placement.description
        return "; ".join(filter(None, (points, cloud.note, colors, placement, opening.weights_reason)))

    def _read(self) -> list[Scan]:
        """The clouds of the file.

        Raises:
            ScanError: one of them cannot be drawn.
        """
        from z2p_core.interfaces import ScanError
        from z2p_renderer.pipeline.coloring.fields import read_scans

        clouds = []
        for cloud in read_scans(self.task.scan, self.columns, self.look.color_options, self.look.max_rows):
            if isinstance(cloud, ScanError):
                raise cloud
            clouds.append(cloud)
        return clouds

    @cached_property
    def _source(self) -> dict[str, Any]:
        """The cloud, for the record."""
        from z2p_renderer.pipeline.inference.scan_source import describe_source

        return describe_source(self.task.scan, self.task.output, 0, self.columns)

    @property
    def _motion_record(self) -> dict[str, Any]:
        """The motion, for the record."""
        from z2p_renderer.pipeline.outputs.camera_path import path_digest

        path = {"cameras": path_digest(self.cameras)} if self.cameras else {}
        return {**asdict(self.motion), "fps": self.fps, **path}
