"""The digest of the kernels' sources, noted beside the compiled library, to see whether the two belong together."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path

LIBRARY_NAME = "kernels.dll" if os.name == "nt" else "kernels.so"
"""File of the compiled kernels: it is not linked with Python, so one file serves every version."""
NOTE_NAME = "kernels.sha256"
"""File beside the library that holds the `source_digest` of what it was compiled from."""
BUILD_MODULE = "build.py"
"""Counts as a source, since it holds the compiler's flags."""


def source_digest(folder: Path = Path(__file__).parent) -> str:
    """sha256 (64 hex digits) of the names and bytes of a folder's C files and of the module that compiles them."""
    digest = hashlib.sha256()
    for path in sorted([folder / BUILD_MODULE, *(folder / "c").glob("*/*.[ch]")]):
        content = path.read_bytes()
        digest.update(f"{path.relative_to(folder).as_posix()} {len(content)}\n".encode() + content)
    return digest.hexdigest()


def are_kernels_outdated(folder: Path = Path(__file__).parent) -> bool:
    """Whether the note says that the library was compiled from other sources; False without a note."""
    note = folder / NOTE_NAME
    return note.is_file() and note.read_text(encoding="utf-8").strip() != source_digest(folder)
