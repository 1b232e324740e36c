"""A part of the usual frame, enlarged to the whole picture: camera and perspective stay as they are."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from numbers import Real
from typing import Any

from z2p_core.interfaces import SettingError

MAX_ZOOM = 32.0
MAX_PAN = 32.0
"""Largest shift of the frame's middle, in shorter sides of the picture."""


@dataclass(frozen=True)
class Zoom:
    """How much larger than usual things are shown, and where the frame's middle is."""

    factor: float = 1.0
    """1 to `MAX_ZOOM`."""
    pan: tuple[float, float] = (0.0, 0.0)
    """Shift of the frame's middle to the right and up, in shorter sides of the picture, after the enlargement."""

    def __bool__(self) -> bool:
        """Whether it changes anything."""
        return self != Zoom()

    def to_json(self) -> dict[str, Any]:
        """Empty where nothing changes."""
        return {"zoom": self.factor, "pan": list(self.pan)} if self else {}


UNZOOMED = Zoom()
"""The whole frame."""


def parse_zoom(factor: Any, pan: Any) -> Zoom:
    """The zoom of a factor and a shift, each None for none.

    Raises:
        SettingError: one of them is no number in its range.
    """
    factor, pan = 1.0 if factor is None else factor, (0.0, 0.0) if pan is None else pan
    if not _is_number(factor) or not 1 <= factor <= MAX_ZOOM:
        raise SettingError(f"zoom: expected a factor from 1 to {MAX_ZOOM:g}, got {factor!r}; for smaller ones, make "
                           "the margin larger")  # fmt: skip
    is_pair = isinstance(pan, Sequence) and len(pan) == 2 and all(map(_is_number, pan))
    if not is_pair or max(map(abs, pan)) > MAX_PAN:
        raise SettingError(f"pan: expected two numbers, right and up in shorter sides of the picture, up to "
                           f"{MAX_PAN:g}, got {pan!r}")  # fmt: skip
    return Zoom(float(factor), (float(pan[0]), float(pan[1])))


def _is_number(value: Any) -> bool:
    return isinstance(value, Real) and not isinstance(value, bool) and math.isfinite(float(value))
