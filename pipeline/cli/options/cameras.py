"""The options for cameras in the data's units, and for what is drawn of them besides pictures."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path, PurePath
from typing import TYPE_CHECKING, Any

import click

from z2p_renderer.pipeline.cli.options.param_types import FiniteRange, PassNames, Position, Shift

if TYPE_CHECKING:  # slow to import: imported at run time only when the options have been read
    from z2p_core.pinhole import AnyCamera
    from z2p_renderer.pipeline.batch.tasks import Task

Command = Callable[..., Any]

CAMERA_OPTIONS = (
    click.option("--look-from", type=Position(),
                 help="Where the camera stands, in the data's coordinates."),
    click.option("--look-at", type=Position(),
                 help="What it looks at, in the data's coordinates.  [default: the middle of the cloud]"),
    click.option("--fov", type=FiniteRange(1, 170), metavar="DEG",
                 help="Angle across the shorter side of its picture; with --look-from.  [default: 40]"),
    click.option("--orthographic", type=FiniteRange(0, 1e9, min_open=True), metavar="MM",
                 help="Parallel rays, to scale: a unit of the data is so many millimetres long in print, at --dpi. The "
                 "picture is as large as the cloud needs, unless --resolution is given."),
)  # fmt: skip
PASS_OPTIONS = (
    click.option("--passes", type=PassNames(),
                 help="Write depth,normal,albedo,alpha,position,trust, or all, beside each picture as <picture>_depth "
                 "and so on, in the data's units, and their camera as <picture>_camera.json."),
    click.option("--passes-format", default="npy", type=click.Choice(["npy", "png", "exr"]),
                 help="Format of the passes: NumPy arrays, 16-bit PNG, or EXR (needs the extra 'exr')."),
)  # fmt: skip
DEFAULT_DPI = 300.0


ZOOM_OPTIONS = (
    click.option("--zoom", type=FiniteRange(1, 32), metavar="F",
                 help="Show a part of the frame, enlarged so many times: its middle, unless --pan moves it.  "
                 "[default: 1]"),
    click.option("--pan", type=Shift(),
                 help="Move what is shown to the right and up, in shorter sides of the picture.  [default: 0,0]"),
)  # fmt: skip


def camera_options(command: Command) -> Command:
    """Decorator that adds `ZOOM_OPTIONS`, `CAMERA_OPTIONS` and `PASS_OPTIONS` to a command."""
    for option in reversed((*ZOOM_OPTIONS, *CAMERA_OPTIONS, *PASS_OPTIONS)):
        command = option(command)
    return command


def read_own_cameras(
    ctx: click.Context, options: dict[str, Any], always_sized: bool = False
) -> list[AnyCamera] | None:
    """The cameras in the data's units that the options stand for, in their pictures' sizes; None for the usual one.

    Cameras of files keep their own sizes unless a resolution is given, or they are `always_sized` by it.

    Raises:
        click.UsageError: options contradict each other.
        SettingError: a file of cameras cannot be read.
    """
    wish = {name: options.get(name) for name in ("look_from", "look_at", "fov", "orthographic")}
    given = [name for name, value in wish.items() if value is not None]
    if given and options["load_camera"] is not None:
        other = given[0].replace("_", "-")
        raise click.UsageError(f"--load-camera and --{other} both choose the camera; leave one out", ctx)
    has_size = always_sized or ctx.get_parameter_source("resolution") is not click.core.ParameterSource.DEFAULT
    if options["load_camera"] is not None:
        return _read_cameras(options["load_camera"], options["resolution"] if has_size else None, options["quiet"])
    if not given:
        return None
    if wish["look_from"] is None and wish["orthographic"] is None:
        raise click.UsageError(f"--{given[0].replace('_', '-')}: expected --look-from X,Y,Z or --orthographic MM with "
                               "it", ctx)  # fmt: skip
    if wish["fov"] is not None and wish["orthographic"] is not None:
        raise click.UsageError("--fov and --orthographic both choose how large the cloud is; leave one out", ctx)
    if wish["look_from"] is not None and ctx.get_parameter_source("view") is not click.core.ParameterSource.DEFAULT:
        raise click.UsageError("--look-from and --view both choose the view; leave one out", ctx)
    if options["margin"] is not None and options["fit"] == "frame":
        raise click.UsageError("--margin and a camera both choose how large the object is; leave one out", ctx)
    for option, name in (("--scale-bar", "scale_bar"), ("--axes", "axes")):
        if options.get(name):
            raise click.UsageError(f"{option} belongs to the usual camera, not to one in the data's units; leave one "
                                   "out", ctx)  # fmt: skip
    wish["dpi"] = options.get("dpi")
    return [_look_at(wish, options["resolution"] if has_size or wish["orthographic"] is None else None)]


def _look_at(wish: dict[str, Any], size: tuple[int, int] | None) -> AnyCamera:
    from z2p_core.pinhole import DEFAULT_FIELD_OF_VIEW, LookAt, pixels_per_unit

    scale = wish["orthographic"]
    return LookAt(
        wish["look_from"], wish["look_at"], None, wish["fov"] or DEFAULT_FIELD_OF_VIEW,
        None if scale is None else pixels_per_unit(scale, wish["dpi"] or DEFAULT_DPI), size,
    )  # fmt: skip


def _read_cameras(path: Path, size: tuple[int, int] | None, quiet: bool) -> list[AnyCamera] | None:
    """The cameras of a file in the data's units, within a size in pixels if one is given; None for a viewpoint."""
    from z2p_renderer.storage.cameras import read_pinholes

    found = read_pinholes(path)
    if found is None:
        return None
    cameras, note = found
    if note and not quiet:
        click.echo(f"note: {path}: {note}", err=True)
    return [camera if size is None else camera.fitted(*size) for camera in cameras]


def for_each_camera(ctx: click.Context, tasks: list[Task], cameras: list[AnyCamera] | None) -> list[Task]:
    """The tasks, each once for every camera if there are several, with pictures named after them.

    Raises:
        click.UsageError: the user named one picture for several cameras.
    """
    if cameras is None or len(cameras) == 1:
        return tasks
    if any(task.single for task in tasks):
        raise click.UsageError(f"--output names one picture, but there are {len(cameras)} cameras; give a folder", ctx)
    names = camera_names(cameras)
    return [replace(task, camera=camera, output=task.output.with_stem(f"{task.output.stem}_{name}"))
            for task in tasks for camera, name in zip(cameras, names, strict=True)]  # fmt: skip


def camera_names(cameras: Sequence[AnyCamera]) -> list[str]:
    """What pictures of several cameras are named after: their images' names without suffix, else their numbers."""
    digits = max(3, len(str(len(cameras) - 1)))
    stems = [re.sub(r"[^\w.-]+", "_", str(PurePath(getattr(camera, "name", "")).with_suffix("")).strip("./"))
             if getattr(camera, "name", "") else "" for camera in cameras]  # fmt: skip
    counts = Counter(stem.lower() for stem in stems)
    return [stem if stem and counts[stem.lower()] == 1 else f"{stem}{'_' if stem else ''}{number:0{digits}d}"
            for number, stem in enumerate(stems)]  # fmt: skip
