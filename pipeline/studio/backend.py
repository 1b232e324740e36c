"""What renders for `z2p_core.render`: the entry point ``z2p.studio`` names it, so that the core need not import it."""

from __future__ import annotations

import hashlib
import math
import os
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import lru_cache
from numbers import Real
from pathlib import Path
from typing import Any

import numpy as np

from z2p_core.api.backend import FilmRequest, RenderedImage, RenderRequest
from z2p_core.api.picture import opaque_over
from z2p_core.api.point_colors import mean_color, name_colors
from z2p_core.coloring.options import AUTO as AUTO_COLORS
from z2p_core.coloring.options import NONE as NO_COLORS
from z2p_core.formats.field_names import field_key
from z2p_core.interfaces import RawCloud, ScanError, SettingError, Value
from z2p_core.pinhole import AnyCamera, LookAt, PinholeCamera, camera_from_json
from z2p_core.placement.margin import parse_margin
from z2p_core.placement.viewpoint import Viewpoint, viewpoint_from_json
from z2p_core.placement.zoom import parse_zoom
from z2p_core.up_axis.axis_names import UP_ROTATIONS, parse_up_axis
from z2p_renderer.pipeline.coloring.fields import has_own_colors, keep_classes, read_scans
from z2p_renderer.pipeline.inference.look import Look, build_look
from z2p_renderer.pipeline.inference.parse_settings import parse_background, parse_controls
from z2p_renderer.pipeline.inference.render_scan import RenderedScan, build_record, render_scan, with_common_scale
from z2p_renderer.pipeline.inference.scan_source import describe_source, path_relative_to
from z2p_renderer.pipeline.inference.weight_selection import AUTO, AnyRenderer, load_renderer
from z2p_renderer.pipeline.placement.hints import options_as_keywords
from z2p_renderer.storage.cameras import read_any_camera
from z2p_renderer.storage.images.animations import check_animation_suffix
from z2p_renderer.storage.images.image_files import OPAQUE_SUFFIXES, WHITE, encode_picture, write_picture
from z2p_renderer.storage.images.pass_files import check_pass_format, write_passes
from z2p_renderer.storage.models.checkpoints import find_weights
from z2p_renderer.storage.poses.read_poses import is_pinhole_json, read_poses
from z2p_renderer.storage.scans.clouds import Scan, format_suffix, scan_from_raw

NAMED_VIEWS = ("auto", "front", "sensor")
MESSAGE_COLOR = (228, 228, 228, 255)
"""sRGB and alpha, of 255, behind the text of `RenderBackend.draw_message`."""
MESSAGE_TEXT_COLOR = (90, 90, 90, 255)


class RenderBackend:
    """The backend of `z2p_core.api.backend`. It leaves torch's random generator and default device as they are."""

    def render_arrays(self, clouds: Sequence[np.ndarray], request: RenderRequest) -> list[RenderedImage]:
        """An image of each cloud (N, 3) float64; rows that are not finite are dropped and noted.

        Raises:
            ScanError: a cloud has no extent.
            SettingError: a setting is invalid.
        """
        labels = [f"[{index}]" if len(clouds) > 1 else "" for index in range(len(clouds))]
        scans = [_scan_from(cloud, index, labels[index], request) for index, cloud in enumerate(clouds)]
        sources = [{"name": None, "sha256": hashlib.sha256(cloud.tobytes()).hexdigest(), "cloud": index}
                   for index, cloud in enumerate(clouds)]  # fmt: skip
        return _render_all(scans, sources, "", request)

    def render_file(self, path: Path, request: RenderRequest) -> list[RenderedImage]:
        """An image of each cloud in a file.

        Raises:
            ScanError: the file cannot be read, or one of its clouds has no extent.
            SettingError: a setting is invalid.
        """
        scans = _read_whole(path, request)
        source = describe_source(path, Path("picture"))
        if source["path"] is not None:  # absolute for now: `_record_for` makes it relative to the saved file
            source["path"] = path.absolute().as_posix()
        sources = [{**source, "cloud": index} for index in range(len(scans))]
        return _render_all(scans, sources, format_suffix(path), request)

    def read_cameras(self, path: Path) -> list[PinholeCamera]:
        """The cameras in the data's units of a file.

        Raises:
            SettingError: the file is missing, or holds none.
        """
        return read_poses(path)[0]

    def save_passes(
        self, passes: Mapping[str, np.ndarray], camera: PinholeCamera, picture: Path, format: str
    ) -> list[Path]:
        """Write passes and their camera beside a picture; the paths of the files.

        Raises:
            SettingError: there is no such format, or its library is not installed.
        """
        check_pass_format(format)
        return write_passes(passes, camera, picture, format)

    def animate(
        self, clouds: Sequence[np.ndarray] | Sequence[Path], request: RenderRequest, film: FilmRequest, path: Path
    ) -> list[str]:
        """Writes a film of clouds (N, 3) float64, or of those in files; what was left out or guessed, in words.

        Raises:
            ScanError: a cloud cannot be drawn.
            SettingError: a setting is invalid.
            PictureError: no film can have the path's suffix, or its extra is not installed.
        """
        from z2p_renderer.pipeline.studio.film_backend import write_film  # late: few calls need it

        check_animation_suffix(path.suffix.lower())
        scans: list[tuple[Scan, str]] = []
        members: list[np.ndarray | Path] = [*clouds]
        for index, cloud in enumerate(members):
            if isinstance(cloud, Path):
                scans += [(scan, format_suffix(cloud)) for scan in _read_whole(cloud, request)]
            else:
                scans.append((_scan_from(cloud, index, f"[{index}]" if len(clouds) > 1 else "", request), ""))
        with _default_device_cpu():
            renderer = _renderer_for(request, any(has_own_colors(scan) for scan, _ in scans))
            request, note = _without_undrawn_colors(request, renderer)
            look = _look_for(renderer, request).written_as(path.suffix.lower())
            colors = _color_per_cloud(request, renderer, len(scans))
            sources = [_film_source(cloud) for cloud in members[:1]]
            return [*write_film(scans, colors, renderer, look, film, sources[0], path), *filter(None, [note])]

    def save_image(self, array: np.ndarray, record: Mapping[str, Any], path: Path) -> None:
        """Write an image (H, W, 4) uint8 with its record, in the format of the path's suffix."""
        write_picture(array, path, record=_record_for(path, record))

    def encode_png(self, array: np.ndarray, record: Mapping[str, Any]) -> bytes:
        """An image (H, W, 4) uint8 with its record, as a PNG file."""
        return encode_picture(array, ".png", record=_record_for(Path("picture"), record))

    def parse_background(self, background: Any) -> tuple[float, float, float] | None:
        """sRGB in [0, 1] of a CSS name, #hex or three numbers; None for a transparent one.

        Raises:
            SettingError: it is none of these.
        """
        return parse_background(background)

    def start_viewer(
        self, points: Sequence[Path] | Sequence[np.ndarray], fields: Sequence[Mapping[str, np.ndarray]], up: str
    ) -> Any:
        """A running viewer of files, or of clouds (N, 3) with the fields of each; see `z2p_core.view`."""
        from z2p_renderer.pipeline.cli.viewer.background import start_viewer  # late: few programs look around

        return start_viewer(points, fields, up)

    def draw_message(self, text: str, size: tuple[int, int]) -> np.ndarray:
        """Image (H, W, 4) uint8 that shows the text, instead of a cloud that could not be rendered."""
        from PIL import Image, ImageDraw, ImageFont

        image, font = Image.new("RGBA", size, MESSAGE_COLOR), ImageFont.load_default(max(10, size[0] // 20))
        pen, lines, line = ImageDraw.Draw(image), [], ""
        for word in text.split():
            if line and pen.textlength(f"{line} {word}", font) > 0.9 * size[0]:
                lines.append(line)
                line = word
            else:
                line = f"{line} {word}".strip()
        pen.multiline_text((size[0] // 20, size[1] // 20), "\n".join([*lines, line]), MESSAGE_TEXT_COLOR, font)
        return np.asarray(image)


def _scan_from(points: np.ndarray, index: int, label: str, request: RenderRequest) -> Scan:
    """The scan of the points (N, 3) of a request's cloud with the fields that are needed, of the classes to keep.

    Raises:
        ScanError: the points are no cloud, or no class is there.
    """
    fields = request.fields[index] if request.fields else {}
    needed = {field_key(name) for name in request.color_options.wanted_fields}
    raw = RawCloud(
        points, fields={name: fields[name] for name in fields if field_key(name) in needed}, field_names=list(fields),
        class_names=request.class_names[index] if request.class_names else {},
        color_kind=request.color_kinds[index] if request.color_kinds else "",
    )  # fmt: skip
    scan = scan_from_raw(raw, label)
    return keep_classes(scan, request.color_options) if request.color_options.classes else scan


def _read_whole(path: Path, request: RenderRequest) -> list[Scan]:
    """All clouds of a file.

    Raises:
        ScanError: it, or one of them, cannot be read.
    """
    scans = []
    for scan in read_scans(path, None, request.color_options):
        if isinstance(scan, ScanError):
            raise scan
        scans.append(scan)
    return scans


def _film_source(cloud: np.ndarray | Path) -> dict[str, Any]:
    """The first cloud of a film, for its record."""
    if isinstance(cloud, Path):
        return describe_source(cloud, Path("film"))
    return {"name": None, "sha256": hashlib.sha256(cloud.tobytes()).hexdigest(), "cloud": 0}


def _render_all(
    scans: list[Scan], sources: list[dict[str, Any]], suffix: str, request: RenderRequest
) -> list[RenderedImage]:
    """An image of each scan; `sources` describe them for their records, `suffix` is their file's."""
    images = []
    with _default_device_cpu():
        renderer = _renderer_for(request, any(has_own_colors(scan) for scan in scans))
        request, note = _without_undrawn_colors(request, renderer)
        look = _look_for(renderer, request)
        if len(scans) > 1 and look.color_options.needs_common_scale:
            look, _ = with_common_scale(renderer, [(scan, suffix) for scan in scans], look)
        for scan, source, color in zip(scans, sources, _color_per_cloud(request, renderer, len(scans)), strict=True):
            own_look = look if color is None else replace(look, values={**look.values, "color": color})
            rendered = _render_labeled(renderer, scan, suffix, own_look)
            array = rendered.picture if look.background is None else opaque_over(rendered.picture, look.background)
            record = build_record(rendered, own_look, source)
            images.append(
                RenderedImage(array, record, (*_notes(scan, rendered, look), *filter(None, [note])), rendered.passes)
            )
    return images


def _without_undrawn_colors(request: RenderRequest, renderer: AnyRenderer) -> tuple[RenderRequest, str]:
    """The request with mean colors of clouds in place of their points' where the weights draw only these; and a note.

    Nothing changes where one color is chosen, or a field.
    """
    is_auto, fields = request.color_options.by == AUTO_COLORS, request.fields
    has_one_color = request.controls.get("color") is not None or bool(request.cloud_colors)
    if renderer.draws_colors or not is_auto or has_one_color or not any("rgb" in one for one in fields):
        return request, ""
    if not all("rgb" in one for one in fields):
        return request, "these weights draw no per-point colours: they are left out; choose one with color="
    means = tuple(mean_color(one["rgb"]) for one in fields)
    note = (
        f"these weights draw no per-point colours: the whole object has their mean, {name_colors(means)}; choose "
        "another with color="
    )
    return replace(request, colors=means), note


@contextmanager
def _default_device_cpu() -> Iterator[None]:
    """Makes the CPU torch's default device, whatever a surrounding training chose; does nothing without torch."""
    torch = sys.modules.get("torch")
    if torch is None:
        yield
        return
    with torch.device("cpu"):
        yield


def _renderer_for(request: RenderRequest, has_colors: bool) -> AnyRenderer:
    """The renderer with the weights that are asked for, from the cache if they have not changed.

    `has_colors` says whether points have colors of their own.
    """
    if str(request.weights) != AUTO:
        return _cached_renderer(request.weights, frozenset(), find_weights(request.weights).stat().st_mtime_ns)
    controls = {name for name, value in request.controls.items() if value is not None}
    by, is_colored = request.color_options.by, bool(request.colors or request.cloud_colors)
    if is_colored or request.color_options.field is not None or (has_colors and by != NO_COLORS):
        controls.add("color")
    return _cached_renderer(request.weights, frozenset(controls), 0)


@lru_cache(maxsize=2)
def _cached_renderer(weights: str | Path, controls: frozenset[str], modified_ns: int) -> AnyRenderer:
    """`modified_ns` is when the weights' file was changed last: it is only part of the cache's key."""
    return load_renderer(weights, controls)


# Engines have no threads in a forked process: see pipeline.inference.engine_selection.
os.register_at_fork(after_in_child=_cached_renderer.cache_clear)


def _color_per_cloud(request: RenderRequest, renderer: AnyRenderer, clouds: int) -> list[Value | None]:
    """The color of each of so many clouds where each has its own; else None.

    Raises:
        SettingError: a color is none, or there are not as many as clouds.
    """
    if request.cloud_colors:
        if len(request.cloud_colors) != clouds:
            raise SettingError(f"expected a color for each of {clouds} clouds, got {len(request.cloud_colors)}")
        return [parse_controls(renderer, {"color": color})["color"] for color in request.cloud_colors]
    colors = [tuple(color) for color in request.colors]
    return [*(colors * clouds if len(colors) == 1 else colors)] or [None] * clouds


def _look_for(renderer: AnyRenderer, request: RenderRequest) -> Look:
    """The look that a request stands for.

    Raises:
        SettingError: a setting is invalid, or the weights do not carry it.
    """
    up = parse_up_axis(request.up)
    if up is None:
        raise SettingError(f"expected up auto, {', '.join(UP_ROTATIONS)}, got {request.up!r}")
    view, (camera, own_camera) = _view(request.view), _camera(request)
    if isinstance(view, tuple) and camera is None:
        other = request.controls.get("elevation")
        if other not in (None, view[1], (view[1],)):
            raise SettingError(f"view {view} and elevation {other} both choose the elevation; leave one out")
    if (camera or own_camera) is not None and request.margin is not None and not request.tight:
        raise SettingError("camera and margin both choose how large the object is; leave one out")
    try:
        return build_look(
            renderer, request.controls, up=up, view=view, azimuth=_angle("azimuth", request.azimuth), camera=camera,
            keep_outliers=request.keep_outliers, cut_top=request.cut_top, smooth=request.smooth, size=request.size,
            background=request.background, supersample=request.supersample, tight=request.tight,
            margin=parse_margin(request.margin), color_options=request.color_options, style=request.style,
            own_camera=own_camera, passes=request.passes, zoom=parse_zoom(request.zoom, request.pan),
        )  # fmt: skip
    except SettingError as error:  # it names the command line's option; Python's keyword has no dashes
        raise SettingError(str(error).removeprefix("--")) from None


def _camera(request: RenderRequest) -> tuple[Viewpoint | None, AnyCamera | None]:
    """The camera that is asked for, checked: a viewpoint or a camera in the data's units, its JSON, or a file of it."""
    camera = request.camera
    if camera is None:
        return None, None
    if isinstance(camera, str | Path):
        camera = read_any_camera(Path(camera))
    if isinstance(camera, LookAt):
        has_size = request.has_size or camera.pixels_per_unit is None
        return None, replace(camera, size=request.size) if has_size and camera.size is None else camera
    if is_pinhole_json(camera):
        camera = camera_from_json(camera)
    if isinstance(camera, PinholeCamera):
        camera = camera_from_json(camera.to_json())
        return None, camera.fitted(*request.size) if request.has_size else camera
    return viewpoint_from_json(camera.to_json() if isinstance(camera, Viewpoint) else camera), None


def _view(view: Any) -> str | float | tuple[float, float]:
    """The view, checked: a named one, an azimuth in degrees, or (azimuth, elevation) in degrees."""
    if isinstance(view, str) and view in NAMED_VIEWS:
        return view
    if isinstance(view, Real):
        return _angle("azimuth of view", view)
    try:
        azimuth, elevation = view
    except (TypeError, ValueError):
        raise SettingError(
            f"expected view {', '.join(NAMED_VIEWS)}, an azimuth or (azimuth, elevation), got {view!r}"
        ) from None
    return _angle("azimuth of view", azimuth), _angle("elevation of view", elevation)


def _angle(what: str, degrees: Any) -> float:
    try:
        angle = math.nan if isinstance(degrees, bool) else float(degrees)
    except (TypeError, ValueError, OverflowError):
        angle = math.nan
    if not math.isfinite(angle):
        raise SettingError(f"{what}: expected degrees, a finite number, got {degrees!r}")
    return angle


def _render_labeled(renderer: AnyRenderer, scan: Scan, suffix: str, look: Look) -> RenderedScan:
    """`render_scan`, whose error names the cloud of a batch."""
    try:
        return render_scan(renderer, scan, suffix, look)
    except ScanError as error:
        raise ScanError(f"cloud {scan.label}: {error}" if scan.label else str(error)) from error


def _notes(scan: Scan, rendered: RenderedScan, look: Look) -> Iterator[str]:
    """What was left out, changed or guessed, in words."""
    placement = rendered.placement
    if scan.dropped:
        yield f"{scan.dropped} points that are not finite were dropped"
    if scan.note:
        yield scan.note
    if scan.repeated:
        yield f"{scan.repeated} points that repeat others, or stand for missing ones, were dropped"
    if placement.outlier_count:
        yield f"{placement.outliers_message} left out of the frame; keep_outliers=True keeps all"
    if placement.background_count:
        yield (
            f"{placement.background_count} points far behind the depth camera's subject were left out; "
            "keep_outliers=True keeps them"
        )
    if placement.smoothing_radius and look.placement_options.smooth == "auto":
        yield "the depth camera's noisy cloud was made smooth; smooth=0 leaves it as it is"
    if placement.rounding_step:
        yield placement.rounding_message
    if placement.outside_count:
        yield f"{placement.outside_count} points lie beyond the camera's frame"
    if rendered.unfamiliar:
        yield f"drawn without the network, which does not know this camera: {rendered.unfamiliar}"
    if placement.hint:
        yield options_as_keywords(placement.hint)


def _record_for(path: Path, record: Mapping[str, Any]) -> dict[str, Any]:
    """The record for an image at that path: the scan's path is relative to it, so that the two can move together."""
    source = dict(record["input"])
    if source.get("path") is not None:
        source["path"] = path_relative_to(Path(source["path"]), path)
    becomes_white = record["background"] == "transparent" and path.suffix.lower() in OPAQUE_SUFFIXES
    return {**record, "input": source, **({"background": list(WHITE)} if becomes_white else {})}
