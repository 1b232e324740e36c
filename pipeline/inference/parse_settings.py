"""Settings from the words and numbers that users give, checked against the weights at hand."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from z2p_core.interfaces import Control, SettingError, Value

if TYPE_CHECKING:  # reading a colour needs no torch
    from z2p_renderer.pipeline.inference.weight_selection import AnyRenderer

Color = tuple[float, float, float]
MAX_SMOOTHING_RADIUS = 0.3
"""Radius of the patches that clouds are made smooth over, at most, in that of the frame."""


def parse_controls(renderer: AnyRenderer, given: Mapping[str, Any]) -> dict[str, Value]:
    """Value of each control that was given, as text, a number or a sequence of numbers; None counts as not given.

    Raises:
        SettingError: a control that the weights do not carry, another elevation than their only one, or a value
            outside its slider.
    """
    values = {}
    for name, wish in given.items():
        if wish is None:
            continue
        if name in renderer.controls:
            values[name] = _value(renderer.controls[name], wish)
        elif name != "elevation":
            carried = ", ".join(renderer.controls) or "none"
            raise SettingError(f"these weights do not carry the control {name!r}; they carry: {carried}; "
                               f"{_carriers(name)}")
        elif (asked := wish[0] if isinstance(wish, list | tuple) else wish) != renderer.fixed_elevation:
            raise SettingError(f"--elevation: these weights know only {renderer.fixed_elevation:g} degrees, got "
                               f"{asked}; leave it out, or take weights that carry the elevation control")
    return values


def parse_smoothing(wish: Any) -> str | float:
    """``auto``, or a radius from 0 to `MAX_SMOOTHING_RADIUS`.

    Raises:
        SettingError: it is neither.
    """
    if isinstance(wish, str) and wish.lower() == "auto":
        return "auto"
    try:
        radius = math.nan if isinstance(wish, bool) else float(wish)
    except (TypeError, ValueError, OverflowError):
        radius = math.nan
    if not 0 <= radius <= MAX_SMOOTHING_RADIUS:
        raise SettingError(f"smooth: expected auto, or a radius from 0 to {MAX_SMOOTHING_RADIUS:g}, got {wish!r}")
    return radius


def parse_background(wish: Any) -> Color | None:
    """sRGB triple in [0, 1] of a CSS name, ``#hex`` or three numbers in [0, 1], as text (``0.9,0.9,1``) or as such.

    None for ``transparent`` or None.

    Raises:
        SettingError: it is none of these.
    """
    if wish is None or (isinstance(wish, str) and wish.lower() in ("transparent", "none")):
        return None
    if isinstance(wish, str) and wish.count(",") == 2 and "(" not in wish:
        wish = wish.split(",")
    if isinstance(wish, str):
        from PIL import ImageColor  # late: help needs no pillow

        try:
            red, green, blue, *alpha = ImageColor.getrgb(wish)
        except ValueError:
            alpha = [0]
        if alpha not in ([], [255]):
            raise SettingError("expected transparent, a CSS colour name, an opaque #hex or r,g,b with each 0 to 1, "
                               f"got {wish!r}")
        return red / 255, green / 255, blue / 255
    try:
        numbers = [float(number) for number in wish]
    except (TypeError, ValueError, OverflowError):
        numbers = []
    if len(numbers) != 3 or not all(0 <= number <= 1 for number in numbers):
        raise SettingError(f"expected a background of three numbers from 0 to 1, got {wish!r}")
    return numbers[0], numbers[1], numbers[2]


def _carriers(control: str) -> str:
    """Which shipped weights carry a control, in words."""
    from z2p_renderer.storage.models.checkpoints import load_weights, shipped_weights

    found = [name for name, path in shipped_weights().items()
             if control in [one["name"] for one in load_weights(path).card["controls"]]]  # fmt: skip
    return f"weights that do: {', '.join(found)}" if found else "no shipped weights do, so train some that do"


def _value(control: Control, wish: Any) -> Value:
    if isinstance(wish, str):
        return control.parse(wish)
    try:
        parts = list(wish) if np.ndim(wish) else [wish]
        numbers = () if any(isinstance(part, bool) for part in parts) else tuple(float(part) for part in parts)
    except (TypeError, ValueError, OverflowError):
        numbers = ()
    if not numbers:
        raise SettingError(f"{control.name}: expected text or numbers, got {wish!r}")
    return control.check(numbers)
