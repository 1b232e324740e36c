"""Loops: an object that turns before the camera, a camera around it, or a light from side to side and back."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from z2p_core.images import (
    bytes_from_unit,
    premultiplied_from_straight,
    straight_from_premultiplied,
    unit_from_bytes,
)
from z2p_core.interfaces import SettingError, Value
from z2p_core.surface.subsampling import subsample_hashed
from z2p_renderer.pipeline.inference.look import Look
from z2p_renderer.pipeline.inference.prepared_render import PreparedRender, fixed_to_object
from z2p_renderer.pipeline.inference.render_scan import RenderedScan, render_prepared, render_scan
from z2p_renderer.pipeline.inference.styles import Frame, StyledCloud, ball_radii
from z2p_renderer.pipeline.inference.trim import content_box, crop_box
from z2p_renderer.pipeline.inference.weight_selection import AnyRenderer
from z2p_renderer.storage.scans.clouds import Scan

LIGHT_SWING_DEGREES = 80.0
"""Largest azimuth of the moving light, to either side."""


@dataclass(frozen=True)
class Motion:
    """What moves in a loop, and in how many frames."""

    kind: str = "turn"
    """``turn``: the object, once around, counter-clockwise from above; ``orbit``: the light turns with it, as if
    the camera went around both; ``light``: the light, right, left and back."""
    frames: int = 48
    steady: int = 1
    """Number of pictures averaged into each frame, spread evenly over the time of the frame (motion blur)."""


def draw_opening(renderer: AnyRenderer, scan: Scan, suffix: str, look: Look) -> RenderedScan:
    """A small picture of the loop's start, whose placement and weights the whole loop is drawn with.

    Raises:
        ScanError: the cloud has no extent, or has no sensor and the look asks for the sensor's view.
    """
    sketch = replace(look.untrimmed, width=64, height=64, supersample=1)
    if look.placement_options.camera is not None:
        sketch = replace(sketch, width=look.width, height=look.height, passes=())
    return render_scan(renderer, scan, suffix, sketch)


def render_frames(opening: RenderedScan, scan: Scan, look: Look, motion: Motion) -> Iterator[np.ndarray]:
    """The frames (H, W, 4) uint8, straight RGBA, of an endless loop.

    `opening` is the scan's `draw_opening` with the same look. With `look.tight` all frames are cropped to the union of
    their visible parts, so that the first is yielded after the last is drawn.

    Raises:
        SettingError: the light is to move, but the weights do not have the control 'light'; or the camera is zoomed.
    """
    renderer = opening.renderer
    if motion.kind != "turn" and "light" not in renderer.controls:
        raise SettingError("these weights do not carry the control 'light', so it cannot move")
    if opening.viewpoint.zoom:
        raise SettingError("this camera shows a part of the frame, which a loop cannot; load one without zoom and pan")
    prepared = prepare_scan(opening, scan, look)
    scale = opening.coloring.scale if opening.coloring is not None and look.color_options.color_bar else None
    look = replace(look, color_options=replace(look.color_options, color_bar=False))  # drawn after the crop
    frames = (_render_frame(prepared, look, motion, opening, number) for number in range(motion.frames))
    if look.tight:
        drawn = list(frames)
        box = content_box(np.max([frame[..., 3] for frame in drawn], axis=0), look.margin)
        frames = (crop_box(frame, box) for frame in drawn)
    if scale is None:
        yield from frames
        return
    from z2p_renderer.pipeline.legends.draw_legend import draw_onto  # late: slow to import

    yield from (draw_onto(frame, scale, look.background) for frame in frames)


def prepare_scan(
    opening: RenderedScan, scan: Scan, look: Look, most_points: int | None = None
) -> PreparedRender | StyledCloud:  # fmt: skip
    """The points that an opening has drawn, prepared once for all frames; about `most_points` of more of them."""
    cloud, floor = opening.cloud, opening.viewpoint.floor
    cloud = cloud if most_points is None else subsample_hashed(cloud, most_points)
    if floor is not None:
        floor = min(floor, float(cloud[:, 2].min()))  # no point lies below the floor
    colors = None if opening.coloring is None else opening.coloring.place(opening.viewpoint)
    if not look.style.needs_network:
        radii = ball_radii(look.style, scan, cloud, opening.viewpoint)
        frame = Frame(cloud, {}, look.width, look.height, floor, colors, radii)
        return StyledCloud(opening.renderer, look.style.name, frame)
    return PreparedRender(opening.renderer, cloud, floor, colors)


def _render_frame(
    prepared: PreparedRender | StyledCloud, look: Look, motion: Motion, opening: RenderedScan, number: int
) -> np.ndarray:
    """One frame: the mean, with premultiplied alpha, of `motion.steady` pictures around its time."""
    offsets = [(index + 0.5) / motion.steady - 0.5 for index in range(motion.steady)]
    pictures = []
    for offset in offsets:
        values, azimuth = _settings_at(opening, motion.kind, (number + offset) / motion.frames)
        pictures.append(render_prepared(prepared, values, look, azimuth))
    if len(pictures) == 1:
        return pictures[0]
    mean = np.mean([premultiplied_from_straight(unit_from_bytes(picture)) for picture in pictures], axis=0)
    return bytes_from_unit(straight_from_premultiplied(mean))


def _settings_at(opening: RenderedScan, kind: str, time: float) -> tuple[dict[str, Value], float]:
    """Values of controls, and by how many degrees the object is turned, at a time from 0 to 1, the loop's share."""
    values, turned = opening.values, 360.0 * time
    if kind == "turn":
        return values, turned
    if kind == "orbit":
        return {**values, "light": fixed_to_object(values["light"], turned)}, turned
    radius, _, height = values["light"]
    return {**values, "light": (radius, LIGHT_SWING_DEGREES * math.sin(2 * math.pi * time), height)}, 0.0
