"""Points and fields of the single scans of an E57 file, by buffers that fit any of their numbers.

pye57 itself reads few fields, and colors of 8 bits alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from z2p_core.formats.color_values import srgb_from_numbers
from z2p_renderer.plugins.readers._helpers.lazy_import import import_lazily

_CARTESIAN = ("cartesianX", "cartesianY", "cartesianZ")
_SPHERICAL = ("sphericalRange", "sphericalAzimuth", "sphericalElevation")
_STATES = ("cartesianInvalidState", "sphericalInvalidState", "isColorInvalid", "isIntensityInvalid",
           "isTimeStampInvalid")  # fmt: skip
COLORS = ("colorRed", "colorGreen", "colorBlue")
NORMALS = ("nor:normalX", "nor:normalY", "nor:normalZ")
_INVALID_BY = {"isColorInvalid": COLORS, "isIntensityInvalid": ("intensity",), "isTimeStampInvalid": ("timeStamp",)}
UNITS = {"timeStamp": "s"}


def attribute_names(file: Any) -> list[str]:
    """Names of what the scans have of each point beside its place, in the file's order."""
    places = {*_CARTESIAN, *_SPHERICAL, *_STATES}
    names = (name for index in range(file.scan_count) for name in file.get_header(index).point_fields)
    return [name for name in dict.fromkeys(names) if name not in places]


def read_scan(file: Any, index: int, wanted: Sequence[str]) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Points (N, 3) float64 of a scan in the file's common axes, and the wanted values (N,) that it has.

    Points that are marked invalid are left out; other values that are become NaN.
    """
    header = file.get_header(index)
    is_cartesian = all(name in header.point_fields for name in _CARTESIAN)
    places = _CARTESIAN if is_cartesian else _SPHERICAL
    invalid_state = "cartesianInvalidState" if is_cartesian else "sphericalInvalidState"
    states = [invalid_state, *(state for state, names in _INVALID_BY.items() if set(names) & set(wanted))]
    values = _read_buffers(file, header, [*places, *wanted, *states])
    points = np.column_stack([values.pop(name) for name in places])
    if not is_cartesian:
        points = import_lazily("pye57.utils").convert_spherical_to_cartesian(points)
    if header.has_pose():
        points = file.to_global(points, header.rotation, header.translation)
        if set(NORMALS) <= values.keys():
            turned = np.column_stack([values[name] for name in NORMALS]) @ header.rotation_matrix.T
            values.update(zip(NORMALS, turned.T, strict=True))
    valid = values.pop(invalid_state, np.zeros(len(points))) == 0
    for state in states[1:]:
        is_invalid = values.pop(state, np.zeros(len(points))) != 0
        for name in _INVALID_BY[state]:
            if name in values and is_invalid.any():
                values[name] = np.where(is_invalid, np.nan, values[name])
    return points[valid], {name: column[valid] for name, column in values.items()}


def scan_colors(file: Any, index: int, values: dict[str, np.ndarray]) -> tuple[np.ndarray, str]:
    """sRGB colors (N, 3) float32 of a scan by the limits that it tells, and their kind; removes them from `values`."""
    numbers = np.column_stack([values.pop(name) for name in COLORS])
    full = _full_color(file.get_header(index))
    known = numbers[np.isfinite(numbers)]
    if full is None or not len(known) or known.max() > full or known.min() < 0:
        return srgb_from_numbers(numbers)
    kind = "shares of 1" if full <= 1 else f"{int(full).bit_length()}-bit"
    return (numbers / full).astype(np.float32), kind


def _full_color(header: Any) -> float | None:
    """The number that stands for full intensity: 1, 255, 1023, 4095 or 65535; None if the scan tells none of these."""
    try:
        full = float(header["colorLimits"]["colorRedMaximum"].value())
    except Exception:  # the library raises errors of its own for what is missing
        return None
    is_full = full == 1 or (full >= 255 and full == int(full) and (int(full) & (int(full) + 1)) == 0)
    return full if is_full else None


def _read_buffers(file: Any, header: Any, names: Sequence[str]) -> dict[str, np.ndarray]:
    """The values (N,) of those of the fields that the scan has."""
    library = import_lazily("pye57.libe57")
    prototype = library.StructureNode(header.points.prototype())
    buffers, arrays = library.VectorSourceDestBuffer(), {}
    for name in names:
        if name in header.point_fields:
            array = np.empty(header.point_count, _buffer_type(library, prototype, name))
            buffers.append(library.SourceDestBuffer(file.image_file, name, array, header.point_count, True, True))
            arrays[name] = array
    header.points.reader(buffers).read()
    return arrays


def _buffer_type(library: Any, prototype: Any, name: str) -> str:
    """The numpy type of a field's buffer: 64 bits, which hold all of its numbers; 32 for those that need no more."""
    if name in (*_CARTESIAN, *_SPHERICAL):
        return "d"
    if name in COLORS or name in _STATES:
        return "f"
    node = prototype[name]
    if isinstance(node, library.IntegerNode):
        return "q"  # not "l": pye57 takes that for 32 bits, as it is on Windows alone
    is_single = isinstance(node, library.FloatNode) and node.precision() == library.FloatPrecision.E57_SINGLE
    return "f" if is_single else "d"
