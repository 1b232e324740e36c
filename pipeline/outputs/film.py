"""Films of a series of clouds: a training run, a diffusion process, a moving scan; the camera may turn meanwhile.

All that could jump from frame to frame is chosen once, for the whole film: up axis, view, scale and floor (as with
``--same-frame``), the weights by the noise of the clouds, the smoothing, the resolution of the network, and the scale
of colors.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from z2p_core.camera import turn
from z2p_core.images import (
    bytes_from_unit,
    premultiplied_from_straight,
    straight_from_premultiplied,
    unit_from_bytes,
)
from z2p_core.interfaces import ScanError
from z2p_core.placement.margin import with_margin
from z2p_core.placement.viewpoint import Viewpoint
from z2p_core.surface.mls_smoothing import smooth_cloud
from z2p_core.surface.noise_level import noise_to_spacing
from z2p_renderer.pipeline.batch.common_view import common_viewpoint_of
from z2p_renderer.pipeline.inference.adaptive_resolution import reduction_factor
from z2p_renderer.pipeline.inference.look import Look
from z2p_renderer.pipeline.inference.render_scan import (
    RenderedScan,
    camera_elevation,
    render_scan,
    with_common_scale,
)
from z2p_renderer.pipeline.inference.renderer import Renderer
from z2p_renderer.pipeline.inference.trim import content_box, crop_box
from z2p_renderer.pipeline.inference.weight_selection import AnyRenderer, select_renderer
from z2p_renderer.pipeline.outputs.series import CloudSeries, between, have_matching_points
from z2p_renderer.pipeline.placement.options import PlacementOptions
from z2p_renderer.pipeline.placement.place_scan import PlacedCloud, place_scan, select_points
from z2p_renderer.storage.scans.clouds import Scan

BLENDS = ("auto", "points", "pictures")
"""How a film goes from one cloud to the next: points move where they match, else pictures fade; or one of the two."""
MAX_PROBED_CLOUDS = 9
"""Clouds, evenly spread over the series, by whose median the weights and the network's resolution are chosen."""


@dataclass(frozen=True)
class FilmPlan:
    """How a series becomes frames."""

    hold: int = 1
    """Number of frames that show each cloud itself."""
    blend: int = 0
    """Number of frames between one cloud and the next."""
    blend_by: str = "auto"
    """One of `BLENDS`."""
    turns: float = 0.0
    """How often the camera goes around during the film."""
    closes: bool = False
    """Whether the last cloud is blended into the first again, so that the loop has no cut."""
    reference: int = 0
    """Index of the cloud by which up axis and view are chosen; -1 for the last one."""
    frames_reference: bool = False
    """Whether the reference fills the frame, rather than all clouds fit; others may reach beyond it, and each stands on
    its own lowest point."""

    def moments(self, clouds: int) -> list[tuple[int, float]]:
        """Of each frame, the index of the newest cloud, and the share from 0 to 1 of the way to the next."""
        moments = []
        for index in range(clouds):
            moments += [(index, 0.0)] * self.hold
            if self.blend and clouds > 1 and (self.closes or index < clouds - 1):
                moments += [(index, step / (self.blend + 1)) for step in range(1, self.blend + 1)]
        return moments


@dataclass(frozen=True)
class Film:
    """A series with all that was chosen for the whole of it."""

    series: CloudSeries
    plan: FilmPlan
    look: Look
    renderer: Renderer
    options: PlacementOptions
    """How each cloud's points are selected: before the common camera."""
    viewpoint: Viewpoint
    """The common camera, with the margin."""
    smoothing: float
    """Radius of the smoothing in the data's units; 0 for none."""
    opening: RenderedScan
    """A small picture of the reference, for the record."""
    description: str
    """What was chosen, and why, in words."""
    notes: tuple[str, ...] = ()
    """What to warn of."""

    @property
    def frame_count(self) -> int:
        """Number of frames."""
        return len(self.plan.moments(len(self.series)))

    def frames(self) -> Iterator[np.ndarray]:
        """The frames (H, W, 4) uint8, straight RGBA; with `look.tight` the first comes after the last is drawn."""
        color_options = replace(self.look.color_options, color_bar=False)  # drawn after the crop
        frames: Iterator[np.ndarray] = _FrameDrawer(self, replace(self.look, color_options=color_options)).frames()
        if self.look.tight:
            drawn = list(frames)
            box = content_box(np.max([frame[..., 3] for frame in drawn], axis=0), self.look.margin)
            frames = (crop_box(frame, box) for frame in drawn)
        scale = None if self.opening.coloring is None else self.opening.coloring.scale
        if scale is None or not self.look.color_options.color_bar:
            return frames
        from z2p_renderer.pipeline.legends.draw_legend import draw_onto  # late: slow to import

        return (draw_onto(frame, scale, self.look.background) for frame in frames)


def plan_film(series: CloudSeries, renderer: AnyRenderer, look: Look, plan: FilmPlan) -> Film:
    """The film of a series; every cloud is read and placed once for it.

    Raises:
        ScanError: no cloud can be read, or the reference has no extent.
    """
    elevation = camera_elevation(renderer, look.values)
    if not -len(series) <= plan.reference < len(series):
        raise ScanError(f"expected a reference from 1 to {len(series)}, the number of clouds, got {plan.reference + 1}")
    reference = place_scan(*series.scan(plan.reference % len(series)), look.placement_options, *elevation)
    options, notes, description = look.placement_options, [], "seen from the given camera"
    if options.viewpoint is None and plan.frames_reference:
        options = replace(options, viewpoint=reference.viewpoint)
        description = f"the frame of cloud {plan.reference % len(series) + 1}: {reference.placement.view_description}"
    elif options.viewpoint is None:
        common = common_viewpoint_of(series.readable_groups(), options, *elevation, reference)
        options = replace(options, viewpoint=common.viewpoint, grounded=common.grounded)
        notes, description = common.notes, common.description
    else:  # turned by the user's azimuth, and of an elevation that the weights know
        options = replace(options, viewpoint=reference.viewpoint)
    options = replace(options, azimuth=0.0, smooth=_kept_smoothing(reference, options.smooth))
    smoothing = reference.placement.smoothing_radius * reference.viewpoint.radius
    selected, reason, look = _choose_for_all(series, renderer, replace(look, placement_options=options))
    look, _ = with_common_scale(selected, series.scans(), look)
    assert options.viewpoint is not None
    viewpoint = with_margin(options.viewpoint, look.frame_margin)
    opening = render_scan(selected, *series.scan(plan.reference % len(series)),
                          replace(look.untrimmed, width=64, height=64, supersample=1, reduction=None))  # fmt: skip
    words = "; ".join(filter(None, (description, reason)))
    return Film(series, plan, look, selected, options, viewpoint, smoothing, opening, words, tuple(notes))


def _kept_smoothing(reference: PlacedCloud, wish: str | float) -> str | float:
    """The smoothing that selects points: none closes no gaps of depth cameras, as in the reference."""
    return wish if reference.placement.filled_count or reference.placement.smoothing_radius else 0.0


def _choose_for_all(series: CloudSeries, renderer: AnyRenderer, look: Look) -> tuple[Renderer, str, Look]:
    """The weights by the median noise of some clouds, the reason, and the look with the network's resolution."""
    step = max(1, -(-len(series) // MAX_PROBED_CLOUDS))
    elevation = camera_elevation(renderer, look.values)
    probes = []
    for index in range(0, len(series), step):
        try:
            probes.append(place_scan(*series.scan(index), look.placement_options, *elevation).cloud)
        except ScanError:  # it is outside the frame, say: drawing it reports that
            continue
    if not probes:
        raise ScanError("none of the clouds lies in the frame; the camera was made for other data or other units")
    by_noise = sorted(probes, key=noise_to_spacing)
    selected, reason = select_renderer(renderer, by_noise[(len(by_noise) - 1) // 2])
    sides = look.width * look.supersample, look.height * look.supersample
    factors = sorted(reduction_factor(cloud, *sides) for cloud in probes)
    return selected, reason, replace(look, reduction=factors[len(factors) // 2])


class _FrameDrawer:
    """Draws the frames one after another; keeps what the next ones need again."""

    def __init__(self, film: Film, look: Look) -> None:
        self._film = film
        fixed = PlacementOptions(
            "+Z", "front", keep_outliers=True, smooth=0.0, grounded=film.options.grounded,
            points_alone=film.options.points_alone,
        )  # fmt: skip
        # no margin: the viewpoint includes it
        self._look = replace(look, placement_options=fixed, tight=False, margin=None)
        self._prepared: dict[tuple[int, float], Scan] = {}
        self._drawn: dict[tuple[int, float, float], np.ndarray] = {}
        self._matches: dict[int, bool] = {}

    def frames(self) -> Iterator[np.ndarray]:
        plan, count = self._film.plan, len(self._film.series)
        moments = plan.moments(count)
        for number, (index, share) in enumerate(moments):
            angle = (360.0 * plan.turns * number / len(moments)) % 360.0
            following = (index + 1) % count
            if share == 0 or self._moves(index, following):
                yield self._draw(index, share, angle)
            else:
                yield _faded(self._draw(index, 0.0, angle), self._draw(following, 0.0, angle), share)

    def _moves(self, index: int, following: int) -> bool:
        """Whether points move from one cloud to the next, rather than pictures fade."""
        if self._film.plan.blend_by == "pictures":
            return False
        if index not in self._matches:
            one, other = (self._film.series.scan(number)[0] for number in (index, following))
            matches = have_matching_points(one, other)
            if self._film.plan.blend_by == "points" and len(one.points) != len(other.points):
                raise ScanError(
                    f"--blend-by points: clouds {index + 1} and {following + 1} have {len(one.points)} and "
                    f"{len(other.points)} points, so that none can move to its place in the other; take "
                    "--blend-by pictures, or auto"
                )
            self._matches[index] = matches or self._film.plan.blend_by == "points"
        return self._matches[index]

    def _draw(self, index: int, share: float, angle: float) -> np.ndarray:
        key = (index, share, angle)
        if key not in self._drawn:
            film = self._film
            rotation = turn(angle) @ np.array(film.viewpoint.rotation)
            viewpoint = replace(film.viewpoint, rotation=tuple(tuple(row) for row in rotation.tolist()))
            options = replace(self._look.placement_options, viewpoint=viewpoint)
            look = replace(self._look, placement_options=options)
            picture = render_scan(film.renderer, self._scan(index, share), "", look).picture
            self._drawn = {**dict([*self._drawn.items()][-1:]), key: picture}  # two at most: of a fade
        return self._drawn[key]

    def _scan(self, index: int, share: float) -> Scan:
        """The cloud at a moment with the points that are drawn, selected and smoothed before the common camera."""
        if (index, share) not in self._prepared:
            film = self._film
            scan, suffix = film.series.scan(index)
            if share > 0:
                scan = between(scan, film.series.scan((index + 1) % len(film.series))[0], share)
            points = select_points(scan, suffix, film.options).points
            if film.smoothing:
                assert film.options.viewpoint is not None
                base = film.options.viewpoint
                points = base.unplace(smooth_cloud(base.place(points), film.smoothing / base.radius))
            prepared = replace(scan, points=points, sensor=None)
            self._prepared = {**dict([*self._prepared.items()][-1:]), (index, share): prepared}
        return self._prepared[index, share]


def _faded(first: np.ndarray, second: np.ndarray, share: float) -> np.ndarray:
    """The mean, with premultiplied alpha, of two pictures (H, W, 4) uint8, by shares `1 - share` and `share`."""
    one, other = (premultiplied_from_straight(unit_from_bytes(picture)) for picture in (first, second))
    return bytes_from_unit(straight_from_premultiplied((1 - share) * one + share * other))


def film_record(record: dict[str, Any], film: Film, fps: float) -> dict[str, Any]:
    """The record of the opening, with the film's plan and the number of clouds."""
    plan = film.plan
    motion = {"kind": "series", "hold": plan.hold, "blend": plan.blend, "blend_by": plan.blend_by,
              "turns": plan.turns, "closes": plan.closes, "frames": film.frame_count, "fps": fps}  # fmt: skip
    return {**record, "batch": len(film.series), "motion": motion}
