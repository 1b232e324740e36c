"""Recognizes the columns that hold x, y and z by their names, also names of degrees, heights and depths."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum

_XYZ = "xyz"
_POINT_AXIS = re.compile(
    r"(?:(?:points?|coord(?:inate)?s?|pos(?:ition)?s?|p|world|utm|map|local|field|xyz|co|loc(?:ation)?"
    r"|vert(?:ex|ices)?|pt|node|translation)[:_. -]?)"
    r"(?:(?:m|mm|cm)_?xyz[:_. ]?)?([xyz012])(?:[_ ](?:m|mm|cm|ft))?"
    r"|([xyz])(?:[_. /-]?(?:m|mm|cm|ft|metres?|meters?|coord(?:inate)?s?|pos(?:ition)?|world|utm|local|axis|value)"
    r"|/(?:longitude|latitude|altitude|easting|northing|height|elevation))"
)
"""Names of one axis of a vector, as ParaView (``Points:0``), VeloView (``Points_m_XYZ:0``), ArcGIS (``POINT_X``),
Metashape (``X/Longitude``) and others write them."""
_MAP_NAMES = {
    "x": ("easting", "east", "e", "ost", "rechtswert", "rechts", "utm_e", "utm_easting", "easting_m", "estasjon",
          "ostwert", "eastings"),
    "y": ("northing", "north", "n", "nord", "hochwert", "hoch", "utm_n", "utm_northing", "northing_m", "nordwert",
          "northings"),
    "z": ("u", "up"),
}  # fmt: skip
_HEIGHT_NAMES = ("height", "elevation", "elev", "alt", "altitude", "h", "hoehe", "höhe", "hohe", "z_elev",
                 "height_m", "elevation_m", "altitude_m", "alt_m", "elev_m", "ellipsoidal_height", "ellipsoid_height",
                 "orthometric_height")  # fmt: skip
_LONGITUDE_NAMES = ("lon", "long", "lng", "longitude", "lon_deg", "longitude_deg", "lon_dd", "x_lon", "gps_lon",
                    "gps_longitude")  # fmt: skip
_LATITUDE_NAMES = ("lat", "latitude", "lat_deg", "latitude_deg", "lat_dd", "y_lat", "gps_lat", "gps_latitude")
_DEPTH_NAMES = ("depth", "sounding", "soundings", "sounding_depth", "water_depth", "waterdepth", "depth_m", "z_depth",
                "dpt", "tiefe", "wassertiefe", "profondeur", "profundidad", "sounding_m", "water_depth_m",
                "depths")  # fmt: skip


class NameFamily(IntEnum):
    """Families of names for an axis, the plainest first: of two columns for an axis, the plainer name wins."""

    PLAIN = 0
    """``x``, ``y``, ``z``."""
    POINT_VECTOR = 1
    """One axis of a vector: ``Points:0``, ``POINT_X``."""
    MAP = 2
    """Map coordinates: easting, northing, up."""
    DEGREES = 3
    """Longitude and latitude; no name of z."""
    HEIGHT = 4
    """Heights; names of z alone."""
    DEPTH = 5
    """Depths below the water's surface; names of z alone."""


_HORIZONTAL_FAMILIES = (NameFamily.PLAIN, NameFamily.POINT_VECTOR, NameFamily.MAP, NameFamily.DEGREES)
_VERTICAL_FAMILIES = (NameFamily.PLAIN, NameFamily.POINT_VECTOR, NameFamily.MAP, NameFamily.HEIGHT, NameFamily.DEPTH)


@dataclass(frozen=True)
class AxisColumns:
    """The columns that hold x, y and z, and what their names say of the numbers."""

    indices: tuple[int, int, int]
    """Index of the column of x, of y and of z, from 0."""
    degrees: bool = False
    """Whether x and y are longitude and latitude."""
    depth: bool = False
    """Whether z is a depth below the water's surface."""
    heights: bool = False
    """Whether z is vertical, by its own name or because x and y are map coordinates."""


def axis_columns(names: Sequence[str]) -> AxisColumns | None:
    """Finds the columns of x, y and z by their names, which are lower-case and without units.

    The names of x and y must come from one family, so that no longitude is paired with a northing.

    Returns:
        None if an axis has no column, or several whose names are equally plain.
    """
    x_columns, y_columns, z_columns = (
        {family: _columns_of_axis(names, family, axis) for family in NameFamily} for axis in _XYZ
    )
    across = next((family for family in _HORIZONTAL_FAMILIES if x_columns[family] and y_columns[family]), None)
    upward = next((family for family in _VERTICAL_FAMILIES
                   if z_columns[family] and (family != NameFamily.MAP or across == NameFamily.MAP)), None)  # fmt: skip
    if across is None or upward is None:
        return None
    candidates = (x_columns[across], y_columns[across], z_columns[upward])
    if any(len(columns) != 1 for columns in candidates):
        return None
    x, y, z = (columns[0] for columns in candidates)
    heights = across in (NameFamily.MAP, NameFamily.DEGREES) or upward in (NameFamily.HEIGHT, NameFamily.DEPTH)
    return AxisColumns((x, y, z), across == NameFamily.DEGREES, upward == NameFamily.DEPTH, heights)


def _columns_of_axis(names: Sequence[str], family: NameFamily, axis: str) -> list[int]:
    """Indices of the columns whose name stands for that axis in that family."""
    return [index for index, name in enumerate(names) if _axis_of_name(name, family) == axis]


def _axis_of_name(name: str, family: NameFamily) -> str | None:
    """``x``, ``y`` or ``z`` if the name stands for that axis in that family; otherwise None."""
    match family:
        case NameFamily.PLAIN:
            return name if name in ("x", "y", "z") else None
        case NameFamily.POINT_VECTOR:
            return _axis_of_vector_component(name)
        case NameFamily.MAP:
            return next((axis for axis, axis_names in _MAP_NAMES.items() if name in axis_names), None)
        case NameFamily.DEGREES:
            return "x" if name in _LONGITUDE_NAMES else "y" if name in _LATITUDE_NAMES else None
        case NameFamily.HEIGHT:
            return "z" if name in _HEIGHT_NAMES else None
        case NameFamily.DEPTH:
            return "z" if name in _DEPTH_NAMES else None


def _axis_of_vector_component(name: str) -> str | None:
    parts = _POINT_AXIS.fullmatch(name)
    if parts is None:
        return None
    axis = parts[1] or parts[2]
    return axis if axis in _XYZ else _XYZ[int(axis)]
