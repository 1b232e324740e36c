"""One scan to one picture: placed, drawn, averaged down, trimmed, with the record of all that made it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from z2p_core import __version__
from z2p_core.images import bytes_from_unit, shrink, unit_from_bytes
from z2p_core.interfaces import SettingError, Value
from z2p_core.placement.margin import radius_with_margin, with_margin
from z2p_core.placement.viewpoint import Viewpoint
from z2p_core.shading.shadow_fade import faded
from z2p_renderer.pipeline.inference.renderer import Renderer
from z2p_renderer.pipeline.placement.place_scan import PlacementOptions, Placement, place_scan
from z2p_renderer.storage.images.image_files import OPAQUE, WHITE
from z2p_renderer.storage.scans.clouds import Scan

Color = tuple[float, float, float]
Crop = tuple[float, float, float, float]
"""Left, top, right and bottom of a part of the frame, which spans 0 to 1."""
Box = tuple[int, int, int, int]
"""First row, the row behind the last, and columns likewise."""

RECORD_FORMAT = 1
"""Format of the record; raised when its meaning changes."""
RECORDED_OPTIONS = ("up", "view", "azimuth", "keep_outliers", "cut_top", "smooth")
"""What the record keeps of the `PlacementOptions` that was asked for; the camera tells the rest."""
MIN_VISIBLE_ALPHA, MAX_STRAY_PIXELS = 8, 2
"""Alpha, of 255, from which on a pixel is part of the picture when it is trimmed, above the haze that weights may leave
at its borders; and how many such pixels in a row or column are none, as in a corner."""
TRIM_MARGIN = 0.02
"""Share of the frame's shorter side that is left around a trimmed picture."""
MAX_NETWORK_SIDE = 8192
"""Pixels along a side that the network is given at most."""


@dataclass(frozen=True)
class Look:
    """How every picture of a run looks."""

    values: dict[str, Value] = field(default_factory=dict)
    """Control -> value; the sliders' defaults for the others."""
    placement_options: PlacementOptions = field(default_factory=PlacementOptions)
    width: int = 512
    height: int = 512
    background: Color | None = None
    """sRGB in [0, 1]; None keeps the picture transparent."""
    supersample: int = 1
    """Drawn this many times as large, then averaged down in linear light."""
    tight: bool = False
    """Trimmed to what is to be seen, the shadow included."""
    crop: Crop | None = None
    """What a trimmed picture shows of its frame, the same for a whole series; None trims it by itself."""
    settled: bool = False
    """The renderer draws every cloud by itself, whatever weights would suit it: they do not change within a series."""
    margin: float | None = None
    """Share of the shorter side that is left free around the object's bounding sphere; or, where the picture is
    trimmed, around what is to be seen. None leaves what is usual."""

    def __post_init__(self) -> None:
        """Refuses what is too large to draw.

        Raises:
            SettingError: it is.
        """
        if max(self.width, self.height) * self.supersample > MAX_NETWORK_SIDE:
            raise SettingError(f"expected at most {MAX_NETWORK_SIDE} pixels a side to draw, got {self.width},{self.height} "
                               f"times a supersample of {self.supersample}; make one of them smaller")

    @property
    def frame_margin(self) -> float | None:
        """The margin around the object in its frame; a trimmed picture has its own, and the usual frame."""
        return None if self.tight else self.margin

    @property
    def untrimmed(self) -> Look:
        """The look with the whole frame."""
        return replace(self, tight=False, margin=self.frame_margin)

    def written_as(self, suffix: str) -> Look:
        """The look in a file of that suffix (lower-case, with its dot): white behind, where it keeps no transparency.

        A background that was asked for stays.
        """
        return replace(self, background=WHITE) if self.background is None and suffix in OPAQUE else self


@dataclass(frozen=True)
class Drawing:
    """A picture and how it came about."""

    picture: np.ndarray
    """(H, W, 4) uint8, straight sRGB RGBA."""
    placement: Placement
    viewpoint: Viewpoint
    values: dict[str, Value]
    """Every control of the weights."""
    renderer: Renderer
    """What drew it."""
    choice: str = ""
    """Why other weights drew it than usual, in words; empty where they did not."""
    chosen: bool = False
    """Whether the weights were chosen to suit the cloud, and not named by the user."""


def render_scan(renderer: Renderer, scan: Scan, suffix: str, look: Look) -> Drawing:
    """The scan of a file with that suffix (lower-case, with its dot; empty for none) as the look has it.

    Raises:
        ScanError: the cloud has no extent, or no sensor though its view is asked for.
    """
    elevation, free = camera_elevation(renderer, look.values)
    placed = place_scan(scan, suffix, look.placement_options, elevation, free)
    values = dict(look.values)
    if placed.placement.elevation is not None:
        values["elevation"] = (placed.placement.elevation,)
    chosen = not look.settled and renderer.sole_weights is None
    renderer, choice = (renderer, "") if look.settled else renderer.suited(placed.cloud)
    viewpoint, cloud = with_margin(placed.viewpoint, look.frame_margin), placed.cloud
    if look.frame_margin is not None:
        cloud = cloud * np.float32(radius_with_margin(look.frame_margin))
    picture = _drawn(renderer, cloud, values, look, viewpoint.floor)
    if look.tight:
        picture = trim_to_content(picture, look.margin) if look.crop is None else crop_frame(picture, look.crop)
    return Drawing(picture, placed.placement, viewpoint, renderer.settings(values), renderer, choice, chosen)


def _drawn(
    renderer: Renderer, cloud: np.ndarray, values: dict[str, Value], look: Look, floor: float | None
) -> np.ndarray:
    """The whole frame (H, W, 4) uint8 of a placed cloud, with a shadow that ends softly at its edges."""
    if floor is not None:
        floor = min(floor, float(cloud[:, 2].min()))  # nothing stands below it
    factor = look.supersample
    picture = renderer.render(cloud, values, look.width * factor, look.height * factor, floor)
    if factor > 1:
        picture = bytes_from_unit(shrink(unit_from_bytes(picture), factor))
    return faded(picture)


def trim_to_content(picture: np.ndarray, margin: float | None = None) -> np.ndarray:
    """The part (H', W', 4) of a straight RGBA picture (H, W, 4) uint8 that shows something, as `content_box` has it."""
    return crop_box(picture, content_box(picture[..., 3], margin))


def crop_frame(picture: np.ndarray, crop: Crop) -> np.ndarray:
    """The part (H', W', 4) of a picture (H, W, 4) that a crop shows: equal sizes are cut to equal sizes."""
    (height, width), (left, top, right, bottom) = picture.shape[:2], crop
    return crop_box(picture, (math.floor(top * height), math.ceil(bottom * height),
                          math.floor(left * width), math.ceil(right * width)))  # fmt: skip


def crop_box(picture: np.ndarray, box: Box) -> np.ndarray:
    """The part (H', W', 4) of a picture (H, W, 4) in a box; transparent where the box reaches beyond the picture."""
    (height, width), (top, bottom, left, right) = picture.shape[:2], box
    inside = picture[max(top, 0) : bottom, max(left, 0) : right]
    beyond = ((max(-top, 0), max(bottom - height, 0)), (max(-left, 0), max(right - width, 0)), (0, 0))
    return np.pad(inside, beyond) if np.any(beyond) else inside


def content_box(alpha: np.ndarray, margin: float | None = None) -> Box:
    """Where alpha (H, W) uint8 shows something; everywhere if nowhere.

    A share of the shorter side is left around it: `margin`, even beyond the picture, or a narrow one within it.
    """
    height, width = alpha.shape
    visible = alpha >= MIN_VISIBLE_ALPHA
    rows, columns = (np.flatnonzero(visible.sum(axis) > MAX_STRAY_PIXELS) for axis in (1, 0))
    if not (len(rows) and len(columns)):
        return 0, height, 0, width
    wide = round((TRIM_MARGIN if margin is None else margin) * min(height, width))
    top, bottom, left, right = rows[0] - wide, rows[-1] + wide + 1, columns[0] - wide, columns[-1] + wide + 1
    if margin is None:
        top, bottom, left, right = max(top, 0), min(bottom, height), max(left, 0), min(right, width)
    return int(top), int(bottom), int(left), int(right)


def build_record(drawing: Drawing, look: Look, source: Mapping[str, Any]) -> dict[str, Any]:
    """All that made a picture, JSON-able; `source` tells of the cloud: name, path, sha256, place in its file."""
    window = {} if look.crop is None else {"window": list(look.crop)}
    return {
        "record": RECORD_FORMAT,
        "version": __version__,
        "input": dict(source),
        "camera": drawing.viewpoint.to_json(),
        "controls": {name: list(value) for name, value in drawing.values.items()},
        "weights": dict(drawing.renderer.weights),
        "weights_chosen": drawing.chosen,
        "engine": drawing.renderer.engine,
        "resolution": [look.width, look.height],
        "background": "transparent" if look.background is None else list(look.background),
        "supersample": look.supersample,
        "fit": "tight" if look.tight else "frame",
        "margin": look.margin,
        "placing": {name: getattr(look.placement_options, name) for name in RECORDED_OPTIONS},
        "stance": drawing.placement.to_json(),
        **window,
    }


def camera_elevation(renderer: Renderer, values: dict[str, Value]) -> tuple[float, tuple[float, float] | None]:
    """The camera's elevation, degrees, and the range in which a view may choose another: None when it is settled."""
    if renderer.fixed_elevation is not None:
        return renderer.fixed_elevation, None
    slider = renderer.controls["elevation"].slider
    settled = "elevation" in values
    return renderer.settings(values)["elevation"][0], None if settled else (slider.low[0], slider.high[0])
