"""What columns of points are called: names that stand for an axis, and those that hold degrees or depths instead."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

_OF_POINTS = re.compile(
    r"(?:(?:points?|coord(?:inate)?s?|pos(?:ition)?s?|p|world|utm|map|local|field|xyz|co|loc(?:ation)?"
    r"|vert(?:ex|ices)?|pt|node|translation)[:_. -]?)"
    r"(?:(?:m|mm|cm)_?xyz[:_. ]?)?([xyz012])(?:[_ ](?:m|mm|cm|ft))?"
    r"|([xyz])(?:[_. /-]?(?:m|mm|cm|ft|metres?|meters?|coord(?:inate)?s?|pos(?:ition)?|world|utm|local|axis|value)"
    r"|/(?:longitude|latitude|altitude|easting|northing|height|elevation))"
)
"""Names of one axis of something, as ParaView (``Points:0``), VeloView (``Points_m_XYZ:0``), ArcGIS (``POINT_X``),
Metashape (``X/Longitude``) and others write them."""
_SURVEYED = {
    "x": ("easting", "east", "e", "ost", "rechtswert", "rechts", "utm_e", "utm_easting", "easting_m", "estasjon",
          "ostwert", "eastings"),
    "y": ("northing", "north", "n", "nord", "hochwert", "hoch", "utm_n", "utm_northing", "northing_m", "nordwert",
          "northings"),
    "z": ("u", "up"),
}  # fmt: skip
_HEIGHTS = ("height", "elevation", "elev", "alt", "altitude", "h", "hoehe", "höhe", "hohe", "z_elev",
            "height_m", "elevation_m", "altitude_m", "alt_m", "elev_m", "ellipsoidal_height", "ellipsoid_height",
            "orthometric_height")  # fmt: skip
_LONGITUDES = ("lon", "long", "lng", "longitude", "lon_deg", "longitude_deg", "lon_dd", "x_lon", "gps_lon",
               "gps_longitude")  # fmt: skip
_LATITUDES = ("lat", "latitude", "lat_deg", "latitude_deg", "lat_dd", "y_lat", "gps_lat", "gps_latitude")
_DEPTHS = ("depth", "sounding", "soundings", "sounding_depth", "water_depth", "waterdepth", "depth_m", "z_depth", "dpt",
           "tiefe", "wassertiefe", "profondeur", "profundidad", "sounding_m", "water_depth_m", "depths")  # fmt: skip
_FAMILIES = (
    lambda name: name if name in ("x", "y", "z") else None,
    lambda name: _axis_of_points(name),
    lambda name: next((axis for axis, names in _SURVEYED.items() if name in names), None),
    lambda name: "x" if name in _LONGITUDES else "y" if name in _LATITUDES else None,
    lambda name: "z" if name in _HEIGHTS else None,
    lambda name: "z" if name in _DEPTHS else None,
)
"""Ways to call an axis, the plainest first: of two columns for an axis, the one with the plainer name is it."""
_MAP, _DEGREES, _HEIGHT, _DEPTH = 2, 3, 4, 5


@dataclass(frozen=True)
class AxisColumns:
    """Which columns hold x, y and z, and what their names say of the numbers."""

    places: tuple[int, int, int]
    degrees: bool = False
    """x and y are longitude and latitude."""
    depth: bool = False
    """z counts from the water's surface down."""
    heights: bool = False
    """z is a height, by its own name or because x and y are a map's."""


def axis_columns(names: Sequence[str]) -> AxisColumns | None:
    """The columns of such names, lower-case and without units, that hold x, y and z; None where that is open.

    An axis has one column: where two have names that are as plain, nobody can tell. x and y are called in one way, so
    that no longitude stands beside a northing.
    """
    found = [[_places(names, family, axis) for family in range(len(_FAMILIES))] for axis in range(3)]
    across = next((family for family in range(4) if found[0][family] and found[1][family]), None)
    upward = next((family for family in (0, 1, 2, 4, 5) if found[2][family] and (family != 2 or across == 2)),
                  None)
    if across is None or upward is None:
        return None
    columns = (found[0][across], found[1][across], found[2][upward])
    if any(len(places) != 1 for places in columns):
        return None
    x, y, z = (places[0] for places in columns)
    heights = across in (_MAP, _DEGREES) or upward in (_HEIGHT, _DEPTH)
    return AxisColumns((x, y, z), across == _DEGREES, upward == _DEPTH, heights)


def _places(names: Sequence[str], family: int, axis: int) -> list[int]:
    return [place for place, name in enumerate(names) if _FAMILIES[family](name) == "xyz"[axis]]


def _axis_of_points(name: str) -> str | None:
    parts = _OF_POINTS.fullmatch(name)
    if parts is None:
        return None
    axis = parts[1] or parts[2]
    return axis if axis in "xyz" else "xyz"[int(axis)]
