"""Whether a binary file has the length that its header promises."""

from __future__ import annotations

from z2p_core.interfaces import ScanError

MAX_TRAILING_BYTES = 16
"""Bytes that may follow the data: a newline, or padding to whole words."""


def check_trailing_bytes(promise: str, expected: int, got: int, max_trailing: int = MAX_TRAILING_BYTES) -> int:
    """The number of trailing bytes in `got` bytes of which `expected` are data; at most `max_trailing`.

    Raises:
        ScanError: fewer bytes than promised, or far more; `promise` begins the message.
    """
    trailing = got - expected
    if trailing < 0:
        raise ScanError(f"{promise}, which takes {expected} bytes, but {got} follow it; the file is cut short or its "
                        "header is wrong: export it again")
    if trailing > max_trailing:
        raise ScanError(f"{promise}, which takes {expected} bytes, but {got} follow it; the file is {trailing} bytes "
                        "longer, so its header is wrong: export it again")
    return trailing


def trailing_bytes_note(trailing: int) -> str:
    """The note for the user on trailing bytes; empty if there are none."""
    return f"stray bytes at the file's end ignored: {trailing}" if trailing else ""
