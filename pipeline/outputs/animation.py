"""Moving pictures: an object that turns before the camera, or a light that goes from side to side and back."""

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
from z2p_core.surface.mls_smoothing import smoothed
from z2p_renderer.pipeline.inference.look import Look
from z2p_renderer.pipeline.inference.render_scan import RenderedScan, render_scan
from z2p_renderer.pipeline.inference.trim import content_box, crop_box
from z2p_renderer.pipeline.inference.weight_selection import AnyRenderer
from z2p_renderer.pipeline.placement.place_scan import PlacementOptions, select_points
from z2p_renderer.storage.scans.clouds import Scan

LIGHT_SWING_DEGREES = 80.0
"""Degrees to either side that the light goes."""


@dataclass(frozen=True)
class Motion:
    """What moves, and how finely."""

    kind: str = "turn"
    """``turn``: once around, counter-clockwise from above; ``light``: the light to the right, to the left and back."""
    frames: int = 48
    steady: int = 1
    """Pictures that each frame is the mean of, spread over its share of the way."""


def draw_opening(renderer: AnyRenderer, scan: Scan, suffix: str, look: Look) -> RenderedScan:
    """How the cloud of a file with that suffix stands as a loop begins, and which weights draw all of it: a sketch.

    Raises:
        ScanError: the cloud has no extent, or no sensor though its view is asked for.
    """
    sketch = replace(look.untrimmed, width=64, height=64, supersample=1)
    return render_scan(renderer, scan, suffix, sketch)


def render_frames(first: RenderedScan, scan: Scan, suffix: str, look: Look, motion: Motion) -> Iterator[np.ndarray]:
    """The frames (H, W, 4) uint8, straight RGBA, of a loop: the last goes over into the first.

    `first` is the scan's `draw_opening` by the same look. With `look.tight` all frames are cut alike, to what shows in any
    of them; they then come after the last was drawn.

    Raises:
        SettingError: the light is to move, but the weights carry no such control.
    """
    renderer = first.renderer
    if motion.kind == "light" and "light" not in renderer.controls:
        raise SettingError("these weights do not carry the control 'light', so it cannot move")
    points = select_points(scan, suffix, look.placement_options).points  # chosen and made smooth once, not for every frame
    if first.placement.smoothing_radius:
        base = without_margin(first.viewpoint, look.frame_margin)  # radii are in the frame's
        points = base.unplace(smoothed(base.place(points), first.placement.smoothing_radius))
    scan = replace(scan, points=points)
    look = replace(look, placement_options=PlacementOptions("+Z", "front", keep_outliers=True, smooth=0.0))
    shots = (_render_frame(renderer, scan, suffix, look, motion, first, number) for number in range(motion.frames))
    if not look.tight:
        yield from shots
        return
    drawn = list(shots)
    box = content_box(np.max([frame[..., 3] for frame in drawn], axis=0), look.margin)
    yield from (crop_box(frame, box) for frame in drawn)


def _render_frame(
    renderer: AnyRenderer, scan: Scan, suffix: str, look: Look, motion: Motion, first: RenderedScan, number: int
) -> np.ndarray:
    """One frame: the mean of `motion.steady` pictures around its place on the way."""
    offsets = [(part + 0.5) / motion.steady - 0.5 for part in range(motion.steady)]
    shots = []
    for offset in offsets:
        share = (number + offset) / motion.frames
        values, viewpoint = _settings_at(look.values, first, motion.kind, share)
        placing = replace(look.placement_options, viewpoint=viewpoint, azimuth=0.0)
        shown = replace(look, values=values, placement_options=placing, tight=False, margin=None)  # the viewpoint has it
        shots.append(render_scan(renderer, scan, suffix, shown).picture)
    if len(shots) == 1:
        return shots[0]
    mean = np.mean([premultiplied_from_straight(unit_from_bytes(shot)) for shot in shots], axis=0)
    return bytes_from_unit(straight_from_premultiplied(mean))


def _settings_at(
    given: dict[str, Value], first: RenderedScan, kind: str, share: float
) -> tuple[dict[str, Value], Viewpoint]:
    """Settings and viewpoint at a share of the way, 0 to 1."""
    if kind == "turn":
        rotation = turn(360.0 * share) @ np.array(first.viewpoint.rotation)
        return given, replace(first.viewpoint, rotation=tuple(tuple(row) for row in rotation.tolist()))
    radius, _, height = first.values["light"]
    return {**given, "light": (radius, LIGHT_SWING_DEGREES * math.sin(2 * math.pi * share), height)}, first.viewpoint
