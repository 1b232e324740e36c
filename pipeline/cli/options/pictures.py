"""The options that `z2p render` and `z2p animate` share, and the look that they describe."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from z2p_core.interfaces import Value
from z2p_renderer.pipeline.cli.options.param_types import (
    BackgroundColor,
    Degrees,
    FiniteRange,
    MarginShare,
    Resolution,
    SmoothRadius,
    UpAxis,
    ViewDirection,
)

if TYPE_CHECKING:  # slow to import: imported at run time only when the options have been read
    from z2p_core.coloring.options import ColorOptions
    from z2p_renderer.pipeline.inference.look import Look
    from z2p_renderer.pipeline.inference.weight_selection import AnyRenderer

Command = Callable[..., Any]

PICTURE_OPTIONS = (
    click.option("--recursive", "-r", is_flag=True, help="Read sub folders as well, and mirror them in OUT."),
    click.option("--columns", metavar="NAMES",
                 help="Names of the columns of text files and .bin, as in x,y,z,r,g,b,intensity."),
    click.option("--weights", default="auto", metavar="W",
                 help="Shipped name or a .safetensors file; auto: the shipped ones that have the given controls, and "
                 "those made for noise if a cloud is noisy."),
    click.option("--engine", metavar="NAME",
                 help="Engine that runs the network: onnxruntime, openvino, torch; or, faster and less exact by one or "
                 "two grey levels on average: onnxruntime-int8, openvino-bf16, openvino-int8. Default: "
                 "onnxruntime-int8 on processors with AVX2, else the first of the others that is installed."),
    click.option("--up", default="auto", type=UpAxis(),
                 help="Axis, or direction X,Y,Z, that points up in the data; auto: that of a depth camera, else the "
                 "usual one of the format, or the one by which the object stands."),
    click.option("--view", default="auto", type=ViewDirection(),
                 help="Direction to look from. auto: that of a depth camera, else the three-quarter view that shows "
                 "most; front: the front of the data; sensor; or degrees from the front, as azimuth or "
                 "azimuth,elevation."),
    click.option("--azimuth", default=0.0, type=Degrees(), metavar="DEG",
                 help="Turn the object about its up axis, counter-clockwise from above, relative to the chosen view "
                 "(--view AZ is absolute)."),
    click.option("--load-camera", "--cameras", "load_camera", type=click.Path(path_type=Path), metavar="FILE",
                 help="Use the camera of a JSON file that --save-camera wrote, or of a picture of z2p; without --up "
                 "and --view. Or cameras in the data's units, one picture each: JSON with K, R, t, width and height, "
                 "nerfstudio's transforms.json, or a COLMAP model."),
    click.option("--keep-outliers", is_flag=True,
                 help="Keep outliers, which make the object small, and the background of a depth camera's subject."),
    click.option("--cut-top", default=0.0, type=FiniteRange(0, 100, max_open=True), metavar="PERCENT",
                 help="Cut off this share of the height at the top, to look into a room."),
    click.option("--style", default="surface", type=click.Choice(["surface", "balls", "discs"]),
                 help="surface: the surface that the points lie on; balls: a lit ball at each point; discs: a lit disc "
                 "at each."),
    click.option("--radius", metavar="R",
                 help="Radius of balls: in the data's units; in percent of the object's radius, as in 2%; or the name "
                 "of a field of the scan.  [default: half the points' spacing]"),
    click.option("--smooth", default="auto", type=SmoothRadius(),
                 help="Smooth the surface over patches of this radius, as a share of the frame's radius; auto: only "
                 "noisy clouds of depth cameras; 0: never, and leave gaps open."),
    click.option("--resolution", "--size", default="512", type=Resolution(),
                 help="In pixels: 512, 640,480 or 640x480."),
    click.option("--background", default="transparent", type=BackgroundColor(),
                 help="transparent, or a CSS colour name, #hex or r,g,b from 0 to 1."),
    click.option("--supersample", default=1, type=click.IntRange(1, 4), metavar="N",
                 help="Draw N times as large and average down: smoother edges."),
    click.option("--fit", default="frame", type=click.Choice(["frame", "tight"]),
                 help="tight trims the picture to what is visible, shadow included."),
    click.option("--margin", type=MarginShare(), metavar="SHARE",
                 help="Free space around the object, as a share of the shorter side or in percent (0.1 or 10%); with "
                 "--fit tight around its shadow too.  [default: 0.1, tight 0.02]"),
)  # fmt: skip
"""In the order of the help: input, view, picture."""


def picture_options(command: Command) -> Command:
    """Decorator that adds `PICTURE_OPTIONS` to a command."""
    for option in reversed(PICTURE_OPTIONS):
        command = option(command)
    return command


def check_view_options(ctx: click.Context, controls: dict[str, Value], options: dict[str, Any]) -> None:
    """Refuses options of which one would have no effect, because both determine the view, elevation or size.

    Raises:
        click.UsageError: two such options are given.
    """
    default = click.core.ParameterSource.DEFAULT
    for name in ("view", "up"):
        if options["load_camera"] is None or ctx.get_parameter_source(name) is default:
            continue
        if name == "view" or options.get("own_cameras") is None:  # those in the data's units know of no up
            raise click.UsageError(f"--load-camera and --{name} both choose the view; leave one out", ctx)
    if isinstance(options["view"], tuple) and "elevation" in controls:
        raise click.UsageError("--view AZ,EL and --elevation both choose the elevation; leave one out", ctx)
    if options["load_camera"] is not None and options["margin"] is not None and options["fit"] == "frame":
        raise click.UsageError("--load-camera and --margin both choose how large the object is; leave one out", ctx)


def look_from_options(
    renderer: AnyRenderer, controls: dict[str, Value], options: dict[str, Any], color_options: ColorOptions
) -> Look:
    """The look that a command's options, its control settings and its color options stand for.

    Raises:
        SettingError: a control that the weights do not carry, or a camera that cannot be loaded.
    """
    from z2p_core.placement.zoom import parse_zoom
    from z2p_core.style import parse_style
    from z2p_renderer.pipeline.inference.look import build_look
    from z2p_renderer.storage.cameras import read_camera

    file, cameras = options["load_camera"], options.get("own_cameras")
    return build_look(
        renderer, controls, up=options["up"], view=options["view"], azimuth=options["azimuth"],
        camera=None if file is None or cameras else read_camera(file), keep_outliers=options["keep_outliers"],
        cut_top=options["cut_top"], smooth=options["smooth"], size=options["resolution"],
        background=options["background"], supersample=options["supersample"], tight=options["fit"] == "tight",
        margin=options["margin"], color_options=color_options, style=parse_style(options["style"], options["radius"]),
        own_camera=cameras[0] if cameras else None,
        passes=options.get("passes") or (), zoom=parse_zoom(options.get("zoom"), options.get("pan")),
    )  # fmt: skip


def parse_columns(options: dict[str, Any]) -> tuple[str, ...] | None:
    """The names of a text file's columns, in lower case; None if --columns is not given.

    Raises:
        click.UsageError: x, y and z are not among them exactly once each.
    """
    if options["columns"] is None:
        return None
    separator = "," if "," in options["columns"] else None
    names = tuple(name.strip().lower() for name in options["columns"].split(separator))
    if any(names.count(axis) != 1 for axis in "xyz"):
        raise click.UsageError(f"--columns: expected a name for each column with x, y and z once each, as in "
                               f"x,y,z,r,g,b; got {options['columns']!r}")
    return names


def check_writable(folder: Path, option: str = "--output") -> None:
    """Makes sure that files can be written into the folder that `option` names; makes the folder if it is missing.

    Raises:
        click.UsageError: they cannot.
        OSError: the disk is full or read-only, say; see `storage.files.disk_errors`.
    """
    import os

    from z2p_renderer.storage.files.atomic_write import file_kind
    from z2p_renderer.storage.files.disk_errors import disk_error_message

    try:
        folder.mkdir(parents=True, exist_ok=True)
        probe = folder / f".z2p-{os.getpid()}.probe"
        probe.touch()
        probe.unlink()
    except OSError as error:
        if disk_error_message(error):  # not a mistake in the call
            raise
        is_file = folder.exists() and not folder.is_dir()
        reason = f"expected a folder or a picture's name, got {file_kind(folder)}" if is_file else error.strerror
        raise click.UsageError(f"cannot write to {folder}: {reason}; choose another {option}") from None
