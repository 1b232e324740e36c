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

_LINE = Text("a text", r"(?s:.*)", maximum=10_000)  # files may have a newline in their names
_SIZE = Number(-1e150, 1e150)
_WHOLE = Count(0, 1 << 50)
_ROW = ListOf(Number(-2, 2), 3, 3)
CAMERA = JsonObject(
    {"centre": ListOf(_SIZE, 3, 3), "radius": Number(0, 1e150, exclude_minimum=True), "rotation": ListOf(_ROW, 3, 3),
     "elevation": Number(-90, 90)},
    {"floor": OrNone(_SIZE), "distance": _SIZE, "field_of_view": _SIZE},
)  # fmt: skip
_STANCE = JsonObject(
    {},
    {"up": _LINE, "up_reason": _LINE, "view_reason": _LINE, "hint": _LINE, "azimuth": OrNone(_SIZE),
     "elevation": OrNone(_SIZE), "outliers": _WHOLE, "outside": _WHOLE, "background": _WHOLE, "added": _WHOLE,
     "far": _WHOLE, "rounded": _SIZE, "smooth": _SIZE, "turned": _SIZE},
)  # fmt: skip
_PLACING = JsonObject(
    {},
    {"up": OrNone(AnyOf((_LINE, ListOf(_SIZE, 3, 3)))), "view": OrNone(AnyOf((_LINE, _SIZE, ListOf(_SIZE, 2, 2)))),
     "azimuth": _SIZE, "keep_outliers": Boolean(),
     "cut_top": Number(0, 100), "smooth": OrNone(AnyOf((_LINE, _SIZE)))},
)  # fmt: skip
_INPUT = JsonObject({}, {"name": OrNone(_LINE), "path": OrNone(_LINE), "sha256": _LINE, "cloud": _WHOLE,
                   "columns": OrNone(ListOf(_LINE, 0, 100))})  # fmt: skip
_PARTS: dict[str, Any] = {
    "version": _LINE,
    "input": _INPUT,
    "camera": CAMERA,
    "controls": MappingOf(ListOf(Number(-1e6, 1e6), 1, 100)),
    "weights": JsonObject({}, {"name": _LINE, "sha256": _LINE}),
    "weights_chosen": Boolean(),
    "engine": _LINE,
    "resolution": ListOf(Count(1, 1 << 20), 2, 2),
    "background": AnyOf((Choice(("transparent",)), ListOf(Number(0, 1), 3, 3))),
    "supersample": Count(1, 16),
    "fit": Choice(("frame", "tight")),
    "margin": OrNone(AnyOf((Number(-1, 1), _LINE))),
    "placing": _PLACING,
    "stance": _STANCE,
    "window": ListOf(_SIZE, 4, 4),
    "motion": MappingOf(AnyOf((_LINE, Boolean(), _SIZE))),
    "batch": Count(1, 1 << 30),
}
RECORD = JsonObject({"record": Count(1, 1)}, _PARTS)
_COMPLETE = JsonObject({
    **{name: _PARTS[name] for name in ("version", "camera", "controls", "resolution", "background", "supersample",
                                       "fit", "placing")},
    "input": JsonObject({"name": OrNone(_LINE), "sha256": _LINE, "cloud": _WHOLE}),
    "weights": JsonObject({"name": _LINE, "sha256": _LINE}),
    "stance": JsonObject({"up": _LINE, "up_reason": _LINE, "azimuth": _SIZE, "view_reason": _LINE, "outliers": _WHOLE,
                    "background": _WHOLE}),
})  # fmt: skip
"""What a picture is drawn again by; parts that came later are missed by nobody."""


def record_fault(record: Any, *, complete: bool = False) -> str:
    """What cannot be about a record, in words; empty where all is well. `complete` asks for all that it takes to draw
    the picture again."""
    try:
        check_value(record, RECORD, "")
        if complete:
            check_value(record, _COMPLETE, "")
            if record["input"]["name"] is not None:
                check_value(record["input"], JsonObject({"path": OrNone(_LINE)}), "input")
    except LimitError as error:
        return str(error)
    return ""
