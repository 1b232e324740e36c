"""How the points of a cloud are shown, as a user chooses it; checked."""

from __future__ import annotations

import math
from dataclasses import dataclass
from numbers import Real
from typing import Any

from z2p_core.interfaces import SettingError

SURFACE, BALLS, DISCS = "surface", "balls", "discs"
STYLE_NAMES = (SURFACE, BALLS, DISCS)
GIVEN_RADII = "given radii"
"""Name of the field that radii become that a caller in Python gives as an array."""


@dataclass(frozen=True)
class Style:
    """A style, and the radius of its balls; with none of the three radii it follows from the points' spacing."""

    name: str = SURFACE
    radius: float | None = None
    """In the data's units."""
    radius_share: float | None = None
    """Share of the frame's radius: that of the object's bounding sphere."""
    radius_field: str | None = None
    """Name of the field of the points that holds it, in the data's units."""

    @property
    def needs_network(self) -> bool:
        """Whether weights are run for a picture."""
        return self.name == SURFACE

    @property
    def wanted_fields(self) -> tuple[str, ...]:
        """Names of the fields that must be read."""
        return () if self.radius_field is None else (self.radius_field,)

    @property
    def radius_text(self) -> str | float | None:
        """The radius as `parse_style` takes it; None for the default."""
        return self.radius_field or (f"{100 * self.radius_share:g}%" if self.radius_share else self.radius)

    def to_json(self) -> dict[str, Any]:
        """What a picture's record says of the style: nothing of the surface's."""
        return {} if self.name == SURFACE else {"style": self.name, "radius": self.radius_text}


def parse_style(name: Any, radius: Any = None) -> Style:
    """The style of that name; `radius` is a number in the data's units, text such as ``2%``, or a field's name.

    Raises:
        SettingError: there is no such style, it has no radius, or the radius is no such thing.
    """
    if not isinstance(name, str) or name not in STYLE_NAMES:
        raise SettingError(f"expected a style {', '.join(STYLE_NAMES)}, got {name!r}")
    if radius is None:
        return Style(name)
    if name != BALLS:
        raise SettingError(f"the radius is that of balls, and the style is {name}; choose the style {BALLS}, or leave "
                           "the radius out")
    text = radius.strip() if isinstance(radius, str) else ""
    if text.endswith("%"):
        share = _positive(text[:-1], radius) / 100
        return Style(name, radius_share=share)
    if text and _number(text) is None:
        return Style(name, radius_field=text)
    return Style(name, radius=_positive(text or radius, radius))


def _positive(number: Any, given: Any) -> float:
    value = _number(number)
    if value is None or not (math.isfinite(value) and value > 0):
        raise SettingError(f"expected a radius above 0 in the data's units, a share of the object's such as 2%, or the "
                           f"name of a field, got {given!r}")
    return value


def _number(given: Any) -> float | None:
    if isinstance(given, bool) or not isinstance(given, str | Real):
        return None
    try:
        return float(given)
    except (ValueError, OverflowError):
        return None
