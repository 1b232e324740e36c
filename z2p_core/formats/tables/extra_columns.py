"""Recognizes colors and normals in the columns behind x, y and z by their numbers."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

_UNIT_LENGTH_TOLERANCE = 0.02
"""Deviation from unit length that a normal may have."""
_MIN_UNIT_SHARE = 0.95
"""Least share of unit vectors among the nonzero rows; rows without a normal hold zeros."""
_COLOR_NAME_SETS = ({"r", "g", "b"}, {"red", "green", "blue"}, {"rgb"}, {"color"}, {"colour"}, {"rf", "gf", "bf"})


@np.errstate(all="ignore")  # the numbers may be no coordinates
def ignored_columns_note(columns: np.ndarray, first: int = 4) -> str:
    """The note on columns (N, M) that are not drawn; `first` is the number of the first one, counted from 1."""
    if columns.shape[1] == 0:
        return ""
    parts = []
    for kind, start, count in _group_columns(columns):
        begin, end = first + start, first + start + count - 1
        place = f"column {begin}" if count == 1 else f"columns {begin} to {end}"
        parts.append(f"{place} ({kind})" if kind else place)
    return f"ignored: {', '.join(parts)}"


def ignored_colors_note(names: Sequence[str]) -> str:
    """The note on columns with these names, lower-case, if some are colors; otherwise empty."""
    for wanted in _COLOR_NAME_SETS:
        if wanted <= set(names):
            return f"its colours are ignored ({', '.join(name for name in names if name in wanted)})"
    return ""


@np.errstate(all="ignore")  # the numbers may be no coordinates
def suggest_extra_names(columns: np.ndarray, first: int) -> list[str]:
    """Names for columns (N, M) in --columns: ``r``, ``g``, ``b``, ``nx`` ..., and ``c9`` for unknown contents."""
    names: list[str] = []
    for kind, start, count in _group_columns(columns):
        known = {"colours": ["r", "g", "b"], "normals": ["nx", "ny", "nz"]}.get(kind, [])
        names += known if known and known[0] not in names else [f"c{first + start + index}" for index in range(count)]
    return names


@np.errstate(all="ignore")  # the numbers may be no coordinates
def are_normals(columns: np.ndarray) -> bool:
    """Whether rows (N, 3) are unit vectors; some may be zero."""
    lengths = np.sqrt((columns**2).sum(1))
    some = lengths > _UNIT_LENGTH_TOLERANCE
    are_units = np.abs(lengths[some] - 1) < _UNIT_LENGTH_TOLERANCE
    return bool(some.any() and are_units.mean() >= _MIN_UNIT_SHARE and some.mean() > 0.5)


def are_colours(columns: np.ndarray) -> bool:
    """Whether rows (N, 3) could be red, green and blue: integers up to 255 or 65535, or numbers in [0, 1].

    Integers that are all 0 or 1 are no colors.
    """
    finite = columns[np.isfinite(columns).all(1)]
    if len(finite) == 0 or finite.min() < 0:
        return False
    whole = bool((finite == np.floor(finite)).all())
    return finite.max() <= 1 if not whole else 1 < finite.max() <= 65535


def _group_columns(columns: np.ndarray) -> list[tuple[str, int, int]]:
    """Runs of columns of one kind: the kind (or ""), the index of the first column, and their number."""
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
