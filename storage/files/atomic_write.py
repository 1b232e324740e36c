"""Atomic file writes: content goes to a hidden temporary file, which is then renamed."""

from __future__ import annotations

import os
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from z2p_core.errors.messages import UserError
from z2p_renderer.storage.files.printable_names import printable


@contextmanager
def atomic_path(path: Path, *, durable: bool = False) -> Iterator[Path]:
    """Yields a temporary path that is renamed to `path` at the end of the block, or removed if the block fails.

    Missing folders are created. Until the rename the old content stays; a killed process leaves at most a hidden file
    ``.z2p-*.part``. `durable` flushes the content to the disk before the rename, so that a crash of the machine leaves
    no partial file either; it costs some milliseconds per file.

    Raises:
        NotAFileError: `path` is something other than a regular file.
        OSError: a folder cannot be created or written to.
    """
    check_file_target(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".z2p-{uuid.uuid4().hex[:16]}.part")  # short: `path` may have the longest valid name
    try:
        yield temporary
        if durable:
            with temporary.open("rb") as file:
                os.fsync(file.fileno())
        temporary.replace(path)
    except OSError as error:
        if error.errno is not None and error.filename is None:  # errors of writing have no file name
            error.filename = str(path)
        raise
    finally:
        temporary.unlink(missing_ok=True)


class NotAFileError(UserError, OSError):
    """The target of a write is a folder, device or pipe, which a rename would fail on or, worse, replace."""


def check_file_target(path: Path) -> None:
    """Checks that a file can be written at `path`: nothing is there, or a regular file.

    Raises:
        NotAFileError: a folder, device, pipe or socket is there, or a link to one.
    """
    if path.exists() and not path.is_file():
        raise NotAFileError(f"{printable(path)}: expected the name of a file to write, got {file_kind(path)}; choose "
                          "another name")


def atomic_write(content: bytes, path: Path, *, durable: bool = False) -> Path:
    """Writes the content atomically, and returns the path. `durable` is that of `atomic_path`.

    Raises:
        OSError: the file cannot be written; the old content is unchanged.
    """
    with atomic_path(path, durable=durable) as temporary:
        temporary.write_bytes(content)
    return path


def file_kind(path: Path) -> str:
    """Words for the kind of file at a path, such as "a folder"."""
    if path.is_dir():
        return "a folder"
    kinds = (("a pipe", path.is_fifo), ("a device", path.is_char_device), ("a disk's device", path.is_block_device),
             ("a socket", path.is_socket))  # fmt: skip
    return next((name for name, holds in kinds if holds()), "a file" if path.is_file() else "no file")
