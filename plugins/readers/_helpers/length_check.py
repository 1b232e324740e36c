"""Whether a binary file has the length that its header promises."""

from __future__ import annotations

from z2p_core.interfaces import ScanError

MAX_TRAILING_BYTES = 16
"""Bytes that may follow the data: a newline, or what fills a file up to whole words."""


def check_trailing_bytes(promise: str, expected: int, got: int, most: int = MAX_TRAILING_BYTES) -> int:
    """How many of `got` bytes follow the `expected` ones; no more than `most` may.

    Raises:
        ScanError: fewer bytes than promised, or far more; `promise` begins the message.
    """
    stray = got - expected
    if stray < 0:
        raise ScanError(f"{promise}, which takes {expected} bytes, but {got} follow it; the file is cut short or its "
                        "header is wrong: export it again")
    if stray > most:
        raise ScanError(f"{promise}, which takes {expected} bytes, but {got} follow it; the file is {stray} bytes "
                        "longer, so its header is wrong: export it again")
    return stray


def trailing_bytes_note(stray: int) -> str:
    """What the file's line says of stray bytes; nothing if there are none."""
    return f"stray bytes at the file's end ignored: {stray}" if stray else ""
