"""How long the rows of a file of bare float32 are, and what they hold: no header says it, but the numbers do."""

from __future__ import annotations

import numpy as np

from z2p_core.formats.raw_lidar import USUAL, WITH_RING, could_be_measured

COLOURED = ("x", "y", "z", "r", "g", "b")
WITH_NORMALS = ("x", "y", "z", "nx", "ny", "nz")
FORMS = (USUAL, WITH_RING, COLOURED, WITH_NORMALS)
"""What rows are known to hold."""
SWEEP_FORMS = (USUAL, WITH_RING)
"""Those that are read unasked, for data sets are full of them."""
SAMPLE_NUMBERS = 60 * 1000
"""Numbers at the head of a file that tell; whole rows of any form."""
_PERIODS = range(2, 7)
"""Rows after which columns of another length come round again, where rows are cut wrongly."""
_LEAST_DISTANCE = 0.25
"""How far two columns' distributions are apart (Kolmogorov and Smirnov's distance) if they hold different things."""
_CHANCE_FACTOR = 1.7
"""Times the root of two over their number: how far apart as many numbers of one distribution may be by chance."""
_LENGTH_TOLERANCE = 0.02
"""How far a normal may be from unit length."""

_LEAST, _MOST = 1e-9, 1e9
"""Between which coordinates and what is measured beside them lie, but for 0."""
_FEWEST_HALVES, _WILD = 60, 0.3
"""Values that tell halves of float64, and the share of lower ones that are nothing measured: chance gives 0.76."""


def fitting_forms(values: np.ndarray, size: int) -> list[tuple[str, ...]]:
    """Forms that rows may have in a file of `size` bytes that begins with these values (N,) float32."""
    return [form for form in FORMS if size and not size % (4 * len(form)) and _fits(values, form)]


def are_doubles(values: np.ndarray) -> bool:
    """Whether values (N,) float32 are halves of float64 numbers: wild by themselves, and sound where joined again.

    The lower halves of such are bits by chance, a good part of them no number of anything measured.
    """
    values = values[: len(values) // 2 * 2]
    if len(values) < _FEWEST_HALVES:
        return False
    joined, low = np.abs(values.astype("<f4").view("<f8")), np.abs(values[0::2])
    sound = (joined == 0) | ((joined > _LEAST) & (joined < _MOST))
    wild = ~np.isfinite(low) | (low > _MOST) | ((low < _LEAST) & (low > 0))
    return bool(sound.all()) and float(wild.mean()) > _WILD


def possible_names(size: int) -> list[str]:
    """Columns, as --columns takes them, by which the rows of a file of so many bytes would be whole."""
    forms = (("x", "y", "z"), USUAL, WITH_RING, COLOURED)
    return [",".join(form) for form in forms if size and not size % (4 * len(form))]


def _fits(values: np.ndarray, form: tuple[str, ...]) -> bool:
    """Whether the values, cut into rows of that form, could be what it says."""
    rows = values[: len(values) // len(form) * len(form)].reshape(-1, len(form))
    if len(rows) == 0 or not could_be_measured(np.column_stack([rows[:, :3], np.zeros(len(rows), np.float32)])):
        return False
    rest = rows[:, 3:]
    if not np.isfinite(rest).all():
        return False
    if form == WITH_NORMALS:
        length = np.linalg.norm(rest, axis=1)
        fits = np.mean((np.abs(length - 1) < _LENGTH_TOLERANCE) | (length == 0)) > 0.98 and bool(rest.any())
    elif form == COLOURED:
        fits = _are_whole(rest, 255) or bool(((rest >= 0) & (rest <= 1)).all())
    else:
        fits = could_be_measured(rows) and (form == USUAL or _are_whole(rest[:, 1:], 255))
    return bool(fits) and not _is_mixed(rows)


def _are_whole(numbers: np.ndarray, most: int) -> bool:
    return bool(((numbers >= 0) & (numbers <= most) & (numbers == np.floor(numbers))).all())


def _is_mixed(rows: np.ndarray) -> bool:
    """Whether most columns (N, C) hold other things in every second row, or every third and so on.

    So they do if rows are cut at a wrong length. Lidars whose beams take turns do so in their height alone.
    """
    order = np.argsort(rows, axis=0, kind="stable")
    for period in _PERIODS:
        if len(rows) < 8 * period:
            break
        least = max(_LEAST_DISTANCE, _CHANCE_FACTOR * (2 * period / len(rows)) ** 0.5)
        if (_farthest_apart(rows, order, period) > least).mean() >= 0.5:
            return True
    return False


def _farthest_apart(rows: np.ndarray, order: np.ndarray, period: int) -> np.ndarray:
    """For each column (C,), how far the values in every so manieth row are from all at the most."""
    whole = np.arange(1, len(rows) + 1)[:, None] / len(rows)
    ranked = np.take_along_axis(rows, order, axis=0)
    last = np.ones(rows.shape, dtype=bool)  # of equal values, only the last one counts
    last[:-1] = ranked[1:] != ranked[:-1]
    apart = np.zeros(rows.shape[1])
    for phase in range(period):
        within = order % period == phase
        share = np.cumsum(within, axis=0) / within.sum(axis=0)
        apart = np.maximum(apart, (np.abs(share - whole) * last).max(axis=0))
    return apart
