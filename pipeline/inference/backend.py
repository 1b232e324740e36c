"""What stands behind `z2p_core.render`: named by the entry point ``z2p.studio``, so that the core need not know it."""

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

from z2p_core.api.backend import RenderRequest
from z2p_core.api.picture import Picture
from z2p_core.images import bytes_from_unit, composite, unit_from_bytes
from z2p_core.interfaces import ScanError, SettingError
from z2p_core.placement.margin import parse_margin
from z2p_core.placement.viewpoint import Viewpoint, viewpoint_from_json
from z2p_core.up_axis.axis_names import UP_ROTATIONS, parse_up_axis
from z2p_renderer.pipeline.inference.batch import describe_source, path_relative_to
from z2p_renderer.pipeline.inference.look import Look, build_look
from z2p_renderer.pipeline.inference.parse_settings import parse_background
from z2p_renderer.pipeline.inference.render_scan import RenderedScan, build_record, render_scan
from z2p_renderer.pipeline.inference.weight_selection import AUTO, AnyRenderer, load_renderer
from z2p_renderer.pipeline.placement.hints import in_python
from z2p_renderer.storage.cameras import read_camera
from z2p_renderer.storage.images.image_files import OPAQUE_SUFFIXES, WHITE, encode_picture, write_picture
from z2p_renderer.storage.models.checkpoints import find_weights
from z2p_renderer.storage.scans.clouds import Scan, format_suffix, read_clouds, usable

NAMED_VIEWS = ("auto", "front", "sensor")
MESSAGE_COLOR, MESSAGE_TEXT_COLOR = (228, 228, 228, 255), (90, 90, 90, 255)


class RenderBackend:
    """Draws for Python: the studio of `z2p_core.api.backend`. torch's generator and default device are left alone."""

    def draw(self, clouds: Sequence[np.ndarray], request: RenderRequest) -> list[Picture]:
        """A picture of each cloud (N, 3) float64; rows that are not finite are dropped and noted.

        Raises:
            ScanError: a cloud that has no extent.
            SettingError: a setting that cannot be.
        """
        labels = [f"[{index}]" if len(clouds) > 1 else "" for index in range(len(clouds))]
        scans = [usable(cloud, label) for cloud, label in zip(clouds, labels, strict=True)]
        sources = [{"name": None, "sha256": hashlib.sha256(cloud.tobytes()).hexdigest(), "cloud": index}
                   for index, cloud in enumerate(clouds)]  # fmt: skip
        return _pictures(scans, sources, "", request)

    def draw_file(self, path: Path, request: RenderRequest) -> list[Picture]:
        """A picture of each cloud in a file.

        Raises:
            ScanError: the file cannot be read, or one of its clouds has no extent.
            SettingError: a setting that cannot be.
        """
        scans = read_clouds(path)
        source = describe_source(path, Path("picture"))
        if source["path"] is not None:  # as a whole: only when it is saved is known what it is to be relative to
            source["path"] = path.absolute().as_posix()
        sources = [{**source, "cloud": index} for index in range(len(scans))]
        return _pictures(scans, sources, format_suffix(path), request)

    def save(self, picture: Picture, path: Path) -> Path:
        """The path, once the picture is written there, in the format of its suffix."""
        write_picture(picture.array, path, record=_record_beside(picture.record, path))
        return path

    def png(self, picture: Picture) -> bytes:
        """The picture as a PNG file."""
        return encode_picture(picture.array, ".png", record=_record_beside(picture.record, Path("picture")))

    def over(self, picture: Picture, background: Any) -> Picture:
        """The picture made opaque; the members of a batch too."""
        color = parse_background(background)
        if color is None:
            return picture
        opaque = _opaque(picture.array, color)
        parts = tuple(self.over(part, color) for part in picture.parts)
        return replace(picture, array=opaque, record={**picture.record, "background": list(color)}, parts=parts)

    def notice(self, text: str, size: tuple[int, int]) -> np.ndarray:
        """Picture (H, W, 4) uint8 that says the text, in place of one that could not be drawn."""
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


def _record_beside(record: Mapping[str, Any], picture: Path) -> dict[str, Any]:
    """The record as it stands in a picture's file: its scan is named from there, so that the two can move together."""
    source = dict(record["input"])
    if source.get("path") is not None:
        source["path"] = path_relative_to(Path(source["path"]), picture)
    clear = record["background"] == "transparent" and picture.suffix.lower() in OPAQUE_SUFFIXES
    return {**record, "input": source, **({"background": list(WHITE)} if clear else {})}


def look_for(renderer: AnyRenderer, request: RenderRequest) -> Look:
    """The look that a request stands for.

    Raises:
        SettingError: a setting that cannot be, or that the weights do not carry.
    """
    up = parse_up_axis(request.up)
    if up is None:
        raise SettingError(f"expected up auto, {', '.join(UP_ROTATIONS)}, got {request.up!r}")
    wishes, view, camera = dict(request.controls), _view(request.view), _camera(request.camera)
    if isinstance(view, tuple) and camera is None:
        other = wishes.get("elevation")
        if other not in (None, view[1], (view[1],)):
            raise SettingError(f"view {view} and elevation {other} both choose the elevation; leave one out")
    if camera is not None and request.margin is not None and not request.tight:
        raise SettingError("camera and margin both choose how large the object is; leave one out")
    try:
        return build_look(
            renderer, wishes, up=up, view=view, azimuth=_angle("azimuth", request.azimuth), camera=camera,
            keep_outliers=request.keep_outliers, cut_top=request.cut_top, smooth=request.smooth, size=request.size,
            background=request.background, supersample=request.supersample, tight=request.tight,
            margin=parse_margin(request.margin),
        )  # fmt: skip
    except SettingError as error:  # it names the command line's option; Python's keyword has no dashes
        raise SettingError(str(error).removeprefix("--")) from None


def _view(view: Any) -> str | float | tuple[float, float]:
    """A known word, an azimuth in degrees, or with the elevation."""
    if isinstance(view, str) and view in NAMED_VIEWS:
        return view
    if isinstance(view, Real):
        return _angle("azimuth of view", view)
    try:
        azimuth, elevation = view
    except (TypeError, ValueError):
        raise SettingError(f"expected view {', '.join(NAMED_VIEWS)}, an azimuth or (azimuth, elevation), got "
                           f"{view!r}") from None
    return _angle("azimuth of view", azimuth), _angle("elevation of view", elevation)


def _angle(what: str, degrees: Any) -> float:
    try:
        angle = math.nan if isinstance(degrees, bool) else float(degrees)
    except (TypeError, ValueError, OverflowError):
        angle = math.nan
    if not math.isfinite(angle):
        raise SettingError(f"{what}: expected degrees, a finite number, got {degrees!r}")
    return angle


def _pictures(scans: list[Scan], sources: list[dict[str, Any]], suffix: str, request: RenderRequest) -> list[Picture]:
    asked = frozenset(name for name, wish in request.controls.items() if wish is not None)
    if request.colors:
        asked |= {"color"}
    changed = 0 if str(request.weights) == AUTO else find_weights(request.weights).stat().st_mtime_ns
    with _unnoticed():
        renderer = _renderer(request.weights, asked if str(request.weights) == AUTO else frozenset(), changed)
        pictures = []
        for scan, source, own in zip(scans, sources, _requests(request, len(scans)), strict=True):
            look = look_for(renderer, own)
            drawing = _drawn(renderer, scan, suffix, look)
            array = drawing.picture if look.background is None else _opaque(drawing.picture, look.background)
            pictures.append(Picture(array, build_record(drawing, look, source), tuple(_notes(scan, drawing, look))))
    return pictures


def _requests(request: RenderRequest, clouds: int) -> list[RenderRequest]:
    """What is asked of each cloud."""
    if not request.colors:
        return [request] * clouds
    colors = list(request.colors) * (clouds if len(request.colors) == 1 else 1)
    return [replace(request, controls={**request.controls, "color": color}) for color in colors]


def _notes(scan: Scan, drawing: RenderedScan, look: Look) -> Iterator[str]:
    """What a user should know of how the picture came about."""
    stance = drawing.placement
    if scan.dropped:
        yield f"{scan.dropped} points that are not finite were dropped"
    if scan.note:
        yield scan.note
    if scan.repeated:
        yield f"{scan.repeated} points that repeat others, or stand for missing ones, were dropped"
    if stance.outlier_count:
        yield f"{stance.outliers_message} left out of the frame; keep_outliers=True keeps all"
    if stance.background_count:
        yield (f"{stance.background_count} points far behind the depth camera's subject were left out; "
               "keep_outliers=True keeps them")
    if stance.smoothing_radius and look.placement_options.smooth == "auto":
        yield "the depth camera's noisy cloud was made smooth; smooth=0 leaves it as it is"
    if stance.rounding_step:
        yield stance.rounding_message
    if stance.outside_count:
        yield f"{stance.outside_count} points lie beyond the camera's frame"
    if stance.hint:
        yield in_python(stance.hint)


def _drawn(renderer: AnyRenderer, scan: Scan, suffix: str, look: Look) -> RenderedScan:
    """As `render_scan` does it; an error names which cloud of the batch it was."""
    try:
        return render_scan(renderer, scan, suffix, look)
    except ScanError as error:
        raise ScanError(f"cloud {scan.label}: {error}" if scan.label else str(error)) from error


@contextmanager
def _unnoticed() -> Iterator[None]:
    """A training around us keeps torch's default device; where torch was not imported, it is not here."""
    torch = sys.modules.get("torch")
    if torch is None:
        yield
        return
    with torch.device("cpu"):
        yield


@lru_cache(maxsize=2)
def _renderer(weights: str | Path, asked: frozenset[str], changed: int) -> AnyRenderer:
    return load_renderer(weights, asked)


os.register_at_fork(after_in_child=_renderer.cache_clear)  # its engines have no threads in a fork; see pipeline.inference.engine_selection


def _camera(camera: Any) -> Viewpoint | None:
    """The camera that was asked for, checked."""
    if camera is None:
        return None
    if isinstance(camera, Picture):
        return camera.camera
    if isinstance(camera, str | Path):
        return read_camera(Path(camera))
    return viewpoint_from_json(camera.to_json() if isinstance(camera, Viewpoint) else camera)


def _opaque(picture: np.ndarray, color: tuple[float, float, float]) -> np.ndarray:
    """The picture over a colour, with an alpha of 255."""
    rgb = bytes_from_unit(composite(unit_from_bytes(picture), color))
    return np.dstack([rgb, np.full(rgb.shape[:2], 255, dtype=np.uint8)])
