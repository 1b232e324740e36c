"""Parses JSON from untrusted files with limits on size, nesting depth and numbers.

Python's own parser accepts NaN, infinity, numbers of thousands of digits, and nesting up to the recursion limit.
"""

from __future__ import annotations

import json
import math
from typing import Any

MAX_BYTES = 1 << 20
MAX_DEPTH = 32
"""Nested objects and lists; the record in an image has seven levels."""
MAX_DIGITS = 40
"""Digits of an integer."""


class JsonError(ValueError):
    """The text is no JSON, or exceeds a limit; the message says which."""


def read_json(text: str | bytes, max_bytes: int = MAX_BYTES) -> Any:
    """Parses a JSON text of at most `max_bytes` bytes to Python objects; all numbers are finite.

    Raises:
        JsonError: the text is no JSON, not UTF-8, too long, nested too deep, or has numbers that are too long or not
            finite.
    """
    if len(text) > max_bytes:
        raise JsonError(f"expected JSON of at most {max_bytes:,} bytes, got {len(text):,}")
    try:
        value = json.loads(text, parse_constant=_refuse_constant, parse_int=_parse_int, parse_float=_parse_float)
    except JsonError:
        raise
    except RecursionError:
        raise JsonError(f"expected JSON nested at most {MAX_DEPTH} deep") from None
    except ValueError as error:  # UnicodeDecodeError is one
        raise JsonError(f"not JSON ({error})") from error
    _check_depth(value)
    return value


def _check_depth(value: Any) -> None:
    """Raises JsonError if objects and lists are nested deeper than `MAX_DEPTH`."""
    level = [value]
    for _ in range(MAX_DEPTH + 1):
        children = [one.values() if isinstance(one, dict) else one for one in level if isinstance(one, dict | list)]
        level = [item for items in children for item in items]
        if not level:
            return
    raise JsonError(f"expected JSON nested at most {MAX_DEPTH} deep")


def _refuse_constant(name: str) -> float:
    raise JsonError(f"expected finite numbers, got {name}")


def _parse_int(digits: str) -> int:
    if len(digits) > MAX_DIGITS:
        raise JsonError(f"expected numbers of at most {MAX_DIGITS} digits, got {len(digits):,} of them")
    return int(digits)


def _parse_float(digits: str) -> float:
    number = float(digits)
    if not math.isfinite(number):
        raise JsonError(f"expected finite numbers, got {digits[:MAX_DIGITS]}")
    return number
