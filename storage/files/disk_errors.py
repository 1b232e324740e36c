"""What a disk refuses: errors of one that is full, read-only, over its quota or out of inodes, told as such.

Such an error is nobody's mistake in a call, and passes when there is room again: commands end with the status
`TEMPORARY_FAILURE` on it, on which a service may start them again.
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
"""Number of the error -> what it means, followed by the place, and what to do."""
_NO_INODES = "no inodes left (too many files) on the disk"
_PERMISSION_ERRORS = (errno.EACCES, errno.EPERM)
"""Counted only below a folder that the caller writes to: elsewhere they tell of a file that a user named."""
_LIBRARY_WORDS = {"No space left on device": errno.ENOSPC, "Disk quota exceeded": errno.EDQUOT,
          "Read-only file system": errno.EROFS}  # fmt: skip
"""How errors that libraries make of these tell it."""
MIN_FREE_BYTES = 1 << 16
"""A disk with fewer bytes left counts as full."""


class DiskError(OSError):
    """A disk's refusal, put into words while it lasted: room may be there again when it is told."""


def disk_error_message(error: BaseException | str, folder: Path | None = None) -> str | None:
    """What a disk refused, in words, as an error or a program's last lines tell; None where it was something else.

    `folder` is where the one who asks writes.
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
    """Words for a disk that has no room left, be it of bytes or of inodes; None where there is some."""
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
    """The error, and those that it came of."""
    seen: set[int] = set()
    while error is not None and id(error) not in seen:
        seen.add(id(error))
        yield error
        error = error.__cause__ or error.__context__
