"""Which way up a scan is shown and from where: as asked, as its file tells, or as its points suggest."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from z2p_core.interfaces import ScanError, Sensor
from z2p_core.linalg import bounding_box, rotate_points
from z2p_core.placement.bounding_sphere import bounding_sphere
from z2p_core.placement.depth_camera import METRES, MILLIMETRES, implied_sensor, is_depth_camera
from z2p_core.placement.view_selection import choose_view, view_from_sensor
from z2p_core.placement.viewpoint import Viewpoint
from z2p_core.rotations import align_to_vertical
from z2p_core.surface.subsampling import subsample_uniform
from z2p_core.up_axis.axis_names import UP_ROTATIONS
from z2p_core.up_axis.choose import UpChoice, choose_up
from z2p_renderer.storage.scans.clouds import Scan

ANY_UNIT = (METRES, MILLIMETRES)
CENTRAL_SHARE, LEVEL_COSINE = 0.25, 0.5
"""How near to the middle of its points, in their widest sides, a scanner stood amid them; and how level, as the cosine
of an angle, it must look for that to say something."""
MEDIAN_SAMPLE = 20_000
"""Points of a larger cloud by which its middle is found."""
ELEVATION_TOLERANCE = 0.5
"""Degrees that do not count as beyond a range."""


@dataclass(frozen=True)
class PlacementOptions:
    """What the user asks of the view."""

    up: str = "auto"
    """``auto``, or the data's axis that points up: ``+Z``, ``-Y``, ..."""
    view: str | float = "auto"
    """``auto``, ``front`` (the data's own front), ``sensor``, or an azimuth in degrees."""
    azimuth: float = 0.0
    """Degrees that the view is turned by on top."""
    keep_outliers: bool = False
    """Keeps stray points, and what lies far behind a depth camera's subject."""
    cut_top: float = 0.0
    """Percent of the height that is cut off from above: a room's ceiling, say."""
    viewpoint: Viewpoint | None = None
    """A camera settled before: it replaces `up`, `view` and the cloud's own frame; `azimuth` still turns it."""
    smooth: str | float = "auto"
    """Radius, in the frame's, of the patches of surface that points are moved onto; 0 leaves them where they are.
    ``auto`` does so too, but for a depth camera's noisy clouds. Gaps in what such a camera measured are closed, but
    with 0."""
    grounded: bool = False
    """Sets the cloud down onto the floor of `viewpoint`, wherever it was."""


def set_upright(points: np.ndarray, scan: Scan, suffix: str, placement_options: PlacementOptions) -> UpChoice:
    """How the cloud is set upright, with the depth camera that it may be seen from."""
    sensor = scan.sensor
    if placement_options.up == "auto" and scan.up and scan.up_certain:
        rotation = np.array(UP_ROTATIONS[scan.up], dtype=np.float64)
        if scan.upward is not None:
            return UpChoice(align_to_vertical(rotation, scan.upward), f"near {scan.up}", scan.up_reason)
        return UpChoice(rotation, scan.up, scan.up_reason)
    units = ANY_UNIT if placement_options.view == "sensor" else (METRES,)
    if placement_options.up == "auto":
        return choose_up(points, sensor, suffix, units, (scan.up, scan.up_reason))
    wanted = None
    if placement_options.view == "sensor":
        wanted = implied_sensor(points, ANY_UNIT) if sensor is None else sensor if is_depth_camera(points, sensor) else None
    return UpChoice(np.array(UP_ROTATIONS[placement_options.up], dtype=np.float64), placement_options.up, "as asked", wanted)


def choose_side(
    points: np.ndarray, up: UpChoice, scan: Scan, placement_options: PlacementOptions, elevation: float
) -> tuple[float, float | None, str]:
    """Azimuth from the file's front, the elevation that goes with it or None, and why.

    Raises:
        ScanError: a sensor's view is asked for and there is none.
    """
    if placement_options.view == "front":
        return 0.0, None, "the front"
    if isinstance(placement_options.view, float):
        return placement_options.view, None, "as asked"
    place = scan.seen_from if up.sensor is None else up.sensor.position
    if place is not None:
        centre = np.array(bounding_sphere(points).centre)
        azimuth, height = view_from_sensor(up.rotation @ (place - centre))
        return azimuth, height, "from the sensor" if up.sensor is not None else "from where one of its cameras stood"
    if scan.sensor is not None and (placement_options.view == "sensor" or (scan.up and scan.up_certain)):
        found = _from_scanner(points, up, scan.sensor)
        if found is not None:
            return found
    elif placement_options.view == "sensor":
        raise ScanError("has no sensor to look from: expected an organised cloud or a VIEWPOINT; use --view auto")
    azimuth, reason = choose_view(rotate_points(points, up.rotation), elevation)
    return azimuth, None, reason


def _from_scanner(points: np.ndarray, up: UpChoice, sensor: Sensor) -> tuple[float, None, str] | None:
    """The side on which a scanner that sees all around stood, or, amid its points, ahead as it looked; or None.

    The camera's elevation stays: from the scanner's own height a scene around it is one line.
    """
    middle = np.median(subsample_uniform(points, MEDIAN_SAMPLE), axis=0)
    low, high = bounding_box(points)
    aside = up.rotation @ (sensor.position - middle)
    if np.hypot(*aside[:2]) > CENTRAL_SHARE * float((high - low).max()):
        return view_from_sensor(aside)[0], None, "from its sensor's side"
    ahead = up.rotation @ sensor.rotation[:, 2]
    if np.hypot(*ahead[:2]) > LEVEL_COSINE:
        return view_from_sensor(-ahead)[0], None, "ahead as its sensor looks"
    return None


def allowed_elevation(wished: float | None, free: tuple[float, float] | None) -> tuple[float | None, str]:
    """The elevation that a view may have of what it wishes, None when it is settled elsewhere, and what to say."""
    if wished is None or free is None:
        return None, ""
    low, high = free
    if low - ELEVATION_TOLERANCE <= wished <= high + ELEVATION_TOLERANCE:
        return min(max(wished, low), high), ""
    return min(max(wished, low), high), f" ({round(wished)} degrees, beyond the weights' {low:g} to {high:g})"
