"""The azimuth from which a cloud is seen: the side that shows most of it, or the side on which its sensor stood.

No choice is certain, so each comes with its reason in words, and the user can force another one.
"""

from __future__ import annotations

import math

import numpy as np

from z2p_core import native
from z2p_core.camera import DEFAULT_ELEVATION
from z2p_core.interfaces import Sensor
from z2p_core.linalg import bounding_box
from z2p_core.surface.subsampling import subsample_uniform

MAX_SAMPLE = 20_000
"""A larger cloud is judged by this many of its points."""
AZIMUTH_COUNT = 24
"""Views that are compared, at equal angles around the cloud."""
THREE_QUARTER_DEGREES = 22.5
"""Angle by which the view turns off the broadest side, so that the object's depth shows as well."""
TIE_TOLERANCE = 0.03
"""Relative difference in coverage up to which two views count as equal."""
CLIMB_TOLERANCE = 0.005
"""Relative gain in coverage from which on a neighboring view counts as better."""
MIN_COVERAGE_SIDE = 12
"""Smallest side, in pixels, of the coarse picture in which coverage is measured."""
MAX_COVERAGE_SIDE = 48
"""Largest side of that picture."""

CENTRAL_SHARE = 0.25
"""A scanner stood amid its points if it is at most this far from their median, in their widest side."""
MIN_LEVEL_COSINE = 0.5
"""A scanner looked ahead, rather than up or down, if its axis is within this cosine of the horizontal plane."""


def choose_view(points: np.ndarray, elevation: float = DEFAULT_ELEVATION) -> tuple[float, str]:
    """Azimuth in degrees that shows most of points (N, 3) with +Z up, turned to a three-quarter view, and the reason.

    Compares `AZIMUTH_COUNT` views from `elevation` degrees. Among views within 3 % of the best, the one nearest to the
    file's own front (azimuth 0) wins, so that noise does not decide between two sides; from there it climbs to the
    nearest maximum.
    """
    low, high = bounding_box(points)
    points = subsample_uniform(points, MAX_SAMPLE) - (low + high) / 2
    reach = float(np.sqrt((points**2).sum(1).max())) or 1.0
    coverage = _projected_coverage(points / reach, elevation)
    nearest_first = sorted(range(AZIMUTH_COUNT), key=lambda step: (min(step, AZIMUTH_COUNT - step), step))
    broadest = next(step for step in nearest_first if coverage[step] >= (1 - TIE_TOLERANCE) * max(coverage))
    while True:
        neighbors = (broadest - 1) % AZIMUTH_COUNT, (broadest + 1) % AZIMUTH_COUNT
        better = max(neighbors, key=lambda step: coverage[step])
        if coverage[better] <= (1 + CLIMB_TOLERANCE) * coverage[broadest]:
            break
        broadest = better
    azimuth = _wrap_degrees(360.0 / AZIMUTH_COUNT * broadest)
    return (azimuth - THREE_QUARTER_DEGREES if azimuth > 0 else azimuth + THREE_QUARTER_DEGREES), "shows most"


def view_from_sensor(towards_sensor: np.ndarray) -> tuple[float, float]:
    """Azimuth and elevation, in degrees, that look from the sensor.

    `towards_sensor` (3,) goes from the cloud's centre to the sensor, in axes with +Z up. The azimuth turns the sensor's
    side to the camera at -Y.
    """
    x, y, z = (float(number) for number in towards_sensor)
    flat = math.hypot(x, y)
    azimuth = 0.0 if flat == 0 else -90.0 - math.degrees(math.atan2(y, x))
    return _wrap_degrees(azimuth), math.degrees(math.atan2(z, flat))


def view_from_scanner(points: np.ndarray, rotation: np.ndarray, sensor: Sensor) -> tuple[float, str] | None:
    """Azimuth in degrees from the side on which a scanner that sees all around stood, and the reason.

    A scanner amid its points (N, 3) gives the direction in which it looked; None if it looked up or down. `rotation`
    (3, 3) brings the data's up axis to +Z. The scanner's own elevation is not used: from its height, a scene around it
    is seen edge-on.
    """
    middle = np.median(subsample_uniform(points, MAX_SAMPLE), axis=0)
    low, high = bounding_box(points)
    aside = rotation @ (sensor.position - middle)
    if np.hypot(*aside[:2]) > CENTRAL_SHARE * float((high - low).max()):
        return view_from_sensor(aside)[0], "from its sensor's side"
    ahead = rotation @ sensor.rotation[:, 2]
    if np.hypot(*ahead[:2]) > MIN_LEVEL_COSINE:
        return view_from_sensor(-ahead)[0], "ahead as its sensor looks"
    return None


def _projected_coverage(points: np.ndarray, elevation: float) -> list[float]:
    """How much each of `AZIMUTH_COUNT` views from afar shows of points (N, 3) in the unit sphere.

    Covered area times the square root of its breadth: without the breadth, small parts of a thin object (the arm of a
    lamp) would count no more than noise. Points cover 3 x 3 pixels of a coarse picture, so that sparse clouds cover
    the surface that they stand for.
    """
    side = int(np.clip(2 * math.sqrt(len(points)), MIN_COVERAGE_SIDE, MAX_COVERAGE_SIDE))
    angles = np.arange(AZIMUTH_COUNT) * (2 * math.pi / AZIMUTH_COUNT)
    covered, breadth = native.projected_coverage(points, angles, math.radians(elevation), side)
    coverage: list[float] = (covered * np.sqrt(breadth)).tolist()
    return coverage


def _wrap_degrees(azimuth: float) -> float:
    """The same angle in (-180, 180]."""
    return 180.0 - (180.0 - azimuth) % 360.0
