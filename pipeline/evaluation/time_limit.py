"""Runs functions in a process of its own, which is killed when one takes too long, with all that it has started."""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections.abc import Callable
from contextlib import suppress
from pickle import PicklingError
from types import TracebackType
from typing import Any

from z2p_core.interfaces import ScanError

START_SECONDS = 600.0
"""Time that a process has to start and to import what the first function needs."""


class TimeLimitError(ScanError):
    """A function took longer than it may."""


class StoppableProcess:
    """Calls module-level functions in one process, started at the first call and kept until the ``with`` block ends.

    It is spawned, as a library's threads do not survive a fork, and leads a process group, which is killed as a whole.
    """

    def __init__(self, seconds: float) -> None:
        """`seconds` are those that a call may take."""
        self.seconds = seconds
        self._process: Any = None
        self._pipe: Any = None

    def __enter__(self) -> StoppableProcess:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self._kill()

    def call(self, function: Callable[..., Any], *arguments: Any, within: float | None = None) -> Any:
        """What the function returns, or the error that it raises; in at most `within` seconds, or `self.seconds`.

        Raises:
            TimeLimitError: it took longer.
            ScanError: its process died, of lack of memory for example.
        """
        self._start()
        limit = self.seconds if within is None else within
        try:
            self._pipe.send((function, arguments))
            if not self._pipe.poll(limit):
                raise TimeLimitError(f"stopped after {limit:g} s")
            result, error = self._pipe.recv()
        except (EOFError, ConnectionError):
            self._process.join(5)
            code = self._process.exitcode
            self._kill()
            raise ScanError(f"its process died (exit status {code}); give a smaller cloud") from None
        except BaseException:  # an interrupt as well: else the pending result would be taken for the next call's
            self._kill()
            raise
        if error is not None:
            raise error
        return result

    def _start(self) -> None:
        if self._process is not None and self._process.is_alive():
            return
        context = multiprocessing.get_context("spawn")
        self._pipe, child_pipe = context.Pipe()
        self._process = context.Process(target=_serve, args=(child_pipe,))  # no daemon, which may start no process
        self._process.start()
        child_pipe.close()
        if not self._pipe.poll(START_SECONDS) or self._pipe.recv() != "ready":
            self._kill()
            raise ScanError(f"a process did not start within {START_SECONDS:g} s")

    def _kill(self) -> None:
        if self._process is None:
            return
        with suppress(ProcessLookupError, PermissionError):  # macOS refuses a group of processes that have ended
            os.killpg(self._process.pid, signal.SIGKILL)
        self._process.kill()  # if it has not come to lead its group yet
        self._process.join()
        self._pipe.close()
        self._process = None


def _serve(pipe: Any) -> None:
    """Runs calls from the pipe until its other end is closed."""
    os.setsid()
    pipe.send("ready")
    while True:
        try:
            function, arguments = pipe.recv()
        except EOFError:
            return
        answer: tuple[Any, Exception | None]
        try:
            answer = function(*arguments), None
        except Exception as error:
            answer = None, error
        try:
            pipe.send(answer)
        except (TypeError, AttributeError, PicklingError) as error:  # an error of a class that only this process knows
            pipe.send((None, RuntimeError(f"{error}: {answer[1]!r}")))
