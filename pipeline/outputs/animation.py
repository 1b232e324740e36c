"""Loops: an object that turns in front of the camera, or a light that moves from side to side and back."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from z2p_core.camera import turn
from z2p_core.images import (
    bytes_from_unit,
    premultiplied_from_straight,
    straight_from_premultiplied,
    unit_from_bytes,
)
from z2p_core.interfaces import SettingError, Value
from z2p_core.placement.margin import without_margin
from z2p_core.placement.viewpoint import Viewpoint
from z2p_core.surface.mls_smoothing import smooth_cloud
from z2p_renderer.pipeline.inference.look import Look
from z2p_renderer.pipeline.inference.render_scan import RenderedScan, render_scan
from z2p_renderer.pipeline.inference.trim import content_box, crop_box
from z2p_renderer.pipeline.inference.weight_selection import AnyRenderer
from z2p_renderer.pipeline.placement.options import PlacementOptions
from z2p_renderer.pipeline.placement.place_scan import select_points
from z2p_renderer.storage.scans.clouds import Scan

LIGHT_SWING_DEGREES = 80.0
"""Largest azimuth of the moving light, to either side."""


@dataclass(frozen=True)
class Motion:
    """What moves in a loop, and in how many frames."""

    kind: str = "turn"
    """``turn``: the object, once around, counter-clockwise from above; ``light``: the light, right, left and back."""
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


def render_frames(opening: RenderedScan, scan: Scan, suffix: str, look: Look, motion: Motion) -> Iterator[np.ndarray]:
    """The frames (H, W, 4) uint8, straight RGBA, of an endless loop.

    `opening` is the scan's `draw_opening` with the same look. With `look.tight` all frames are cropped to the union of
    their visible parts, so that the first is yielded after the last is drawn.

    Raises:
        SettingError: the light is to move, but the weights do not have the control 'light'.
    """
    renderer = opening.renderer
    if motion.kind == "light" and "light" not in renderer.controls:
        raise SettingError("these weights do not carry the control 'light', so it cannot move")
    points = select_points(scan, suffix, look.placement_options).points  # selected and smoothed once for all frames
    if opening.placement.smoothing_radius:
        base = without_margin(opening.viewpoint, look.frame_margin)  # whose radius the smoothing radius is relative to
        points = base.unplace(smooth_cloud(base.place(points), opening.placement.smoothing_radius))
    scan = replace(scan, points=points)
    look = replace(look, placement_options=PlacementOptions("+Z", "front", keep_outliers=True, smooth=0.0))
    scale = opening.coloring.scale if opening.coloring is not None and look.color_options.color_bar else None
    look = replace(look, color_options=replace(look.color_options, color_bar=False))  # drawn after the crop
    frames = (_render_frame(renderer, scan, suffix, look, motion, opening, number) for number in range(motion.frames))
    if look.tight:
        drawn = list(frames)
        box = content_box(np.max([frame[..., 3] for frame in drawn], axis=0), look.margin)
        frames = (crop_box(frame, box) for frame in drawn)
    if scale is None:
        yield from frames
        return
    from z2p_renderer.pipeline.legends.draw_legend import draw_onto  # late: slow to import

    yield from (draw_onto(frame, scale, look.background) for frame in frames)


def _render_frame(
    renderer: AnyRenderer, scan: Scan, suffix: str, look: Look, motion: Motion, opening: RenderedScan, number: int
) -> np.ndarray:
    """One frame: the mean, with premultiplied alpha, of `motion.steady` pictures around its time."""
    offsets = [(index + 0.5) / motion.steady - 0.5 for index in range(motion.steady)]
    pictures = []
    for offset in offsets:
        time = (number + offset) / motion.frames
        values, viewpoint = _settings_at(look.values, opening, motion.kind, time)
        placement_options = replace(look.placement_options, viewpoint=viewpoint, azimuth=0.0)
        # no margin: the opening's viewpoint includes it
        shown = replace(look, values=values, placement_options=placement_options, tight=False, margin=None)
        pictures.append(render_scan(renderer, scan, suffix, shown).picture)
    if len(pictures) == 1:
        return pictures[0]
    mean = np.mean([premultiplied_from_straight(unit_from_bytes(picture)) for picture in pictures], axis=0)
    return bytes_from_unit(straight_from_premultiplied(mean))


def _settings_at(
    controls: dict[str, Value], opening: RenderedScan, kind: str, time: float
) -> tuple[dict[str, Value], Viewpoint]:
    """Control settings and viewpoint at a time from 0 to 1, the share of the loop that has passed."""
    if kind == "turn":
        rotation = turn(360.0 * time) @ np.array(opening.viewpoint.rotation)
        return controls, replace(opening.viewpoint, rotation=tuple(tuple(row) for row in rotation.tolist()))
    radius, _, height = opening.values["light"]
    azimuth = LIGHT_SWING_DEGREES * math.sin(2 * math.pi * time)
    return {**controls, "light": (radius, azimuth, height)}, opening.viewpoint
