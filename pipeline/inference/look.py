"""How a picture is to look: control values, placement, size and background; built here from a user's settings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from z2p_core.coloring.options import ColorOptions
from z2p_core.formats.row_subsampling import rows_for_picture
from z2p_core.interfaces import SettingError, Value
from z2p_core.pinhole import AnyCamera, LookAt, PinholeCamera
from z2p_core.placement.viewpoint import Viewpoint
from z2p_core.placement.zoom import UNZOOMED, Zoom
from z2p_core.style import BALLS, Style
from z2p_renderer.pipeline.inference.parse_settings import parse_background, parse_controls, parse_smoothing
from z2p_renderer.pipeline.inference.styles import check_style
from z2p_renderer.pipeline.inference.weight_selection import AnyRenderer
from z2p_renderer.pipeline.legends.marks import Marks
from z2p_renderer.pipeline.placement.options import PlacementOptions
from z2p_renderer.storage.images.image_files import DOCUMENT_SUFFIXES, OPAQUE_SUFFIXES, WHITE

Color = tuple[float, float, float]
Crop = tuple[float, float, float, float]
"""Left, top, right and bottom of a part of the frame, each a share of the frame's width or height, from 0 to 1."""

MAX_NETWORK_SIDE = 8192
"""Largest side, in pixels, of an image that the network is run on."""


@dataclass(frozen=True)
class Look:
    """How every picture of a run looks."""

    values: dict[str, Value] = field(default_factory=dict)
    """Control name -> value. A control that is not in it has its slider's default."""
    placement_options: PlacementOptions = field(default_factory=PlacementOptions)
    width: int = 512
    """Width of the frame, in pixels."""
    height: int = 512
    """Height of the frame, in pixels."""
    background: Color | None = None
    """sRGB in [0, 1]; None keeps the picture transparent."""
    supersample: int = 1
    """The frame is rendered this many times as large, then averaged down in linear light."""
    tight: bool = False
    """Whether the picture is trimmed to its visible part, the shadow included."""
    crop: Crop | None = None
    """The part of the frame that a trimmed picture shows, the same for a whole series; None: its own visible part."""
    color_options: ColorOptions = field(default_factory=ColorOptions)
    """What the points are colored by."""
    style: Style = field(default_factory=Style)
    """How the points are shown."""
    passes: tuple[str, ...] = ()
    """What else is drawn of every picture: `z2p_core.pass_names.PASSES`."""
    without_network: str = ""
    """Why pictures are drawn without the network, whatever the view; empty if views decide it."""
    margin: float | None = None
    """Free border as a share of the shorter side: around the object's bounding sphere or, in a trimmed picture, around
    the visible part. None: the default of either."""
    zoom: Zoom = UNZOOMED
    """The part of the frame that is shown, in place of a loaded camera's."""
    marks: Marks = field(default_factory=Marks)
    """A scale bar and axes."""
    dpi: float | None = None
    """Pixels for an inch on paper; None where the user does not say."""
    is_document: bool = False
    """Whether the picture is for a PDF or SVG, in which marks and color bar are drawn as vectors, not as pixels."""
    reduction: int | None = None
    """Factor by which the network draws smaller, the same for a whole film; None: by each cloud's own spacing."""

    def __post_init__(self) -> None:
        """Check the size.

        Raises:
            SettingError: a side times `supersample` is larger than `MAX_NETWORK_SIDE`.
        """
        if max(self.width, self.height) * self.supersample > MAX_NETWORK_SIDE:
            raise SettingError(f"expected at most {MAX_NETWORK_SIDE} pixels a side to draw, got {self.width},"
                               f"{self.height} times a supersample of {self.supersample}; make one of them smaller")

    @property
    def max_rows(self) -> int:
        """How many points of a large file its pictures can show."""
        return rows_for_picture(self.width * self.supersample, self.height * self.supersample)

    @property
    def frame_margin(self) -> float | None:
        """The margin around the object in its frame; None in a trimmed picture, whose frame has the default margin."""
        return None if self.tight else self.margin

    @property
    def untrimmed(self) -> Look:
        """The same look, showing the whole frame."""
        return replace(self, tight=False, margin=self.frame_margin)

    def taken_by(self, camera: AnyCamera) -> Look:
        """The same look as another camera in the data's units sees it."""
        size = (camera.width, camera.height) if isinstance(camera, PinholeCamera) else camera.size
        width, height = size or (self.width, self.height)
        options = replace(self.placement_options, camera=camera)
        return replace(self, placement_options=options, width=width, height=height)

    def written_as(self, suffix: str) -> Look:
        """The look in a file with that suffix (lower-case, with its dot).

        Formats without transparency get a white background, unless the look has one.
        """
        look = replace(self, is_document=True) if suffix in DOCUMENT_SUFFIXES else self
        return replace(look, background=WHITE) if self.background is None and suffix in OPAQUE_SUFFIXES else look


def build_look(
    renderer: AnyRenderer,
    controls: Mapping[str, Any],
    *,
    up: str,
    view: str | float | tuple[float, float],
    azimuth: float,
    camera: Viewpoint | None,
    keep_outliers: bool,
    cut_top: float,
    smooth: Any,
    size: tuple[int, int],
    background: Any,
    supersample: int,
    tight: bool,
    margin: float | None,
    crop: Crop | None = None,
    color_options: ColorOptions | None = None,
    style: Style | None = None,
    own_camera: AnyCamera | None = None,
    passes: tuple[str, ...] = (),
    zoom: Zoom | None = None,
) -> Look:
    """The `Look` that a command's options, a call of `z2p_core.render` or a picture's record stand for.

    Args:
        renderer: its weights say which controls there are.
        controls: control name -> text, number or numbers; None counts as not given.
        view: ``auto``, ``front``, ``sensor``, azimuth in degrees, or (azimuth, elevation) in degrees.
        camera: replaces `up` and `view`, the elevation included.
        smooth, background: see `parse_smoothing` and `parse_background`.
        size: width and height in pixels.
        own_camera: a camera in the data's units: it replaces `view`; its own picture's shape is kept within `size`.

    The other arguments are fields of `PlacementOptions` and `Look`.

    Raises:
        SettingError: the weights do not carry a control, or a value is outside its range.
    """
    if isinstance(view, tuple):
        view, elevation = view
        if camera is None:
            controls = {**controls, "elevation": elevation}
    if own_camera is not None:
        own_camera, size = _sized_camera(own_camera, size, azimuth, controls)
    width, height = size
    style, values = style or Style(), parse_controls(renderer, controls)
    options = PlacementOptions(
        up=up, view=view, azimuth=azimuth, keep_outliers=keep_outliers, cut_top=cut_top, viewpoint=camera,
        smooth=parse_smoothing(smooth), camera=own_camera, points_alone=style.name == BALLS,
    )  # fmt: skip
    check_style(style, renderer, values)
    return Look(
        values=values, placement_options=options, width=width, height=height,
        background=parse_background(background), supersample=supersample, tight=tight, crop=crop, margin=margin,
        color_options=replace(color_options or ColorOptions(), other_fields=style.wanted_fields), style=style,
        passes=passes, zoom=_checked_zoom(zoom, tight, own_camera, camera),
    )  # fmt: skip


def _checked_zoom(zoom: Zoom | None, tight: bool, own_camera: AnyCamera | None, camera: Viewpoint | None) -> Zoom:
    """The zoom that a look has.

    Raises:
        SettingError: something else determines the part of the frame as well.
    """
    own = Zoom() if camera is None else camera.zoom
    if zoom and (own_camera is not None or own):
        raise SettingError("zoom or pan and the camera both choose the part of the frame; leave one out")
    if (zoom or own) and tight:
        raise SettingError("zoom or pan and --fit tight both choose the part of the frame; leave one out")
    return zoom or Zoom()


def _sized_camera(
    camera: AnyCamera, size: tuple[int, int], azimuth: float, controls: Mapping[str, Any]
) -> tuple[AnyCamera, tuple[int, int]]:
    """The camera with a picture of that size in pixels, or one that fits into it; and the picture's size.

    Raises:
        SettingError: other settings determine the view as well.
    """
    has_place = isinstance(camera, PinholeCamera) or camera.eye is not None
    if has_place and azimuth:
        raise SettingError("camera and azimuth both choose the side; leave one out")
    if has_place and controls.get("elevation") is not None:
        raise SettingError("camera and elevation both choose the camera's height; leave one out")
    if isinstance(camera, LookAt):
        return camera, camera.size or size
    return camera, (camera.width, camera.height)
