"""The up axis that comments in a file's header state, directly or through the program that wrote the file."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import NamedTuple

from z2p_core.up_axis.known_programs import program_up, writes_fixed_axis


class UpHint(NamedTuple):
    """The up axis that a file's header names."""

    axis: str
    """Such as ``-Y``."""
    reason: str
    """The source of the axis, in a few words."""
    certain: bool
    """True if the shape must not overrule it."""


_LETTER = r"(?P<sign>(?<![\w+-])[+-]\s?|\b(?:plus|minus|positive|negative|pos|neg)[ _-]?|(?<![\w+-]))(?P<axis>[xyz])"
"""An axis with its sign, if it has one; the hyphen in ``handed-y`` is none."""
_VECTOR = r"(?P<vector>[+-]?\d[\d.]*(?:[,\s]+[+-]?\d[\d.]*){2})(?![\d.])"
_END = r"(?![\w?+])(?!\s*\?)(?!\s*(?:[,/|&]|\bor\b|\band\b)\s*[+-]?[xyz]\b(?![ _-]*[a-z=:]))"
"""The end of an axis: no letters, no question mark and no other axes may follow."""
_UP_IS = (
    r"(?<![a-z0-9])(?:(?:up|upright|vertical|height)[ _-]?(?:axis|vector|dir(?:ection)?)|axis[ _-]?up|world[ _-]?up)"
    rf"(?:\s+(?:is|points))?[\s\"',=:>(\[]+(?:(?:the|along)\s+)*(?:{_LETTER}(?:[ _-]?(?:axis|up))?{_END}|{_VECTOR})"
)
"""``up axis: Y``, ``upAxis="+Z"``, ``vertical axis z``, ``up vector (0, 1, 0)``."""
_UP_ALONE = (
    r"(?:^|[,;:(\[]|\b(?:world|scene|model|data|global|is|axes|system|frame)\b|=\s*[+-]?[xyz]\s)\s*"
    rf"(?:up|vertical)(?:(?:\s*[:=]\s*|\s+is\s+|\s+)[\"']?(?:along\s+)?{_LETTER}(?:[ _-]?(?:axis|up))?{_END}"
    rf"(?=[\"']?\s*(?:$|[.,;)\]]|\w+\s*=))|\s*[:=]\s*[(\[]?\s*{_VECTOR})"
)
"""``up: Y``, ``up = -z``; the word has so many other uses that nothing else may stand around it."""
_AXIS_UP = (
    rf"{_LETTER}(?:[ _-]?axis)?(?:[ _-]|\s*[=:]\s*|\s+(?:is|points?|pointing|goes|looks?)\s+)"
    r"(?:up(?:wards?)?(?!_[a-z])|vertical(?=\s*(?:$|[.,;)\]])))"
    r"(?![a-z0-9])(?![ _-]*(?:\d|\?|unknown\b))(?!\s*[:=]\s*(?:[+-]?[xyz]\b|0|false|no\b))"
    r"(?!\s+(?:to|by|from|until)\b(?!\s+[+-]?[xyz]\b))"
)
"""``Y-up``, ``-Y up``, ``Z_UP``, ``+z is up``, ``z axis points upwards``."""
_NEGATION = (
    r"(?:\b(?:not|no|non|isn't|never|without|unless|if|maybe|perhaps)\b\W*"
    r"|\b(?:mov|shift|scal|round|sum|add|turn|rotat|flip|split|set|back|clean|look|mix|count|siz)\w*[ _]*"
    r"|(?<![a-z0-9])(?<!x[\s,]y[\s,])(?<!x, y, )[xyz][\s,/]+)$"
)
"""Words before an axis after which the text does not state an up axis: ``not y-up``, ``moved z up``, ``x y z up``."""
_REQUIRED_WORDS = ("up", "vertical", "height")
"""Every match contains one of these: other lines are skipped, as compiling the patterns takes longer than reading a
small file."""
_MAX_LINE_LETTERS = 1000
"""The rest of a longer line is ignored."""
_MAX_QUOTE_LETTERS = 60
"""A reason quotes this much of a line."""


def up_of_comments(lines: Sequence[str], suffix: str, usual: str = "") -> UpHint | None:
    """The up axis that comments of a file with that suffix (lower-case, with its dot) state; None if they state none.

    `usual` is the axis that the file's family uses, if it is known. A "vertical axis" without a sign is ignored if it
    differs from `usual` in the sign only, since programs write it for both signs.
    """
    matches = [] if any(map(writes_fixed_axis, lines)) else [(axis_in(line), line) for line in lines]
    axes = {axis for axis, _ in matches if axis}
    if len(axes) > 1:
        return None
    if axes:
        axis, line = next((axis, line) for axis, line in matches if axis)
        unsigned = "vertical" in line.lower() and not re.search(r"[+-]\s?[xyz]\b|-\d", line.lower())
        if unsigned and usual[-1:] == axis[-1]:
            return None
        return UpHint(axis, f"its header says so ({_quoted(line)})", certain=True)
    axis, program = program_up(lines, suffix)
    return UpHint(axis, f"usual for {program}, which its header names", certain=False) if axis else None


def axis_in(text: str) -> str:
    """The signed axis that a line states to be up, as in ``up axis: Y``, ``z_up``; empty if it states none, or two."""
    line = _plain(text)
    if not any(word in line for word in _REQUIRED_WORDS):
        return ""
    axes = {_axis(match) for pattern in (_UP_IS, _UP_ALONE, _AXIS_UP) for match in re.finditer(pattern, line)
            if not re.search(_NEGATION, line[: match.start()])}  # fmt: skip
    return axes.pop() if len(axes) == 1 else ""


def axis_of_vector(numbers: Sequence[float]) -> str:
    """The signed axis along which a vector of three numbers points; empty if it is along none."""
    along = [(number, name) for number, name in zip(numbers, "XYZ", strict=True) if number]
    if len(along) != 1:
        return ""
    return ("+" if along[0][0] > 0 else "-") + along[0][1]


def _plain(text: str) -> str:
    """The line in lower case with single spaces, cut to `_MAX_LINE_LETTERS`."""
    spaced = re.sub(r"\b[uU]p(?=Axis|Vector|Dir)", "up ", text[:_MAX_LINE_LETTERS])
    return " ".join(spaced.lower().replace("\N{MINUS SIGN}", "-").split())


def _axis(match: re.Match[str]) -> str:
    """The signed axis of a match; empty for a vector along none, which then conflicts with other matches."""
    parts = match.groupdict()
    if parts.get("vector"):
        try:
            return axis_of_vector([float(word) for word in re.split(r"[,\s]+", parts["vector"])])
        except ValueError:
            return ""
    below = parts["sign"].startswith(("-", "minus", "neg"))
    return ("-" if below else "+") + parts["axis"].upper()


def _quoted(line: str) -> str:
    """A comment as one printable line."""
    text = "".join(letter for letter in " ".join(line.split()) if letter.isprintable())
    return text if len(text) <= _MAX_QUOTE_LETTERS else f"{text[:_MAX_QUOTE_LETTERS].rstrip()}..."
