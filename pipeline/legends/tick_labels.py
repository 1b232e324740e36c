"""Ticks of a color bar: round numbers between its limits, and how these are written."""

from __future__ import annotations

import math
from collections.abc import Sequence

_ROUND_STEPS = [1, 2, 2.5, 5, 10]
"""Steps between ticks, times a power of ten."""
_MAX_PLAIN, _MIN_PLAIN = 1e6, 1e-3
"""The largest number of an axis is written with a power of ten from here on, and below here."""
_MAX_POWER_DIGITS = 4
"""Significant digits up to which a power of ten is preferred; where ticks need more, the shorter text is written."""
_SMALLEST_SPAN = 1e-300
"""Limits that are closer than this are one value, and smaller numbers are written as 0."""
_MIN_RELATIVE_SPAN = 1e-13
"""Limits that differ by less, relative to their size, are one value: float64 holds no numbers between them."""
_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def choose_ticks(low: float, high: float, most: int) -> tuple[list[float], list[str]]:
    """At most `most` + 1 round numbers from `low` to `high` in rising order, and the text of each.

    Equal limits have one tick, at their value. Limits with fewer than two round numbers between them
    are the ticks themselves.
    """
    if high - low <= max(_MIN_RELATIVE_SPAN * max(abs(low), abs(high)), _SMALLEST_SPAN):
        return [low], [_shortest_text(low)]
    if high - low == math.inf:
        return [low, high], [_shortest_text(low), _shortest_text(high)]
    ticks = _round_numbers(low, high, max(most, 1))
    if len(ticks) < 2:
        return [low, high], _texts([low, high], _rounding_step(low, high))
    return ticks, _texts(ticks, ticks[1] - ticks[0])


def _round_numbers(low: float, high: float, most: int) -> list[float]:
    """Multiples of a round step within the limits."""
    from matplotlib.ticker import MaxNLocator  # late: slow to import

    slack = (high - low) * 1e-9
    ticks = MaxNLocator(nbins=most, steps=_ROUND_STEPS).tick_values(low, high)
    return [min(max(float(tick), low), high) for tick in ticks if low - slack <= tick <= high + slack]


def _rounding_step(low: float, high: float) -> float:
    """A power of ten that rounds two limits to three digits of their difference."""
    return 10.0 ** (math.floor(math.log10(high - low)) - 2)


def _texts(ticks: Sequence[float], step: float) -> list[str]:
    """The texts of ticks, all with the digits that their step needs."""
    last_place = _last_place(step)
    largest = max(map(abs, ticks))
    first_place = math.floor(math.log10(largest))
    needed_digits = first_place - last_place + 1
    plain = [_plain_text(tick, max(-last_place, 0)) for tick in ticks]
    if _MIN_PLAIN <= largest < _MAX_PLAIN:
        return plain
    exponent = first_place
    if math.isclose(largest, 10.0**first_place) and last_place < first_place:  # 10×10⁵, not 1.0×10⁶
        exponent -= 1
    power = [_power_text(tick, exponent, max(exponent - last_place, 0)) for tick in ticks]
    is_short = needed_digits <= _MAX_POWER_DIGITS or max(map(len, power)) < max(map(len, plain))
    return power if is_short else plain


def _last_place(step: float) -> int:
    """The power of ten of the last digit that a step of three digits has: -1 for 2.5, 2 for 500."""
    exponent = math.floor(math.log10(step)) - 2
    for place in (exponent + 2, exponent + 1):
        in_places = step / 10.0**place
        if math.isclose(in_places, round(in_places), rel_tol=1e-6):
            return place
    return exponent


def _plain_text(number: float, decimals: int) -> str:
    """A number with a number of decimals and a true minus sign; never a negative zero."""
    text = f"{number:.{decimals}f}"
    if float(text) == 0:
        return text.lstrip("-")
    return text.replace("-", "−")


def _power_text(number: float, exponent: int, decimals: int) -> str:
    """A number as a multiple of a power of ten, such as ``2.5×10⁻⁷``; ``0`` for zero."""
    mantissa = _plain_text(number / 10.0**exponent, decimals)
    if float(mantissa.replace("−", "-")) == 0:
        return "0"
    return f"{mantissa}×10{str(exponent).translate(_SUPERSCRIPTS)}"


def number_text(number: float) -> str:
    """A single number as on an axis, with as few digits as it needs, six at most."""
    return _shortest_text(number)


def _shortest_text(number: float) -> str:
    """A single number, to six digits, or all digits of a whole number below 10**12."""
    if abs(number) < _SMALLEST_SPAN:
        return "0"
    if abs(number) < 1e12 and number == round(number):
        return _plain_text(number, 0)
    exponent = math.floor(math.log10(abs(number)))
    if _MIN_PLAIN <= abs(number) < _MAX_PLAIN:
        return _plain_text(float(f"{number:.6g}"), _decimals_of(f"{number:.5e}", exponent))
    return _power_text(number, exponent, _decimals_of(f"{number:.5e}", 0))


def _decimals_of(scientific: str, exponent: int) -> int:
    """Decimals of a number that is written as ``1.25000e+03``, times a power of ten, without zeros at its end."""
    mantissa = scientific.split("e")[0].rstrip("0").rstrip(".")
    digits_behind = len(mantissa.split(".")[1]) if "." in mantissa else 0
    return max(digits_behind - exponent, 0)
