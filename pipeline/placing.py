"""How a scan stands in its picture: upright, seen from a telling side, without the strays that would make it small."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from storage.clouds import FEWEST_POINTS, Scan
from z2p_core.camera import DEFAULT_ELEVATION, turn
from z2p_core.foreground import is_room, subject, support, upright
from z2p_core.framing import (
    METRES,
    MILLIMETRES,
    UP_AXES,
    Up,
    choose_up,
    choose_view,
    implied_sensor,
    sensor_view,
)
from z2p_core.geometry import bounding_sphere
from z2p_core.interfaces import ScanError, Sensor
from z2p_core.strays import clip_outliers, thinned
from z2p_core.turning import along, extent, turned
from z2p_core.viewpoint import Viewpoint, frame

SETTLED = "as settled"
"""Stands for up where a camera was settled before."""
ROOM_HINT = "it looks like a room: --cut-top 40 --elevation 55 shows its inside"
MILLIMETRES_HINT = "if it is a depth camera's in millimetres, --view sensor looks from there"
FEWEST_STEPPED, STEPS, WIDE = 1000, 60, 0.1
"""Of a cloud an axis of which was rounded: its points, the steps at most of that axis along its widest side, and the
width of that axis as a share of that side."""
ANY_UNIT = (METRES, MILLIMETRES)
FEW_POINTS, FEW_HINT = 100, "so few points tell no surface: some hundreds are needed for a shape to show"
SMALL_HINT = "nearly all of its points lie in a small part of the frame: the others may be strays, to be removed first"
MOST, SMALL = 0.97, 0.2
"""Share of the points that is nearly all, and the radius about their middle, in the frame's, that is small."""
COARSE = 1000
"""Steps that a cloud spans at least where its numbers are fine enough: fewer show in a picture."""
OUTSIDE = 1.2
"""Distance from the middle, in radii, from where on a point may lie outside a square picture."""


@dataclass(frozen=True)
class Placing:
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


@dataclass(frozen=True)
class Stance:
    """How a cloud came to stand in its picture, and why."""

    up: str
    up_reason: str
    azimuth: float
    """Degrees that the upright cloud was turned by in all."""
    elevation: float | None
    """Degrees that the view asks of the camera; None leaves it to the settings."""
    view_reason: str
    outliers: int
    """Stray points left out."""
    outside: int = 0
    """Points beyond the frame of a camera that was settled before."""
    background: int = 0
    """Points left out that lie far behind a depth camera's subject."""
    hint: str = ""
    """What the user may want to try."""
    rounded: float = 0.0
    """Step, in the data's units, to which float32 has rounded it far from the origin; 0 where that does not show."""

    @property
    def told(self) -> str:
        """Part of a line that says it."""
        height = "" if self.elevation is None else f", elevation {round(self.elevation)}"
        turned = f", turned on by {round(self.azimuth)}" if self.azimuth else ""
        settled = f"{self.view_reason}{height}{turned}"
        chosen = f"up {self.up}: {self.up_reason}; azimuth {round(self.azimuth)}{height}: {self.view_reason}"
        parts = (
            settled if self.up == SETTLED else chosen,
            f"{self.outliers} stray points left out of the frame" if self.outliers else "",
            f"{self.background} points far behind it left out" if self.background else "",
            f"{self.outside} points beyond the camera's frame" if self.outside else "",
            self.told_rounded if self.rounded else "",
            self.hint if self.up != SETTLED else "",
        )
        return "; ".join(filter(None, parts))

    @property
    def told_rounded(self) -> str:
        """What a `rounded` that is not 0 means."""
        return (f"its float32 numbers, so far from the origin, are rounded to steps of {self.rounded:g}: save float64, "
                "or subtract an offset first")


@dataclass(frozen=True)
class Placed:
    """A cloud ready to be drawn."""

    cloud: np.ndarray
    """Points (N, 3) float32 in world units."""
    stance: Stance
    viewpoint: Viewpoint
    """What placed it, with the camera's elevation."""


def place(
    scan: Scan,
    suffix: str,
    placing: Placing,
    elevation: float = DEFAULT_ELEVATION,
    free: tuple[float, float] | None = None,
) -> Placed:
    """The scan of a file with that suffix (lower-case, with its dot), placed as asked.

    `elevation` is the camera's in degrees, unless the view from a sensor brings its own: it may within the range
    `free`; None means that the camera's stays.

    Raises:
        ScanError: there is no extent to scale, or a sensor's view is asked of a cloud without one.
    """
    shown = shown_points(scan, suffix, placing)
    points, up = shown.points, shown.up
    if placing.viewpoint is not None:
        return _as_settled(shown, placing.viewpoint, placing.azimuth, elevation, free)
    azimuth, wished, reason = _view(points, up, placing, elevation)
    wished, beyond = _allowed(wished, free)
    azimuth += placing.azimuth
    viewpoint = frame(points, turn(azimuth) @ up.rotation, elevation if wished is None else wished)
    cloud = viewpoint.place(points)
    hint = _hint(points, up, placing) or (SMALL_HINT if not placing.keep_outliers and _is_small(cloud) else "")
    stance = Stance(up.axis, up.reason, azimuth, wished, reason + beyond, shown.outliers, 0, shown.background, hint,
                    _rounded(points))  # fmt: skip
    return Placed(cloud, stance, viewpoint)


@dataclass(frozen=True)
class Shown:
    """The points that are to be drawn, and what was left out."""

    points: np.ndarray
    """(N, 3) float64 in the file's axes."""
    up: Up
    outliers: int
    background: int


def shown_points(scan: Scan, suffix: str, placing: Placing) -> Shown:
    """The scan without strays, without what lies far behind a depth camera's subject, and without the top cut off.

    Raises:
        ScanError: nothing is left below the cut.
    """
    kept = np.ones(len(scan.points), dtype=bool) if placing.keep_outliers else clip_outliers(scan.points)
    points = scan.points[kept] if not kept.all() else scan.points
    up = _upright(points, scan.sensor, suffix, placing)
    background = 0
    if up.sensor is not None and not placing.keep_outliers:
        before = subject(points, up.sensor)
        background = int(len(before) - before.sum())
        if background:
            points = points[before]
            points = points[clip_outliers(points)]
    if up.sensor is not None and placing.up == "auto":
        normal = support(points, up.rotation[2], up.sensor)
        if normal is not None:
            up = replace(up, rotation=upright(up.rotation, normal), axis="the table's normal",
                         reason=f"{up.reason}, set upright by the plane that things stand on")
    outliers = len(scan.points) - background - len(points)
    if placing.cut_top:
        rotation = up.rotation if placing.viewpoint is None else np.array(placing.viewpoint.rotation)
        height = along(points, rotation[2])
        points = points[height <= height.max() - placing.cut_top / 100 * np.ptp(height)]
        if len(points) < FEWEST_POINTS:
            raise ScanError(f"--cut-top {placing.cut_top:g} leaves {len(points)} points; cut off less")
    return Shown(points, up, outliers, background)


def _as_settled(
    shown: Shown, viewpoint: Viewpoint, azimuth: float, elevation: float, free: tuple[float, float] | None
) -> Placed:
    """The points before a camera that was settled before, turned on by `azimuth` degrees."""
    wished, beyond = _allowed(viewpoint.elevation, free)
    rotation = turn(azimuth) @ np.array(viewpoint.rotation) if azimuth else np.array(viewpoint.rotation)
    viewpoint = replace(viewpoint, rotation=tuple(tuple(row) for row in rotation.tolist()),
                        elevation=elevation if wished is None else wished)
    cloud = viewpoint.place(shown.points)
    outside = int(((cloud**2).sum(1) > OUTSIDE**2).sum())
    if outside == len(cloud):
        raise ScanError("lies beyond the camera's frame as a whole; the camera was made for other data or other units")
    stance = Stance(SETTLED, "the camera's", azimuth, wished, f"seen from the given camera{beyond}", shown.outliers,
                    outside, shown.background, rounded=_rounded(shown.points))
    return Placed(cloud, stance, viewpoint)


def _rounded(points: np.ndarray) -> float:
    """Step between the float32 numbers at points (N, 3) that hold nothing finer, if the cloud spans few of them."""
    with np.errstate(over="ignore", invalid="ignore"):  # beyond float32: nothing to say
        low, high = extent(points)
        step = float(np.spacing(np.float32(max(high.max(), -low.min()))))
        if (high - low).max() >= COARSE * step or not np.array_equal(points, points.astype(np.float32)):
            return 0.0
    return step


def _hint(points: np.ndarray, up: Up, placing: Placing) -> str:
    """What the user may want to try or to know, or nothing."""
    if len(points) < FEW_POINTS:
        return FEW_HINT
    upright_points = turned(points, up.rotation)
    if not placing.cut_top and (is_room(upright_points) or is_room(upright_points / MILLIMETRES)):
        return ROOM_HINT
    if (placing.up, placing.view, up.sensor) == ("auto", "auto", None) and implied_sensor(points, (MILLIMETRES,)):
        return MILLIMETRES_HINT
    return _stepped(points) if up.sensor is None else ""


def _stepped(points: np.ndarray) -> str:
    """What to say of points (N, 3) of which an axis, but not all, takes few values; or nothing."""
    if len(points) < FEWEST_STEPPED:
        return ""
    some = points[:: -(-len(points) // FEWEST_STEPPED)]  # from the whole file, whose rows may be sorted by place
    different = np.array([len(np.unique(some[:, axis])) for axis in range(3)])
    low, high = extent(points)
    width = high - low
    stepped = (width > WIDE * width.max()) & (width * STEPS > different * width.max())
    if not stepped.any() or different.max() < 5 * STEPS:  # a grid of voxels has steps along all axes
        return ""
    axes = " and ".join("xyz"[axis] for axis in np.flatnonzero(stepped))
    return f"few different values of {axes}, as when digits are lost in saving: if so, save more of them"


def _is_small(cloud: np.ndarray) -> bool:
    """Whether few of the placed points (N, 3) float32 make the frame wide, and the others hardly fill it."""
    sample = thinned(cloud)
    away = np.sqrt(((sample - np.median(sample, axis=0)) ** 2).sum(1))
    return bool(np.quantile(away, MOST) < SMALL)


def _allowed(wished: float | None, free: tuple[float, float] | None) -> tuple[float | None, str]:
    """The elevation that a view may have of what it wishes, None when it is settled elsewhere, and what to say."""
    if wished is None or free is None:
        return None, ""
    low, high = free
    if low <= wished <= high:
        return wished, ""
    return min(max(wished, low), high), f" ({round(wished)} degrees, beyond the weights' {low:g} to {high:g})"


def _upright(points: np.ndarray, sensor: Sensor | None, suffix: str, placing: Placing) -> Up:
    """How the cloud is set upright, with the sensor that it may be seen from."""
    if placing.up == "auto":
        up = choose_up(points, sensor, suffix, ANY_UNIT if placing.view == "sensor" else (METRES,))
        wanted = up.sensor or sensor if placing.view == "sensor" else up.sensor
        return Up(up.rotation, up.axis, up.reason, wanted)
    rotation = np.array(UP_AXES[placing.up], dtype=np.float64)
    wanted = (sensor or implied_sensor(points, ANY_UNIT)) if placing.view == "sensor" else None
    return Up(rotation, placing.up, "as asked", wanted)


def _view(points: np.ndarray, up: Up, placing: Placing, elevation: float) -> tuple[float, float | None, str]:
    """Azimuth, the elevation that goes with it or None, and why."""
    if placing.view == "sensor" and up.sensor is None:
        raise ScanError("has no sensor to look from: expected an organised cloud or a VIEWPOINT; use --view auto")
    if placing.view == "front":
        return 0.0, None, "the front"
    if isinstance(placing.view, float):
        return placing.view, None, "as asked"
    if up.sensor is not None:
        centre = np.array(bounding_sphere(points).centre)
        azimuth, height = sensor_view(up.rotation @ (up.sensor.position - centre))
        return azimuth, height, "from the sensor"
    azimuth, reason = choose_view(turned(points, up.rotation), elevation)
    return azimuth, None, reason
