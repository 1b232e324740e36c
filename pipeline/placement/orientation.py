"""Up axis and view of a scan: by the user's options, else by the file, else by the points."""

from __future__ import annotations

import numpy as np

from z2p_core.interfaces import ScanError
from z2p_core.linalg import rotate_points
from z2p_core.placement.bounding_sphere import bounding_sphere
from z2p_core.placement.depth_camera import METRES, MILLIMETRES, implied_sensor, is_depth_camera
from z2p_core.placement.view_selection import choose_view, view_from_scanner, view_from_sensor
from z2p_core.rotations import align_to_vertical
from z2p_core.up_axis.axis_names import UP_ROTATIONS, up_rotation
from z2p_core.up_axis.choose import UpChoice, choose_up
from z2p_renderer.pipeline.placement.options import PlacementOptions
from z2p_renderer.storage.scans.clouds import Scan

ANY_UNIT = (METRES, MILLIMETRES)
"""Units per metre in which a cloud may look like a depth camera's, if the user names the sensor's view."""
ELEVATION_TOLERANCE_DEGREES = 0.5
"""An elevation at most this far beyond the range is clamped without a note."""


def choose_upright(points: np.ndarray, scan: Scan, suffix: str, options: PlacementOptions) -> UpChoice:
    """The up axis of points (N, 3) of the scan, and the depth camera that took it, if any.

    By the user's option; else by the file, if it is certain; else by `choose_up`. `suffix` is the file's, with its dot.
    """
    sensor = scan.sensor
    if options.up == "auto" and scan.up and scan.up_certain:
        rotation = np.array(UP_ROTATIONS[scan.up], dtype=np.float64)
        if scan.upward is not None:
            return UpChoice(align_to_vertical(rotation, scan.upward), f"near {scan.up}", scan.up_reason)
        return UpChoice(rotation, scan.up, scan.up_reason)
    units = ANY_UNIT if options.view == "sensor" else (METRES,)
    if options.up == "auto":
        return choose_up(points, sensor, suffix, units, (scan.up, scan.up_reason))
    camera = None
    if options.view == "sensor":
        if sensor is None:
            camera = implied_sensor(points, ANY_UNIT)
        elif is_depth_camera(points, sensor):
            camera = sensor
    return UpChoice(up_rotation(options.up), options.up, "as asked", camera)


def choose_side(
    points: np.ndarray, up: UpChoice, scan: Scan, options: PlacementOptions, elevation: float
) -> tuple[float, float | None, str]:
    """Azimuth in degrees from the file's front, the elevation of a sensor in degrees or None, and the reason.

    By the user's option; else by the sensor; else the side that shows most of points (N, 3) from `elevation` degrees.

    Raises:
        ScanError: the user wants the sensor's view, but the scan has no sensor.
    """
    if options.view == "front":
        return 0.0, None, "the front"
    if isinstance(options.view, float):
        return options.view, None, "as asked"
    position = scan.seen_from if up.sensor is None else up.sensor.position
    if position is not None:
        centre = np.array(bounding_sphere(points).centre)
        azimuth, height = view_from_sensor(up.rotation @ (position - centre))
        return azimuth, height, "from the sensor" if up.sensor is not None else "from where one of its cameras stood"
    if scan.sensor is not None and (options.view == "sensor" or (scan.up and scan.up_certain)):
        view = view_from_scanner(points, up.rotation, scan.sensor)
        if view is not None:
            azimuth, reason = view
            return azimuth, None, reason
    elif options.view == "sensor":
        raise ScanError("has no sensor to look from: expected an organised cloud or a VIEWPOINT; use --view auto")
    azimuth, reason = choose_view(rotate_points(points, up.rotation), elevation)
    return azimuth, None, reason


def clamp_elevation(wanted: float | None, elevation_range: tuple[float, float] | None) -> tuple[float | None, str]:
    """The elevation `wanted` by a view, clamped to the range, in degrees; and a note if it lies beyond the range.

    None if the view wants none, or if weights or user fix the elevation (then `elevation_range` is None).
    """
    if wanted is None or elevation_range is None:
        return None, ""
    low, high = elevation_range
    if low - ELEVATION_TOLERANCE_DEGREES <= wanted <= high + ELEVATION_TOLERANCE_DEGREES:
        return min(max(wanted, low), high), ""
    return min(max(wanted, low), high), f" ({round(wanted)} degrees, beyond the weights' {low:g} to {high:g})"
