"""What values may be: limits that tell what was expected, for every field of settings, and every key of JSON objects.

A table names a limit for each field or key; `check_fields` compares, and refuses with the key, what was expected and what
came. One mechanism serves configurations, the cards of weights, pictures' records and cameras. It is our own, as its
messages are those of settings, and libraries for schemas cost a start of 25 to 66 ms (msgspec, jsonschema) beside the
quarter of a second that a picture takes.
"""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol

MAX_SHOWN_CHARACTERS = 60
"""Characters of a value that a message shows."""


class LimitError(ValueError):
    """A value outside its limits; the message names the key, what was expected and what came."""

    def __init__(self, message: str, limit: Limit | DataclassFields | JsonObject) -> None:
        super().__init__(message)
        self.limit = limit


class Limit(Protocol):
    """What one value may be."""

    @property
    def expected(self) -> str:
        """In words, as they follow "expected"."""

    def holds(self, value: Any) -> bool:
        """Whether a value is within the limit; never an error."""


@dataclass(eq=False, repr=False)
class Number:
    """A finite number in a range."""

    least: float
    most: float
    above: bool = False
    """Whether the least itself is left out."""

    @property
    def expected(self) -> str:
        start = f"above {self.least:g} and" if self.above else f"from {self.least:g}"
        return f"a number {start} {'up to' if self.above else 'to'} {self.most:g}"

    def holds(self, value: Any) -> bool:
        if isinstance(value, bool) or not isinstance(value, int | float):
            return False
        return self.least <= value <= self.most and math.isfinite(value) and not (self.above and value == self.least)


@dataclass(eq=False, repr=False)
class Count:
    """A whole number in a range."""

    least: int
    most: int

    @property
    def expected(self) -> str:
        return f"a whole number from {self.least:,} to {self.most:,}"

    def holds(self, value: Any) -> bool:
        return type(value) is int and self.least <= value <= self.most


@dataclass(eq=False, repr=False)
class Choice:
    """One of some names."""

    names: tuple[str, ...]

    @property
    def expected(self) -> str:
        return f"one of {', '.join(name or repr(name) for name in self.names)}"

    def holds(self, value: Any) -> bool:
        return isinstance(value, str) and value in self.names


@dataclass(eq=False, repr=False)
class Text:
    """A line of text that a pattern fits as a whole."""

    expected: str
    pattern: str = r"[^\x00-\x1f\x7f]*"
    most: int = 4096

    def holds(self, value: Any) -> bool:
        return isinstance(value, str) and len(value) <= self.most and re.fullmatch(self.pattern, value) is not None


@dataclass(eq=False, repr=False)
class Boolean:
    """True or false."""

    expected: str = "true or false"

    def holds(self, value: Any) -> bool:
        return type(value) is bool


@dataclass(eq=False, repr=False)
class OrNone:
    """Nothing, or what another limit holds."""

    limit: Limit | JsonObject

    @property
    def expected(self) -> str:
        return f"{self.limit.expected}, or none"

    def holds(self, value: Any) -> bool:
        return value is None or self.limit.holds(value)


@dataclass(eq=False, repr=False)
class AnyOf:
    """What any of some limits holds."""

    limits: tuple[Limit, ...]

    @property
    def expected(self) -> str:
        return " or ".join(limit.expected for limit in self.limits)

    def holds(self, value: Any) -> bool:
        return any(_is_within(limit, value) for limit in self.limits)


@dataclass(eq=False, repr=False)
class ListOf:
    """A list of so many values, each within a limit."""

    limit: Limit | JsonObject
    least: int = 0
    most: int = 1000
    distinct: bool = False

    @property
    def expected(self) -> str:
        number = f"{self.least:,}" if self.least == self.most else f"{self.least:,} to {self.most:,}"
        return f"a list of {number}{' different' * self.distinct} values"

    def holds(self, value: Any) -> bool:
        if not isinstance(value, list | tuple) or not self.least <= len(value) <= self.most:
            return False
        return not self.distinct or len(set(map(repr, value))) == len(value)


@dataclass(eq=False, repr=False)
class DataclassFields:
    """Another dataclass, with a table of its own."""

    limits: Mapping[str, Limit | DataclassFields]
    expected: str = "a table"

    def holds(self, value: Any) -> bool:
        return dataclasses.is_dataclass(value)


@dataclass(eq=False, repr=False)
class JsonObject:
    """A JSON object: some keys that must be there, some that may be; others are let through."""

    required: Mapping[str, Limit | DataclassFields | JsonObject]
    optional: Mapping[str, Limit | DataclassFields | JsonObject] = dataclasses.field(default_factory=dict)
    expected: str = "an object"

    def holds(self, value: Any) -> bool:
        return isinstance(value, Mapping)


@dataclass(eq=False, repr=False)
class MappingOf:
    """A JSON object of any keys, up to some, whose values are all within one limit."""

    limit: Limit | JsonObject
    most: int = 1000
    expected: str = "an object"

    def holds(self, value: Any) -> bool:
        return isinstance(value, Mapping) and len(value) <= self.most


def check_fields(settings: Any, limits: Mapping[str, Limit | DataclassFields], prefix: str = "") -> None:
    """Nothing, when every field of a dataclass is within its limit.

    Raises:
        LimitError: one is not; its key is told with `prefix` before it.
    """
    for field in dataclasses.fields(settings):
        check_value(getattr(settings, field.name), limits[field.name], prefix + field.name)


def check_value(value: Any, limit: Limit | DataclassFields | JsonObject, key: str) -> None:
    """Nothing, when a value is within its limit, and all that it holds.

    Raises:
        LimitError: it is not; what is wrong is told with `key` before it.
    """
    if not limit.holds(value):
        raise LimitError(f"{key}: expected {limit.expected}, got {describe_value(value)}".removeprefix(": "), limit)
    if isinstance(limit, OrNone) and value is not None:
        check_value(value, limit.limit, key)
    if isinstance(limit, DataclassFields):
        check_fields(value, limit.limits, f"{key}.")
    if isinstance(limit, ListOf):
        for index, item in enumerate(value):
            check_value(item, limit.limit, f"{key}[{index}]")
    if isinstance(limit, MappingOf):
        for name, item in value.items():
            check_value(item, limit.limit, f"{key}.{describe_value(name).strip(chr(39))}")
    if isinstance(limit, JsonObject):
        _check_keys(value, limit, key)


def _is_within(limit: Limit, value: Any) -> bool:
    """Whether a value is within a limit, and all that it holds."""
    try:
        check_value(value, limit, "")
    except LimitError:
        return False
    return True


def _check_keys(value: Mapping[str, Any], limit: JsonObject, key: str) -> None:
    before = f"{key}." if key else ""
    for name, one in limit.required.items():
        if name not in value:
            raise LimitError(f"{before}{name}: expected {one.expected}, got none", one)
        check_value(value[name], one, before + name)
    for name, one in limit.optional.items():
        if name in value:
            check_value(value[name], one, before + name)


def describe_value(value: Any) -> str:
    """A value for a message, shortened: it may hold millions of digits."""
    if isinstance(value, int) and not isinstance(value, bool) and value.bit_length() > 200:
        return f"a number of {int(value.bit_length() * math.log10(2)):,} digits"
    try:
        text = repr(list(value) if isinstance(value, tuple) else value)
    except (ValueError, RecursionError):
        return f"a {type(value).__name__}"
    return text if len(text) <= MAX_SHOWN_CHARACTERS else f"{text[:MAX_SHOWN_CHARACTERS]}..."
