"""How a pipeline that fails ends: with the one line that says why, and an exit status that says whether to try again.

Tasks run in processes of their own, so what failed in them comes here through a pipe that all of them have inherited.
luigi's closing summary, which names no reason, is left out then.
"""

from __future__ import annotations

import json
import os
from contextlib import suppress

import luigi.retcodes

from z2p_renderer.storage.files.disk_errors import TEMPORARY_FAILURE
from z2p_renderer.workflows.process.task_log import lines_logged, log_line

_notes_reader, _notes_writer = os.pipe()
os.set_blocking(_notes_reader, False)
os.set_blocking(_notes_writer, False)
MAX_LINE_CHARACTERS = 3000
"""Characters of a line that is kept: less than what goes through a pipe in one piece."""


def record_failure(line: str, *, temporary: bool = False) -> None:
    """Say that something failed, and keep the line for the end; `temporary` where the same command may succeed later."""
    log_line(line)
    note = json.dumps({"line": line[:MAX_LINE_CHARACTERS], "passing": temporary, "said": lines_logged.value}).encode()
    with suppress(OSError):  # of so many failures the first ones will do
        os.write(_notes_writer, note[:4000] + b"\n")


def summarize_failures() -> bool:
    """Whether anything failed: then one line ends it all, and the exit status tells whether it may pass."""
    notes = _read_notes()
    if not notes:
        return False
    if len(notes) > 1:
        log_line(f"FAILED {len(notes)} tasks, the first: {str(notes[0]['line']).removeprefix('FAILED ')}")
    elif notes[0]["said"] != lines_logged.value:  # other tasks went on
        log_line(str(notes[0]["line"]))
    if all(note["passing"] for note in notes):
        _set_exit_status(TEMPORARY_FAILURE)
    return True


def _read_notes() -> list[dict[str, str | bool | int]]:
    text = b""
    with suppress(BlockingIOError):
        while part := os.read(_notes_reader, 1 << 16):
            text += part
    notes = []
    for line in text.splitlines():
        with suppress(ValueError):
            notes.append(json.loads(line))
    return notes


def _set_exit_status(status: int) -> None:
    """luigi has read its exit statuses by now, into an object that it keeps for all who ask: this one."""
    statuses = luigi.retcodes.retcode()
    statuses.task_failed = statuses.scheduling_error = status
