"""Points and fields of the single scans of an E57 file, by buffers that fit any of their numbers.

pye57 itself reads few fields, and colors of 8 bits alone.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from z2p_core.formats.color_values import srgb_from_numbers
from z2p_core.formats.row_subsampling import subsample_blocks
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


def read_scan(
    file: Any, index: int, wanted: Sequence[str], step: float, rng: np.random.Generator
) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Points (N, 3) float64 of a scan in the file's common axes, and the wanted values (N,) that it has.

    The scan is read in blocks. Of each `step` records one is kept at random. Points that are marked invalid are left
    out; other values that are become NaN.
    """
    header = file.get_header(index)
    blocks = [_usable_points(file, header, block, wanted) for block in _read_blocks(header, file, wanted, step, rng)]
    if not blocks:
        return np.empty((0, 3)), {}
    values = {name: np.concatenate([block[1][name] for block in blocks]) for name in blocks[0][1]}
    return np.concatenate([points for points, _ in blocks]), values


def _place_names(header: Any) -> tuple[tuple[str, ...], str]:
    """Names of the three coordinates of a scan, and of the state that tells which points are invalid."""
    is_cartesian = all(name in header.point_fields for name in _CARTESIAN)
    places = _CARTESIAN if is_cartesian else _SPHERICAL
    return places, "cartesianInvalidState" if is_cartesian else "sphericalInvalidState"


def _blocks(count: int, width: int, step: float, rng: np.random.Generator) -> list[tuple[int, np.ndarray]]:
    return list(subsample_blocks(count, width, rng, math.ceil(count / step))) if count else []


def _read_blocks(
    header: Any, file: Any, wanted: Sequence[str], step: float, rng: np.random.Generator
) -> Iterator[dict[str, np.ndarray]]:
    """What the records hold of each point: coordinates, wanted values and states, in blocks."""
    places, invalid_state = _place_names(header)
    states = [invalid_state, *(state for state, names in _INVALID_BY.items() if set(names) & set(wanted))]
    names = [*places, *wanted, *states]
    width = 8 * len(names)
    for rows, kept, values in _read_buffers(file, header, names, _blocks(header.point_count, width, step, rng)):
        yield {name: array[:rows].copy() if step == 1 else array[kept] for name, array in values.items()}


def _usable_points(
    file: Any, header: Any, values: dict[str, np.ndarray], wanted: Sequence[str]
) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """The points of a block in common axes, without those that are invalid, and their values."""
    places, invalid_state = _place_names(header)
    is_cartesian = places == _CARTESIAN
    states = [state for state in values if state in _STATES and state != invalid_state]
    points = np.column_stack([values.pop(name) for name in places])
    if not is_cartesian:
        points = import_lazily("pye57.utils").convert_spherical_to_cartesian(points)
    if header.has_pose():
        points = file.to_global(points, header.rotation, header.translation)
        if set(NORMALS) <= values.keys():
            turned = np.column_stack([values[name] for name in NORMALS]) @ header.rotation_matrix.T
            values.update(zip(NORMALS, turned.T, strict=True))
    valid = values.pop(invalid_state, np.zeros(len(points))) == 0
    for state in states:
        is_invalid = values.pop(state) != 0
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


def _read_buffers(
    file: Any, header: Any, names: Sequence[str], blocks: Sequence[tuple[int, np.ndarray]]
) -> Iterator[tuple[int, np.ndarray, dict[str, np.ndarray]]]:
    """Of each block its rows, those to keep, and buffers with the values of those of the fields that the scan has."""
    library = import_lazily("pye57.libe57")
    prototype = library.StructureNode(header.points.prototype())
    buffers, arrays = library.VectorSourceDestBuffer(), {}
    size = max([rows for rows, _ in blocks], default=1)
    for name in names:
        if name in header.point_fields:
            array = np.empty(size, _buffer_type(library, prototype, name))
            buffers.append(library.SourceDestBuffer(file.image_file, name, array, size, True, True))
            arrays[name] = array
    reader = header.points.reader(buffers)
    for rows, kept in blocks:
        came = reader.read()
        if came != rows:
            raise ValueError(f"{rows} records expected, {came} came")
        yield rows, kept, arrays
    reader.close()


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
