"""Which C files the kernels were compiled from, and how: noted beside them, since code and kernels may come apart."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path

NOTE, BUILD = "kernels.sha256", "build.py"
LIBRARY = "kernels.dll" if os.name == "nt" else "kernels.so"
"""The compiled kernels: the same for every Python, so no Python is in their name."""


def digest(folder: Path = Path(__file__).parent) -> str:
    """sha256 (64 hex digits) of the names and bytes of the C files in a folder, and of what compiles them."""
    found = hashlib.sha256()
    for path in sorted([folder / BUILD, *(folder / "c").glob("*/*.[ch]")]):
        content = path.read_bytes()
        found.update(f"{path.relative_to(folder).as_posix()} {len(content)}\n".encode() + content)
    return found.hexdigest()


def outdated(folder: Path = Path(__file__).parent) -> bool:
    """Whether the kernels in a folder are noted to come from others than what lies beside them."""
    note = folder / NOTE
    return note.is_file() and note.read_text(encoding="utf-8").strip() != digest(folder)
