"""Recognizes disk errors (full, read-only, over quota, out of inodes) and words them for the user.

Such an error is temporary and no mistake of the caller: commands then exit with the status `TEMPORARY_FAILURE`, on
which a service may start them again.
"""

from __future__ import annotations

import errno
import os
from collections.abc import Iterator
from pathlib import Path

TEMPORARY_FAILURE = 75
"""Exit status, EX_TEMPFAIL of sysexits.h: the same command may succeed later."""
_RERUN_ADVICE = "and the same command goes on"
_FREE_SPACE_ADVICE, _WRITABLE_ADVICE = f"free some, {_RERUN_ADVICE}", f"make it writable, {_RERUN_ADVICE}"
_ERROR_TEXTS = {
    errno.ENOSPC: ("no space left on the disk", _FREE_SPACE_ADVICE),
    errno.EDQUOT: ("the quota is used up on the disk", _FREE_SPACE_ADVICE),
    errno.EROFS: ("read-only: the disk", _WRITABLE_ADVICE),
    errno.EIO: ("reading or writing failed on the disk", f"look after it, {_RERUN_ADVICE}"),
    errno.ESTALE: ("out of reach: the network disk", f"wait for it, {_RERUN_ADVICE}"),
    errno.EMFILE: ("too many open files for one process, one", f"raise the limit (ulimit -n), {_RERUN_ADVICE}"),
    errno.ENFILE: ("too many open files for this machine, one", f"end other programs, {_RERUN_ADVICE}"),
}
"""Error number -> its description, which precedes the path, and the advice."""
_NO_INODES = "no inodes left (too many files) on the disk"
_PERMISSION_ERRORS = (errno.EACCES, errno.EPERM)
"""These count as disk errors only below the output folder: elsewhere they concern a file that the user named."""
_LIBRARY_WORDS = {"No space left on device": errno.ENOSPC, "Disk quota exceeded": errno.EDQUOT,
          "Read-only file system": errno.EROFS}  # fmt: skip
"""Words in the errors that libraries raise in place of these -> error number."""
MIN_FREE_BYTES = 1 << 16
"""A disk with fewer bytes left counts as full."""


class DiskError(OSError):
    """A disk error whose message was made when it occurred: later the disk may have space again."""


def disk_error_message(error: BaseException | str, folder: Path | None = None) -> str | None:
    """The message for a disk error, from an exception or the last lines of a program; None for any other error.

    `folder` is the folder that the caller writes to.
    """
    texts = [error] if isinstance(error, str) else []
    for one in _iter_causes(error) if isinstance(error, BaseException) else ():
        texts.append(str(one))
        if isinstance(one, DiskError):
            return str(one)
        if not isinstance(one, OSError) or one.errno is None:
            continue
        named = Path(os.fsdecode(one.filename)) if isinstance(one.filename, str | bytes | os.PathLike) else None
        if one.errno in _ERROR_TEXTS:
            return _disk_message(one.errno, named or folder)
        if one.errno in _PERMISSION_ERRORS and named and folder and _lies_in(named, folder):
            return f"no permission for {named}; {_WRITABLE_ADVICE}"
    number = next((number for words, number in _LIBRARY_WORDS.items() if any(words in text for text in texts)), None)
    return None if number is None else _disk_message(number, folder)


def full_disk_message(folder: Path) -> str | None:
    """The message if the disk of a folder has no bytes or no inodes left; otherwise None."""
    try:
        disk = os.statvfs(folder)
    except OSError:
        return None
    room = disk.f_bavail * disk.f_frsize >= MIN_FREE_BYTES and not _has_no_inodes(folder)
    return None if room else _disk_message(errno.ENOSPC, folder)


def _disk_message(number: int, place: Path | None) -> str:
    reason, advice = _ERROR_TEXTS[number]
    if number == errno.ENOSPC and place is not None and _has_no_inodes(place):
        reason = _NO_INODES
    return f"{reason} of {place}; {advice}" if place is not None else f"{reason}; {advice}"


def _has_no_inodes(path: Path) -> bool:
    place = next((one for one in (path, *path.absolute().parents) if one.exists()), None)
    if place is None:
        return False
    disk = os.statvfs(place)
    return bool(disk.f_files) and not disk.f_favail


def _lies_in(path: Path, folder: Path) -> bool:
    return folder.absolute() in (path.absolute(), *path.absolute().parents)


def _iter_causes(error: BaseException | None) -> Iterator[BaseException]:
    """The error and its chain of causes."""
    seen: set[int] = set()
    while error is not None and id(error) not in seen:
        seen.add(id(error))
        yield error
        error = error.__cause__ or error.__context__
