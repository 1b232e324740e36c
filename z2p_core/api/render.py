"""`render`: points in, a picture out."""

from __future__ import annotations

import inspect
import reprlib
import warnings
from collections import ChainMap
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from numbers import Real
from pathlib import Path
from typing import Any

import numpy as np

from z2p_core import registry
from z2p_core.api.backend import RenderedImage, RenderRequest, load_backend
from z2p_core.api.picture import Picture, tile_images
from z2p_core.api.point_arrays import point_arrays
from z2p_core.api.point_colors import (
    are_scalars,
    mean_color,
    name_colors,
    parse_colors,
    split_by_cloud,
    split_scalars,
)
from z2p_core.coloring.options import (
    AUTO,
    GIVEN_FIELD,
    NONE,
    RGB,
    ColorOptions,
    parse_classes,
    parse_limits,
    parse_relight,
)
from z2p_core.errors.did_you_mean import suggest_name
from z2p_core.interfaces import ScanError, SettingError
from z2p_core.pass_names import parse_passes
from z2p_core.pinhole import AnyCamera
from z2p_core.placement.viewpoint import Viewpoint
from z2p_core.scene import SIDE_LIMITS
from z2p_core.style import GIVEN_RADII, Style, parse_style

DEFAULT_SIDE = 512
"""Width and height of a picture in pixels, unless the caller names a size."""


ControlValue = str | float | Sequence[float] | None
"""What a control may be set to: text as on the command line, a number, or numbers; None for its default."""


class RenderWarning(UserWarning):
    """Something was left out or replaced on the way to the picture; the message says what, and what to do."""


class UnknownArgument(SettingError, TypeError):
    """A keyword that is neither an argument of `render` nor an installed control; the message names the nearest one."""


def render(
    points: Any,
    colors: Any = None,
    *,
    up: str | None = None,
    view: str | float | tuple[float, float] = "auto",
    azimuth: float = 0.0,
    camera: Viewpoint | AnyCamera | Picture | Mapping[str, Any] | str | Path | None = None,
    size: int | tuple[int, int] | None = None,
    resolution: int | tuple[int, int] | None = None,
    background: str | Sequence[float] | None = None,
    supersample: int = 1,
    fit: str = "frame",
    margin: float | str | None = None,
    zoom: float | None = None,
    pan: Sequence[float] | None = None,
    keep_outliers: bool = False,
    cut_top: float = 0.0,
    smooth: str | float = "auto",
    weights: str | Path = "auto",
    cmap: str | None = None,
    clim: Sequence[float] | None = None,
    color_bar: bool = False,
    classes: int | Sequence[int] | None = None,
    relight: float | None = None,
    style: str = "surface",
    radius: Any = None,
    passes: str | Sequence[str] | None = None,
    **controls: ControlValue,
) -> Picture:
    """Picture of a point cloud, or of each cloud of a batch, as though its surface had been rendered in a studio.

    Args:
        points: array or tensor (N, 3 or more), of which x, y, z count, or a batch (B, N, 3 or more); a cloud of
            open3d, trimesh, pyvista or laspy; a list of these; or the path of a file. Any unit, any offset.
        colors: what colors the points. None: the colors that an object or a file has, else one color for all. Or

            - sRGB (N, 3), for a batch (B, N, 3) or a list of (N, 3): floats in [0, 1], or integers to 255 (to 1 if
              none is larger); NaN where unknown. They are the surface's albedo under the studio's light;
            - scalars (N,), (B, N) or a list of (N,): floats, shown through `cmap`; points with NaN are grey;
            - labels, the same of whole numbers or bools: few different ones get a color each;
            - the name of a field of the object or file, such as ``"intensity"``; ``"x"``, ``"y"``, ``"z"``,
              ``"height"``; ``"rgb"`` for its own colors, ``"none"`` for one color.

            A `color` replaces them. Weights that draw no textures get the mean of sRGB colors, with a warning.
        up: the data's axis that points up, ``+Z`` (or ``Z``), ``-Y``, ...; ``auto`` looks for a depth camera's own,
            then weighs the shape against what is usual for the format. None: ``auto`` for a file, as in `z2p
            render`, else ``+Z``.
        view: ``auto`` (a three-quarter side that shows most), ``front``, ``sensor``, or degrees from the front:
            azimuth, or (azimuth, elevation).
        azimuth: degrees that the object is turned by on top of that.
        camera: another picture or its `picture.camera`, or a file that --save-camera wrote; the object keeps its true
            size and place before it. Replaces `up` and `view`. Or a camera in the data's units: `pinhole_camera(K, R,
            t, size)`, `look_at(eye, target)`, a mapping or JSON file with K, R, t, width and height; its picture fits
            into `size` where one is given.
        size, resolution: the picture's size in pixels, one number or (width, height), 32 to 4096; two names for the
            same argument. None: 512.
        background: None for transparent, or a CSS name, ``#hex`` or sRGB triple in [0, 1].
        supersample: render this many times as large and average down, 1 to 4.
        fit: ``frame`` (the bounding sphere fits) or ``tight`` (trimmed to the visible part, the shadow included).
        margin: free border around the object's bounding sphere, or with ``tight`` around the visible part: a share of
            the shorter side, 0 to 0.45, or percent as in ``"10%"``. None: 0.1, or 0.02 with ``tight``.
        zoom: show a part of the frame, enlarged so many times, 1 to 32.
        pan: move what is shown by (right, up), in shorter sides of the picture.
        keep_outliers: keep outliers that make the object small, and points far behind a depth camera's subject.
        cut_top: percent of the height to cut off from above, to look into a room.
        smooth: smooth the surface over patches of that radius, 0 to 0.3 of the frame's; ``auto``: only a depth
            camera's noisy clouds, whose small gaps are then closed as well; 0: neither.
        weights: a shipped name or a .safetensors file; ``auto`` takes shipped ones that carry the controls asked for,
            and for noisy clouds those trained on noise.
        cmap: name of a colormap for scalars: ``viridis``, ``turbo``, ``batlow_r`` and hundreds more.
        clim: values (low, high) at both ends of the colormap. None: the 2nd and 98th percentile, of all clouds.
        color_bar: draw the colormap's bar, or the classes' legend, beside the picture.
        classes: keep only the points with these labels, of `colors`, or of a field such as ``classification``.
        relight: how much of the studio's light falls on the points' colors: 1 (all) to 0 (they stay as they are, with
            the shadow on the floor). None: 1.
        style: ``surface`` (the surface that the points lie on), ``balls`` (a lit ball at each point, without any
            network) or ``discs`` (a lit disc in each point's tangent plane, clipped to join its neighbors).
        radius: of balls, in the data's units: a number, one for each point (N,), (B, N) or a list of (N,), or the name
            of a field of the object or file; or a share of the object's bounding sphere, as in ``"2%"``. None: half
            the points' spacing.
        passes: what else is drawn into `picture.passes`: some of ``depth``, ``normal``, ``albedo``, ``alpha``,
            ``position`` and ``trust``, or ``all``; see `z2p_core.pass_names`.
        **controls: the value of a control, by its name: text as on the command line, a number, or numbers. Every
            installed control has a keyword, those of other packages too; None stands for its default. Built in are

            - color: CSS name, ``#hex`` or sRGB triple in [0, 1]; for a batch also a list of these, one for each cloud.
            - light: distance 3 to 4.5, azimuth -90 to 90 (0 behind the camera, positive to the right), elevation 25
              to 75.
            - elevation: the camera's, 0 to 80 degrees above the horizon.
            - metallic, roughness: 0 to 1, for weights that carry them.

    Raises:
        ScanError: the points are no cloud (a ValueError).
        SettingError: a setting is invalid (a ValueError).
        UnknownArgument: a keyword is neither an argument nor an installed control (a TypeError and a SettingError).
        WeightsError: there are no such weights (a ValueError).
    """
    settings = {name: value for name, value in locals().items() if name not in ("points", "colors")}
    request = build_request(points, colors, settings)
    images, notes, is_batch = _render_images(points, colors, request, radius)
    for note in dict.fromkeys([*notes, *(note for image in images for note in image.notes)]):
        warnings.warn(note, RenderWarning, stacklevel=2)
    if not images:
        raise ScanError("expected clouds, got an empty batch")
    pictures = tuple(Picture(image.array, image.record, image.notes, passes=image.passes) for image in images)
    if not is_batch and len(pictures) == 1:
        return pictures[0]
    record = {**pictures[0].record, "batch": len(pictures)}
    return Picture(tile_images([picture.array for picture in pictures]), record, parts=pictures)


def build_request(points: Any, colors: Any, settings: Mapping[str, Any]) -> RenderRequest:
    """The request that the keywords of `render` stand for; `settings` has all of them, and ``controls``.

    Controls may also be among the other keywords.

    Raises:
        SettingError: one is invalid, or unknown.
    """
    given = dict(settings)
    controls = {**given.pop("controls", {}), **{name: given.pop(name) for name in registry.names("controls")
                                                if name in given}}  # fmt: skip
    check_names(controls)
    up, camera = given["up"], given["camera"]
    if up is None:
        up = "auto" if isinstance(points, str | Path) else "+Z"
    if isinstance(camera, Picture):
        camera = camera.camera
    cloud_colors = _cloud_colors(controls.get("color"))
    if cloud_colors:
        controls["color"] = None
    style = _style(given["style"], given["radius"])
    return RenderRequest(
        up, given["view"], given["azimuth"], camera, controls, chosen_size(given["size"], given["resolution"]),
        given["background"], _factor(given["supersample"]), _tight(given["fit"]),
        _switch("keep_outliers", given["keep_outliers"]), _percent(given["cut_top"]), given["smooth"], given["margin"],
        _weights(given["weights"]),
        color_options=ColorOptions(
            _field_name(colors), given["cmap"], parse_limits(given["clim"]), parse_classes(given["classes"]),
            parse_relight(given["relight"]), _switch("color_bar", given["color_bar"]), other_fields=style.wanted_fields,
        ),
        style=style, has_size=given["size"] is not None or given["resolution"] is not None,
        passes=parse_passes(given["passes"]), zoom=given["zoom"], pan=given["pan"], cloud_colors=cloud_colors,
    )  # fmt: skip


def _cloud_colors(color: Any) -> tuple[Any, ...]:
    """The colors of a batch's clouds, if `color` is a list of colors (texts or triples) rather than one; else none."""
    if not isinstance(color, list | tuple) and not (isinstance(color, np.ndarray) and color.ndim == 2):
        return ()
    members = list(color)
    return () if all(isinstance(one, Real) for one in members) else tuple(members)


def _signature_with_controls() -> inspect.Signature:
    """The signature of `render` with a keyword for each installed control, as `help` and notebooks show it."""
    signature = inspect.signature(render)
    parameters = [one for one in signature.parameters.values() if one.kind is not inspect.Parameter.VAR_KEYWORD]
    controls = [inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=None, annotation="ControlValue")
                for name in registry.names("controls") if name not in signature.parameters]  # fmt: skip
    return signature.replace(parameters=[*parameters, *controls])


render.__signature__ = _signature_with_controls()  # type: ignore[attr-defined]


def _render_images(
    points: Any, colors: Any, request: RenderRequest, radii: Any
) -> tuple[list[RenderedImage], list[str], bool]:
    """An image of each cloud, what to warn of beside their own notes, and whether `points` is a batch."""
    if isinstance(points, str | Path):
        if request.style.radius_field == GIVEN_RADII:
            raise SettingError("expected the name of one of the file's fields as radius, got an array: its numbers "
                               "cannot be matched to the file's points; read the points first")
        is_named = colors is None or isinstance(colors, str)
        request, told = (request, list[str]()) if is_named else _with_mean_color(request, colors)
        return load_backend().render_file(Path(points), request), told, False
    clouds, request, notes, is_batch = prepare_clouds(points, colors, request, radii)
    return load_backend().render_arrays(clouds, request), notes, is_batch


def prepare_clouds(
    points: Any, colors: Any, request: RenderRequest, radii: Any = None
) -> tuple[list[np.ndarray], RenderRequest, list[str], bool]:
    """Clouds (N, 3) float64, the request with their fields and colors, what to warn of, and whether it is a batch.

    Raises:
        ScanError: the points are no cloud.
        SettingError: the colors are none, or not one for each point or cloud.
    """
    given_colors = None if isinstance(colors, str) else colors
    given, notes = point_arrays(points), list[str]()
    request = replace(
        request, fields=given.fields, class_names=given.class_names, color_kinds=given.color_kinds
    )  # fmt: skip
    notes += given.notes if colors is None else ()
    if request.style.radius_field == GIVEN_RADII:
        request = _with_radii(request, radii, given.clouds)
    if given_colors is not None:
        if request.controls.get("color") is None and not request.cloud_colors:
            request = _with_colors(request, given_colors, given.clouds)
        else:
            notes.append("colors= are left out: the whole object has the colour given")
    elif given.unused_columns and colors is None and not any("rgb" in fields for fields in given.fields):
        notes.append(f"columns behind x, y, z were left out ({given.unused_columns}): colours of points are drawn if "
                     "they are given as colors=, normals are not needed")  # fmt: skip
    if request.cloud_colors and len(request.cloud_colors) != len(given.clouds):
        raise SettingError(f"expected one color, or a list of one for each of {len(given.clouds)} clouds, got a list "
                           f"of {len(request.cloud_colors)}")
    return given.clouds, request, notes, given.batched


def _with_colors(request: RenderRequest, colors: Any, clouds: Sequence[np.ndarray]) -> RenderRequest:
    """The request with what a caller gives as colors: sRGB, scalars or labels.

    Raises:
        SettingError: these are none, or not one for each point.
    """
    is_scalar = are_scalars(colors, clouds)
    name, by = (GIVEN_FIELD, GIVEN_FIELD) if is_scalar else ("rgb", request.color_options.by)
    parts = split_scalars(colors, clouds) if is_scalar else split_by_cloud(parse_colors(colors), clouds)
    others = request.fields or [{} for _ in clouds]
    fields = tuple(ChainMap({name: part}, other)  # type: ignore[arg-type]  # it is only read
                   for other, part in zip(others, parts, strict=True))  # fmt: skip
    return replace(request, fields=fields, color_kinds=(), color_options=replace(request.color_options, by=by))


def _with_radii(request: RenderRequest, radii: Any, clouds: Sequence[np.ndarray]) -> RenderRequest:
    """The request with the radii (N,) of each cloud that a caller gives.

    Raises:
        SettingError: they are not one number for each point.
    """
    try:
        parts = split_scalars(radii, clouds)
    except SettingError as error:
        raise SettingError(str(error).replace("colors", "radii")) from None
    others = request.fields or [{} for _ in clouds]
    fields = tuple(ChainMap({GIVEN_RADII: part}, other)  # type: ignore[arg-type]  # it is only read
                   for other, part in zip(others, parts, strict=True))  # fmt: skip
    return replace(request, fields=fields)


def _style(style: Any, radius: Any) -> Style:
    """The style and the radius of its balls, of which there may be one for each point."""
    is_array = radius is not None and not isinstance(radius, str) and np.ndim(radius) > 0
    return parse_style(style, GIVEN_RADII if is_array else radius)


def _field_name(colors: Any) -> str:
    """What points are colored by, if it is named: a field, or one of auto, rgb and none."""
    if not isinstance(colors, str):
        return AUTO
    by = colors.strip()
    return by.lower() if by.lower() in (AUTO, RGB, NONE) else by


def check_names(controls: Collection[str]) -> None:
    """
    Raises:
        UnknownArgument: a name is neither an argument of `render` nor an installed control.
    """
    installed = registry.names("controls")
    unknown = sorted(set(controls) - set(installed))
    if unknown:
        known = [*(name for name in inspect.signature(render).parameters if name not in installed), *installed]
        nearest = suggest_name(unknown[0], [name.replace("_", "-") for name in known])
        guess = "" if nearest is None else f" (did you mean {nearest.split()[0].replace('-', '_')}?)"
        raise UnknownArgument(f"unknown argument {unknown[0]!r}{guess}; expected {', '.join(known)}, or another "
                              "installed control")


def _with_mean_color(request: RenderRequest, colors: Any) -> tuple[RenderRequest, list[str]]:
    """The request for a file with the mean of its points' colors (M, 3), and a warning about it.

    Its rows cannot be told to belong to these colors, as readers leave some out.

    Raises:
        SettingError: they are no colors.
    """
    if np.ndim(colors) == 1:
        raise SettingError("expected the name of one of the file's fields, such as colors='intensity', got an array: "
                           "its numbers cannot be matched to the file's points; read the points first")
    if request.controls.get("color") is not None:
        return request, ["colors= are left out: the whole object has the colour given"]
    mean = mean_color(parse_colors(colors))
    note = f"colors= of a file cannot be matched to its points: the whole object has their mean, {name_colors([mean])}"
    return replace(request, colors=(mean,)), [f"{note}; leave colors out for the file's own, or read the points first"]


def chosen_size(size: Any, resolution: Any, usual: int = DEFAULT_SIDE) -> tuple[int, int]:
    """Width and height in pixels by whichever of the two names was used.

    Raises:
        SettingError: both were, or it is no size.
    """
    if size is not None and resolution is not None:
        raise SettingError(f"size and resolution are two names for one thing, got {size!r} and {resolution!r}; leave "
                           "one out")
    given = resolution if size is None else size
    return pixel_size(usual if given is None else given)


def pixel_size(size: Any) -> tuple[int, int]:
    """Width and height in pixels, of one number or two.

    Raises:
        SettingError: no whole numbers, or not from 32 to 4096.
    """
    try:
        sides = list(size) if np.ndim(size) else [size, size]
        whole = [int(side) for side in sides if not isinstance(side, bool | str | bytes) and int(side) == side]
    except (TypeError, ValueError, ArithmeticError, RuntimeError):  # no numbers, nan, infinity, a tensor of others
        sides, whole = [], []
    least, most = SIDE_LIMITS
    if not (len(whole) == len(sides) == 2 and all(least <= side <= most for side in whole)):
        raise SettingError(f"expected a size of one or two whole numbers from {least} to {most} pixels, got "
                           f"{reprlib.repr(size)}")
    return whole[0], whole[1]


def _switch(name: str, wish: Any) -> bool:
    if not isinstance(wish, bool | np.bool_):
        raise SettingError(f"expected {name} True or False, got {wish!r}")
    return bool(wish)


def _factor(supersample: Any) -> int:
    if isinstance(supersample, bool) or not (isinstance(supersample, Real) and supersample in (1, 2, 3, 4)):
        raise SettingError(f"expected a supersample of 1, 2, 3 or 4, got {supersample!r}")
    return int(float(supersample))


def _tight(fit: Any) -> bool:
    if not (isinstance(fit, str) and fit in ("frame", "tight")):
        raise SettingError(f"expected fit 'frame' or 'tight', got {fit!r}")
    return bool(fit == "tight")


def _weights(weights: Any) -> str | Path:
    if not isinstance(weights, str | Path):
        raise SettingError(f"expected weights as 'auto', a shipped name or the path of a .safetensors file, got "
                           f"{weights!r}")
    return weights


def _percent(cut_top: Any) -> float:
    number = isinstance(cut_top, Real) and not isinstance(cut_top, bool)
    if not (number and 0 <= cut_top < 100):
        raise SettingError(f"expected cut_top from 0 to below 100 percent, got {cut_top!r}")
    return float(cut_top)
