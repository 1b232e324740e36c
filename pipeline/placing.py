"""How a scan stands in its picture: upright, seen from a telling side, without the strays that would make it small."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from z2p_core.camera import DEFAULT_ELEVATION, turn
from z2p_core.dropouts import dropouts
from z2p_core.foreground import depths, subject, support, upright
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
from z2p_core.smoothing import patch_radius, smoothed
from z2p_core.strays import clip_below, clip_outliers
from z2p_core.turning import along, turned
from z2p_core.viewpoint import Viewpoint, frame
from z2p_renderer.pipeline.hints import hint_for, hint_for_placed, hint_for_settled, rounding
from z2p_renderer.storage.clouds import FEWEST_POINTS, Scan

SETTLED = "as settled"
"""Stands for up where a camera was settled before."""
ANY_UNIT = (METRES, MILLIMETRES)
HARDLY = 0.5
"""Degrees that do not count as beyond a range."""
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
    smooth: str | float = "auto"
    """Radius, in the frame's, of the patches of surface that points are moved onto; 0 leaves them where they are.
    ``auto`` does so too, but for a depth camera's noisy clouds. Gaps in what such a camera measured are closed, but
    with 0."""


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
    smooth: float = 0.0
    """Radius, in the frame's, of the patches that points were moved onto; 0 where they were not."""
    added: int = 0
    """Points put into gaps of what a depth camera measured."""

    @property
    def told(self) -> str:
        """Part of a line that says it."""
        parts = (
            self.told_view,
            f"{self.told_strays} left out of the frame" if self.outliers else "",
            f"{self.background} points far behind it left out" if self.background else "",
            f"{self.outside} points beyond the camera's frame" if self.outside else "",
            f"{self.added} put into small gaps of it" if self.added else "",
            self.told_rounded if self.rounded else "",
            f"made smooth over {self.smooth:.2g} of its radius" if self.smooth else "",
            self.hint,
        )
        return "; ".join(filter(None, parts))

    @property
    def told_view(self) -> str:
        """Up and view, with their reasons."""
        height = "" if self.elevation is None else f", elevation {round(self.elevation)}"
        if self.up == SETTLED:
            return f"{self.view_reason}{height}" + (f", turned on by {round(self.azimuth)}" if self.azimuth else "")
        return f"up {self.up}: {self.up_reason}; azimuth {round(self.azimuth)}{height}: {self.view_reason}"

    @property
    def told_strays(self) -> str:
        """How many were left out."""
        return f"{self.outliers} stray point{'' if self.outliers == 1 else 's'}"

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
        return _as_settled(shown, placing.viewpoint, placing, elevation, free)
    azimuth, wished, reason = _told_view(points, up, scan, placing) or _view(points, up, placing, elevation)
    wished, beyond = _allowed(wished, free)
    azimuth += placing.azimuth
    viewpoint = frame(points, turn(azimuth) @ up.rotation, elevation if wished is None else wished)
    cloud, smooth = _smoothed(viewpoint.place(points), shown, placing)
    hint = hint_for(points, up, by_itself=(placing.up, placing.view) == ("auto", "auto"), whole=not placing.cut_top)
    if not placing.keep_outliers:
        hint = "; ".join(filter(None, (hint_for_placed(cloud), hint)))
    stance = Stance(up.axis, up.reason, azimuth, wished, reason + beyond, shown.outliers, 0, shown.background, hint,
                    rounding(points), smooth, shown.added)  # fmt: skip
    return Placed(cloud, stance, viewpoint)


@dataclass(frozen=True)
class Shown:
    """The points that are to be drawn, and what was left out."""

    points: np.ndarray
    """(N, 3) float64 in the file's axes."""
    up: Up
    outliers: int
    background: int
    added: int
    """How many of the points, the last ones, were put into gaps of what a depth camera measured."""


def shown_points(scan: Scan, suffix: str, placing: Placing) -> Shown:
    """The scan without strays, without what lies far behind a depth camera's subject, and without the top cut off.

    Raises:
        ScanError: nothing is left below the cut.
    """
    kept = np.ones(len(scan.points), dtype=bool) if placing.keep_outliers else clip_outliers(scan.points)
    points = scan.points[kept] if not kept.all() else scan.points
    up = _upright(points, scan, suffix, placing)
    background, put_in = 0, points[:0]
    if up.sensor is None and not placing.keep_outliers:
        kept = clip_below(points, along(points, _upward(up, placing)))
        points = points[kept] if not kept.all() else points
    if up.sensor is not None:
        put_in = points[:0] if placing.smooth == 0 else dropouts(points, up.sensor)
        if not placing.keep_outliers:
            points, background = _subject(points, up.sensor)
            put_in = put_in[depths(put_in, up.sensor) <= depths(points, up.sensor).max()]
    if up.sensor is not None and placing.up == "auto":
        normal = support(points, up.rotation[2], up.sensor)
        if normal is not None:
            up = replace(up, rotation=upright(up.rotation, normal), axis="the table's normal",
                         reason=f"{up.reason}, set upright by the plane that things stand on")
    outliers = len(scan.points) - background - len(points)
    added = len(put_in)
    points = np.concatenate([points, put_in]) if added else points
    if placing.cut_top:
        height = along(points, _upward(up, placing))
        low = height <= height.max() - placing.cut_top / 100 * np.ptp(height)
        points, added = points[low], int(low[len(low) - added :].sum())
        if len(points) < FEWEST_POINTS:
            raise ScanError(f"--cut-top {placing.cut_top:g} leaves {len(points)} points; cut off less")
    return Shown(points, up, outliers, background, added)


def _subject(points: np.ndarray, sensor: Sensor) -> tuple[np.ndarray, int]:
    """The points (M, 3) of a depth camera's subject, without strays, and how many lie far behind it."""
    before = subject(points, sensor)
    background = int(len(before) - before.sum())
    if background:
        points = points[before]
        points = points[clip_outliers(points)]
    return points, background


def _upward(up: Up, placing: Placing) -> np.ndarray:
    """The direction (3,) in the file's axes that points up in the picture."""
    rotation = up.rotation if placing.viewpoint is None else np.array(placing.viewpoint.rotation)
    upward: np.ndarray = rotation[2]
    return upward


def _as_settled(
    shown: Shown, viewpoint: Viewpoint, placing: Placing, elevation: float, free: tuple[float, float] | None
) -> Placed:
    """The points before a camera that was settled before, turned on as asked."""
    wished, beyond = _allowed(viewpoint.elevation, free)
    azimuth = placing.azimuth
    rotation = turn(azimuth) @ np.array(viewpoint.rotation) if azimuth else np.array(viewpoint.rotation)
    viewpoint = replace(viewpoint, rotation=tuple(tuple(row) for row in rotation.tolist()),
                        elevation=elevation if wished is None else wished)
    cloud = viewpoint.place(shown.points)
    outside = int(((cloud**2).sum(1) > OUTSIDE**2).sum())
    if outside == len(cloud):
        raise ScanError("lies beyond the camera's frame as a whole; the camera was made for other data or other units")
    cloud, smooth = _smoothed(cloud, shown, placing)
    stance = Stance(SETTLED, "the camera's", azimuth, wished, f"seen from the given camera{beyond}", shown.outliers,
                    outside, shown.background, hint_for_settled(cloud), rounding(shown.points), smooth, shown.added)
    return Placed(cloud, stance, viewpoint)


def _smoothed(cloud: np.ndarray, shown: Shown, placing: Placing) -> tuple[np.ndarray, float]:
    """The placed cloud (N, 3), made as smooth as asked, and over which radius; 0 where it was left as it is."""
    radius = placing.smooth
    if not isinstance(radius, float):
        measured = cloud[: len(cloud) - shown.added]
        radius = 0.0 if shown.up.sensor is None else patch_radius(measured)
    return (smoothed(cloud, radius), radius) if radius else (cloud, 0.0)


def _allowed(wished: float | None, free: tuple[float, float] | None) -> tuple[float | None, str]:
    """The elevation that a view may have of what it wishes, None when it is settled elsewhere, and what to say."""
    if wished is None or free is None:
        return None, ""
    low, high = free
    if low - HARDLY <= wished <= high + HARDLY:
        return min(max(wished, low), high), ""
    return min(max(wished, low), high), f" ({round(wished)} degrees, beyond the weights' {low:g} to {high:g})"


def _upright(points: np.ndarray, scan: Scan, suffix: str, placing: Placing) -> Up:
    """How the cloud is set upright, with the sensor that it may be seen from."""
    sensor = scan.sensor
    if placing.up == "auto" and scan.up and scan.up_certain:
        rotation = np.array(UP_AXES[scan.up], dtype=np.float64)
        if scan.upward is not None:
            return Up(upright(rotation, scan.upward), f"near {scan.up}", scan.up_reason)
        return Up(rotation, scan.up, scan.up_reason)
    if placing.up == "auto":
        up = choose_up(points, sensor, suffix, ANY_UNIT if placing.view == "sensor" else (METRES,))
        wanted = up.sensor or sensor if placing.view == "sensor" else up.sensor
        return Up(up.rotation, up.axis, up.reason, wanted)
    rotation = np.array(UP_AXES[placing.up], dtype=np.float64)
    wanted = (sensor or implied_sensor(points, ANY_UNIT)) if placing.view == "sensor" else None
    return Up(rotation, placing.up, "as asked", wanted)


def _told_view(points: np.ndarray, up: Up, scan: Scan, placing: Placing) -> tuple[float, float | None, str] | None:
    """The view, as `_view` gives it, that the file tells of; None where it does not, or the user asks for another.

    A lidar that sees all around is in the middle of its sweep, so only where it looks ahead says something.
    """
    if placing.view not in ("auto", "sensor") or up.sensor is not None:
        return None
    if scan.seen_from is not None:
        centre = np.array(bounding_sphere(points).centre)
        azimuth, height = sensor_view(up.rotation @ (scan.seen_from - centre))
        return azimuth, height, "from where one of its cameras stood"
    if scan.sensor is not None and scan.up and scan.up_certain:
        return sensor_view(up.rotation @ -scan.sensor.rotation[:, 2])[0], None, "ahead as its sensor looks"
    return None


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
