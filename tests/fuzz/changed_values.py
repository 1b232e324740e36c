"""Nested values, as JSON and TOML hold them, changed at random: other kinds, other numbers, more or less of them."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from typing import Any

import numpy as np

Place = tuple[Any, ...]
"""Keys and indices that lead to a value."""

DEEP, LONG, TWICE = "@deep@", "@long@", "@twice@"
"""Stand for what no value can be, and only a text can hold: see `json_text`."""
RAW = {DEEP: "[" * 100_000 + "]" * 100_000, LONG: "9" * 5_000, TWICE: '{"a": 1, "a": 2}'}
ODD: tuple[Any, ...] = (
    None, True, False, 0, -1, 1, 2, 3, 7, 100, 1000, 2**15, 2**31 - 1, 2**31, 2**32, 2**53 + 1, 2**63, -(2**63) - 1,
    2**64, 10**30, 10**400, 0.0, -0.0, 0.5, 1.5, -1.5, 1e-320, 1e-9, 1e9, 1e38, 1e154, 1e300, -1e300, math.nan,
    math.inf, -math.inf, "", " ", "x", "0", "nan", "1e5", "none", "../x", "/", ".", "a/b", "a\nb", "a\0b", "x" * 3000,
    "é\ud800", "train", "builtin", [], [[]], [0], [None], ["x"], [1.0, 2.0], [math.nan] * 3, [[1, 0, 0]] * 3,
    [0] * 2000, {}, {"": 0}, {"x": {"y": {}}}, {"name": "x"}, DEEP, LONG, TWICE,
)  # fmt: skip


def changed(value: Any, rng: np.random.Generator, times: int | None = None) -> Any:
    """A copy of the value with so many changes, a few by default."""
    for _ in range(int(rng.choice([1, 1, 1, 2, 4])) if times is None else times):
        places = list(_places(value))
        value = _with(value, places[rng.integers(len(places))], rng)
    return value


def json_text(value: Any) -> str:
    """The value as JSON, in which Python's own names stand for what is not finite, and `RAW` for what it stands for."""
    text = json.dumps(_speakable(value))
    for sign, raw in RAW.items():
        text = text.replace(json.dumps(sign), raw)
    return text


def plain(value: Any) -> Any:
    """The value without the stand-ins, for those who get it as it is: deep nesting in their place."""
    if isinstance(value, dict):
        return {key: plain(one) for key, one in value.items()}
    if isinstance(value, list):
        return [plain(one) for one in value]
    if value == DEEP and isinstance(value, str):
        deep: Any = 0
        for _ in range(150):
            deep = [deep]
        return deep
    return int(RAW[LONG][:4000]) if isinstance(value, str) and value == LONG else value


def odd(rng: np.random.Generator) -> Any:
    """A value that few expect."""
    return ODD[rng.integers(len(ODD))]


def _places(value: Any, here: Place = ()) -> Iterator[Place]:
    """Where values lie, the whole among them; of long lists a few."""
    yield here
    if isinstance(value, dict):
        for key, one in value.items():
            yield from _places(one, (*here, key))
    elif isinstance(value, list):
        for index, one in enumerate(value[:12]):
            yield from _places(one, (*here, index))


def _with(value: Any, place: Place, rng: np.random.Generator) -> Any:
    """A copy in which what lies at a place is another."""
    if not place:
        return _other(value, rng)
    first, *rest = place
    if isinstance(value, dict):
        if not rest and rng.random() < 0.15:
            return {key: one for key, one in value.items() if key != first}
        if not rest and rng.random() < 0.05:
            return {(f"{key}x" if key == first else key): one for key, one in value.items()}
        return {key: _with(one, tuple(rest), rng) if key == first else one for key, one in value.items()}
    return [_with(one, tuple(rest), rng) if index == first else one for index, one in enumerate(value)]


def _other(value: Any, rng: np.random.Generator) -> Any:
    """Another value in place of one, in half of the cases one like it."""
    if rng.random() < 0.5:
        return odd(rng)
    if isinstance(value, bool) or value is None:
        return odd(rng)
    if isinstance(value, int | float):
        if not abs(value) < 1e100:  # float() would fail
            return -value
        return [-value, value + 1, value - 1, value * 1000, value / 1000, float(value), str(value), [value],
                value * 1e200][rng.integers(9)]  # fmt: skip
    if isinstance(value, str):
        return [value + "x", value[:-1], value.upper(), value * 50, [value], {value: value}, len(value)][
            rng.integers(7)
        ]
    if isinstance(value, list):
        return [value[:-1], [*value, odd(rng)], value[::-1], value * 3, value[:1], dict(enumerate(map(str, value))),
        [value],
                value[0] if value else 0][rng.integers(8)]  # fmt: skip
    return [
        {**value, "more": odd(rng)},
        list(value.values()),
        list(value),
        {**value, **{str(k): odd(rng) for k in value}},
    ][rng.integers(4)]


def _speakable(value: Any) -> Any:
    """The same with whole numbers too long for Python's own writing in place by a stand-in."""
    if isinstance(value, dict):
        return {str(key): _speakable(one) for key, one in value.items()}
    if isinstance(value, list):
        return [_speakable(one) for one in value]
    return LONG if type(value) is int and value.bit_length() > 10_000 else value
