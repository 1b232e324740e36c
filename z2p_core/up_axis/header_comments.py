"""What the comments in a file's header say of up: the axis itself, or the program that wrote it."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import NamedTuple

from z2p_core.up_axis.known_programs import program_up, writes_fixed_axis


class UpHint(NamedTuple):
    """An axis such as ``-Y``, what tells it, in a few words, and whether that settles it."""

    axis: str
    reason: str
    certain: bool


_LETTER = r"(?P<sign>(?<![\w+-])[+-]\s?|\b(?:plus|minus|positive|negative|pos|neg)[ _-]?|(?<![\w+-]))(?P<axis>[xyz])"
"""An axis with its sign, if it has one; the hyphen in ``handed-y`` is none."""
_VECTOR = r"(?P<vector>[+-]?\d[\d.]*(?:[,\s]+[+-]?\d[\d.]*){2})(?![\d.])"
_NO_MORE = r"(?![\w?+])(?!\s*\?)(?!\s*(?:[,/|&]|\bor\b|\band\b)\s*[+-]?[xyz]\b(?![ _-]*[a-z=:]))"
"""What may not follow an axis: more letters, a doubt, or other axes beside it."""
_UP_IS = (
    r"(?<![a-z0-9])(?:(?:up|upright|vertical|height)[ _-]?(?:axis|vector|dir(?:ection)?)|axis[ _-]?up|world[ _-]?up)"
    rf"(?:\s+(?:is|points))?[\s\"',=:>(\[]+(?:(?:the|along)\s+)*(?:{_LETTER}(?:[ _-]?(?:axis|up))?{_NO_MORE}|{_VECTOR})"
)
"""``up axis: Y``, ``upAxis="+Z"``, ``vertical axis z``, ``up vector (0, 1, 0)``."""
_UP_ALONE = (
    r"(?:^|[,;:(\[]|\b(?:world|scene|model|data|global|is|axes|system|frame)\b|=\s*[+-]?[xyz]\s)\s*"
    rf"(?:up|vertical)(?:(?:\s*[:=]\s*|\s+is\s+|\s+)[\"']?(?:along\s+)?{_LETTER}(?:[ _-]?(?:axis|up))?{_NO_MORE}"
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
_NOT_SO = (
    r"(?:\b(?:not|no|non|isn't|never|without|unless|if|maybe|perhaps)\b\W*"
    r"|\b(?:mov|shift|scal|round|sum|add|turn|rotat|flip|split|set|back|clean|look|mix|count|siz)\w*[ _]*"
    r"|(?<![a-z0-9])(?<!x[\s,]y[\s,])(?<!x, y, )[xyz][\s,/]+)$"
)
"""What before an axis makes it none that is said to be up: ``not y-up``, ``moved z up``, ``x y z up``."""
_WORDS = ("up", "vertical", "height")
"""One of these is in every match; to make the patterns takes longer than to read a small file."""
_LONGEST_LINE, _LONGEST_QUOTE = 1000, 60


def up_of_comments(lines: Sequence[str], suffix: str, usual: str = "") -> UpHint | None:
    """What comments say of up in a file with that suffix (lower-case, with its dot); None where they say nothing.

    `usual` is the axis that its kind has by other marks. Of an axis that is named without its sign, and that programs
    write for either, that is kept.
    """
    found = [] if any(map(writes_fixed_axis, lines)) else [(axis_in(line), line) for line in lines]
    axes = {axis for axis, _ in found if axis}
    if len(axes) > 1:
        return None
    if axes:
        axis, line = next((axis, line) for axis, line in found if axis)
        unsigned = "vertical" in line.lower() and not re.search(r"[+-]\s?[xyz]\b|-\d", line.lower())
        if unsigned and usual[-1:] == axis[-1]:
            return None
        return UpHint(axis, f"its header says so ({_quoted(line)})", certain=True)
    axis, program = program_up(lines, suffix)
    return UpHint(axis, f"usual for {program}, which its header names", certain=False) if axis else None


def axis_in(text: str) -> str:
    """The axis, with its sign, that a line says is up: ``up axis: Y``, ``z_up``; empty if it says none, or several."""
    line = _plain(text)
    if not any(word in line for word in _WORDS):
        return ""
    found = {_axis(match) for pattern in (_UP_IS, _UP_ALONE, _AXIS_UP) for match in re.finditer(pattern, line)
             if not re.search(_NOT_SO, line[: match.start()])}  # fmt: skip
    return found.pop() if len(found) == 1 else ""


def axis_of_vector(numbers: Sequence[float]) -> str:
    """The axis, with its sign, along which three numbers point; empty if it is none."""
    along = [(number, name) for number, name in zip(numbers, "XYZ", strict=True) if number]
    if len(along) != 1:
        return ""
    return ("+" if along[0][0] > 0 else "-") + along[0][1]


def _plain(text: str) -> str:
    """The line in lower case, cut to a length that a person would write."""
    spaced = re.sub(r"\b[uU]p(?=Axis|Vector|Dir)", "up ", text[:_LONGEST_LINE])
    return " ".join(spaced.lower().replace("\N{MINUS SIGN}", "-").split())


def _axis(match: re.Match[str]) -> str:
    """The axis of a match; empty, which agrees with no other, for a vector along none."""
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
    return text if len(text) <= _LONGEST_QUOTE else f"{text[:_LONGEST_QUOTE].rstrip()}..."
