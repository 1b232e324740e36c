"""Readers whose library may end the whole process on a damaged file: each file in a process of its own, with limits.

The process is started afresh (not forked, which threads do not outlive), reads one file, and hands its points back in a
file without a name, in memory where the system has such.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import asdict, fields
from importlib import import_module
from pathlib import Path
from typing import IO, Any

import numpy as np

from z2p_core.errors.messages import error_reason
from z2p_core.interfaces import RawCloud, Reader, ScanError, Sensor

SPARE_BYTES = 3 << 30
"""Bytes of addresses that a process takes at the most beside what its file needs; most of them are libraries'."""
_START_CODE = ("import json, sys; sys.path[:] = json.loads(sys.argv[2]); "
          "from z2p_renderer.storage.scans.isolated_reading import serve; serve()")
_WEB_CLIENT = "requests"
"""A web client that laspy imports where there is one, which takes longer than to read a small file."""
_ONE_THREAD = {name: "1" for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")}


class ReaderEndedError(ScanError):
    """The reader's process ended without an answer."""


def read_apart(reader: Reader, path: Path, memory: int) -> list[RawCloud]:
    """What the reader gives for a file, read by a process that may take so many bytes of memory and `SPARE_BYTES`.

    Raises:
        ScanError: the reader raised an error, or its process ended.
    """
    with _unnamed() as answer:
        kind = type(reader)
        order = {"module": kind.__module__, "reader": kind.__qualname__, "path": str(path.absolute()), "memory": memory,
                 "columns": reader.columns and list(reader.columns), "answer": answer.fileno()}  # fmt: skip
        command = [sys.executable, "-c", _START_CODE, json.dumps(order), json.dumps(sys.path)]
        try:
            done = subprocess.run(command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, process_group=0,
                                  stderr=subprocess.DEVNULL, pass_fds=[answer.fileno()],
                                  env={**os.environ, **_ONE_THREAD}, check=False)  # fmt: skip
        except OSError as error:
            raise ScanError(f"no process could be started to read it ({error.strerror}); try again") from error
        answer.seek(0)
        return _taken(answer, done.returncode)


def can_read_apart(reader: Reader) -> bool:
    """Whether another process can be started here and would find the reader."""
    return os.name == "posix" and bool(sys.executable) and type(reader).__module__ != "__main__"


def _unnamed() -> IO[bytes]:
    """A file without a name, in memory where the system has such."""
    if hasattr(os, "memfd_create"):
        return os.fdopen(os.memfd_create("z2p"), "w+b")
    return tempfile.TemporaryFile()


def _taken(answer: IO[bytes], status: int) -> list[RawCloud]:
    """The clouds of an answer.

    Raises:
        ScanError: as `read_apart` says.
    """
    line = answer.readline()
    try:
        told = json.loads(line)
    except ValueError:
        told = {}
    if "error" in told:
        raise ScanError(told["error"])
    if "clouds" not in told or status != 0:
        raise ReaderEndedError(f"the reader's process ended ({_told_status(status)}): the file is damaged, or wants "
                               "more memory than there is; export it again")
    clouds = []
    for cloud in told["clouds"]:
        rows = cloud.pop("rows")
        points = np.empty((rows, 3))
        if answer.readinto(points) != points.nbytes:  # type: ignore[attr-defined]
            raise ReaderEndedError("the reader's process broke off its answer; try again")
        arrays = {name: np.array(cloud[name]) for name in ("upward", "seen_from") if cloud[name] is not None}
        sensor = cloud["sensor"] and Sensor(*(np.array(cloud["sensor"][name]) for name in ("position", "rotation")))
        clouds.append(RawCloud(**{**cloud, **arrays, "points": points, "sensor": sensor}))
    return clouds


def _told_status(status: int) -> str:
    """How a process ended, in words."""
    if status >= 0:
        return f"exit status {status}"
    with suppress(ValueError):
        return f"{signal.Signals(-status).name}"
    return f"signal {-status}"


def serve() -> None:
    """Reads the file of the order in the process's arguments, and writes the answer into the file it names."""
    order = json.loads(sys.argv[1])
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the one who ordered it decides what an interrupt ends
    _limit_memory(order["memory"] + SPARE_BYTES)
    sys.modules[_WEB_CLIENT] = None  # type: ignore[assignment]
    try:
        kind: Any = import_module(order["module"])
        for name in order["reader"].split("."):
            kind = getattr(kind, name)
        reader = kind()
        reader.columns = order["columns"] and tuple(order["columns"])
        given = reader.read(Path(order["path"]))
        _write(order["answer"], [cloud if isinstance(cloud, RawCloud) else RawCloud(cloud) for cloud in given])
    except Exception as error:
        reason = str(error) if isinstance(error, ScanError) else failure_message(order["reader"], error)
        _write(order["answer"], error=reason)
    os._exit(0)  # a library's threads, or what it cleans up at the end, hold nobody up


def failure_message(name: str, error: BaseException) -> str:
    """What is said of a reader that failed in a way of its own."""
    return f"the reader {name!r} failed ({type(error).__name__}: {error_reason(error)})"


def _limit_memory(size: int) -> None:
    """Has the system refuse this process more than so many bytes of addresses, where it knows how."""
    with suppress(ImportError, OSError, ValueError):
        import resource

        hard = resource.getrlimit(resource.RLIMIT_AS)[1]
        resource.setrlimit(resource.RLIMIT_AS, (size if hard < 0 else min(size, hard), hard))


def _write(place: int, clouds: Sequence[RawCloud] = (), error: str = "") -> None:
    with os.fdopen(place, "wb") as file:
        if error:
            file.write(json.dumps({"error": error}).encode() + b"\n")
            return
        arrays = [np.ascontiguousarray(cloud.points, np.float64) for cloud in clouds]
        shapes = [array.shape for array in arrays if array.ndim != 2 or array.shape[1] != 3]
        if shapes:
            file.write(json.dumps({"error": f"the reader gave an array {shapes[0]}, expected (N, 3); its plugin is "
                                            "broken"}).encode() + b"\n")  # fmt: skip
            return
        told = [{**_plain(cloud), "rows": len(array)} for cloud, array in zip(clouds, arrays, strict=True)]
        file.write(json.dumps({"clouds": told}).encode() + b"\n")
        for array in arrays:
            file.write(array.data)


def _plain(cloud: RawCloud) -> dict[str, Any]:
    """All but the points, as JSON has it."""
    told = {field.name: getattr(cloud, field.name) for field in fields(cloud) if field.name != "points"}
    if cloud.sensor is not None:
        told["sensor"] = {name: value.tolist() for name, value in asdict(cloud.sensor).items()}
    return {name: value.tolist() if isinstance(value, np.ndarray) else value for name, value in told.items()}
