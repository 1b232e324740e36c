"""File names for messages, and checks for existence that accept any name."""

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
    """Whether a file exists; unlike `Path.is_file` before Python 3.14 this raises no error for overlong names."""
    return os.path.isfile(path)  # noqa: PTH113


def is_folder(path: str | Path) -> bool:
    """Whether a folder exists; see `is_file`."""
    return os.path.isdir(path)  # noqa: PTH112


def path_exists(path: str | Path) -> bool:
    """Whether anything exists at the path; see `is_file`."""
    return os.path.exists(path)  # noqa: PTH110
