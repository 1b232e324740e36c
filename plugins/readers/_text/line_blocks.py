"""The lines of a text file, many at a time, and where an editor shows one of them."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from typing import TextIO

from z2p_core.formats.tables.header_lines import column_names, text_encoding, without_comment
from z2p_core.interfaces import ScanError

_FIRST_BLOCK_CHARACTERS = 1 << 18
"""Characters from which the form of the rows is told."""
_BLOCK_CHARACTERS = 1 << 22
"""Characters that are read at a time, so that the text of a large file is never in memory as a whole."""
_ENCODING_SAMPLE_BYTES = 1 << 10
"""Bytes that tell how a text is encoded: titles have letters beyond ASCII, rows have none."""
_LONG_LINE_BYTES = 1 << 16
"""Bytes of a line that is no point's by all means."""
_MAX_LINE_CHARACTERS = 1 << 22
"""Characters of a line at the most; the longest real ones are rows of rasters and tracks of COLMAP."""


def content_blocks(path: Path) -> Iterator[list[str]]:
    """Lines that hold something, without what ``#`` begins; some first ones, then many at a time.

    Raises:
        ScanError: a line is longer than any row of numbers.
    """
    for lines in _iter_batches(path):
        if "#" in "".join(lines):
            lines = [line.split("#", 1)[0] for line in lines]
        if "" in lines or any(map(str.isspace, lines)):
            lines = [line for line in lines if line and not line.isspace()]
        if lines:
            yield lines


def has_long_lines(path: Path) -> bool:
    """Whether the first line goes on and on, as that of a text without line breaks does."""
    with path.open("rb") as file:
        head = file.read(_LONG_LINE_BYTES)
    return len(head) == _LONG_LINE_BYTES and b"\n" not in head and b"\r" not in head


def line_number(path: Path, index: int) -> int:
    """Where an editor shows the line that has `index` others with content before it: the first line is 1.

    The file is read again for it, which costs only those that are refused; to remember it would cost all.
    """
    return _find_line(path, index)[0]


def truncation_hint(path: Path, index: int) -> str:
    """What to say of a line that goes on behind ``#``, as a colour would."""
    if "#" not in _find_line(path, index)[1]:
        return ""
    return "; on that line '#' begins a comment, so the rest of it was not read: take the sign out where it is none"


def _find_line(path: Path, index: int) -> tuple[int, str]:
    """Number and text of the line that has `index` others with content before it."""
    lines = (line for batch in _iter_batches(path) for line in batch)
    content_lines = ((number, line) for number, line in enumerate(lines, start=1) if line.split("#", 1)[0].strip())
    return next(islice(content_lines, index, None))


def _iter_batches(path: Path) -> Iterator[list[str]]:
    """All lines without their ends, some first ones, in which names behind ``#`` are kept, then many at a time."""
    named = False
    with _open_decoded(path) as file:
        for lines in _iter_line_batches(file):
            yield lines if named else _with_names(lines)
            named = True


def _iter_line_batches(file: TextIO) -> Iterator[list[str]]:
    """Lines without their ends; what a line would be whose end never comes is not waited for."""
    rest, number, wanted = "", 0, _FIRST_BLOCK_CHARACTERS
    while True:
        text = file.read(wanted)
        lines = (rest + text).split("\n")
        last = len(text) < wanted
        if max(map(len, lines)) > _MAX_LINE_CHARACTERS:
            index = next(index for index, line in enumerate(lines) if len(line) > _MAX_LINE_CHARACTERS)
            raise ScanError(f"line {number + index + 1} is longer than {_MAX_LINE_CHARACTERS >> 20} million characters, so "
                            "this is no table with a point a line; export the file again, with line breaks")
        rest = "" if last else lines.pop()
        if lines:
            yield lines
            number += len(lines)
            wanted = _BLOCK_CHARACTERS
        if last:
            return


def _with_names(first: list[str]) -> list[str]:
    """The first lines of a file, in which one that names columns behind ``#``, as numpy writes it, begins with ``//``.

    So it is kept for the head of the file, which takes it for a comment that may mean something else.
    """
    for index, line in enumerate(first):
        if line.startswith("#"):
            if column_names(names := line.lstrip("#")):
                first[index] = "//" + names
        elif line.strip():
            first[index] = without_comment(line)
            break
    return first


def _open_decoded(path: Path) -> TextIO:
    with path.open("rb") as file:
        encoding = text_encoding(file.read(_ENCODING_SAMPLE_BYTES))
    return path.open(encoding=encoding, errors="replace")
