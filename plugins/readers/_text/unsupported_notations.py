"""Ways to write points that are no numbers in columns, and what to do about each."""

from __future__ import annotations

import re
from collections.abc import Sequence

_DEGREE_NAMES = {"lat", "latitude", "lon", "long", "lng", "longitude"}
"""Names of columns that hold degrees."""
_WKT_GEOMETRY = re.compile(r"\b(?:POINT|MULTIPOINT)\s*(?:Z|M|ZM)?\s*\(", re.IGNORECASE)
_SEXAGESIMAL_ANGLE = re.compile(r"\d\s*[°º]\s*\d+(?:[.,]\d+)?\s*['′]")
_POLAR_NAMES = ({"range", "r", "rho", "distance", "radius", "dist"}, {"azimuth", "theta", "az", "bearing", "hz", "longitude"})
"""Names of a distance from the scanner and of an angle about it."""
_BRACKETED_NUMBERS = re.compile(r"\s*[(\[{]+\s*[-+]?[\d.]+[^)\]}]*[)\]}]")
_THOUSANDS_SEPARATORS = re.compile(r"(?<![\d.,])[-+]?\d{1,3}([.,'\u00a0\u202f\u2019])\d{3}(?:\1\d{3})*(?!\1)[.,]\d+(?![\d.,])")
"""A number with a mark behind its thousands and another one before its decimals."""


def notation_message(lines: Sequence[str]) -> str:
    """What is wrong with a line, and what to do, where it or the next one writes points in a way of its own."""
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
        return ("it names a distance and angles from the scanner, not x, y and z; export those, or reckon x = r "
                "cos(el) cos(az), y = r cos(el) sin(az) and z = r sin(el)")
    if number := _THOUSANDS_SEPARATORS.search(line):
        return f"{number[0]!r} has marks between its thousands; export the numbers without them"
    return ""


def missing_height_hint(title: str) -> str:
    """What to say of a line that names latitude and longitude, but no height or several."""
    if not _DEGREE_NAMES & set(re.split(r"[^a-z]+", title.lower())):
        return ""
    return "; beside longitude and latitude one column has to be called height, altitude or depth"
