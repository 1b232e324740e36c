"""How a scan stands in its picture: upright, seen from a telling side, without the strays that would make it small."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from z2p_core.camera import DEFAULT_ELEVATION, DISTANCE, turn
from z2p_core.interfaces import ScanError, Sensor
from z2p_core.linalg import dot_axis
from z2p_core.placement.background import foreground_mask, sensor_depths, support_plane_normal
from z2p_core.placement.depth_gaps import fill_depth_gaps
from z2p_core.placement.isolated_points import non_isolated_mask
from z2p_core.placement.outliers import above_low_outliers_mask, inlier_mask, visible_cluster_mask
from z2p_core.placement.viewpoint import Viewpoint, frame_points
from z2p_core.rotations import align_to_vertical
from z2p_core.surface.mls_smoothing import smoothing_radius, smooth_cloud
from z2p_core.surface.subsampling import prepend_canonical_point
from z2p_core.up_axis.choose import UpChoice
from z2p_renderer.pipeline.placement.few_points import FEWEST_FOR_SURFACE, as_balls
from z2p_renderer.pipeline.placement.hints import few_hint, hint_for, hint_for_placed, hint_for_settled, rounding
from z2p_renderer.pipeline.placement.placement_record import FIXED_CAMERA, Placement
from z2p_renderer.pipeline.placement.view import PlacementOptions, allowed_elevation, choose_side, set_upright
from z2p_renderer.storage.scans.clouds import FEWEST_POINTS, Scan

__all__ = ["SETTLED", "Placed", "Placing", "Shown", "Stance", "place", "shown_points"]

OUTSIDE = 1.2
"""Distance from the middle, in radii, from where on a point may lie outside a square picture."""
TOO_NEAR, MOST_NEAR = 0.7, 0.02
"""Depth before a settled camera, in its radii, that is too near for a picture; and share of points that may be so."""


@dataclass(frozen=True)
class PlacedCloud:
    """A cloud ready to be drawn."""

    cloud: np.ndarray
    """Points (N, 3) float32 in world units."""
    placement: Placement
    viewpoint: Viewpoint
    """What placed it, with the camera's elevation."""


def place_scan(
    scan: Scan,
    suffix: str,
    placement_options: PlacementOptions,
    elevation: float = DEFAULT_ELEVATION,
    free: tuple[float, float] | None = None,
) -> PlacedCloud:
    """The scan of a file with that suffix (lower-case, with its dot), placed as asked.

    `elevation` is the camera's in degrees, unless the view from a sensor brings its own: it may within the range
    `free`; None means that the camera's stays.

    Raises:
        ScanError: there is no extent to scale, or a sensor's view is asked of a cloud without one.
    """
    shown = select_points(scan, suffix, placement_options)
    points, up = shown.points, shown.up
    if placement_options.viewpoint is not None:
        return _as_settled(shown, placement_options.viewpoint, placement_options, elevation, free)
    azimuth, wished, reason = choose_side(points, up, scan, placement_options, elevation)
    wished, beyond = allowed_elevation(wished, free)
    azimuth += placement_options.azimuth
    viewpoint = frame_points(prepend_canonical_point(points), turn(azimuth) @ up.rotation, elevation if wished is None else wished)
    cloud, smooth = _smoothed(viewpoint.place(points), shown, placement_options)
    by_itself = (placement_options.up, placement_options.view) == ("auto", "auto")
    hint = few_hint(shown.few) if shown.few else hint_for(points, up, by_itself, whole=not placement_options.cut_top)
    if not placement_options.keep_outliers and not shown.few:
        hint = "; ".join(filter(None, (hint_for_placed(cloud), hint)))
    stance = Placement(up.axis, up.reason, azimuth, wished, reason + beyond, shown.outliers, 0, shown.background, hint,
                    rounding(points), smooth, shown.added, shown.far, placement_options.azimuth)  # fmt: skip
    return PlacedCloud(cloud, stance, viewpoint)


@dataclass(frozen=True)
class SelectedPoints:
    """The points that are to be drawn, and what was left out."""

    points: np.ndarray
    """(N, 3) float64 in the file's axes."""
    up: UpChoice
    outliers: int
    background: int
    added: int
    """How many of the points, the last ones, were put into gaps of what a depth camera measured."""
    far: int = 0
    """Those of the outliers that lie in clusters so far from the largest one that nothing would show."""
    few: int = 0
    """How many they were, where they were so few that each became a ball of points."""


def select_points(scan: Scan, suffix: str, placement_options: PlacementOptions) -> SelectedPoints:
    """The scan without strays, without what lies far behind a depth camera's subject, and without the top cut off.

    Raises:
        ScanError: nothing is left below the cut.
    """
    points, far = (scan.points, 0) if placement_options.keep_outliers else _without_strays(scan.points)
    up = set_upright(points, scan, suffix, placement_options)
    background, put_in = 0, points[:0]
    if up.sensor is None and not placement_options.keep_outliers:
        kept = above_low_outliers_mask(points, dot_axis(points, _upward(up, placement_options)))
        points = points[kept] if not kept.all() else points
    if up.sensor is not None:
        put_in = points[:0] if placement_options.smooth == 0 else fill_depth_gaps(points, up.sensor)
        if not placement_options.keep_outliers:
            points, background = _subject(points, up.sensor)
            put_in = put_in[sensor_depths(put_in, up.sensor) <= sensor_depths(points, up.sensor).max()]
    if up.sensor is not None and placement_options.up == "auto":
        normal = support_plane_normal(points, up.rotation[2], up.sensor)
        if normal is not None:
            up = replace(up, rotation=align_to_vertical(up.rotation, normal), axis="the table's normal",
                         reason=f"{up.reason}, set upright by the plane that things stand on")
    outliers = len(scan.points) - background - len(points)
    added = len(put_in)
    points = np.concatenate([points, put_in]) if added else points
    if placement_options.cut_top:
        height = dot_axis(points, _upward(up, placement_options))
        low = height <= height.max() - placement_options.cut_top / 100 * np.ptp(height)
        points, added = points[low], int(low[len(low) - added :].sum())
        if len(points) < FEWEST_POINTS:
            raise ScanError(f"--cut-top {placement_options.cut_top:g} leaves {len(points)} points; cut off less")
    few = len(points) if len(points) < FEWEST_FOR_SURFACE else 0
    return SelectedPoints(as_balls(points) if few else points, up, outliers, background, 0 if few else added, far, few)


def _without_strays(points: np.ndarray) -> tuple[np.ndarray, int]:
    """The points (M, 3) without strays and without what lies too far from the others, and how many of these it is."""
    kept = inlier_mask(points)
    points = points[kept] if not kept.all() else points
    near = visible_cluster_mask(points)
    far = len(near) - int(near.sum())
    if far:
        points = points[near]
        points = points[inlier_mask(points)]
    near = non_isolated_mask(points)
    return points[near] if not near.all() else points, far


def _subject(points: np.ndarray, sensor: Sensor) -> tuple[np.ndarray, int]:
    """The points (M, 3) of a depth camera's subject, without strays, and how many lie far behind it."""
    if len(points) < FEWEST_FOR_SURFACE:  # a gap between a few points says nothing
        return points, 0
    before = foreground_mask(points, sensor)
    background = int(len(before) - before.sum())
    if background:
        points = points[before]
        points = points[inlier_mask(points)]
    return points, background


def _upward(up: UpChoice, placement_options: PlacementOptions) -> np.ndarray:
    """The direction (3,) in the file's axes that points up in the picture."""
    rotation = up.rotation if placement_options.viewpoint is None else np.array(placement_options.viewpoint.rotation)
    upward: np.ndarray = rotation[2]
    return upward


def _as_settled(
    shown: SelectedPoints, viewpoint: Viewpoint, placement_options: PlacementOptions, elevation: float, free: tuple[float, float] | None
) -> PlacedCloud:
    """The points before a camera that was settled before, turned on as asked."""
    wished, beyond = allowed_elevation(viewpoint.elevation, free)
    azimuth = placement_options.azimuth
    rotation = turn(azimuth) @ np.array(viewpoint.rotation) if azimuth else np.array(viewpoint.rotation)
    viewpoint = replace(viewpoint, rotation=tuple(tuple(row) for row in rotation.tolist()),
                        elevation=elevation if wished is None else wished)
    cloud = viewpoint.place(shown.points)
    if placement_options.grounded and viewpoint.floor is not None:
        drop = (float(cloud[:, 2].min()) - viewpoint.floor) * viewpoint.radius
        x, y, z = (np.array(viewpoint.centre) + drop * rotation[2]).tolist()
        viewpoint = replace(viewpoint, centre=(x, y, z))
        cloud = viewpoint.place(shown.points)
    outside = int(((cloud**2).sum(1) > OUTSIDE**2).sum())
    if outside == len(cloud):
        raise ScanError("lies beyond the camera's frame as a whole; the camera was made for other data or other units")
    _check_before(cloud, viewpoint)
    hint = hint_for_settled(cloud, viewpoint)
    if beyond:
        hint = "; ".join(filter(None, (f"the camera's elevation was changed{beyond}", hint)))
    cloud, smooth = _smoothed(cloud, shown, placement_options)
    stance = Placement(FIXED_CAMERA, "the camera's", azimuth, wished, f"seen from the given camera{beyond}", shown.outliers,
                    outside, shown.background, hint, rounding(shown.points), smooth, shown.added,
                    shown.far)  # fmt: skip
    return PlacedCloud(cloud, stance, viewpoint)


def _check_before(cloud: np.ndarray, viewpoint: Viewpoint) -> None:
    """
    Raises:
        ScanError: the placed cloud (N, 3) reaches the place where the camera stands, or beyond.
    """
    angle = math.radians(viewpoint.elevation)
    depth = DISTANCE - dot_axis(cloud.astype(np.float64), np.array([0.0, -math.cos(angle), math.sin(angle)]))
    if (depth < TOO_NEAR).mean() > MOST_NEAR:
        reach = float(np.sqrt((cloud**2).sum(1)).max())
        raise ScanError(f"reaches the camera or lies behind it: its farthest point lies {reach:.3g} radii from the "
                        f"camera's centre; make the camera's radius ({viewpoint.radius:g}) larger, or move the centre")


def _smoothed(cloud: np.ndarray, shown: SelectedPoints, placement_options: PlacementOptions) -> tuple[np.ndarray, float]:
    """The placed cloud (N, 3), made as smooth as asked, and over which radius; 0 where it was left as it is."""
    radius = placement_options.smooth
    if not isinstance(radius, float):
        measured = cloud[: len(cloud) - shown.added]
        radius = 0.0 if shown.up.sensor is None else smoothing_radius(measured)
    return (smooth_cloud(cloud, radius), radius) if radius else (cloud, 0.0)
