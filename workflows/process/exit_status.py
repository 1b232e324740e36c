"""The end of a failed pipeline: one line with the reason, and an exit status that says whether to try again.

Tasks run in processes of their own and report their failures through a pipe that they all inherit. luigi's closing
summary, which names no reasons, is not printed after a failure.
"""

from __future__ import annotations

import json
import os
from contextlib import suppress

import luigi.retcodes

from z2p_renderer.storage.files.disk_errors import TEMPORARY_FAILURE
from z2p_renderer.workflows.process.task_log import lines_logged, log_line

_failures_reader, _failures_writer = os.pipe()
os.set_blocking(_failures_reader, False)
os.set_blocking(_failures_writer, False)
MAX_LINE_CHARACTERS = 3000
"""Lines are cut to this length, so that each record fits into one atomic write to a pipe."""
MAX_RECORD_BYTES = 4000
"""A pipe takes 4096 bytes (PIPE_BUF) at once without mixing them with those of other writers."""


def record_failure(line: str, *, temporary: bool = False) -> None:
    """Print a failure, and record it for the end; `temporary` means that the same command may succeed later."""
    log_line(line)
    record = {"line": line[:MAX_LINE_CHARACTERS], "temporary": temporary, "lines_logged": lines_logged.value}
    with suppress(OSError):  # the pipe is full of earlier failures, which suffice
        os.write(_failures_writer, json.dumps(record).encode()[:MAX_RECORD_BYTES] + b"\n")


def summarize_failures() -> bool:
    """Whether any task failed. If so, print the reason as the last line and set the exit status."""
    failures = _read_failures()
    if not failures:
        return False
    if len(failures) > 1:
        log_line(f"FAILED {len(failures)} tasks, the first: {str(failures[0]['line']).removeprefix('FAILED ')}")
    elif failures[0]["lines_logged"] != lines_logged.value:  # other tasks have printed lines after it
        log_line(str(failures[0]["line"]))
    if all(failure["temporary"] for failure in failures):
        _set_exit_status(TEMPORARY_FAILURE)
    return True


def _read_failures() -> list[dict[str, str | bool | int]]:
    text = b""
    with suppress(BlockingIOError):
        while part := os.read(_failures_reader, 1 << 16):
            text += part
    failures = []
    for line in text.splitlines():
        with suppress(ValueError):  # a record that was cut
            failures.append(json.loads(line))
    return failures


def _set_exit_status(status: int) -> None:
    """Change luigi's exit statuses. It has read its configuration into this shared object before the tasks ran."""
    statuses = luigi.retcodes.retcode()
    statuses.task_failed = statuses.scheduling_error = status
