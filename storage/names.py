"""Names of files, as they are told to people."""

from __future__ import annotations

from pathlib import Path


def printable(path: Path) -> str:
    """The path as one line: names with a newline or undecodable bytes are quoted and escaped."""
    text = str(path)
    return text if text.isprintable() else ascii(text)
