"""What the columns behind x, y and z seem to hold, told by their numbers: colours, normals or other values."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

_UNIT_LENGTH_TOLERANCE = 0.02
"""How far a normal's length may be from 1."""
_MIN_UNIT_SHARE = 0.95
"""Share of the rows that must agree; where something was not measured, zeros stand."""
_COLOR_NAME_SETS = ({"r", "g", "b"}, {"red", "green", "blue"}, {"rgb"}, {"color"}, {"colour"}, {"rf", "gf", "bf"})


@np.errstate(all="ignore")  # of numbers that are no coordinates
def ignored_columns_note(columns: np.ndarray, first: int = 4) -> str:
    """What is left out, in words, of a file whose columns (N, M) from the `first` on, counted from 1, are not drawn."""
    if columns.shape[1] == 0:
        return ""
    parts = []
    for kind, start, count in _group_columns(columns):
        begin, end = first + start, first + start + count - 1
        place = f"column {begin}" if count == 1 else f"columns {begin} to {end}"
        parts.append(f"{place} ({kind})" if kind else place)
    return f"ignored: {', '.join(parts)}"


def ignored_colors_note(names: Sequence[str]) -> str:
    """What is left out, in words, of a file whose columns have such names, lower-case, where someone may miss it."""
    for wanted in _COLOR_NAME_SETS:
        if wanted <= set(names):
            return f"its colours are ignored ({', '.join(name for name in names if name in wanted)})"
    return ""


@np.errstate(all="ignore")  # of numbers that are no coordinates
def suggest_extra_names(columns: np.ndarray, first: int) -> list[str]:
    """Names for columns (N, M) as --columns takes them: ``r``, ``g``, ``b``, and ``c9`` for what cannot be told."""
    names: list[str] = []
    for kind, start, count in _group_columns(columns):
        known = {"colours": ["r", "g", "b"], "normals": ["nx", "ny", "nz"]}.get(kind, [])
        names += known if known and known[0] not in names else [f"c{first + start + index}" for index in range(count)]
    return names


@np.errstate(all="ignore")  # of numbers that are no coordinates
def are_normals(columns: np.ndarray) -> bool:
    """Whether columns (N, 3) are unit vectors; zeros may stand between."""
    lengths = np.sqrt((columns**2).sum(1))
    some = lengths > _UNIT_LENGTH_TOLERANCE
    are_units = np.abs(lengths[some] - 1) < _UNIT_LENGTH_TOLERANCE
    return bool(some.any() and are_units.mean() >= _MIN_UNIT_SHARE and some.mean() > 0.5)


def are_colours(columns: np.ndarray) -> bool:
    """Whether columns (N, 3) are whole numbers from 0 to 255 or 65535, or shares of 1, that could be red, green, blue.

    Numbers that are all the same show nothing.
    """
    finite = columns[np.isfinite(columns).all(1)]
    if len(finite) == 0 or finite.min() < 0:
        return False
    whole = bool((finite == np.floor(finite)).all())
    return finite.max() <= 1 if not whole else 1 < finite.max() <= 65535


def _group_columns(columns: np.ndarray) -> list[tuple[str, int, int]]:
    """What each run of columns holds, where it begins, and how many they are."""
    groups: list[tuple[str, int, int]] = []
    start = 0
    while start < columns.shape[1]:
        three = columns[:, start : start + 3]
        with np.errstate(all="ignore"):
            kind = "" if three.shape[1] < 3 else "normals" if are_normals(three) else ""
            kind = "colours" if not kind and three.shape[1] == 3 and are_colours(three) else kind
        if kind:
            groups.append((kind, start, 3))
        elif groups and not groups[-1][0]:
            groups[-1] = ("", groups[-1][1], groups[-1][2] + 1)
        else:
            groups.append(("", start, 1))
        start += 3 if kind else 1
    return groups
