"""One scan to one picture: place the cloud, select the weights, render the frame, trim it; with a record of it all."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from z2p_core import __version__
from z2p_core.camera_placement.usual_camera import usual_pinhole
from z2p_core.camera_placement.zoomed_camera import zoomed_camera
from z2p_core.coloring.options import AUTO, NONE
from z2p_core.images import bytes_from_unit, linear_from_srgb, shrink, unit_from_bytes
from z2p_core.interfaces import PointColors, SettingError, Value
from z2p_core.linalg import bounding_box
from z2p_core.pinhole import PinholeCamera
from z2p_core.placement.margin import radius_with_margin, with_margin
from z2p_core.placement.viewpoint import Viewpoint
from z2p_core.shading.shadow_fade import fade_shadow
from z2p_renderer.pipeline.coloring.color_points import Coloring, Scale, color_points
from z2p_renderer.pipeline.coloring.common_scale import share_scale
from z2p_renderer.pipeline.inference.look import Look
from z2p_renderer.pipeline.inference.prepared_render import PreparedRender
from z2p_renderer.pipeline.inference.renderer import Renderer
from z2p_renderer.pipeline.inference.styles import DRAW, Frame, StyledCloud, ball_radii
from z2p_renderer.pipeline.inference.trim import content_box, crop_box, crop_rows_and_columns
from z2p_renderer.pipeline.inference.weight_selection import AnyRenderer, AutoRenderer, select_renderer
from z2p_renderer.pipeline.legends.marks import FrameGeometry
from z2p_renderer.pipeline.placement.camera_placement import check_zoom
from z2p_renderer.pipeline.placement.place_scan import PlacedCloud, place_scan
from z2p_renderer.pipeline.placement.placement_record import Placement
from z2p_renderer.storage.scans.clouds import Scan

if TYPE_CHECKING:
    from z2p_renderer.pipeline.legends.annotate import Annotations

Bounds = tuple[tuple[float, float, float], tuple[float, float, float]]
RECORD_FORMAT = 1
"""Version of the record's format, raised when the meaning of a key changes."""
DEFAULT_BASE_SRGB = (0.906, 0.906, 0.906)
"""sRGB of the base color where no control sets one: `z2p_core.scene.DEFAULT_BASE_COLOR`."""
RECORDED_OPTIONS = ("up", "view", "azimuth", "keep_outliers", "cut_top", "smooth")
"""Fields of `PlacementOptions` that the record keeps; the camera stands for the others."""


@dataclass(frozen=True)
class RenderedScan:
    """A picture, and what it was made with."""

    picture: np.ndarray
    """(H, W, 4) uint8, straight sRGB RGBA."""
    placement: Placement
    viewpoint: Viewpoint
    """What placed the cloud, the margin included."""
    values: dict[str, Value]
    """The value of every control of the weights."""
    renderer: Renderer
    """What rendered it."""
    weights_reason: str = ""
    """Why other weights than the default ones were selected, in words; empty where they were not."""
    has_automatic_weights: bool = False
    """Whether the weights were selected by the cloud, rather than named by the user."""
    coloring: Coloring | None = None
    """The colors of the points, in place of the control ``color``; None if the whole object has one color."""
    pinhole: PinholeCamera | None = None
    """The camera of the user's, in the data's units; None: the usual one, which `viewpoint` describes."""
    unfamiliar: str = ""
    """Why it was drawn without the network; empty if it was not."""
    passes: Mapping[str, np.ndarray] = field(default_factory=dict)
    """What else the look asks for: `z2p_core.shading.passes`."""
    pass_camera: PinholeCamera | None = None
    """The camera of the passes, in the data's units; None without passes."""
    offset: tuple[int, int] = (0, 0)
    """Row and column of the frame at which the picture begins, if it was trimmed."""
    bounds: Bounds | None = None
    """Lowest and highest coordinates of the drawn points, in the data's units; None where no axes are drawn."""
    cloud: np.ndarray = field(default_factory=partial(np.empty, (0, 3), np.float32))
    """The points (N, 3) float32 that were drawn, in world units, the margin included."""

    def annotations(self, look: Look) -> Annotations:
        """What is drawn onto the picture and beside it."""
        from z2p_renderer.pipeline.legends.annotate import Annotations  # late: slow to import

        bounds = self.bounds or ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
        geometry = FrameGeometry(self.viewpoint, look.width, look.height, self.offset[1], self.offset[0], bounds)
        scale = self.coloring.scale if self.coloring is not None and look.color_options.color_bar else None
        return Annotations(geometry, look.marks, scale, look.tight)

    def annotated(self, look: Look) -> RenderedScan:
        """The same with annotations in the picture, but for a document, which holds them as vectors."""
        has_bar = self.coloring is not None and self.coloring.scale is not None and look.color_options.color_bar
        if look.is_document or not (look.marks or has_bar):
            return self
        from z2p_renderer.pipeline.legends.annotate import annotate  # late: slow to import

        return replace(self, picture=annotate(self.picture, self.annotations(look), look.background))


def render_scan(renderer: AnyRenderer, scan: Scan, suffix: str, look: Look) -> RenderedScan:
    """The picture of a scan from a file with that suffix (lower-case, with its dot; empty for none).

    Raises:
        ScanError: the cloud has no extent, or the sensor's view is asked for and the scan has no sensor.
    """
    elevation, elevation_range = camera_elevation(renderer, look.values)
    placed = place_scan(scan, suffix, look.placement_options, elevation, elevation_range)
    if placed.camera is not None:
        placed = replace(placed, unfamiliar=_reason_without_network(placed, look))
    selected, reason = select_renderer(renderer, placed.cloud, look.style.needs_network)

    values = dict(look.values)
    if placed.placement.elevation is not None:  # the view chose it
        values["elevation"] = (placed.placement.elevation,)
    viewpoint, cloud = with_margin(placed.viewpoint, look.frame_margin), placed.cloud
    viewpoint = replace(viewpoint, zoom=look.zoom) if look.zoom else viewpoint
    if look.frame_margin is not None:
        cloud = cloud * np.float32(radius_with_margin(look.frame_margin))

    coloring = _choose_colors(scan, viewpoint, selected, look)
    colors = None if coloring is None else coloring.place(viewpoint)
    radii = ball_radii(look.style, scan, cloud, viewpoint)
    if placed.camera is None:
        picture = _render_frame(selected, cloud, values, look, viewpoint, colors, radii)
    else:
        picture = _render_from(selected, placed, values, look, colors, radii)
    passes: dict[str, np.ndarray] = {}
    pass_camera = None
    if look.passes:
        pass_camera, passes = _draw_passes(cloud, viewpoint, placed.pinhole, colors, selected.settings(values), look)
    top = left = 0
    if look.tight:
        is_own, crop = look.crop is None, look.crop or (0.0, 0.0, 1.0, 1.0)
        box = content_box(picture[..., 3], look.margin) if is_own else crop_rows_and_columns(picture, crop)
        picture, top, left = crop_box(picture, box), box[0], box[2]
    bounds = _data_bounds(placed) if look.marks.axes else None
    return RenderedScan(picture, placed.placement, viewpoint, selected.settings(values), selected, reason,
                        isinstance(renderer, AutoRenderer), coloring, placed.pinhole, placed.unfamiliar,
                        passes, pass_camera, (top, left), bounds, cloud).annotated(look)  # fmt: skip


def _reason_without_network(placed: PlacedCloud, look: Look) -> str:
    """Why a camera of the user's is drawn without the network; empty if it is not, or the style needs none."""
    return (look.without_network or placed.unfamiliar) if look.style.needs_network else ""


def _data_bounds(placed: PlacedCloud) -> Bounds:
    """The lowest and highest coordinates of a placed cloud along the data's axes, in the data's units."""
    low, high = bounding_box(placed.viewpoint.unplace(placed.cloud))
    return tuple(low.tolist()), tuple(high.tolist())


def _choose_colors(scan: Scan, viewpoint: Viewpoint, renderer: Renderer, look: Look) -> Coloring | None:
    """The colors of the scan's points; None if the whole object has one.

    Raises:
        ScanError: the scan has not the field that the look names.
        SettingError: the weights draw no colors of points, and the look insists on them.
    """
    options = look.color_options
    if options.by == NONE or (options.by == AUTO and ("color" in look.values or not renderer.draws_colors)):
        return None
    if not renderer.draws_colors:
        raise SettingError(
            f"the weights {renderer.weights['name']!r} draw no colours of points; choose others with "
            "--weights, or --color-by none"
        )
    return color_points(scan, viewpoint, options)


def camera_elevation(renderer: AnyRenderer, values: dict[str, Value]) -> tuple[float, tuple[float, float] | None]:
    """The camera's elevation in degrees, and the range from which a view may choose another one.

    The range is None where the elevation is fixed, by the weights or by the user.
    """
    if renderer.fixed_elevation is not None:
        return renderer.fixed_elevation, None
    slider = renderer.controls["elevation"].slider
    if "elevation" in values:
        return values["elevation"][0], None
    return slider.default[0], (slider.low[0], slider.high[0])


def viewpoint_of(renderer: AnyRenderer, scan: Scan, suffix: str, look: Look) -> Viewpoint:
    """The viewpoint that `render_scan` would place the scan at, before the margin.

    Raises:
        ScanError: see `render_scan`.
    """
    elevation, elevation_range = camera_elevation(renderer, look.values)
    return place_scan(scan, suffix, look.placement_options, elevation, elevation_range).viewpoint


def with_common_scale(
    renderer: AnyRenderer, scans: Iterable[tuple[Scan, str]], look: Look
) -> tuple[Look, Scale | None]:
    """The look with one scale of colors for all scans (each with its file's suffix), and that scale.

    None where points are not colored by a field, or no scan has it.
    """
    options, scale = share_scale(scans, look.color_options, partial(viewpoint_of, renderer, look=look))
    return replace(look, color_options=options), scale


def _render_frame(
    renderer: Renderer, cloud: np.ndarray, values: dict[str, Value], look: Look, viewpoint: Viewpoint,
    colors: PointColors | None, radii: np.ndarray | None,
) -> np.ndarray:  # fmt: skip
    """The whole frame (H, W, 4) uint8 of a placed cloud (N, 3) float32; its shadow fades towards the frame's edges.

    Raises:
        ScanError: a zoom shows nothing of it.
    """
    floor = viewpoint.floor
    if floor is not None:
        floor = min(floor, float(cloud[:, 2].min()))  # no point lies below the floor
    factor = look.supersample
    width, height, camera = look.width * factor, look.height * factor, None
    if viewpoint.zoom:
        elevation = renderer.settings(values).get("elevation", (viewpoint.elevation,))[0]
        camera = zoomed_camera(width, height, elevation, viewpoint.zoom)
        check_zoom(cloud, camera)
    frame = Frame(cloud, values, width, height, floor, colors, radii, look.reduction, camera)
    return _finish_frame(DRAW[look.style.name](renderer, frame), factor)


def render_prepared(
    prepared: PreparedRender | StyledCloud, values: dict[str, Value], look: Look, azimuth: float
) -> np.ndarray:  # fmt: skip
    """The whole frame (H, W, 4) uint8, as of `render_scan`, of a prepared cloud turned by `azimuth` degrees."""
    factor = look.supersample
    return _finish_frame(prepared.render(values, look.width * factor, look.height * factor, azimuth), factor)


def _finish_frame(image: np.ndarray, factor: int) -> np.ndarray:
    """An image (factor H, factor W, 4) uint8 at its final size (H, W, 4), its shadow faded towards the edges."""
    if factor > 1:
        image = bytes_from_unit(shrink(unit_from_bytes(image), factor))
    return fade_shadow(image)


def _render_from(
    renderer: Renderer, placed: PlacedCloud, values: dict[str, Value], look: Look, colors: PointColors | None,
    radii: np.ndarray | None,
) -> np.ndarray:  # fmt: skip
    """The frame (H, W, 4) uint8 of a placed cloud as a camera of the user's sees it."""
    camera, factor = placed.camera, look.supersample
    assert camera is not None
    large = camera.resized(camera.width * factor, camera.height * factor)
    if look.style.needs_network:
        image = renderer.render_from(placed.cloud, large, values, None, colors, use_network=not placed.unfamiliar)
    else:
        frame = Frame(placed.cloud, values, large.width, large.height, None, colors, radii, camera=large)
        image = DRAW[look.style.name](renderer, frame)
    return _finish_frame(image, factor)


def _draw_passes(
    cloud: np.ndarray, viewpoint: Viewpoint, pinhole: PinholeCamera | None, colors: PointColors | None,
    values: dict[str, Value], look: Look,
) -> tuple[PinholeCamera, dict[str, np.ndarray]]:  # fmt: skip
    """The passes that the look asks for, and their camera; `pinhole` is the user's own, if any.

    Raises:
        SettingError: the picture is trimmed, so that its pixels are no longer the camera's.
    """
    from z2p_core.shading.passes import draw_passes  # late: few pictures have passes

    if look.tight:
        raise SettingError("passes show the whole frame of their camera; leave out --fit tight")
    if pinhole is None:
        elevation = values["elevation"][0] if "elevation" in values else viewpoint.elevation
        pinhole = usual_pinhole(viewpoint, look.width, look.height, elevation)
    color = linear_from_srgb(np.array(values.get("color", DEFAULT_BASE_SRGB), np.float32))
    return pinhole, draw_passes(look.passes, cloud, viewpoint, pinhole, color if colors is None else colors)


def build_record(rendered: RenderedScan, look: Look, source: Mapping[str, Any]) -> dict[str, Any]:
    """All that made a picture, JSON-able; `source` describes the cloud: name, path, sha256, index in its file."""
    window = {} if look.crop is None else {"window": list(look.crop)}
    size = [look.width, look.height] if rendered.pinhole is None else [rendered.pinhole.width, rendered.pinhole.height]
    return {
        "record": RECORD_FORMAT,
        "version": __version__,
        "input": dict(source),
        "camera": rendered.viewpoint.to_json(),
        "controls": {name: list(value) for name, value in rendered.values.items()},
        "weights": dict(rendered.renderer.weights),
        **_colors_record(rendered.coloring, look),
        "weights_chosen": rendered.has_automatic_weights,
        **({"engine": rendered.renderer.engine} if look.style.needs_network else {}),
        **look.style.to_json(),
        "resolution": size,
        "background": "transparent" if look.background is None else list(look.background),
        "supersample": look.supersample,
        "fit": "tight" if look.tight else "frame",
        "margin": look.margin,
        "placing": {name: getattr(look.placement_options, name) for name in RECORDED_OPTIONS},
        "stance": rendered.placement.to_json(),
        **window,
        **_pinhole_record(rendered, look),
        **({} if look.dpi is None else {"dpi": look.dpi}),
        **{name: value for name, value in vars(look.marks).items() if value},
    }


def _pinhole_record(rendered: RenderedScan, look: Look) -> dict[str, Any]:
    """What a record says of a camera in the data's units: nothing without one."""
    wish = look.placement_options.camera
    if rendered.pinhole is None or wish is None:
        return {}
    return {
        "pinhole": rendered.pinhole.to_json(),
        "pinhole_wish": wish.to_json(),
        **({"without_network": rendered.unfamiliar} if rendered.unfamiliar else {}),
    }


def _colors_record(coloring: Coloring | None, look: Look) -> dict[str, Any]:
    """What a record says of the points' colors: nothing where there are none, and no classes were chosen."""
    options = look.color_options
    kept = {"classes": list(options.classes)} if options.classes else {}
    if coloring is None:
        return {**({"color_by": NONE} if options.by == NONE else {}), **kept}
    return {**coloring.to_json(), **({"color_bar": True} if options.color_bar else {}), **kept}
