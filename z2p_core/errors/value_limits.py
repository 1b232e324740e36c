"""Limits of values: a small schema language for the fields of settings and the keys of JSON objects.

A table gives each field or key a limit; `check_fields` and `check_value` compare, and raise an error that names the
key, what was expected and the value. Configurations, cards of weights, records in pictures and cameras are checked in
this way. Schema libraries are not used because importing them takes 25 to 66 ms (msgspec, jsonschema), which is much
beside the quarter of a second that a picture takes.
"""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol

MAX_SHOWN_CHARACTERS = 60
"""Longer values are cut in messages."""


class LimitError(ValueError):
    """A value outside its limits; the message names the key, what was expected and the value."""

    def __init__(self, message: str, limit: Limit | DataclassFields | JsonObject) -> None:
        super().__init__(message)
        self.limit = limit


class Limit(Protocol):
    """The values that are allowed."""

    @property
    def expected(self) -> str:
        """The allowed values in words, as they follow "expected" in a message."""

    def allows(self, value: Any) -> bool:
        """Whether a value is within the limit; raises nothing, whatever the value is."""


@dataclass(eq=False, repr=False)
class Number:
    """A finite number in a range."""

    minimum: float
    maximum: float
    exclude_minimum: bool = False
    """Whether the minimum itself is outside the range."""

    @property
    def expected(self) -> str:
        start = f"above {self.minimum:g} and" if self.exclude_minimum else f"from {self.minimum:g}"
        return f"a number {start} {'up to' if self.exclude_minimum else 'to'} {self.maximum:g}"

    def allows(self, value: Any) -> bool:
        if isinstance(value, bool) or not isinstance(value, int | float):
            return False
        if not self.minimum <= value <= self.maximum or not math.isfinite(value):
            return False
        return not (self.exclude_minimum and value == self.minimum)


@dataclass(eq=False, repr=False)
class Count:
    """A whole number in a range."""

    minimum: int
    maximum: int

    @property
    def expected(self) -> str:
        return f"a whole number from {self.minimum:,} to {self.maximum:,}"

    def allows(self, value: Any) -> bool:
        return type(value) is int and self.minimum <= value <= self.maximum


@dataclass(eq=False, repr=False)
class Choice:
    """One of some names."""

    names: tuple[str, ...]

    @property
    def expected(self) -> str:
        return f"one of {', '.join(name or repr(name) for name in self.names)}"

    def allows(self, value: Any) -> bool:
        return isinstance(value, str) and value in self.names


@dataclass(eq=False, repr=False)
class Text:
    """A text that matches a pattern from its beginning to its end."""

    expected: str
    pattern: str = r"[^\x00-\x1f\x7f]*"
    maximum: int = 4096
    """Characters."""

    def allows(self, value: Any) -> bool:
        return isinstance(value, str) and len(value) <= self.maximum and re.fullmatch(self.pattern, value) is not None


@dataclass(eq=False, repr=False)
class Boolean:
    """True or false."""

    expected: str = "true or false"

    def allows(self, value: Any) -> bool:
        return type(value) is bool


@dataclass(eq=False, repr=False)
class OrNone:
    """None, or a value that another limit allows."""

    limit: Limit | JsonObject

    @property
    def expected(self) -> str:
        return f"{self.limit.expected}, or none"

    def allows(self, value: Any) -> bool:
        return value is None or self.limit.allows(value)


@dataclass(eq=False, repr=False)
class AnyOf:
    """A value that at least one of several limits allows."""

    limits: tuple[Limit, ...]

    @property
    def expected(self) -> str:
        return " or ".join(limit.expected for limit in self.limits)

    def allows(self, value: Any) -> bool:
        return any(_is_within(limit, value) for limit in self.limits)


@dataclass(eq=False, repr=False)
class ListOf:
    """A list or tuple of `minimum` to `maximum` values, each within one limit."""

    limit: Limit | JsonObject
    minimum: int = 0
    maximum: int = 1000
    distinct: bool = False

    @property
    def expected(self) -> str:
        number = f"{self.minimum:,}" if self.minimum == self.maximum else f"{self.minimum:,} to {self.maximum:,}"
        return f"a list of {number}{' different' * self.distinct} values"

    def allows(self, value: Any) -> bool:
        if not isinstance(value, list | tuple) or not self.minimum <= len(value) <= self.maximum:
            return False
        return not self.distinct or len(set(map(repr, value))) == len(value)


@dataclass(eq=False, repr=False)
class DataclassFields:
    """A dataclass, with a table of limits for its fields."""

    limits: Mapping[str, Limit | DataclassFields]
    expected: str = "a table"

    def allows(self, value: Any) -> bool:
        return dataclasses.is_dataclass(value)


@dataclass(eq=False, repr=False)
class JsonObject:
    """A JSON object with required and optional keys; other keys are allowed and not checked."""

    required: Mapping[str, Limit | DataclassFields | JsonObject]
    optional: Mapping[str, Limit | DataclassFields | JsonObject] = dataclasses.field(default_factory=dict)
    expected: str = "an object"

    def allows(self, value: Any) -> bool:
        return isinstance(value, Mapping)


@dataclass(eq=False, repr=False)
class MappingOf:
    """A JSON object of at most `maximum` keys of any name, whose values are all within one limit."""

    limit: Limit | JsonObject
    maximum: int = 1000
    expected: str = "an object"

    def allows(self, value: Any) -> bool:
        return isinstance(value, Mapping) and len(value) <= self.maximum


def check_fields(settings: Any, limits: Mapping[str, Limit | DataclassFields], prefix: str = "") -> None:
    """Checks that every field of a dataclass is within its limit.

    Raises:
        LimitError: a field is not; the message names it, with `prefix` before it.
    """
    for field in dataclasses.fields(settings):
        check_value(getattr(settings, field.name), limits[field.name], prefix + field.name)


def check_value(value: Any, limit: Limit | DataclassFields | JsonObject, key: str) -> None:
    """Checks that a value, and all values inside it, are within the limit.

    Raises:
        LimitError: one is not; the message names its place by `key` and the keys and indices below it.
    """
    if not limit.allows(value):
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
    """Whether a value, and all values inside it, are within the limit."""
    try:
        check_value(value, limit, "")
    except LimitError:
        return False
    return True


def _check_keys(value: Mapping[str, Any], limit: JsonObject, key: str) -> None:
    prefix = f"{key}." if key else ""
    for name, item_limit in limit.required.items():
        if name not in value:
            raise LimitError(f"{prefix}{name}: expected {item_limit.expected}, got none", item_limit)
        check_value(value[name], item_limit, prefix + name)
    for name, item_limit in limit.optional.items():
        if name in value:
            check_value(value[name], item_limit, prefix + name)


def describe_value(value: Any) -> str:
    """A value as text for a message, shortened: settings may hold numbers of millions of digits."""
    if isinstance(value, int) and not isinstance(value, bool) and value.bit_length() > 200:
        return f"a number of {int(value.bit_length() * math.log10(2)):,} digits"
    try:
        text = repr(list(value) if isinstance(value, tuple) else value)
    except (ValueError, RecursionError):
        return f"a {type(value).__name__}"
    return text if len(text) <= MAX_SHOWN_CHARACTERS else f"{text[:MAX_SHOWN_CHARACTERS]}..."
