"""Places a scan before the camera: the points to draw, the up axis, the view, and the frame.

`place_scan` does all steps; `select_points` the first four, which leave the points in the file's coordinates:

1. remove outliers;
2. choose the up axis, and find the depth camera that took the scan, if any;
3. with a depth camera: fill gaps in depth, remove the background, level the support plane; else remove low outliers;
4. cut the top off, if the user wants it;
5. choose the view, frame the bounding sphere into the unit sphere (or use the fixed camera), smooth;
6. describe what was done.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from z2p_core.camera import DEFAULT_ELEVATION, DISTANCE, turn
from z2p_core.camera_placement.placed_camera import PlacedCamera, place_camera
from z2p_core.interfaces import ScanError
from z2p_core.linalg import dot_axis
from z2p_core.pinhole import LookAt, PinholeCamera
from z2p_core.placement.background import remove_background, sensor_depths
from z2p_core.placement.depth_gaps import fill_depth_gaps
from z2p_core.placement.outliers import above_low_outliers_mask, remove_outliers
from z2p_core.placement.point_balls import MIN_SURFACE_POINTS, points_to_balls
from z2p_core.placement.support_plane import support_plane_normal
from z2p_core.placement.viewpoint import Viewpoint, frame_points
from z2p_core.rotations import align_to_vertical
from z2p_core.surface.mls_smoothing import smooth_cloud, smoothing_radius
from z2p_core.surface.subsampling import prepend_canonical_point
from z2p_core.up_axis.choose import UpChoice
from z2p_renderer.pipeline.placement.camera_placement import camera_viewpoint, check_visible, unfamiliar_reason
from z2p_renderer.pipeline.placement.hints import (
    MIN_POINTS_FOR_SHAPE,
    few_points_hint,
    fixed_camera_hint,
    float32_step,
    scan_hint,
    small_part_hint,
)
from z2p_renderer.pipeline.placement.options import PlacementOptions
from z2p_renderer.pipeline.placement.orientation import choose_side, choose_upright, clamp_elevation
from z2p_renderer.pipeline.placement.placement_record import FIXED_CAMERA, Placement
from z2p_renderer.storage.scans.clouds import MIN_POINTS, Scan

MIN_OUTSIDE_RADII = 1.2
"""Distance from the frame's center, in its radius, beyond which a point counts as outside the frame."""
MIN_CAMERA_DEPTH = 0.7
"""Depth before a fixed camera, in the frame's radius, below which a point is too near for a picture."""
MAX_NEAR_SHARE = 0.02
"""Largest share of the points that may be too near."""


@dataclass(frozen=True)
class PlacedCloud:
    """A cloud ready to be drawn."""

    cloud: np.ndarray
    """Points (N, 3) float32 in world units."""
    placement: Placement
    viewpoint: Viewpoint
    """The transform that placed it, with the camera's elevation."""
    camera: PlacedCamera | None = None
    """A camera of the user's, in world units; None: the usual one at that elevation."""
    pinhole: PinholeCamera | None = None
    """The same in the data's units."""
    unfamiliar: str = ""
    """Why the network cannot draw what that camera sees, in words; empty if it can."""


@dataclass(frozen=True)
class SelectedPoints:
    """The points that are drawn, in the file's coordinates, and how many were left out or added."""

    points: np.ndarray
    """(N, 3) float64 in the file's axes."""
    up: UpChoice
    outlier_count: int
    """Number of outliers left out, those of `far_count` included."""
    background_count: int
    """Number of points left out because they lie far behind a depth camera's subject."""
    filled_count: int
    """Number of points, the last ones, that fill gaps in a depth camera's measurements."""
    far_count: int = 0
    """Number of outliers in clusters so far from the largest one that nothing would be visible."""
    ball_count: int = 0
    """Number of points if they are so few that each became a ball of points; else 0."""


def place_scan(
    scan: Scan,
    suffix: str,
    options: PlacementOptions,
    elevation: float = DEFAULT_ELEVATION,
    elevation_range: tuple[float, float] | None = None,
) -> PlacedCloud:
    """The scan of a file with that suffix (lower-case, with its dot), placed before the camera.

    `elevation` is the camera's in degrees. The view from a sensor replaces it within `elevation_range`; None keeps it.

    Raises:
        ScanError: no point or no extent is left; the user wants the sensor's view of a scan without a sensor; or the
            scan lies outside a fixed camera's frame or reaches that camera.
    """
    selected = select_points(scan, suffix, options)
    if options.viewpoint is not None:
        return _place_before_fixed_camera(selected, options.viewpoint, options, elevation, elevation_range)
    if options.camera is not None:
        return _place_before_own_camera(selected, scan, options, elevation, elevation_range)
    points, up = selected.points, selected.up
    azimuth, wanted, reason = choose_side(points, up, scan, options, elevation)
    own_elevation, note = clamp_elevation(wanted, elevation_range)
    azimuth += options.azimuth
    viewpoint = frame_points(prepend_canonical_point(points), turn(azimuth) @ up.rotation,
                             elevation if own_elevation is None else own_elevation)  # fmt: skip
    cloud = viewpoint.place(points)
    radius = _patch_radius(cloud, selected, options)
    cloud = smooth_cloud(cloud, radius) if radius else cloud
    placement = Placement(
        up.axis, up.reason, azimuth, own_elevation, reason + note, selected.outlier_count,
        background_count=selected.background_count, hint=_hint(cloud, selected, options),
        rounding_step=float32_step(points), smoothing_radius=radius, filled_count=selected.filled_count,
        far_count=selected.far_count, user_azimuth=options.azimuth,
    )  # fmt: skip
    return PlacedCloud(cloud, placement, viewpoint)


def _place_before_own_camera(
    selected: SelectedPoints, scan: Scan, options: PlacementOptions, elevation: float,
    elevation_range: tuple[float, float] | None,
) -> PlacedCloud:  # fmt: skip
    """The points before a camera in the data's units.

    Raises:
        ScanError: the camera sees none of them.
        SettingError: the camera cannot be.
    """
    points, up, wish = selected.points, selected.up, options.camera
    assert wish is not None
    azimuth, own_elevation = 0.0, elevation
    if isinstance(wish, LookAt) and wish.eye is None:  # only its direction is left to choose
        azimuth, wanted, _ = choose_side(points, up, scan, options, elevation)
        own_elevation = elevation if wanted is None else wanted
    azimuth, height = math.radians(azimuth + options.azimuth), math.radians(own_elevation)
    across = np.array([math.sin(azimuth), math.cos(azimuth)]) * -math.cos(height)
    viewpoint, pinhole = camera_viewpoint(
        prepend_canonical_point(points), up.rotation, wish, np.array([*across.tolist(), math.sin(height)])
    )  # fmt: skip
    cloud, camera = viewpoint.place(points), place_camera(pinhole, viewpoint)
    check_visible(cloud, camera)
    radius = _patch_radius(cloud, selected, options)
    cloud = smooth_cloud(cloud, radius) if radius else cloud
    unfamiliar = unfamiliar_reason(cloud, camera, elevation, elevation_range)
    kind = "the given orthographic camera" if pinhole.orthographic else "the given camera"
    reason = f"as {kind} sees it" + (f"; drawn without the network, as {unfamiliar}" if unfamiliar else "")
    settled = None if elevation_range is None else min(max(camera.elevation, elevation_range[0]), elevation_range[1])
    placement = Placement(
        up.axis, up.reason, 0.0, settled, reason, selected.outlier_count,
        background_count=selected.background_count, rounding_step=float32_step(points), smoothing_radius=radius,
        hint=few_points_hint(selected.ball_count) if selected.ball_count else "", filled_count=selected.filled_count,
        far_count=selected.far_count, own_camera=True,
    )  # fmt: skip
    return PlacedCloud(cloud, placement, viewpoint, camera, pinhole, unfamiliar)


def select_points(scan: Scan, suffix: str, options: PlacementOptions) -> SelectedPoints:
    """The scan without outliers, without the background of a depth camera's subject, and without the top cut off.

    Raises:
        ScanError: fewer than `MIN_POINTS` are left below the cut.
    """
    points, far_count = (scan.points, 0) if options.keep_outliers else remove_outliers(scan.points)
    up = choose_upright(points, scan, suffix, options)
    filled, background_count = points[:0], 0
    if up.sensor is None:
        if not options.keep_outliers:
            above = above_low_outliers_mask(points, dot_axis(points, _up_direction(up, options)))
            points = points[above] if not above.all() else points
    else:
        if options.smooth != 0:
            filled = fill_depth_gaps(points, up.sensor)
        if not options.keep_outliers:
            points, background_count = remove_background(points, up.sensor)
            filled = filled[sensor_depths(filled, up.sensor) <= sensor_depths(points, up.sensor).max()]
        if options.up == "auto":
            up = _level_support_plane(points, up)
    outlier_count = len(scan.points) - background_count - len(points)
    filled_count = len(filled)
    points = np.concatenate([points, filled]) if filled_count else points
    if options.cut_top:
        points, filled_count = _cut_top(points, filled_count, _up_direction(up, options), options.cut_top)
    if 0 < len(points) < MIN_SURFACE_POINTS and not options.points_alone:
        return SelectedPoints(points_to_balls(points), up, outlier_count, background_count, 0, far_count, len(points))
    return SelectedPoints(points, up, outlier_count, background_count, filled_count, far_count)


def _up_direction(up: UpChoice, options: PlacementOptions) -> np.ndarray:
    """The direction (3,) in the file's axes that points up in the picture."""
    rotation = up.rotation if options.viewpoint is None else np.array(options.viewpoint.rotation)
    direction: np.ndarray = rotation[2]
    return direction


def _level_support_plane(points: np.ndarray, up: UpChoice) -> UpChoice:
    """The choice of up, with the table or floor of a depth camera's points (N, 3) turned level if there is one."""
    assert up.sensor is not None
    normal = support_plane_normal(points, up.rotation[2], up.sensor)
    if normal is None:
        return up
    return replace(up, rotation=align_to_vertical(up.rotation, normal), axis="the table's normal",
                   reason=f"{up.reason}, set upright by the plane that things stand on")


def _cut_top(points: np.ndarray, filled_count: int, up: np.ndarray, percent: float) -> tuple[np.ndarray, int]:
    """Points (M, 3) below the top `percent` of the height along `up` (3,), and how many of them fill gaps.

    Raises:
        ScanError: too few are left.
    """
    height = dot_axis(points, up)
    low = height <= height.max() - percent / 100 * np.ptp(height)
    points, filled_count = points[low], int(low[len(low) - filled_count :].sum())
    if len(points) < MIN_POINTS:
        raise ScanError(f"--cut-top {percent:g} leaves {len(points)} points; cut off less")
    return points, filled_count


def _patch_radius(cloud: np.ndarray, selected: SelectedPoints, options: PlacementOptions) -> float:
    """Radius of the patches that smooth a placed cloud (N, 3), in the frame's radius; 0 leaves it as it is."""
    if isinstance(options.smooth, float):
        return options.smooth
    measured = cloud[: len(cloud) - selected.filled_count]
    return 0.0 if selected.up.sensor is None else smoothing_radius(measured)


def _hint(cloud: np.ndarray, selected: SelectedPoints, options: PlacementOptions) -> str:
    """Hints about a cloud (N, 3) that z2p framed itself, joined by semicolons; empty without any."""
    if selected.ball_count:
        return few_points_hint(selected.ball_count)
    if options.points_alone and len(cloud) < MIN_POINTS_FOR_SHAPE:
        return ""
    automatic = (options.up, options.view) == ("auto", "auto")
    hint = scan_hint(selected.points, selected.up, automatic, whole=not options.cut_top)
    return hint if options.keep_outliers else "; ".join(filter(None, (small_part_hint(cloud), hint)))


def _place_before_fixed_camera(
    selected: SelectedPoints, viewpoint: Viewpoint, options: PlacementOptions, elevation: float,
    elevation_range: tuple[float, float] | None,
) -> PlacedCloud:  # fmt: skip
    """The points before a given camera, turned by the user's azimuth and set onto the camera's floor if `grounded`.

    Raises:
        ScanError: all of them lie outside its frame, or they reach the camera.
    """
    own_elevation, note = clamp_elevation(viewpoint.elevation, elevation_range)
    azimuth = options.azimuth
    rotation = turn(azimuth) @ np.array(viewpoint.rotation) if azimuth else np.array(viewpoint.rotation)
    viewpoint = replace(viewpoint, rotation=tuple(tuple(row) for row in rotation.tolist()),
                        elevation=elevation if own_elevation is None else own_elevation)
    cloud = viewpoint.place(selected.points)
    if options.grounded and viewpoint.floor is not None:
        drop = (float(cloud[:, 2].min()) - viewpoint.floor) * viewpoint.radius
        x, y, z = (np.array(viewpoint.centre) + drop * rotation[2]).tolist()
        viewpoint = replace(viewpoint, centre=(x, y, z))
        cloud = viewpoint.place(selected.points)
    outside_count = int(((cloud**2).sum(1) > MIN_OUTSIDE_RADII**2).sum())
    if outside_count == len(cloud):
        raise ScanError("lies beyond the camera's frame as a whole; the camera was made for other data or other units")
    _check_camera_distance(cloud, viewpoint)
    hint = fixed_camera_hint(cloud, viewpoint)
    if note:
        hint = "; ".join(filter(None, (f"the camera's elevation was changed{note}", hint)))
    radius = _patch_radius(cloud, selected, options)
    cloud = smooth_cloud(cloud, radius) if radius else cloud
    placement = Placement(
        FIXED_CAMERA, "the camera's", azimuth, own_elevation, f"seen from the given camera{note}",
        selected.outlier_count, outside_count, selected.background_count, hint, float32_step(selected.points), radius,
        selected.filled_count, selected.far_count,
    )  # fmt: skip
    return PlacedCloud(cloud, placement, viewpoint)


def _check_camera_distance(cloud: np.ndarray, viewpoint: Viewpoint) -> None:
    """
    Raises:
        ScanError: the placed cloud (N, 3) reaches the place where the camera stands, or beyond.
    """
    angle = math.radians(viewpoint.elevation)
    depth = DISTANCE - dot_axis(cloud.astype(np.float64), np.array([0.0, -math.cos(angle), math.sin(angle)]))
    if (depth < MIN_CAMERA_DEPTH).mean() > MAX_NEAR_SHARE:
        reach = float(np.sqrt((cloud**2).sum(1)).max())
        raise ScanError(f"reaches the camera or lies behind it: its farthest point lies {reach:.3g} radii from the "
                        f"camera's centre; make the camera's radius ({viewpoint.radius:g}) larger, or move the centre")
