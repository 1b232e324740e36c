"""Recognizes notations of points that are not read, and gives advice on each."""

from __future__ import annotations

import re
from collections.abc import Sequence

_DEGREE_NAMES = {"lat", "latitude", "lon", "long", "lng", "longitude"}
"""Names of columns that hold degrees."""
_WKT_GEOMETRY = re.compile(r"\b(?:POINT|MULTIPOINT)\s*(?:Z|M|ZM)?\s*\(", re.IGNORECASE)
_SEXAGESIMAL_ANGLE = re.compile(r"\d\s*[°º]\s*\d+(?:[.,]\d+)?\s*['′]")
_POLAR_NAMES = (
    {"range", "r", "rho", "distance", "radius", "dist"},
    {"azimuth", "theta", "az", "bearing", "hz", "longitude"},
)
"""Names of the radius and of the azimuth in polar coordinates about the scanner."""
_BRACKETED_NUMBERS = re.compile(r"\s*[(\[{]+\s*[-+]?[\d.]+[^)\]}]*[)\]}]")
_THOUSANDS_SEPARATORS = re.compile(
    r"(?<![\d.,])[-+]?\d{1,3}([.,'\u00a0\u202f\u2019])\d{3}(?:\1\d{3})*(?!\1)[.,]\d+(?![\d.,])"
)
"""A number with a thousands separator and a different decimal separator."""


def notation_message(lines: Sequence[str]) -> str:
    """Advice if the first line, or one of `lines`, has points in a notation that is not read; otherwise empty."""
    if any(map(_WKT_GEOMETRY.search, lines)):
        return ("its points are written as geometry (WKT), which z2p does not read; export x, y and z as columns, as "
                "QGIS does with the geometry AS_XYZ, and PostGIS with ST_X, ST_Y and ST_Z")
    line = lines[0]
    if _BRACKETED_NUMBERS.match(line):
        return f"its numbers stand in brackets ({line.strip()[:40]}); take the brackets out of the file"
    if _SEXAGESIMAL_ANGLE.search(line):
        return "its angles are in degrees, minutes and seconds; export them as degrees with decimals, or as metres"
    words = set(re.split(r"[^a-z]+", line.lower()))
    if all(words & names for names in _POLAR_NAMES) and not {"x", "y", "z"} <= words:
        return ("it names a distance and angles from the scanner, not x, y and z; export those, or compute x = r "
                "cos(el) cos(az), y = r cos(el) sin(az) and z = r sin(el)")
    if number := _THOUSANDS_SEPARATORS.search(line):
        return f"{number[0]!r} has marks between its thousands; export the numbers without them"
    return ""


def missing_height_hint(title: str) -> str:
    """Advice on a title that names latitude or longitude without one clear height; empty for other titles."""
    if not _DEGREE_NAMES & set(re.split(r"[^a-z]+", title.lower())):
        return ""
    return "; beside longitude and latitude one column has to be called height, altitude or depth"
