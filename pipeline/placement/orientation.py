"""Up axis and view of a scan: by the user's options, else by the file, else by the points."""

from __future__ import annotations

import numpy as np

from z2p_core.interfaces import ScanError
from z2p_core.linalg import rotate_points
from z2p_core.placement.bounding_sphere import bounding_sphere
from z2p_core.placement.depth_camera import METRES, MILLIMETRES, implied_sensor, is_depth_camera
from z2p_core.placement.view_selection import choose_view, view_from_scanner, view_from_sensor
from z2p_core.rotations import align_to_vertical
from z2p_core.up_axis.axis_names import UP_ROTATIONS
from z2p_core.up_axis.choose import UpChoice, choose_up
from z2p_renderer.pipeline.placement.options import PlacementOptions
from z2p_renderer.storage.scans.clouds import Scan

ANY_UNIT = (METRES, MILLIMETRES)
ELEVATION_TOLERANCE_DEGREES = 0.5
"""An elevation counts as within the range up to this far beyond it."""


def choose_upright(points: np.ndarray, scan: Scan, suffix: str, options: PlacementOptions) -> UpChoice:
    """How points (N, 3) of the scan are set upright, with the depth camera that they may be seen from."""
    sensor = scan.sensor
    if options.up == "auto" and scan.up and scan.up_certain:
        rotation = np.array(UP_ROTATIONS[scan.up], dtype=np.float64)
        if scan.upward is not None:
            return UpChoice(align_to_vertical(rotation, scan.upward), f"near {scan.up}", scan.up_reason)
        return UpChoice(rotation, scan.up, scan.up_reason)
    units = ANY_UNIT if options.view == "sensor" else (METRES,)
    if options.up == "auto":
        return choose_up(points, sensor, suffix, units, (scan.up, scan.up_reason))
    wanted = None
    if options.view == "sensor":
        if sensor is None:
            wanted = implied_sensor(points, ANY_UNIT)
        elif is_depth_camera(points, sensor):
            wanted = sensor
    return UpChoice(np.array(UP_ROTATIONS[options.up], dtype=np.float64), options.up, "as asked", wanted)


def choose_side(
    points: np.ndarray, up: UpChoice, scan: Scan, options: PlacementOptions, elevation: float
) -> tuple[float, float | None, str]:
    """Azimuth from the file's front, the elevation that goes with it or None, and why.

    Raises:
        ScanError: a sensor's view is asked for and there is none.
    """
    if options.view == "front":
        return 0.0, None, "the front"
    if isinstance(options.view, float):
        return options.view, None, "as asked"
    place = scan.seen_from if up.sensor is None else up.sensor.position
    if place is not None:
        centre = np.array(bounding_sphere(points).centre)
        azimuth, height = view_from_sensor(up.rotation @ (place - centre))
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
    """The elevation in degrees that a view gets, and a note if it wanted one beyond the range.

    None if the view wants none, or if the elevation is given elsewhere (no `elevation_range`).
    """
    if wanted is None or elevation_range is None:
        return None, ""
    low, high = elevation_range
    if low - ELEVATION_TOLERANCE_DEGREES <= wanted <= high + ELEVATION_TOLERANCE_DEGREES:
        return min(max(wanted, low), high), ""
    return min(max(wanted, low), high), f" ({round(wanted)} degrees, beyond the weights' {low:g} to {high:g})"
