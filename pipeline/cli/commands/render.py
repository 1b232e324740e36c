"""`z2p render`, also called `z2p run-inference`: point clouds to pictures."""

from __future__ import annotations

import json
import warnings
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from z2p_core.interfaces import Value
from z2p_renderer.pipeline.cli.errors import ExitStatus, is_debugging
from z2p_renderer.pipeline.cli.options.cameras import camera_options, for_each_camera, read_own_cameras
from z2p_renderer.pipeline.cli.options.coloring import color_options, color_options_from, describe_scale
from z2p_renderer.pipeline.cli.options.controls import CONTROL_SETTINGS_KEY, InferenceCommand
from z2p_renderer.pipeline.cli.options.inputs import find_input_scans
from z2p_renderer.pipeline.cli.options.palettes import PALETTES, palette_colors
from z2p_renderer.pipeline.cli.options.paper import paper_options, settle_resolution, with_paper
from z2p_renderer.pipeline.cli.options.param_types import FileFormat, OutputPath, SheetGrid, is_output_folder
from z2p_renderer.pipeline.cli.options.pictures import (
    check_view_options,
    check_writable,
    look_from_options,
    parse_columns,
    picture_options,
)
from z2p_renderer.pipeline.cli.progress import Progress, note_if_opaque, open_progress, report_outcomes
from z2p_renderer.pipeline.cli.render_extras import check_extras, write_extras
from z2p_renderer.pipeline.cli.result_json import outcome_to_json, settings_to_json

if TYPE_CHECKING:  # slow to import: imported at run time only when the options have been read
    from z2p_renderer.pipeline.batch.render_files import Outcome
    from z2p_renderer.pipeline.batch.tasks import Task
    from z2p_renderer.pipeline.coloring.color_points import Scale
    from z2p_renderer.pipeline.inference.look import Look
    from z2p_renderer.pipeline.inference.weight_selection import AnyRenderer

UNSUPPORTED_SUFFIXES = (".bmp", ".gif", ".mp4", ".apng", ".eps", ".exr", ".avif")
"""An output with one of these suffixes is refused, rather than made a folder of that name."""
SUFFIX_OF_FORMAT = {"png": ".png", "webp": ".webp", "jpeg": ".jpg", "tiff": ".tif", "pdf": ".pdf", "svg": ".svg"}
FORMAT_ALIASES = {"jpg": "jpeg", "tif": "tiff"}


@click.command(cls=InferenceCommand, context_settings={"show_default": True})
@click.argument("inputs", nargs=-1, required=True, metavar="INPUT...")
@click.option("--output", "-o", default="pictures", type=OutputPath(), metavar="OUT",
              help="Folder for the pictures; or, for one cloud, the picture itself (.png, .webp, .jpg, .tif, .pdf, "
              ".svg).")
@click.option("--format", "format_", default="png", type=FileFormat(list(SUFFIX_OF_FORMAT), FORMAT_ALIASES),
              help="Format of the pictures in a folder.")
@picture_options
@camera_options
@paper_options
@color_options
@click.option("--legend", type=OutputPath(file=True), metavar="FILE",
              help="Write the colour bar, or the classes' legend, to a file of its own: .svg, .pdf or .png.")
@click.option("--same-frame", is_flag=True,
              help="One camera for all clouds, which keep their sizes and positions in it; with --fit tight also one "
              "crop.")
@click.option("--save-camera", type=OutputPath(file=True), metavar="FILE",
              help="Write the camera to a JSON file; several clouds need --same-frame.")
@click.option("--palette", "palette_name", type=click.Choice(list(PALETTES)),
              help="Colours for a series, one for each cloud in turn, safe for colour-blind readers.")
@click.option("--sheet", type=SheetGrid(), metavar="4x3",
              help="Write contact sheets OUT/sheet.png with this many columns and rows.")
@click.option("--gallery", is_flag=True, help="Write OUT/gallery.html, one page with all pictures and their settings.")
@click.option("--overwrite", is_flag=True,
              help="Render existing pictures again. Otherwise they are skipped, except a single named picture whose "
              "settings have changed.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON line for each file to stdout.")
@click.option("--jobs", type=click.IntRange(min=1), metavar="N",
              help="Number of files rendered at the same time.  [default: one per core]")
@click.option("--quiet", "-q", is_flag=True, help="Report failures only.")
@click.pass_context
def render(ctx: click.Context, inputs: tuple[str, ...], output: Path, **options: Any) -> None:
    """Render point clouds to pictures: each INPUT is a file, a folder, a quoted glob, or - for standard input.

    \b
    z2p render scans/ --output pictures
    z2p render bunny.ply -o bunny.png --color teal --light 3.6,30,45
    z2p render "frames/*.pcd" -o frames --same-frame --sheet 4x3 --gallery

    Each picture holds a record of what made it: `z2p info` shows it, `z2p rerender` draws it again with changes.

    Exit status: 0 all rendered or already there, 1 some files failed (the others are done), 2 wrong usage.
    """
    with warnings.catch_warnings():
        if not is_debugging():
            warnings.simplefilter("ignore")  # warnings of libraries would bury the one line for each file
        failed = _run(ctx, inputs, output, ctx.meta.get(CONTROL_SETTINGS_KEY, {}), options)
    ctx.exit(ExitStatus.SOME_FAILED if failed else ExitStatus.DONE)


def _run(
    ctx: click.Context, inputs: tuple[str, ...], output: Path, controls: dict[str, Value], options: dict[str, Any]
) -> int:
    """Renders all files; returns how many files, contact sheets and the like failed."""
    columns = parse_columns(options)
    if options["palette_name"] and "color" in controls:
        raise click.UsageError("--palette and --color both choose the colour; leave one out", ctx)
    options["own_cameras"] = read_own_cameras(ctx, options)
    check_view_options(ctx, controls, options)
    settle_resolution(ctx, options)
    colors = color_options_from(ctx, controls, options)
    scans = find_input_scans(ctx, inputs, options, columns is not None)
    from z2p_core.parallel import core_count
    from z2p_renderer.pipeline.batch.render_files import render_files
    from z2p_renderer.pipeline.inference.weight_selection import load_renderer

    jobs = min(options["jobs"] or core_count(), len(scans) * len(options["own_cameras"] or [None]))
    threads = None if jobs == 1 else max(1, core_count() // jobs)
    renderer = load_renderer(options["weights"], controls, threads, options["engine"])
    look = with_paper(look_from_options(renderer, controls, options, colors), options)
    tasks = for_each_camera(ctx, _plan(ctx, scans, inputs, output, options), options["own_cameras"])
    check_extras(ctx, tasks, output, options)
    if options["passes"]:
        from z2p_renderer.storage.images.pass_files import check_pass_format

        check_pass_format(options["passes_format"])
    if options["same_frame"] and options["own_cameras"]:
        raise click.UsageError("--same-frame and a camera both choose the frame; leave one out", ctx)
    if options["same_frame"]:
        renderer, look = _share_frame(scans, renderer, look, columns, options["quiet"])
    elif options["save_camera"] is not None and len(scans) > 1 and not options["own_cameras"]:
        raise click.UsageError(f"--save-camera: {len(scans)} scans have a camera each; add --same-frame", ctx)
    look, scale = _share_scale(scans, renderer, look, columns, options)
    bar = open_progress(len(tasks), options["quiet"])
    outcomes = render_files(
        tasks, renderer, look, options["overwrite"], jobs, columns, bar.count_picture, options["passes_format"]
    )
    counts, done = _report(outcomes, bar, renderer, look, options)
    failed_extras = write_extras(done, output, look, scale, options)
    if not options["quiet"]:
        click.echo(f"{counts['ok']} rendered, {counts['skipped']} skipped, {counts['failed']} failed", err=True)
    return counts["failed"] + failed_extras


def _plan(
    ctx: click.Context, scans: list[Path], inputs: tuple[str, ...], output: Path, options: dict[str, Any]
) -> list[Task]:
    """The tasks; makes sure beforehand that their pictures can be written."""
    from z2p_renderer.pipeline.batch.tasks import Task, plan_outputs
    from z2p_renderer.storage.images.image_files import DOCUMENT_SUFFIXES, FORMATS

    output_suffix, is_folder = output.suffix.lower(), is_output_folder(ctx, output)
    is_picture = output_suffix in (*FORMATS, *DOCUMENT_SUFFIXES) and not is_folder
    if output_suffix in UNSUPPORTED_SUFFIXES and not is_folder:
        loops = "; loops are made by z2p animate" if output_suffix in (".gif", ".mp4", ".apng") else ""
        raise click.UsageError(f"--output {output}: expected a folder, or a picture named "
                               f"{', '.join((*FORMATS, *DOCUMENT_SUFFIXES))}{loops}", ctx)  # fmt: skip
    suffix = output_suffix if is_picture else SUFFIX_OF_FORMAT[options["format_"]]
    if is_picture and len(scans) > 1:
        raise click.UsageError(f"--output {output} names one picture, but {len(scans)} scans match; give a folder", ctx)
    is_format_given = ctx.get_parameter_source("format_") is not click.core.ParameterSource.DEFAULT
    kinds = {**FORMATS, **{document: document for document in DOCUMENT_SUFFIXES}}
    if is_picture and is_format_given and kinds[suffix] != kinds[SUFFIX_OF_FORMAT[options["format_"]]]:
        raise click.UsageError(f"--format {options['format_']} does not fit --output {output}; leave it out", ctx)
    check_writable(output.parent if is_picture else output)
    if options["background"] == "transparent" and not options["quiet"]:
        note_if_opaque(suffix)
    if is_picture:
        tasks = [Task(scans[0], output, single=True)]
    else:
        folders = [Path(text) for text in inputs if Path(text).is_dir()]
        tasks = plan_outputs(scans, folders, output, options["recursive"], suffix)
    if options["palette_name"] is None:
        return tasks
    colors = palette_colors(options["palette_name"])
    starts = [index % len(colors) for index in range(len(tasks))]
    return [replace(task, colors=colors[start:] + colors[:start]) for task, start in zip(tasks, starts, strict=True)]


def _share_frame(
    scans: list[Path], renderer: AnyRenderer, look: Look, columns: tuple[str, ...] | None, quiet: bool
) -> tuple[AnyRenderer, Look]:
    """The weights for all clouds; and the look with one camera that fits all, and one crop if pictures are trimmed."""
    from z2p_renderer.pipeline.batch.common_view import common_crop, common_viewpoint
    from z2p_renderer.pipeline.inference.render_scan import camera_elevation
    from z2p_renderer.pipeline.inference.weight_selection import select_renderer

    if look.placement_options.viewpoint is None:  # a loaded camera is common to all already
        common = common_viewpoint(scans, look.placement_options, *camera_elevation(renderer, look.values), columns,
                                  look.color_options)
        renderer, choice = select_renderer(renderer, common.first)
        if not quiet:
            reasons = "; ".join(filter(None, (common.description, choice)))
            click.echo("\n".join([f"one frame for {common.cloud_count} clouds: {reasons}", *common.notes]), err=True)
        look = replace(look, placement_options=replace(
            look.placement_options, viewpoint=common.viewpoint, azimuth=0.0, grounded=common.grounded
        ))  # fmt: skip
    if look.tight:
        look = replace(look, crop=common_crop(scans, renderer, look, columns))
    return renderer, look


def _share_scale(
    scans: list[Path], renderer: AnyRenderer, look: Look, columns: tuple[str, ...] | None, options: dict[str, Any]
) -> tuple[Look, Scale | None]:
    """The look with one scale of colors for all clouds; and that scale, which a legend shows.

    A single file is not read for it beforehand, unless a legend is asked for.
    """
    from z2p_renderer.pipeline.coloring.common_scale import scans_of
    from z2p_renderer.pipeline.inference.render_scan import with_common_scale

    if options["legend"] is None and (len(scans) == 1 or not look.color_options.needs_common_scale):
        return look, None
    look, scale = with_common_scale(renderer, scans_of(scans, columns, look.color_options), look)
    if scale is not None and len(scans) > 1 and not options["quiet"]:
        click.echo(f"one scale of colours for all clouds: {describe_scale(scale)}", err=True)
    return look, scale


def _report(
    outcomes: Iterator[Outcome], bar: Progress, renderer: AnyRenderer, look: Look, options: dict[str, Any]
) -> tuple[dict[str, int], list[Outcome]]:
    """Prints each outcome when its file is done; returns the number of files by status, and all outcomes."""
    settings = settings_to_json(renderer, look, options)
    counts, done = {"ok": 0, "skipped": 0, "failed": 0}, []
    for outcome in report_outcomes(outcomes, bar, options["quiet"]):
        counts[outcome.status] += 1
        done.append(outcome)
        if options["as_json"]:
            click.echo(json.dumps(outcome_to_json(outcome, settings)))
    return counts, done
