"""What the card of weights holds, key by key: strangers write cards too."""

from __future__ import annotations

from z2p_core.errors.value_limits import (
    AnyOf,
    Boolean,
    Count,
    DataclassFields,
    JsonObject,
    Limit,
    ListOf,
    Number,
    OrNone,
    Text,
)
from z2p_core.network.tensor_shapes import SIZE_LIMITS

_NAME = Text("the name of a plugin", r"[^\x00-\x1f\x7f]{1,200}")
_VERSION = Text("a version", r"[^\x00-\x1f\x7f]{1,200}")
_PLUGIN = JsonObject({"name": _NAME, "version": _VERSION})

NETWORK: dict[str, Limit | DataclassFields] = {
    "kind": Text("the name of a network", r"\w{1,100}"),
    **SIZE_LIMITS,
    "zbuffer": _NAME,
    "gbuffer": _NAME,
    "encoder": _NAME,
    "conditions": ListOf(_NAME, 0, 100),
}
"""Of the network that a card describes: absurd sizes are refused before anything is made of them."""

CARD = JsonObject(
    {
        "network": JsonObject({}, NETWORK),
        "zbuffer": _PLUGIN,
        "gbuffer": _PLUGIN,
        "encoder": JsonObject({"name": _NAME, "version": _VERSION, "state": JsonObject({})}),
        "controls": ListOf(JsonObject({"name": _NAME, "version": _VERSION, "size": Count(1, 1000)}), 1, 100),
        "resolution": AnyOf((Count(1, 65_536), ListOf(Count(1, 65_536), 1, 1000))),
        "fixed_elevation": OrNone(Number(-90, 90)),
        "training": JsonObject({}, {"cropped": Boolean()}),
    },
    {"conditions": ListOf(_PLUGIN, 0, 100)},
)
