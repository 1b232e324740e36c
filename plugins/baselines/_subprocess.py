"""Runs a library function that may hang in a separate process, which is killed after a time limit."""

from __future__ import annotations

import multiprocessing
import os
import threading
from collections.abc import Callable
from typing import Any

from z2p_core.errors.messages import error_reason
from z2p_core.interfaces import ScanError


class SubprocessFunction:
    """Calls `function`, a module-level one, in a process that is kept for the next call.

    The process is spawned, not forked, since a library's threads do not survive a fork.
    """

    def __init__(self, function: Callable[..., Any]) -> None:
        self._function, self._lock = function, threading.Lock()
        self._process: Any = None
        self._pipe: Any = None
        self._owner = 0

    def __call__(self, *arguments: Any, within: float) -> Any:
        """Result of the function for these arguments, in at most `within` seconds.

        Raises:
            ScanError: it took longer, its process died, or it raised an error.
        """
        with self._lock:
            self._start()
            name = self._function.__name__
            try:
                self._pipe.send(arguments)
                if not self._pipe.poll(within):
                    self._end()
                    raise ScanError(f"{name} did not end within {within:g} s and was stopped; give a smaller cloud")
                result, error = self._pipe.recv()
            except (EOFError, OSError):
                code = self._end()
                raise ScanError(f"{name} died (exit status {code}); give another cloud") from None
            except BaseException:  # an interrupt: else the pending result would be taken for the next call's
                if self._process is not None:
                    self._end()
                raise
        if error:
            raise ScanError(f"{name}: {error}")
        return result

    def _start(self) -> None:
        if self._process is not None and self._owner == os.getpid() and self._process.is_alive():
            return
        context = multiprocessing.get_context("spawn")
        self._pipe, child_pipe = context.Pipe()
        self._process = context.Process(target=_serve_calls, args=(self._function, child_pipe), daemon=True)
        self._process.start()
        self._owner = os.getpid()
        child_pipe.close()

    def _end(self) -> int | None:
        self._process.kill()
        self._process.join()
        code: int | None = self._process.exitcode
        self._process = None
        self._pipe.close()
        return code


def _serve_calls(function: Callable[..., Any], pipe: Any) -> None:
    """Runs calls from the pipe until its other end is closed."""
    while True:
        try:
            arguments = pipe.recv()
        except EOFError:
            return
        try:
            pipe.send((function(*arguments), ""))
        except Exception as error:
            pipe.send((None, error_reason(error)))
