"""Files that are written whole or not at all: under a hidden name first, which a rename makes theirs at the end."""

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
    """Where to write what `path` is to hold: it gets that name when the block ends, and goes when the block fails.

    Folders on the way are made. Until the end whatever was there before stays, and a process that is killed leaves a
    hidden file ``.z2p-*.part`` at most. `durable` brings the content to the disk before it gets its name, so that a
    machine that goes down tears no file either; it costs some milliseconds a file.

    Raises:
        NoFileError: something other than a file lies there.
        OSError: a folder cannot be made or written to.
    """
    check_file_target(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".z2p-{uuid.uuid4().hex[:16]}.part")  # short: the name itself may be as long as can be
    try:
        yield temporary
        if durable:
            with temporary.open("rb") as file:
                os.fsync(file.fileno())
        temporary.replace(path)
    except OSError as error:
        if error.errno is not None and error.filename is None:  # an error of writing, unlike one of opening, names none
            error.filename = str(path)
        raise
    finally:
        temporary.unlink(missing_ok=True)


class NotAFileError(UserError, OSError):
    """A folder, device or pipe where a file is to be written, which a rename would fail on or, worse, replace."""


def check_file_target(path: Path) -> None:
    """Nothing, where a file can be written: where there is none, or one that may be replaced.

    Raises:
        NoFileError: a folder, device, pipe or socket, or a link to one.
    """
    if path.exists() and not path.is_file():
        raise NotAFileError(f"{printable(path)}: expected the name of a file to write, got {file_kind(path)}; choose "
                          "another name")


def atomic_write(content: bytes, path: Path, *, durable: bool = False) -> Path:
    """The path, once a file of that content is there.

    `durable` is that of `atomic_path`.

    Raises:
        OSError: the file cannot be written; what was there before is left as it was.
    """
    with atomic_path(path, durable=durable) as temporary:
        temporary.write_bytes(content)
    return path


def file_kind(path: Path) -> str:
    """What lies at a path, in words, where it is no plain file."""
    if path.is_dir():
        return "a folder"
    kinds = (("a pipe", path.is_fifo), ("a device", path.is_char_device), ("a disk's device", path.is_block_device),
             ("a socket", path.is_socket))  # fmt: skip
    return next((name for name, holds in kinds if holds()), "a file" if path.is_file() else "no file")
