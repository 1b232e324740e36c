"""The styles in which a placed cloud is drawn: a table of functions, one for each name of `z2p_core.style`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from z2p_core import registry
from z2p_core.camera import Camera, turn
from z2p_core.camera_placement.placed_camera import PlacedCamera
from z2p_core.images import bytes_from_unit, srgb_from_linear, straight_from_premultiplied
from z2p_core.interfaces import PointColors, ScanError, SettingError, Value
from z2p_core.native import NeighborGrid, to_straight_rgba8
from z2p_core.placement.viewpoint import Viewpoint
from z2p_core.scene import SceneDescription
from z2p_core.settings import apply_controls
from z2p_core.shading.channels import RADIANCE_RGB, GBufferChannel
from z2p_core.shading.demodulation import apply_relative_radiance, reduce_light
from z2p_core.shading.light_transport import base_color
from z2p_core.shading.textured_light import neutral_albedo
from z2p_core.style import BALLS, DISCS, SURFACE, Style
from z2p_renderer.pipeline.coloring.fields import find_scalars
from z2p_renderer.pipeline.inference.renderer import Renderer
from z2p_renderer.storage.scans.clouds import Scan

if TYPE_CHECKING:
    from z2p_renderer.pipeline.inference.weight_selection import AnyRenderer

RADIUS_PER_SPACING = 0.5
"""Radius of balls over the median spacing of points, unless the user says: neighbors about touch."""
MAX_UNASKED_RADIUS = 0.2
"""Largest radius that is chosen for balls, in radii of the frame: all of the outermost ones shows."""
MAX_SPACING_POINTS = 20_000
"""Points at which the spacing is measured, at most."""
SPACING_NEIGHBORS = 13
"""Neighbors that are searched for it, the point itself included."""
LARGEST_RADIUS = 1.0
"""Largest radius of a ball, in radii of the frame; larger ones are a mistake of units."""
DISC_GBUFFER = "surfels"
"""Name of the G-buffer whose rough rendering the style of discs shows."""


@dataclass(frozen=True)
class Frame:
    """What is drawn, placed before the camera."""

    cloud: np.ndarray
    """(N, 3) float32, world units."""
    values: Mapping[str, Value]
    """Control name -> value; defaults for those that are missing."""
    width: int
    height: int
    floor: float | None
    """Height of the floor in world units; None: under what is lowest."""
    colors: PointColors | None
    radii: np.ndarray | None
    """(N,) float32 of balls, world units; None where the style has none."""
    reduction: int | None = None
    """As for `Renderer.render`."""
    camera: PlacedCamera | None = None
    """A camera of the user's; None for the usual one."""


def draw_surface(renderer: Renderer, frame: Frame) -> np.ndarray:
    """The surface that the weights see in the points."""
    if frame.camera is not None:
        return renderer.render_from(frame.cloud, frame.camera, dict(frame.values), frame.floor, frame.colors)
    return renderer.render(
        frame.cloud, dict(frame.values), frame.width, frame.height, frame.floor, frame.colors, frame.reduction
    )


def draw_balls(renderer: Renderer, frame: Frame) -> np.ndarray:
    """A lit diffuse ball at each point; no network is run."""
    from z2p_core.shading.balls import Balls
    from z2p_core.shading.balls import draw_balls as draw

    assert frame.radii is not None
    scene, floor = scene_of(renderer, frame), frame.floor
    if floor is not None:
        scene.floor = min(floor, float((frame.cloud[:, 2] - frame.radii).min()))
    albedo, relight = _albedo(frame, scene)
    balls = Balls(frame.cloud, frame.radii, albedo, relight)
    image = np.moveaxis(draw(balls, _camera(frame, scene), scene), 0, -1)
    straight = straight_from_premultiplied(image)
    straight[..., :3] = srgb_from_linear(straight[..., :3])
    return bytes_from_unit(straight)


def draw_discs(renderer: Renderer, frame: Frame) -> np.ndarray:
    """The surfels under the scene's light: what the network of other styles starts from."""
    scene = scene_of(renderer, frame)
    camera = _camera(frame, scene)
    gbuffer = registry.load("gbuffers", DISC_GBUFFER)()
    features, relative, neutral = np.empty((gbuffer.channels, camera.height, camera.width), np.float32), None, None
    if frame.colors is None:
        gbuffer.draw_into(features, frame.cloud, camera, scene)
    else:
        neutral = neutral_albedo(frame.colors.albedo)
        scene.material["Base Color"] = (*neutral.tolist(), 1.0)
        relative = gbuffer.draw_textured_into(features, frame.cloud, frame.colors, camera, scene)
    coverage, shadow = features[GBufferChannel.COVERAGE], features[GBufferChannel.SHADOW]
    image = np.empty((4, camera.height, camera.width), np.float32)
    image[:3] = features[RADIANCE_RGB] * coverage
    image[3] = coverage + (1 - coverage) * shadow
    if frame.colors is not None and relative is not None and neutral is not None:
        if frame.colors.relight < 1:
            reduce_light(image, neutral, relative[3], frame.colors.relight)
        apply_relative_radiance(image, relative[:3], relative[3])
    return to_straight_rgba8(image)


DRAW: dict[str, Callable[[Renderer, Frame], np.ndarray]] = {
    SURFACE: draw_surface, BALLS: draw_balls, DISCS: draw_discs
}  # fmt: skip
"""Style -> function that draws a frame (H, W, 4) uint8, straight sRGB RGBA, with a renderer's controls."""


def check_style(style: Style, renderer: AnyRenderer, given: Mapping[str, Value]) -> None:
    """Refuses controls that a style has no use for.

    Raises:
        SettingError: one of the `given` controls is one.
    """
    unused = unused_controls(style, renderer, given)
    if unused:
        raise SettingError(
            f"--{unused[0]}: the style {style.name} is matt, so it has no {unused[0]}; leave it out, or "
            f"use the style {SURFACE}"
        )


def unused_controls(style: Style, renderer: AnyRenderer, given: Mapping[str, Value]) -> list[str]:
    """Names of the given controls that change more of the material than its color, which only the surface shows."""
    if style.needs_network:
        return []
    unused = []
    for name, value in given.items():
        scene = SceneDescription()
        apply_controls({name: value}, {name: renderer.controls[name]}, scene)
        if set(scene.material) - {"Base Color"}:
            unused.append(name)
    return unused


def ball_radii(style: Style, scan: Scan, cloud: np.ndarray, viewpoint: Viewpoint) -> np.ndarray | None:
    """Radii (N,) float32 in world units of the balls of a placed cloud (N, 3); None for other styles.

    Raises:
        ScanError: the scan has no such field, or its values are no radii.
        SettingError: the radius is larger than the frame.
    """
    if style.name != BALLS:
        return None
    if style.radius_field is not None:
        return _radii_of_field(style.radius_field, scan, cloud, viewpoint)
    if style.radius is not None:
        radius = style.radius / viewpoint.radius
    else:
        radius = style.radius_share or min(RADIUS_PER_SPACING * median_spacing(cloud), MAX_UNASKED_RADIUS)
    if radius > LARGEST_RADIUS:
        raise SettingError(
            f"the radius {style.radius_text} is larger than the whole object, whose bounding sphere has "
            f"radius {viewpoint.radius:.4g}; radii are in the data's units, or in percent of that one"
        )
    return np.full(len(cloud), radius, np.float32)


def median_spacing(cloud: np.ndarray) -> float:
    """Median distance between neighboring points of a cloud (N, 3), as if they lay on a square grid; world units."""
    if len(cloud) < 2:
        return LARGEST_RADIUS
    grid = NeighborGrid(cloud)
    step = -(-len(cloud) // MAX_SPACING_POINTS)
    _, spacing = grid.neighbors(np.arange(0, len(cloud), step), SPACING_NEIGHBORS)
    return float(min(np.median(spacing), LARGEST_RADIUS))


def scene_of(renderer: Renderer, frame: Frame) -> SceneDescription:
    """The scene that the renderer's controls describe with a frame's values."""
    scene = SceneDescription(floor=frame.floor)
    if renderer.fixed_elevation is not None:
        scene.elevation = renderer.fixed_elevation
    apply_controls(renderer.settings(dict(frame.values)), renderer.controls, scene)
    return scene


def _camera(frame: Frame, scene: SceneDescription) -> Camera:
    """The camera that a frame is seen by."""
    return frame.camera or Camera(frame.width, frame.height, scene.elevation)


def _albedo(frame: Frame, scene: SceneDescription) -> tuple[np.ndarray, float]:
    """Linear colors (N, 3) of a frame's points, and how much of the light falls on them."""
    if frame.colors is None:
        return np.tile(base_color(scene), (len(frame.cloud), 1)), 1.0
    return frame.colors.albedo[nearest_of(frame.colors.points, frame.cloud)], frame.colors.relight


def nearest_of(points: np.ndarray, positions: np.ndarray) -> np.ndarray:
    """Index (M,) of the point of (N, 3) that is nearest to each position (M, 3)."""
    if len(points) == len(positions) and np.array_equal(points, positions):
        return np.arange(len(points))
    grid = NeighborGrid(points)  # whose points have an order of their own
    in_given_order = np.lexsort(points.astype(np.float32).T)
    in_grid_order = np.lexsort(grid.points.T)
    given = np.empty(len(points), np.intp)
    given[in_grid_order] = in_given_order
    return given[grid.nearest_to_positions(positions)]


def _radii_of_field(name: str, scan: Scan, cloud: np.ndarray, viewpoint: Viewpoint) -> np.ndarray:
    """Radii (N,) of a placed cloud from the values of a field.

    Raises:
        ScanError: there is no such field, or a value is no radius.
    """
    field = find_scalars(scan, name, "take the radius from")
    radii = (field.values.astype(np.float64) / viewpoint.radius).astype(np.float32)
    usable = (radii > 0) & (radii <= LARGEST_RADIUS)
    if not usable.all():
        worst = field.values[~usable][0]
        raise ScanError(
            f"the field {field.name!r} is to hold radii above 0 and up to {viewpoint.radius:.4g}, the "
            f"radius of the whole object, in the data's units; got {worst:g} among {len(radii)} values"
        )
    return radii[nearest_of(viewpoint.place(field.points), cloud)]


@dataclass(frozen=True)
class StyledCloud:
    """A placed cloud in a style that needs no network, drawn anew for each frame."""

    renderer: Renderer
    style: str
    frame: Frame

    def render(self, values: dict[str, Value], width: int, height: int, azimuth: float) -> np.ndarray:
        """As `PreparedRender.render`."""
        rotation, frame = turn(azimuth).astype(np.float32).T, self.frame
        colors = frame.colors and replace(frame.colors, points=frame.colors.points @ rotation)
        turned = replace(
            frame, cloud=frame.cloud @ rotation, values=values, width=width, height=height, colors=colors
        )  # fmt: skip
        return DRAW[self.style](self.renderer, turned)
