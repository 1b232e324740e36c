"""Names of files, as they are told to people."""

from __future__ import annotations

import os
from pathlib import Path


def printable(path: Path) -> str:
    """The path as one line: names with a newline or undecodable bytes are quoted and escaped."""
    text = str(path)
    return text if text.isprintable() else ascii(text)


def without_gz(path: Path) -> Path:
    """The path under which a gzip'd file would lie unpacked: without ``.gz``; any other as it is."""
    return path.with_suffix("") if path.suffix.lower() == ".gz" else path


def is_file(path: str | Path) -> bool:
    """Whether a file lies there; unlike `Path.is_file` before Python 3.14 this refuses no name, however long."""
    return os.path.isfile(path)  # noqa: PTH113


def is_folder(path: str | Path) -> bool:
    """The same for folders."""
    return os.path.isdir(path)  # noqa: PTH112


def path_exists(path: str | Path) -> bool:
    """The same for anything."""
    return os.path.exists(path)  # noqa: PTH110
