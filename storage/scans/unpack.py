"""Unpacks gzip'd scans, and spools standard input, into temporary files."""

from __future__ import annotations

import gzip
import shutil
import tempfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from z2p_core.interfaces import ScanError
from z2p_renderer.storage.scans.content_detection import suffix_of

STDIN_STEM = "stdin"
"""Stem of the file that holds standard input."""
SPOOL_FOLDER_PREFIX = "z2p-stdin-"
"""Prefix of the temporary folder that holds standard input."""
_CHUNK_BYTES = 1 << 20
"""Streams are copied and unpacked in chunks of this size."""
_PACKED_SUFFIXES, _ASSUMED_COMPRESSION_RATIO = (".laz", ".npz", ".e57"), 8
"""Formats that may be compressed, and the compression ratio that is assumed for them."""


def spool(stream: BinaryIO, folder: Path) -> Path:
    """Copies a stream to ``stdin.<suffix>`` in the folder; its first bytes decide the suffix.

    Text of no other known format gets ``.txt``, which allows any columns.

    Raises:
        ScanError: the stream is empty, or begins like gzip and is not.
    """
    head = stream.read(_CHUNK_BYTES)
    if not head:
        raise ScanError("standard input is empty; pipe a scan into it, as in: cat scan.ply | z2p run-inference -")
    zipped = head.startswith(b"\x1f\x8b")
    try:
        start = zlib.decompressobj(31).decompress(head, _CHUNK_BYTES) if zipped else head
    except zlib.error as error:
        raise ScanError(f"standard input begins like a gzip file, and is none ({error}); send it again") from error
    path = folder / STDIN_STEM
    with path.open("wb") as file:
        file.write(head)
        shutil.copyfileobj(stream, file, _CHUNK_BYTES)
    suffix = suffix_of(start, _unpacked_size(path) if zipped else path.stat().st_size)
    return path.rename(folder / f"{STDIN_STEM}{suffix}{'.gz' if zipped else ''}")


def content_size(path: Path) -> int:
    """About how many bytes a scan holds when unpacked: by its gzip trailer, or by an assumed compression ratio.

    Raises:
        OSError: it cannot be read.
    """
    size = path.stat().st_size
    if path.suffix.lower() == ".gz":
        return max(size, _unpacked_size(path))
    return size * (_ASSUMED_COMPRESSION_RATIO if path.suffix.lower() in _PACKED_SUFFIXES else 1)


def _unpacked_size(path: Path) -> int:
    """Unpacked size of a gzip file in bytes, modulo 4 GiB, from its last four bytes."""
    with path.open("rb") as file:
        file.seek(max(path.stat().st_size - 4, 0))
        return int.from_bytes(file.read(), "little")


def is_spooled(path: Path) -> bool:
    """Whether `spool` wrote the file."""
    return path.name.startswith(f"{STDIN_STEM}.") and path.parent.name.startswith(SPOOL_FOLDER_PREFIX)


@contextmanager
def unpacked_file(path: Path, max_bytes: int | None) -> Iterator[Path]:
    """The path itself; for a .gz, a temporary file with its content that exists while the context is open.

    Raises:
        ScanError: the gzip file is damaged, or unpacks to more than `max_bytes` (None: no limit).
    """
    if path.suffix.lower() != ".gz":
        yield path
        return
    with tempfile.TemporaryDirectory(prefix="z2p-") as folder:
        inner = Path(folder) / Path(path.name).with_suffix("").name
        _unpack(path, inner, max_bytes)
        yield inner


def _unpack(path: Path, inner: Path, max_bytes: int | None) -> None:
    """Unpacks the gzip file `path` to `inner`, in chunks.

    Raises:
        ScanError: see `unpacked_file`.
    """
    size = 0
    try:
        with gzip.open(path) as packed, inner.open("wb") as file:
            while chunk := packed.read(_CHUNK_BYTES):
                size += len(chunk)
                if max_bytes is not None and size > max_bytes:
                    raise ScanError(f"unpacks to more than {max_bytes / 1e9:.1f} GB, which do not fit into memory; "
                                    "thin the scan out first")
                file.write(chunk)
    except (EOFError, zlib.error, gzip.BadGzipFile) as error:
        raise ScanError(f"cannot be unpacked ({error}); the file is damaged or cut short: fetch it again") from error
