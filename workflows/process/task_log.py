"""The log file of each task, with everything that it and its child processes print."""

from __future__ import annotations

import multiprocessing
import os
import sys
import time
import traceback
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

TAIL_LINES = 12
_TAIL_BYTES = 16_384

lines_logged = multiprocessing.RawValue("L", 0)
"""Number of lines that all processes of a pipeline have logged so far; in shared memory."""
_terminal: int | None = None
"""File descriptor of stderr from before it was redirected to a task's log; None while it is not redirected."""


def log_line(line: str) -> None:
    """Print a line of progress on stderr, and in the log of the running task."""
    lines_logged.value += 1
    with suppress(OSError):  # the terminal may have been closed, which must not stop the work
        os.write(2 if _terminal is None else _terminal, f"{line}\n".encode())
    if _terminal is not None:
        stamp = time.strftime("%H:%M:%S", time.gmtime())
        with suppress(OSError):  # an error of a full disk must not hide the task's own error
            os.write(2, "".join(f"{stamp} {part}\n" for part in line.splitlines()).encode())


@contextmanager
def output_to_log(path: Path) -> Iterator[None]:
    """Redirect stdout and stderr, of child processes too, to the file at `path`; an error's traceback is appended."""
    global _terminal
    path.parent.mkdir(parents=True, exist_ok=True)
    sys.stdout.flush()
    sys.stderr.flush()
    saved = [os.dup(1), os.dup(2)]
    log = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
    began = time.strftime("%Y-%m-%d %H:%M:%S UTC", time.gmtime())
    with suppress(OSError):  # a full disk, which the task itself will report
        os.write(log, f"--- {began}, process {os.getpid()} on {os.uname().nodename}\n".encode())
    os.dup2(log, 1)
    os.dup2(log, 2)
    os.close(log)
    outer = _terminal
    # keep the real terminal if nested: a task may repair an upstream result, which has a log of its own
    _terminal = saved[1] if outer is None else outer
    try:
        yield
    except BaseException:
        with suppress(OSError):
            os.write(2, traceback.format_exc().encode())
        raise
    finally:
        for stream in (sys.stdout, sys.stderr):
            with suppress(OSError):
                stream.flush()
        _terminal = outer
        for number, descriptor in zip((1, 2), saved, strict=True):
            os.dup2(descriptor, number)
            os.close(descriptor)


def last_lines(path: Path, count: int = TAIL_LINES) -> list[str]:
    """The last `count` lines of a log; an empty list if there is no log."""
    try:
        with path.open("rb") as file:
            file.seek(max(0, path.stat().st_size - _TAIL_BYTES))
            return file.read().decode(errors="replace").splitlines()[-count:]
    except OSError:
        return []
