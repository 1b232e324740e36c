"""Reads the lines of a text file in blocks, and finds the line numbers for messages."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from typing import TextIO

from z2p_core.formats.tables.header_lines import column_names, text_encoding, without_comment
from z2p_core.interfaces import ScanError

_FIRST_BLOCK_CHARACTERS = 1 << 18
"""Size of the first block, from which the row format is detected."""
_BLOCK_CHARACTERS = 1 << 22
"""Size of later blocks, so that a large file is never in memory as a whole."""
_ENCODING_SAMPLE_BYTES = 1 << 10
"""Bytes from which the encoding is detected: titles have letters beyond ASCII, rows have none."""
_LONG_LINE_BYTES = 1 << 16
"""A first line of this many bytes is no row of a point."""
_MAX_LINE_CHARACTERS = 1 << 22
"""Longer lines are refused; the longest ones in practice are rows of rasters and tracks of COLMAP."""


def content_blocks(path: Path) -> Iterator[list[str]]:
    """The nonempty lines without ``#`` comments, in blocks: a small one first, then larger ones.

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
    """Whether the first line is very long, as that of a text without line breaks is."""
    with path.open("rb") as file:
        head = file.read(_LONG_LINE_BYTES)
    return len(head) == _LONG_LINE_BYTES and b"\n" not in head and b"\r" not in head


def line_number(path: Path, index: int) -> int:
    """The line number, counted from 1, of the content line with that index, counted from 0.

    The file is read again for it, so that only files that are refused pay for it.
    """
    return _find_line(path, index)[0]


def truncation_hint(path: Path, index: int) -> str:
    """Advice on a content line of which a part was read as a ``#`` comment, such as a color; empty for other lines."""
    if "#" not in _find_line(path, index)[1]:
        return ""
    return "; on that line '#' begins a comment, so the rest of it was not read: take the sign out where it is none"


def _find_line(path: Path, index: int) -> tuple[int, str]:
    """Line number and text of the content line with that index."""
    lines = (line for batch in _iter_batches(path) for line in batch)
    content_lines = ((number, line) for number, line in enumerate(lines, start=1) if line.split("#", 1)[0].strip())
    return next(islice(content_lines, index, None))


def _iter_batches(path: Path) -> Iterator[list[str]]:
    """All lines without line ends, in blocks; in the first block, column names behind ``#`` are kept."""
    named = False
    with _open_decoded(path) as file:
        for lines in _iter_line_batches(file):
            yield lines if named else _with_names(lines)
            named = True


def _iter_line_batches(file: TextIO) -> Iterator[list[str]]:
    """Blocks of lines without line ends; a line that is too long is refused before it is in memory as a whole."""
    rest, number, wanted = "", 0, _FIRST_BLOCK_CHARACTERS
    while True:
        text = file.read(wanted)
        lines = (rest + text).split("\n")
        last = len(text) < wanted
        if max(map(len, lines)) > _MAX_LINE_CHARACTERS:
            index = next(index for index, line in enumerate(lines) if len(line) > _MAX_LINE_CHARACTERS)
            millions = _MAX_LINE_CHARACTERS >> 20
            raise ScanError(f"line {number + index + 1} is longer than {millions} million characters, so this is "
                            "no table with a point a line; export the file again, with line breaks")
        rest = "" if last else lines.pop()
        if lines:
            yield lines
            number += len(lines)
            wanted = _BLOCK_CHARACTERS
        if last:
            return


def _with_names(first: list[str]) -> list[str]:
    """Replaces the ``#`` before column names, as numpy writes them, by ``//`` in the first lines of a file.

    So the names are not removed as a comment; `parse_head` then treats them as optional.
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
