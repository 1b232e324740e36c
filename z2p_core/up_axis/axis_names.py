"""The six axes that may point up: their spellings, and the rotations that bring them to +Z."""

from __future__ import annotations

import math
import re
from typing import Any

import numpy as np

from z2p_core.rotations import align_to_vertical

UP_ROTATIONS = {
    "+Z": ((1, 0, 0), (0, 1, 0), (0, 0, 1)),
    "-Z": ((-1, 0, 0), (0, 1, 0), (0, 0, -1)),
    "+Y": ((1, 0, 0), (0, 0, -1), (0, 1, 0)),
    "-Y": ((1, 0, 0), (0, 0, 1), (0, -1, 0)),
    "+X": ((0, 0, -1), (0, 1, 0), (1, 0, 0)),
    "-X": ((0, 0, 1), (0, 1, 0), (-1, 0, 0)),
}
"""The data's up axis -> rotation matrix (rows) that brings it to +Z.

The camera stands at -Y, so each rotation also decides which side of the data is its front:

- +Y up, (x, y, z) -> (x, -z, y): the side that faces +Z, as in OpenGL's axes;
- -Y up, (x, y, z) -> (x, z, -y): the side that faces -Z, which a depth camera at the origin sees;
- the others leave y as it is: the side that faces -Y.
"""

_SPELLINGS = re.compile(
    r"((?P<sign>[+-])|(?P<word>plus|minus|pos|neg|positive|negative)[ _-]?)?(?P<axis>[xyz])([ _-]?(up|axis))?"
)


MAX_DIRECTION = 1e6
"""Largest number in a direction; the least positive one is its inverse."""


def up_rotation(up: str) -> np.ndarray:
    """Rotation (3, 3) that brings what `parse_up_axis` returned, but for ``auto``, to +Z."""
    if up in UP_ROTATIONS:
        return np.array(UP_ROTATIONS[up], dtype=np.float64)
    direction = np.array([float(number) for number in up.split(",")])
    axis = int(np.abs(direction).argmax())
    nearest = ("-" if direction[axis] < 0 else "+") + "XYZ"[axis]
    return align_to_vertical(np.array(UP_ROTATIONS[nearest], dtype=np.float64), direction / np.linalg.norm(direction))


def parse_up_axis(text: Any) -> str | None:
    """``auto``, or a signed axis such as ``+Y``, from ``y``, ``+y``, ``Y-up``, ``minus z``; None for anything else.

    A direction, as three numbers or as ``0,0.1,1``, becomes a text of that kind, or the axis that it lies on.
    """
    direction = _parse_direction(text)
    if direction is not None:
        return direction
    word = text.strip().lower() if isinstance(text, str) else ""
    if word == "auto":
        return "auto"
    match = _SPELLINGS.fullmatch(word)
    if match is None:
        return None
    negative = match["sign"] == "-" or (match["word"] or "") in ("minus", "neg", "negative")
    return ("-" if negative else "+") + match["axis"].upper()


def _parse_direction(given: Any) -> str | None:
    """A direction (3,), or a text of one, as a text; an axis by its name; None for anything else."""
    try:
        numbers = [float(part) for part in (given.split(",") if isinstance(given, str) else given)]
    except (TypeError, ValueError):
        return None
    length = max((abs(number) for number in numbers), default=0.0)
    if len(numbers) != 3 or not 1 / MAX_DIRECTION <= length <= MAX_DIRECTION or any(map(math.isnan, numbers)):
        return None
    axes = [axis for axis, number in zip("XYZ", numbers, strict=True) if number]
    if len(axes) == 1:
        return ("-" if min(numbers) < 0 else "+") + axes[0]
    return ",".join(f"{number:g}" for number in numbers)
