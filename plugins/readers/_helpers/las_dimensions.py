"""Dimensions of LAS points: their values, units, and the names of classes."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any

import numpy as np

_CLASS_NAMES = {
    0: "never classified", 1: "unclassified", 2: "ground", 3: "low vegetation", 4: "medium vegetation",
    5: "high vegetation", 6: "building", 7: "low noise", 8: "model key-point", 9: "water", 10: "rail",
    11: "road surface", 12: "overlap", 13: "wire guard", 14: "wire conductor", 15: "transmission tower",
    16: "wire-structure connector", 17: "bridge deck", 18: "high noise", 19: "overhead structure",
    20: "ignored ground", 21: "snow", 22: "temporal exclusion",
}  # fmt: skip
"""Classes of the ASPRS in LAS 1.4, R15."""
_LEGACY_CLASSES = range(13)
"""Classes that point formats 0 to 5 define."""
_UNITS = {"gps_time": "s", "scan_angle": "degrees", "scan_angle_rank": "degrees"}
_SCAN_ANGLE_STEP_DEGREES = 0.006
"""What one step of the scan angle of point formats 6 to 10 is."""
_GROUPS = {"intensity": "INTENSITY", "scan_angle": "SCAN_ANGLE", "user_data": "USER_DATA", "gps_time": "GPS_TIME",
           "point_source_id": "POINT_SOURCE_ID", "red": "RGB", "green": "RGB", "blue": "RGB", "nir": "NIR",
           "wavepacket_index": "WAVEPACKET", "wavepacket_offset": "WAVEPACKET", "wavepacket_size": "WAVEPACKET",
           "return_point_wave_location": "WAVEPACKET", "x_t": "WAVEPACKET", "y_t": "WAVEPACKET",
           "z_t": "WAVEPACKET"}  # fmt: skip
"""The layer of a packed file that holds a dimension, as laspy calls it."""
_ALWAYS = {"X": "XY_RETURNS_CHANNEL", "Y": "XY_RETURNS_CHANNEL", "return_number": "XY_RETURNS_CHANNEL", "Z": "Z",
           "number_of_returns": "XY_RETURNS_CHANNEL", "scanner_channel": "XY_RETURNS_CHANNEL",
           "classification": "CLASSIFICATION", "synthetic": "FLAGS", "key_point": "FLAGS", "withheld": "FLAGS",
           "overlap": "FLAGS", "scan_direction_flag": "FLAGS", "edge_of_flight_line": "FLAGS"}  # fmt: skip
"""The layers of places, and of what tells noise."""


def selected_dimensions(laspy: Any, names: Iterable[str], wants: Callable[[str], bool]) -> Any:
    """The layers of a packed file (point formats 6 to 10) to unpack for those of the dimensions that are wanted."""
    layers = {*_ALWAYS.values()}
    for name in names:
        is_color = _GROUPS.get(name) == "RGB"
        if name not in _ALWAYS and (wants("rgb") if is_color else wants(name)):
            layers.add(_GROUPS.get(name, "ALL_EXTRA_BYTES"))
    selection = laspy.DecompressionSelection(0)
    for layer in layers:
        selection |= laspy.DecompressionSelection[layer]
    return selection


def dimension_values(chunk: Any, name: str) -> np.ndarray:
    """The values (N,) of a dimension of laspy's records; scan angles in degrees, extra bytes with their scale.

    Extra dimensions of several components give their first.
    """
    values = np.asarray(chunk[name])
    if name == "scan_angle":
        return values.astype(np.float32) * np.float32(_SCAN_ANGLE_STEP_DEGREES)
    return values if values.ndim == 1 else values[:, 0]


def dimension_units(names: Iterable[str]) -> Mapping[str, str]:
    """The units of those dimensions that have one."""
    return {name: _UNITS[name] for name in names if name in _UNITS}


def class_names(legacy: bool) -> Mapping[str, Mapping[int, str]]:
    """The names of the classes, for point formats below 6 if they are `legacy`."""
    known = {code: name for code, name in _CLASS_NAMES.items() if not legacy or code in _LEGACY_CLASSES}
    return {"classification": known}
