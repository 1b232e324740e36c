"""What the record inside a picture holds, key by key: pictures come from strangers, and records are edited by hand."""

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
_COORDINATE = Number(-1e150, 1e150)
_COUNT = Count(0, 1 << 50)
_ROTATION_ROW = ListOf(Number(-2, 2), 3, 3)
CAMERA_LIMITS = JsonObject(
    {"centre": ListOf(_COORDINATE, 3, 3), "radius": Number(0, 1e150, exclude_minimum=True), "rotation": ListOf(_ROTATION_ROW, 3, 3),
     "elevation": Number(-90, 90)},
    {"floor": OrNone(_COORDINATE), "distance": _COORDINATE, "field_of_view": _COORDINATE},
)  # fmt: skip
_STANCE = JsonObject(
    {},
    {"up": _TEXT, "up_reason": _TEXT, "view_reason": _TEXT, "hint": _TEXT, "azimuth": OrNone(_COORDINATE),
     "elevation": OrNone(_COORDINATE), "outliers": _COUNT, "outside": _COUNT, "background": _COUNT, "added": _COUNT,
     "far": _COUNT, "rounded": _COORDINATE, "smooth": _COORDINATE, "turned": _COORDINATE},
)  # fmt: skip
_PLACING = JsonObject(
    {},
    {"up": OrNone(AnyOf((_TEXT, ListOf(_COORDINATE, 3, 3)))), "view": OrNone(AnyOf((_TEXT, _COORDINATE, ListOf(_COORDINATE, 2, 2)))),
     "azimuth": _COORDINATE, "keep_outliers": Boolean(),
     "cut_top": Number(0, 100), "smooth": OrNone(AnyOf((_TEXT, _COORDINATE)))},
)  # fmt: skip
_INPUT = JsonObject({}, {"name": OrNone(_TEXT), "path": OrNone(_TEXT), "sha256": _TEXT, "cloud": _COUNT,
                   "columns": OrNone(ListOf(_TEXT, 0, 100))})  # fmt: skip
_PARTS: dict[str, Any] = {
    "version": _TEXT,
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
    "window": ListOf(_COORDINATE, 4, 4),
    "motion": MappingOf(AnyOf((_TEXT, Boolean(), _COORDINATE))),
    "batch": Count(1, 1 << 30),
}
RECORD_LIMITS = JsonObject({"record": Count(1, 1)}, _PARTS)
_REDRAWABLE_LIMITS = JsonObject({
    **{name: _PARTS[name] for name in ("version", "camera", "controls", "resolution", "background", "supersample",
                                       "fit", "placing")},
    "input": JsonObject({"name": OrNone(_TEXT), "sha256": _TEXT, "cloud": _COUNT}),
    "weights": JsonObject({"name": _TEXT, "sha256": _TEXT}),
    "stance": JsonObject({"up": _TEXT, "up_reason": _TEXT, "azimuth": _COORDINATE, "view_reason": _TEXT, "outliers": _COUNT,
                    "background": _COUNT}),
})  # fmt: skip
"""What a picture is drawn again by; parts that came later are missed by nobody."""


def record_fault(record: Any, *, complete: bool = False) -> str:
    """What cannot be about a record, in words; empty where all is well. `complete` asks for all that it takes to draw
    the picture again."""
    try:
        check_value(record, RECORD_LIMITS, "")
        if complete:
            check_value(record, _REDRAWABLE_LIMITS, "")
            if record["input"]["name"] is not None:
                check_value(record["input"], JsonObject({"path": OrNone(_TEXT)}), "input")
    except LimitError as error:
        return str(error)
    return ""
