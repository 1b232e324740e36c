"""From a bare cloud to a view of it: which way is up, and where to look from.

Nothing here is certain, so every choice comes with its reason in words, and the user can force another one.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from z2p_core import native
from z2p_core.camera import DEFAULT_ELEVATION
from z2p_core.interfaces import Sensor
from z2p_core.linalg import bounding_box, rotate_points
from z2p_core.surface.subsampling import even_share
from z2p_core.up_axis.choose import guess_up_axis

UP_ROTATIONS = {
    "+Z": ((1, 0, 0), (0, 1, 0), (0, 0, 1)),
    "-Z": ((-1, 0, 0), (0, 1, 0), (0, 0, -1)),
    "+Y": ((1, 0, 0), (0, 0, -1), (0, 1, 0)),
    "-Y": ((1, 0, 0), (0, 0, 1), (0, -1, 0)),
    "+X": ((0, 0, -1), (0, 1, 0), (1, 0, 0)),
    "-X": ((0, 0, 1), (0, 1, 0), (-1, 0, 0)),
}
"""The data's up axis -> rotation (rows) that brings it to +Z.

The camera stands at -Y, so these also choose the data's front. +Y up, (x, y, z) -> (x, -z, y): what faces +Z faces the
camera (OpenGL's axes). -Y up, (x, z, -y): what faces -Z does (a depth camera's axes, seen from the sensor). The
others leave y alone, so what faces -Y does.
"""
CAMERA_CONE = 60.0
"""Degrees from its axis within which a depth camera sees; a laser scanner sees all around."""
IMPLIED_CONE, IMPLIED_DEPTHS = 50.0, (0.1, 15.0)
"""Cone in degrees and depths in metres of a cloud that may be a depth camera's although its file does not say so."""
NARROW_CONE, DOUBLE, DOUBLE_NARROW = 25.0, 0.1, 0.015
"""Within the narrow cone, in degrees, hardly anything lies by chance, so a mere relief, a face say, may be a depth
camera's; and the least shares of directions from the side with two depths, of any such cloud and of one so narrow."""
FEWEST_FOR_LAYERS = 500
MOST_LOOKED_AT = 20_000
"""Points of a larger cloud by which a view is chosen."""
AZIMUTHS = 24
THREE_QUARTER = 22.5
"""Degrees off the broadest view, so that the object's depth shows as well."""
TIE, NOISE = 0.03, 0.005


@dataclass(frozen=True)
class UpChoice:
    """How a cloud is set upright."""

    rotation: np.ndarray
    """Matrix (3, 3) from the file's axes to ones with +Z up and the front at -Y."""
    axis: str
    """What points up: ``+Y``, or ``the sensor's -Y`` when that is none of the file's axes."""
    reason: str
    sensor: Sensor | None = None
    """The depth camera that took the cloud, told by the file or implied by the points."""
    other: str = ""
    """The file's axis that may be up instead, where the cloud leaves a doubt."""


METRES, MILLIMETRES = 1.0, 1000.0
"""Units to a metre, as depth cameras give them."""


def choose_up(
    points: np.ndarray, sensor: Sensor | None, suffix: str, units: Sequence[float] = (METRES,),
    usual: tuple[str, str] = ("", ""),
) -> UpChoice:  # fmt: skip
    """Which way is up in finite points (N, 3) of a file with that suffix (lower-case, with its dot), and why.

    A depth camera's own up, else what `guess_up_axis` makes of the cloud's shape, of its format, and of the axis that is
    `usual` for such files, with the reason. A sensor that sees all around (a laser scanner) says nothing about up.
    Without a sensor the points may look like a depth camera's in one of the `units` to a metre.
    """
    reason = "as its depth camera stood"
    if sensor is not None and not is_depth_camera(points, sensor):
        sensor = None
    elif sensor is None:
        sensor, reason = implied_sensor(points, units), "it looks like a depth camera's view from the origin"
    if sensor is not None:
        rotation = np.array(UP_ROTATIONS["-Y"], dtype=np.float64) @ sensor.rotation.T
        return UpChoice(rotation, _axis_name(rotation[2]), reason, sensor)
    guess = guess_up_axis(points, suffix, *usual)
    return UpChoice(np.array(UP_ROTATIONS[guess.axis], dtype=np.float64), guess.axis, guess.reason, other=guess.other)


def implied_sensor(points: np.ndarray, units: Sequence[float] = (METRES,)) -> Sensor | None:
    """Depth camera at the origin that points (N, 3) seem to come from, though no file says so; or None.

    Its mark: all points lie before the origin in a narrow cone along +Z (OpenCV's axes) or -Z (OpenGL's), and seen from
    there hardly any direction holds two depths, while from the side many do. A whole object shows its back as well.
    Hills measured from the air have that mark, too: depths must be those of such cameras in one of the `units` to a
    metre, and millimetres cannot be told from hills that lie some hundred metres above the sea.
    """
    if len(points) < FEWEST_FOR_LAYERS:
        return None
    sign = 1.0 if points[:, 2].max() > 0 else -1.0
    depth = sign * points[:, 2]
    nearest, farthest = IMPLIED_DEPTHS
    if not any(nearest * unit <= depth.min() and depth.max() <= farthest * unit for unit in units):
        return None
    off_axis = math.degrees(math.atan(float((np.hypot(points[:, 0], points[:, 1]) / depth).max())))
    if off_axis > IMPLIED_CONE:
        return None
    x, y, z = even_share(points, MOST_LOOKED_AT).T
    depth = sign * z
    from_origin = _layered(x / depth, y / depth, depth, float(np.median(depth)))
    from_side = max(_layered(y, z, x, 1.0), _layered(x, z, y, 1.0))
    least = DOUBLE_NARROW if off_axis <= NARROW_CONE else DOUBLE
    if from_origin > 0.05 or from_side < max(least, 3 * from_origin):
        return None
    return Sensor(np.zeros(3), np.diag([1.0, sign, sign]))


def view_from_sensor(towards_sensor: np.ndarray) -> tuple[float, float]:
    """Azimuth and elevation, degrees, that look from the sensor.

    `towards_sensor` (3,) goes from the cloud's centre to the sensor, in axes with +Z up. The azimuth turns the sensor's
    side to the camera at -Y.
    """
    x, y, z = (float(number) for number in towards_sensor)
    flat = math.hypot(x, y)
    azimuth = 0.0 if flat == 0 else -90.0 - math.degrees(math.atan2(y, x))
    return _wrapped(azimuth), math.degrees(math.atan2(z, flat))


def choose_view(points: np.ndarray, elevation: float = DEFAULT_ELEVATION) -> tuple[float, str]:
    """Azimuth in degrees that shows most of points (N, 3) with +Z up, turned for a three-quarter look, and why.

    `AZIMUTHS` views from `elevation` are weighed. What differs by under 3 % is a tie, won by the view nearest to the
    file's own front (azimuth 0), so that noise does not choose between two sides; from there it goes uphill.
    """
    low, high = bounding_box(points)
    points = even_share(points, MOST_LOOKED_AT) - (low + high) / 2
    reach = float(np.sqrt((points**2).sum(1).max())) or 1.0
    shown = _showing(points / reach, elevation)
    nearest_first = sorted(range(AZIMUTHS), key=lambda step: (min(step, AZIMUTHS - step), step))
    broadest = next(step for step in nearest_first if shown[step] >= (1 - TIE) * max(shown))
    while True:
        better = max((broadest - 1) % AZIMUTHS, (broadest + 1) % AZIMUTHS, key=lambda step: shown[step])
        if shown[better] <= (1 + NOISE) * shown[broadest]:
            break
        broadest = better
    azimuth = _wrapped(360.0 / AZIMUTHS * broadest)
    return (azimuth - THREE_QUARTER if azimuth > 0 else azimuth + THREE_QUARTER), "shows most"


def is_depth_camera(points: np.ndarray, sensor: Sensor) -> bool:
    """True when nearly all points lie in the cone before the sensor."""
    seen = rotate_points(even_share(points, MOST_LOOKED_AT) - sensor.position, sensor.rotation.T)
    inside = np.hypot(seen[:, 0], seen[:, 1]) <= math.tan(math.radians(CAMERA_CONE)) * seen[:, 2]
    return bool(inside.mean() > 0.98)


def _axis_name(up: np.ndarray) -> str:
    """Name of the file's axis along a unit vector (3,)."""
    longest = int(np.abs(up).argmax())
    if abs(up[longest]) < 1 - 1e-6:
        return "the sensor's -Y"
    return ("+" if up[longest] > 0 else "-") + "XYZ"[longest]


def _layered(u: np.ndarray, v: np.ndarray, depth: np.ndarray, scale: float) -> float:
    """Share of the cells of a picture (u, v) that hold two clearly different depths.

    Cells hold eight points or so. Different: a gap in depth wider than six cells, which no slope brings about that is
    sampled along its way; `scale` is the length of one unit of u.
    """
    plane = np.column_stack([u - u.min(), v - v.min()])
    size = math.sqrt(float(plane.max(0).prod()) * 8 / len(u))
    for _ in range(2):  # the first round finds how much of the rectangle is taken at all
        if not size > 0:
            return 0.0
        column, row = (plane / size).astype(np.int64).T
        cell = column * (int(row.max()) + 1) + row
        taken = len(np.unique(cell))
        wide = 6 * size * scale
        size *= math.sqrt(taken * 8 / len(u))
    order = np.lexsort((depth, cell))
    gap = (np.diff(depth[order]) > wide) & (np.diff(cell[order]) == 0)
    return len(np.unique(cell[order][1:][gap])) / taken


def _showing(points: np.ndarray, elevation: float) -> list[float]:
    """How much each of `AZIMUTHS` views from afar shows of points (N, 3) in the unit sphere.

    That is the covered area times the root of its breadth: without the breadth, a thin thing's small parts (the arm of
    a lamp) would count no more than noise. The area is that of 3 x 3 dots on a coarse picture, which lets few points
    cover what they stand for.
    """
    side = int(np.clip(2 * math.sqrt(len(points)), 12, 48))
    turns = np.arange(AZIMUTHS) * (2 * math.pi / AZIMUTHS)
    covered, breadth = native.showing(points, turns, math.radians(elevation), side)
    shown: list[float] = (covered * np.sqrt(breadth)).tolist()
    return shown


def _wrapped(azimuth: float) -> float:
    """The same angle in (-180, 180]."""
    return 180.0 - (180.0 - azimuth) % 360.0
