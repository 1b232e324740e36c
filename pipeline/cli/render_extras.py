"""Files that `z2p render` writes beside the pictures: the camera, contact sheets and the gallery."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from z2p_renderer.pipeline.cli.options.pictures import check_writable

if TYPE_CHECKING:  # slow to import: imported at run time only when the options have been read
    from z2p_renderer.pipeline.batch.render_files import Outcome
    from z2p_renderer.pipeline.batch.tasks import Task
    from z2p_renderer.pipeline.coloring.color_points import Scale
    from z2p_renderer.pipeline.inference.look import Look


def check_extras(ctx: click.Context, tasks: list[Task], output: Path, options: dict[str, Any]) -> None:
    """Makes sure, before the first picture is drawn, that contact sheets, gallery and camera replace no other files.

    Raises:
        click.UsageError: a contact sheet would replace a picture of this run.
        SettingError: a file of another kind is in the place of a sheet or of the camera.
        PictureError: a file of another kind is in the place of the gallery.
    """
    from z2p_renderer.storage.images.image_files import DOCUMENT_SUFFIXES, FORMATS

    is_picture = output.suffix.lower() in (*FORMATS, *DOCUMENT_SUFFIXES) and not output.is_dir()
    folder = output.parent if is_picture else output
    for name in ("sheet", "gallery"):
        if options[name] and any(task.output.suffix.lower() in DOCUMENT_SUFFIXES for task in tasks):
            raise click.UsageError(f"--{name} cannot show PDF or SVG files; make it of PNGs, or use z2p figure", ctx)
    if options["sheet"] is not None:
        _check_sheets(ctx, tasks, folder, options["sheet"])
    if options["gallery"]:
        from z2p_renderer.pipeline.outputs.gallery import check_gallery_place

        check_gallery_place(folder / "gallery.html")
    if options["legend"] is not None:
        _check_legend(ctx, tasks, options["legend"])
    if options["save_camera"] is not None:
        from z2p_renderer.storage.cameras import check_camera_place

        used_paths = [path for task in tasks for path in (task.scan, task.output)]
        check_camera_place(options["save_camera"], [*used_paths, folder / "gallery.html"])
        check_writable(options["save_camera"].parent, "--save-camera")


def _check_legend(ctx: click.Context, tasks: list[Task], legend: Path) -> None:
    from z2p_renderer.pipeline.legends.draw_legend import LEGEND_SUFFIXES

    if legend.suffix.lower() not in LEGEND_SUFFIXES:
        raise click.UsageError(f"--legend {legend}: expected a file named {', '.join(LEGEND_SUFFIXES)}", ctx)
    used_paths = {path.absolute() for task in tasks for path in (task.scan, task.output)}
    if legend.absolute() in used_paths:
        raise click.UsageError(f"--legend {legend} is a scan or a picture of this run too; choose another name", ctx)
    check_writable(legend.parent, "--legend")


def _check_sheets(ctx: click.Context, tasks: list[Task], folder: Path, grid: tuple[int, int]) -> None:
    from z2p_renderer.pipeline.outputs.contact_sheet import check_sheet_places, sheet_path

    columns, rows = grid
    sheet_count = -(-len(tasks) // (columns * rows))
    sheets = {sheet_path(folder, number) for number in range(1, sheet_count + 1)}
    for task in tasks:
        if task.output in sheets:
            raise click.UsageError(f"--sheet writes {task.output}, which is the picture of {task.scan} too; rename "
                                   "the scan", ctx)  # fmt: skip
    check_sheet_places(folder, sheet_count)


def write_extras(
    done: list[Outcome], output: Path, look: Look, scale: Scale | None, options: dict[str, Any]
) -> int:  # fmt: skip
    """Writes the camera, legend, contact sheets and gallery that the options ask for; returns how many failed.

    `scale` is what the legend shows.
    """
    from z2p_renderer.storage.images.image_files import is_readable_picture

    pictures = [path for outcome in done for path in outcome.outputs
                if path.is_file() and (outcome.status != "failed" or is_readable_picture(path))]  # fmt: skip
    folder = output if output.is_dir() else output.parent
    extras: dict[str, Callable[[], list[Path]]] = {}
    if options["save_camera"] is not None:
        extras["the camera"] = lambda: _save_camera(done, look, options)
    if options["legend"] is not None and scale is not None:
        extras["the legend"] = lambda: _write_legend(scale, options["legend"])
    if options["sheet"] is not None and pictures:
        extras["the contact sheets"] = lambda: _write_sheets(pictures, folder, options["sheet"])
    if options["gallery"] and pictures:
        extras["the gallery"] = lambda: _write_gallery(pictures, folder)
    failed = 0
    for name, write in extras.items():
        try:
            written = write()
        except OSError as error:  # the disk is full, say; the pictures have been written
            failed += 1
            click.echo(f"failed: {name}: {error.strerror or error}", err=True)
            continue
        for path in () if options["quiet"] else written:
            click.echo(f"wrote {path}", err=True)
    return failed


def _write_sheets(pictures: list[Path], folder: Path, grid: tuple[int, int]) -> list[Path]:
    from z2p_renderer.pipeline.outputs.contact_sheet import write_contact_sheets

    return write_contact_sheets(pictures, folder, *grid)


def _write_legend(scale: Scale, path: Path) -> list[Path]:
    from z2p_renderer.pipeline.legends.draw_legend import write_legend

    write_legend(scale, path)
    return [path]


def _write_gallery(pictures: list[Path], folder: Path) -> list[Path]:
    from z2p_renderer.pipeline.outputs.gallery import write_gallery

    return [write_gallery(pictures, folder / "gallery.html")]


def _save_camera(done: list[Outcome], look: Look, options: dict[str, Any]) -> list[Path]:
    from z2p_core.pinhole import PinholeCamera
    from z2p_core.placement.margin import with_margin
    from z2p_renderer.storage.cameras import read_any_camera, read_camera, write_camera
    from z2p_renderer.storage.poses.read_poses import write_poses

    pinholes = [pinhole for outcome in done for pinhole in outcome.pinholes]
    if look.placement_options.camera is not None and not pinholes:  # skipped: their pictures know them
        kept = [read_any_camera(path) for outcome in done if outcome.status == "skipped" for path in outcome.outputs]
        pinholes = [camera for camera in kept if isinstance(camera, PinholeCamera)]
    if pinholes:
        write_poses(pinholes, options["save_camera"])
        return [options["save_camera"]]
    viewpoints = [viewpoint for outcome in done for viewpoint in outcome.viewpoints]
    if options["same_frame"] and look.placement_options.viewpoint is not None:
        viewpoints = [with_margin(look.placement_options.viewpoint, look.frame_margin)]
    if not viewpoints and done[0].status == "skipped":
        viewpoints = [read_camera(done[0].outputs[0])]
    if len(viewpoints) > 1:
        raise click.UsageError(f"--save-camera: the file's {len(viewpoints)} clouds have a camera each; "
                               "add --same-frame")
    if not viewpoints:
        return []  # the file failed, which has been reported
    write_camera(viewpoints[0], options["save_camera"])
    return [options["save_camera"]]
