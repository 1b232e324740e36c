"""The six axes that may point up: their spellings, and the rotations that bring them to +Z."""

from __future__ import annotations

import re
from typing import Any

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


def parse_up_axis(text: Any) -> str | None:
    """``auto``, or a signed axis such as ``+Y``, from ``y``, ``+y``, ``Y-up``, ``minus z``; None for anything else."""
    word = text.strip().lower() if isinstance(text, str) else ""
    if word == "auto":
        return "auto"
    match = _SPELLINGS.fullmatch(word)
    if match is None:
        return None
    negative = match["sign"] == "-" or (match["word"] or "") in ("minus", "neg", "negative")
    return ("-" if negative else "+") + match["axis"].upper()
