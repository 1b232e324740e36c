"""`z2p render`, once `z2p run-inference`: point clouds to pictures, with an option for each installed control."""

from __future__ import annotations

import json
import warnings
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from z2p_core.interfaces import Value
from z2p_renderer.pipeline.cli.errors import is_debugging
from z2p_renderer.pipeline.cli.options.controls import CONTROL_SETTINGS_KEY, InferenceCommand
from z2p_renderer.pipeline.cli.options.inputs import find_input_scans
from z2p_renderer.pipeline.cli.options.palettes import PALETTES, palette_colors
from z2p_renderer.pipeline.cli.options.param_types import FileFormat, OutputPath, SheetGrid, is_output_folder
from z2p_renderer.pipeline.cli.options.pictures import (
    check_view_options,
    check_writable,
    look_from,
    parse_columns,
    picture_options,
)
from z2p_renderer.pipeline.cli.progress import (
    Progress,
    note_if_opaque,
    open_progress,
    outcome_to_json,
    report_outcomes,
    settings_to_json,
)

if TYPE_CHECKING:  # at run time these wait until the options have been read: they are slow to import
    from z2p_renderer.pipeline.inference.batch import Outcome, Task
    from z2p_renderer.pipeline.inference.look import Look
    from z2p_renderer.pipeline.inference.weight_selection import AnyRenderer

NOT_WRITTEN = (".bmp", ".gif", ".mp4", ".svg", ".pdf", ".eps", ".exr", ".avif")
"""Suffixes that nobody means as a folder's."""
SUFFIXES = {"png": ".png", "webp": ".webp", "jpeg": ".jpg", "tiff": ".tif"}
SUFFIX_NAMES = {"jpg": "jpeg", "tif": "tiff"}


@click.command(cls=InferenceCommand, context_settings={"show_default": True})
@click.argument("inputs", nargs=-1, required=True, metavar="INPUT...")
@click.option("--output", "-o", default="pictures", type=OutputPath(), metavar="OUT",
              help="Folder for the pictures; or, for one cloud, the picture itself (.png, .webp, .jpg, .tif).")
@click.option("--format", "format_", default="png", type=FileFormat(list(SUFFIXES), SUFFIX_NAMES),
              help="Of pictures in a folder.")
@picture_options
@click.option("--same-frame", is_flag=True,
              help="One camera for all clouds, which keep their sizes and places in it; with --fit tight one crop.")
@click.option("--save-camera", type=OutputPath(file=True), metavar="FILE",
              help="Write the camera as JSON; several clouds need --same-frame.")
@click.option("--palette", "palette_name", type=click.Choice(list(PALETTES)),
              help="Colours for a series, a cloud each in turn, safe for colour-blind readers.")
@click.option("--sheet", type=SheetGrid(), metavar="4x3", help="Contact sheets OUT/sheet.png of so many columns and rows.")
@click.option("--gallery", is_flag=True, help="OUT/gallery.html, one page with all pictures and their settings.")
@click.option("--overwrite", is_flag=True,
              help="Render again what is there; it is skipped otherwise, but for one named picture whose settings "
              "have changed.")
@click.option("--json", "as_json", is_flag=True, help="One JSON line a file on stdout.")
@click.option("--jobs", type=click.IntRange(min=1), metavar="N",
              help="Files rendered at the same time.  [default: one a core]")
@click.option("--quiet", "-q", is_flag=True, help="Tell of failures only.")
@click.pass_context
def render(ctx: click.Context, inputs: tuple[str, ...], output: Path, **options: Any) -> None:
    """Render point clouds to pictures: each INPUT is a file, a folder, a quoted glob, or - for standard input.

    \b
    z2p render scans/ --output pictures
    z2p render bunny.ply -o bunny.png --color teal --light 3.6,30,45
    z2p render "frames/*.pcd" -o frames --same-frame --sheet 4x3 --gallery

    Each picture carries what made it: see `z2p info`, and change it with `z2p rerender`.

    Exit status: 0 all rendered or there before, 1 some files failed (the others are done), 2 wrong usage.
    """
    with warnings.catch_warnings():
        if not is_debugging():
            warnings.simplefilter("ignore")  # libraries' remarks would bury the one line a file gets
        failed = _run(ctx, inputs, output, ctx.meta.get(CONTROL_SETTINGS_KEY, {}), options)
    ctx.exit(1 if failed else 0)


def _run(
    ctx: click.Context, inputs: tuple[str, ...], output: Path, values: dict[str, Value], options: dict[str, Any]
) -> int:
    """How many files failed, and how many of the pages and sheets beside them."""
    columns = parse_columns(options)
    if options["palette_name"] and "color" in values:
        raise click.UsageError("--palette and --color both choose the colour; leave one out", ctx)
    check_view_options(ctx, values, options)
    scans = find_input_scans(ctx, inputs, options, columns is not None)
    from z2p_core.parallel import core_count
    from z2p_renderer.pipeline.inference.batch import render_files
    from z2p_renderer.pipeline.inference.weight_selection import load_renderer

    jobs = min(options["jobs"] or core_count(), len(scans))
    threads = None if jobs == 1 else max(1, core_count() // jobs)
    renderer = load_renderer(options["weights"], values, threads, options["engine"])
    look = look_from(renderer, values, options)
    tasks = _plan(ctx, scans, inputs, output, options)
    _check_extras(ctx, tasks, output, options)
    if options["same_frame"]:
        renderer, look = _same_frame(scans, renderer, look, columns, options["quiet"])
    elif options["save_camera"] is not None and len(scans) > 1:
        raise click.UsageError(f"--save-camera: {len(scans)} scans have a camera each; add --same-frame", ctx)
    bar = open_progress(len(tasks), options["quiet"])
    outcomes = render_files(tasks, renderer, look, options["overwrite"], jobs, columns, bar.drawn)
    counts, done = _render(outcomes, bar, renderer, look, options)
    lost = _write_extras(done, output, look, options)
    if not options["quiet"]:
        click.echo(f"{counts['ok']} rendered, {counts['skipped']} skipped, {counts['failed']} failed", err=True)
    return counts["failed"] + lost


def _render(
    outcomes: Iterator[Outcome], bar: Progress, renderer: AnyRenderer, look: Look, options: dict[str, Any]
) -> tuple[dict[str, int], list[Outcome]]:
    """How many files ended in which way, and all that became of them, each told as it gets done."""
    settings = settings_to_json(renderer, look, options)
    counts, done = {"ok": 0, "skipped": 0, "failed": 0}, []
    for outcome in report_outcomes(outcomes, bar, options["quiet"]):
        counts[outcome.status] += 1
        done.append(outcome)
        if options["as_json"]:
            click.echo(json.dumps(outcome_to_json(outcome, settings)))
    return counts, done


def _plan(
    ctx: click.Context, scans: list[Path], inputs: tuple[str, ...], output: Path, options: dict[str, Any]
) -> list[Task]:
    """The tasks, once it is sure that their pictures can be written."""
    from z2p_renderer.pipeline.inference.batch import Task, plan_outputs
    from z2p_renderer.storage.images.image_files import FORMATS

    alone = output.suffix.lower() in FORMATS and not is_output_folder(ctx, output)
    if output.suffix.lower() in NOT_WRITTEN and not is_output_folder(ctx, output):
        loops = "; loops are made by z2p animate" if output.suffix.lower() in (".gif", ".mp4") else ""
        raise click.UsageError(f"--output {output}: expected a folder, or a picture named {', '.join(FORMATS)}{loops}",
                               ctx)  # fmt: skip
    suffix = output.suffix.lower() if alone else SUFFIXES[options["format_"]]
    if alone and len(scans) > 1:
        raise click.UsageError(f"--output {output} names one picture, but {len(scans)} scans match; give a folder", ctx)
    given = ctx.get_parameter_source("format_") is not click.core.ParameterSource.DEFAULT
    if alone and given and FORMATS[suffix] != FORMATS[SUFFIXES[options["format_"]]]:
        raise click.UsageError(f"--format {options['format_']} does not fit --output {output}; leave it out", ctx)
    check_writable(output.parent if alone else output)
    if options["background"] == "transparent" and not options["quiet"]:
        note_if_opaque(suffix)
    if alone:
        tasks = [Task(scans[0], output, single=True)]
    else:
        folders = [Path(text) for text in inputs if Path(text).is_dir()]
        tasks = plan_outputs(scans, folders, output, options["recursive"], suffix)
    colors = palette_colors(options["palette_name"]) if options["palette_name"] else ()
    return [replace(task, colors=colors[turn % len(colors) :] + colors[: turn % len(colors)]) if colors else task
            for turn, task in enumerate(tasks)]  # fmt: skip


def _check_extras(ctx: click.Context, tasks: list[Task], output: Path, options: dict[str, Any]) -> None:
    """Contact sheets, gallery and camera replace nobody's file: said before the first picture is drawn."""
    from z2p_renderer.storage.images.image_files import FORMATS

    folder = output.parent if output.suffix.lower() in FORMATS and not output.is_dir() else output
    if options["sheet"] is not None:
        from z2p_renderer.pipeline.outputs.contact_sheet import check_sheet_places

        columns, rows = options["sheet"]
        count = -(-len(tasks) // (columns * rows))
        names = {"sheet.png", *(f"sheet_{number}.png" for number in range(2, count + 1))}
        for task in tasks:
            if task.output.parent == folder and task.output.name in names:
                raise click.UsageError(f"--sheet writes {task.output}, which is the picture of {task.scan} too; rename "
                                       "the scan", ctx)  # fmt: skip
        check_sheet_places(folder, count)
    if options["gallery"]:
        from z2p_renderer.pipeline.outputs.gallery import check_gallery_place

        check_gallery_place(folder / "gallery.html")
    if options["save_camera"] is not None:
        from z2p_renderer.storage.cameras import check_camera_place

        taken = [path for task in tasks for path in (task.scan, task.output)]
        check_camera_place(options["save_camera"], [*taken, folder / "gallery.html"])
        check_writable(options["save_camera"].parent, "--save-camera")


def _same_frame(
    scans: list[Path], renderer: AnyRenderer, look: Look, columns: tuple[str, ...] | None, quiet: bool
) -> tuple[AnyRenderer, Look]:
    """The weights for all, and the look with the one camera that fits all clouds, and one crop if they are trimmed."""
    from z2p_renderer.pipeline.inference.common_view import common_crop, common_viewpoint
    from z2p_renderer.pipeline.inference.render_scan import camera_elevation
    from z2p_renderer.pipeline.inference.weight_selection import select_renderer

    if look.placement_options.viewpoint is None:  # a loaded camera is one for all already
        series = common_viewpoint(scans, look.placement_options, *camera_elevation(renderer, look.values), columns)
        renderer, choice = select_renderer(renderer, series.first)
        if not quiet:
            told = "; ".join(filter(None, (series.told, choice)))
            click.echo("\n".join([f"one frame for {series.clouds} clouds: {told}", *series.notes]), err=True)
        placing = replace(look.placement_options, viewpoint=series.viewpoint, azimuth=0.0, grounded=series.grounded)
        look = replace(look, placement_options=placing)
    if look.tight:
        look = replace(look, crop=common_crop(scans, renderer, look, columns))
    return renderer, look


def _write_extras(done: list[Outcome], output: Path, look: Look, options: dict[str, Any]) -> int:
    """Writes the camera, the contact sheets and the gallery, those that were asked for; how many could not be."""
    from z2p_renderer.storage.images.image_files import is_readable_picture

    pictures = [path for outcome in done for path in outcome.outputs
                if path.is_file() and (outcome.status != "failed" or is_readable_picture(path))]  # fmt: skip
    folder = output if output.is_dir() else output.parent
    extras: dict[str, Callable[[], list[Path]]] = {}
    if options["save_camera"] is not None:
        extras["the camera"] = lambda: _save_camera(done, look, options)
    if options["sheet"] is not None and pictures:
        extras["the contact sheets"] = lambda: _write_sheets(pictures, folder, options["sheet"])
    if options["gallery"] and pictures:
        extras["the gallery"] = lambda: _write_gallery(pictures, folder)
    failed = 0
    for name, write in extras.items():
        try:
            written = write()
        except OSError as error:  # the disk is full, say; the pictures are there
            failed += 1
            click.echo(f"failed: {name}: {error.strerror or error}", err=True)
            continue
        for path in () if options["quiet"] else written:
            click.echo(f"wrote {path}", err=True)
    return failed


def _write_sheets(pictures: list[Path], folder: Path, grid: tuple[int, int]) -> list[Path]:
    from z2p_renderer.pipeline.outputs.contact_sheet import write_contact_sheets

    return write_contact_sheets(pictures, folder, *grid)


def _write_gallery(pictures: list[Path], folder: Path) -> list[Path]:
    from z2p_renderer.pipeline.outputs.gallery import write_gallery

    return [write_gallery(pictures, folder / "gallery.html")]


def _save_camera(done: list[Outcome], look: Look, options: dict[str, Any]) -> list[Path]:
    from z2p_core.placement.margin import with_margin
    from z2p_renderer.storage.cameras import read_camera, write_camera

    viewpoints = [viewpoint for outcome in done for viewpoint in outcome.viewpoints]
    if options["same_frame"] and look.placement_options.viewpoint is not None:
        viewpoints = [with_margin(look.placement_options.viewpoint, look.frame_margin)]
    if not viewpoints and done[0].status == "skipped":
        viewpoints = [read_camera(done[0].outputs[0])]
    if len(viewpoints) > 1:
        raise click.UsageError(f"--save-camera: the file's {len(viewpoints)} clouds have a camera each; "
                               "add --same-frame")
    if not viewpoints:
        return []  # the file failed, which has been told
    write_camera(viewpoints[0], options["save_camera"])
    return [options["save_camera"]]
