"""Limits of the values in a picture's record, key by key: pictures may come from anywhere, and be edited by hand."""

from __future__ import annotations

from typing import Any

from z2p_core.errors.value_limits import (
    AnyOf,
    Boolean,
    Choice,
    Count,
    JsonObject,
    LimitError,
    ListOf,
    MappingOf,
    Number,
    OrNone,
    Text,
    check_value,
)

_TEXT = Text("a text", r"(?s:.*)", maximum=10_000)  # files may have a newline in their names
_NUMBER = Number(-1e150, 1e150)
"""Squares of such numbers stay finite."""
_COUNT = Count(0, 1 << 50)
_VECTOR = ListOf(_NUMBER, 3, 3)
_MATRIX = ListOf(ListOf(Number(-2, 2), 3, 3), 3, 3)

CAMERA_LIMITS = JsonObject(
    {
        "centre": _VECTOR,
        "radius": Number(0, 1e150, exclude_minimum=True),
        "rotation": _MATRIX,
        "elevation": Number(-90, 90),
    },
    {"floor": OrNone(_NUMBER), "distance": _NUMBER, "field_of_view": _NUMBER},
)
_STANCE = JsonObject({}, {
    **dict.fromkeys(("up", "up_reason", "view_reason", "hint"), _TEXT),
    **dict.fromkeys(("azimuth", "elevation"), OrNone(_NUMBER)),
    **dict.fromkeys(("outliers", "outside", "background", "added", "far"), _COUNT),
    **dict.fromkeys(("rounded", "smooth", "turned"), _NUMBER),
})  # fmt: skip
_PLACING = JsonObject({}, {
    "up": OrNone(AnyOf((_TEXT, _VECTOR))),
    "view": OrNone(AnyOf((_TEXT, _NUMBER, ListOf(_NUMBER, 2, 2)))),
    "azimuth": _NUMBER,
    "keep_outliers": Boolean(),
    "cut_top": Number(0, 100),
    "smooth": OrNone(AnyOf((_TEXT, _NUMBER))),
})  # fmt: skip
_INPUT = JsonObject({}, {
    "name": OrNone(_TEXT),
    "path": OrNone(_TEXT),
    "sha256": _TEXT,
    "cloud": _COUNT,
    "columns": OrNone(ListOf(_TEXT, 0, 100)),
})  # fmt: skip
_PARTS: dict[str, Any] = {
    "version": _TEXT,
    "color_by": _TEXT,
    "input": _INPUT,
    "camera": CAMERA_LIMITS,
    "controls": MappingOf(ListOf(Number(-1e6, 1e6), 1, 100)),
    "weights": JsonObject({}, {"name": _TEXT, "sha256": _TEXT}),
    "weights_chosen": Boolean(),
    "engine": _TEXT,
    "resolution": ListOf(Count(1, 1 << 20), 2, 2),
    "background": AnyOf((Choice(("transparent",)), ListOf(Number(0, 1), 3, 3))),
    "supersample": Count(1, 16),
    "fit": Choice(("frame", "tight")),
    "margin": OrNone(AnyOf((Number(-1, 1), _TEXT))),
    "placing": _PLACING,
    "stance": _STANCE,
    "window": ListOf(_NUMBER, 4, 4),
    "motion": MappingOf(AnyOf((_TEXT, Boolean(), _NUMBER))),
    "batch": Count(1, 1 << 30),
    "pinhole": MappingOf(AnyOf((_TEXT, _NUMBER, _VECTOR, ListOf(_VECTOR, 3, 3)))),
    "pinhole_wish": MappingOf(AnyOf((_TEXT, Boolean(), OrNone(_NUMBER), _VECTOR, ListOf(_VECTOR, 3, 3)))),
    "without_network": _TEXT,
    "dpi": Number(0, 1e6, exclude_minimum=True),
    "scale_bar": Boolean(),
    "axes": Boolean(),
    "unit": _TEXT,
}
RECORD_LIMITS = JsonObject({"record": Count(1, 1)}, _PARTS)
_REDRAWABLE_LIMITS = JsonObject({
    **{name: _PARTS[name] for name in ("version", "camera", "controls", "resolution", "background", "supersample",
                                       "fit", "placing")},
    "input": JsonObject({"name": OrNone(_TEXT), "sha256": _TEXT, "cloud": _COUNT}),
    "weights": JsonObject({"name": _TEXT, "sha256": _TEXT}),
    "stance": JsonObject({
        **dict.fromkeys(("up", "up_reason", "view_reason"), _TEXT),
        "azimuth": _NUMBER,
        **dict.fromkeys(("outliers", "background"), _COUNT),
    }),
})  # fmt: skip
"""The parts that drawing a picture again needs; newer parts are optional, for older pictures lack them."""


def record_fault(record: Any, *, complete: bool = False) -> str:
    """What is wrong with a record, in words; empty if it is valid.

    `complete` also requires all parts that drawing the picture again needs.
    """
    try:
        check_value(record, RECORD_LIMITS, "")
        if complete:
            check_value(record, _REDRAWABLE_LIMITS, "")
            if record["input"]["name"] is not None:
                check_value(record["input"], JsonObject({"path": OrNone(_TEXT)}), "input")
    except LimitError as error:
        return str(error)
    return ""
