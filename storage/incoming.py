"""Scans that are no plain files: gzip'd ones and standard input, in a temporary file while they are read."""

from __future__ import annotations

import gzip
import re
import shutil
import tempfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from z2p_core.column_names import column_names, is_comment, is_number, is_row
from z2p_core.interfaces import ScanError

STDIN_STEM = "stdin"
MAGIC = (
    (b"ply", ".ply"), (b"# .PCD", ".pcd"), (b"VERSION", ".pcd"), (b"\x93NUMPY", ".npy"), (b"PK\x03\x04", ".npz"),
    (b"LASF", ".las"), (b"ASTM-E57", ".e57"), (b"OFF", ".off"), (b"glTF", ".glb"), (b"solid", ".stl"),
)  # fmt: skip
"""First bytes -> suffix."""
PREFIX = "z2p-stdin-"
"""Of the temporary folder that keeps standard input."""
_STEP = 1 << 20


def spool(stream: BinaryIO, folder: Path) -> Path:
    """File ``stdin.<suffix>`` in the folder that holds all of a stream; its format is told by its first bytes.

    Text that says nothing else of itself counts as ``.xyz``, or as ``.obj`` where its lines begin with ``v``.

    Raises:
        ScanError: nothing comes, or what begins like gzip is not.
    """
    head = stream.read(_STEP)
    if not head:
        raise ScanError("standard input is empty; pipe a scan into it, as in: cat scan.ply | z2p run-inference -")
    zipped = head.startswith(b"\x1f\x8b")
    try:
        start = zlib.decompressobj(31).decompress(head, 4096) if zipped else head
    except zlib.error as error:
        raise ScanError(f"standard input begins like a gzip file, and is none ({error}); send it again") from error
    path = folder / f"{STDIN_STEM}{suffix_of(start)}{'.gz' if zipped else ''}"
    with path.open("wb") as file:
        file.write(head)
        shutil.copyfileobj(stream, file, _STEP)
    return path


def is_spooled(path: Path) -> bool:
    """Whether a file is what `spool` keeps of standard input."""
    return path.name.startswith(f"{STDIN_STEM}.") and path.parent.name.startswith(PREFIX)


def suffix_of(head: bytes) -> str:
    """Suffix of the format that a file's first bytes belong to."""
    for magic, suffix in MAGIC:
        if head.startswith(magic):
            return suffix
    lines = [line for line in head[:_STEP].splitlines() if line.strip() and not line.lstrip().startswith(b"#")]
    return ".obj" if any(line.split()[0] == b"v" for line in lines[:200]) else ".xyz"


def is_prose(path: Path, named: bool = False) -> bool:
    """Whether a .txt or .csv file begins with neither three numbers nor the names x, y and z: a note, not a scan.

    Where the user has `named` its columns, one line may stand before the numbers, and words beside them.
    """
    if path.suffix.lower() not in (".txt", ".csv") or not path.is_file():  # opening a pipe would wait for ever
        return False
    try:
        with path.open("rb") as file:
            head = file.read(4096).decode("utf-8-sig", errors="replace")
    except OSError:
        return False  # the reader says what is wrong
    lines = [line for line in (line.split("#")[0].strip() for line in head.splitlines()) if line]
    if any(map(column_names, lines[: _first_row(lines) + 1])):
        return False
    rows = lines[_first_row(lines) :]
    if named and rows and not is_row(rows[0]):
        rows = rows[1:]
    words = re.split(r"[;,\s]+", rows[0].strip(";,")) if rows else []
    numbers = sum(map(is_number, words))
    return numbers < 3 or (numbers < len(words) and not named)


def _first_row(lines: list[str]) -> int:
    """Index of the first line that is no comment."""
    return next((index for index, line in enumerate(lines) if not is_comment(line)), len(lines))


@contextmanager
def unpacked(path: Path, largest: int | None) -> Iterator[Path]:
    """The path itself, or while the context lasts a temporary file with the content of a .gz, unpacked step by step.

    Raises:
        ScanError: it is no gzip file, is cut short, or would unpack to more than `largest` bytes (None: no limit).
    """
    if path.suffix.lower() != ".gz":
        yield path
        return
    with tempfile.TemporaryDirectory(prefix="z2p-") as folder:
        inner = Path(folder) / Path(path.name).with_suffix("").name
        _unpack(path, inner, largest)
        yield inner


def _unpack(path: Path, inner: Path, largest: int | None) -> None:
    size = 0
    try:
        with gzip.open(path) as packed, inner.open("wb") as file:
            while step := packed.read(_STEP):
                size += len(step)
                if largest is not None and size > largest:
                    raise ScanError(f"unpacks to more than {largest / 1e9:.1f} GB, which do not fit into memory; "
                                    "thin the scan out first")
                file.write(step)
    except (EOFError, zlib.error, gzip.BadGzipFile) as error:
        raise ScanError(f"cannot be unpacked ({error}); the file is damaged or cut short: fetch it again") from error
