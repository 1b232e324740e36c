"""Reads a file in a subprocess with a memory limit, for readers whose library may crash on a damaged file.

The subprocess is started, not forked (forking is unsafe with threads). It reads one file and returns the points through
an unnamed file, in memory where the system supports that.
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
"""Address space allowed for the subprocess beyond what the file needs, in bytes; libraries take most of it."""
_START_CODE = ("import json, sys; sys.path[:] = json.loads(sys.argv[2]); "
          "from z2p_renderer.storage.scans.isolated_reading import serve; serve()")
_WEB_CLIENT = "requests"
"""laspy imports this web client if it is installed, which takes longer than reading a small file."""
_ONE_THREAD = {name: "1" for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")}


class ReaderEndedError(ScanError):
    """The reader's process ended without a result."""


def read_in_subprocess(reader: Reader, path: Path, memory: int) -> list[RawCloud]:
    """Runs a reader in a subprocess that may use `memory` bytes for the file, and `SPARE_BYTES` beside it.

    Raises:
        ScanError: the reader raised an error, or its process ended.
    """
    with _unnamed_file() as result:
        kind = type(reader)
        request = {"module": kind.__module__, "reader": kind.__qualname__, "path": str(path.absolute()),
                   "memory": memory, "columns": reader.columns and list(reader.columns),
                   "wanted": None if reader.wanted is None else list(reader.wanted), "max_rows": reader.max_rows,
                   "result": result.fileno()}  # fmt: skip
        command = [sys.executable, "-c", _START_CODE, json.dumps(request), json.dumps(sys.path)]
        try:
            done = subprocess.run(command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, process_group=0,
                                  stderr=subprocess.DEVNULL, pass_fds=[result.fileno()],
                                  env={**os.environ, **_ONE_THREAD}, check=False)  # fmt: skip
        except OSError as error:
            raise ScanError(f"no process could be started to read it ({error.strerror}); try again") from error
        result.seek(0)
        return _parse_result(result, done.returncode)


def can_read_in_subprocess(reader: Reader) -> bool:
    """Whether another process can be started here and would find the reader."""
    return os.name == "posix" and bool(sys.executable) and type(reader).__module__ != "__main__"


def _unnamed_file() -> IO[bytes]:
    """An unnamed file, in memory where the system supports that."""
    if hasattr(os, "memfd_create"):
        return os.fdopen(os.memfd_create("z2p"), "w+b")
    return tempfile.TemporaryFile()


def _parse_result(result: IO[bytes], status: int) -> list[RawCloud]:
    """The clouds that the subprocess wrote into the result file.

    Raises:
        ScanError: see `read_in_subprocess`.
    """
    line = result.readline()
    try:
        header = json.loads(line)
    except ValueError:
        header = {}
    if "error" in header:
        raise ScanError(header["error"])
    if "clouds" not in header or status != 0:
        raise ReaderEndedError(f"the reader's process ended ({_describe_status(status)}): the file is damaged, or "
                               "wants more memory than there is; export it again")
    clouds = []
    for cloud in header["clouds"]:
        points = _read_array(result, np.dtype(np.float64), (cloud.pop("rows"), 3))
        cloud["fields"] = {name: _read_array(result, np.dtype(kind), shape)
                           for name, (kind, shape) in cloud["fields"].items()}  # fmt: skip
        cloud["class_names"] = {name: {int(value): word for value, word in words.items()}
                                for name, words in cloud["class_names"].items()}  # fmt: skip
        arrays = {name: np.array(cloud[name]) for name in ("upward", "seen_from") if cloud[name] is not None}
        sensor = cloud["sensor"] and Sensor(*(np.array(cloud["sensor"][name]) for name in ("position", "rotation")))
        clouds.append(RawCloud(**{**cloud, **arrays, "points": points, "sensor": sensor}))
    return clouds


def _read_array(result: IO[bytes], dtype: np.dtype, shape: Sequence[int]) -> np.ndarray:
    """The next array of the result file."""
    array = np.empty(tuple(shape), dtype)
    if result.readinto(array.reshape(-1).view(np.uint8)) != array.nbytes:  # type: ignore[attr-defined]
        raise ReaderEndedError("the reader's process broke off its answer; try again")
    return array


def _describe_status(status: int) -> str:
    """Describes the exit status of a process."""
    if status >= 0:
        return f"exit status {status}"
    with suppress(ValueError):
        return f"{signal.Signals(-status).name}"
    return f"signal {-status}"


def serve() -> None:
    """Runs in the subprocess: reads the file that the request (in the arguments) names, and writes the result."""
    request = json.loads(sys.argv[1])
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent process handles interrupts
    _limit_memory(request["memory"] + SPARE_BYTES)
    sys.modules[_WEB_CLIENT] = None  # type: ignore[assignment]
    try:
        kind: Any = import_module(request["module"])
        for name in request["reader"].split("."):
            kind = getattr(kind, name)
        reader = kind()
        reader.columns = request["columns"] and tuple(request["columns"])
        reader.wanted, reader.max_rows = request["wanted"], request["max_rows"]
        clouds = reader.read(Path(request["path"]))
        _write(request["result"], [cloud if isinstance(cloud, RawCloud) else RawCloud(cloud) for cloud in clouds])
    except Exception as error:
        reason = str(error) if isinstance(error, ScanError) else failure_message(request["reader"], error)
        _write(request["result"], error=reason)
    os._exit(0)  # do not wait for a library's threads and exit handlers


def failure_message(name: str, error: BaseException) -> str:
    """The message for a reader that raised something other than a ScanError."""
    return f"the reader {name!r} failed ({type(error).__name__}: {error_reason(error)})"


def _limit_memory(size: int) -> None:
    """Limits the address space of this process to `size` bytes, where the system supports that."""
    with suppress(ImportError, OSError, ValueError):
        import resource

        hard = resource.getrlimit(resource.RLIMIT_AS)[1]
        resource.setrlimit(resource.RLIMIT_AS, (size if hard < 0 else min(size, hard), hard))


def _write(descriptor: int, clouds: Sequence[RawCloud] = (), error: str = "") -> None:
    with os.fdopen(descriptor, "wb") as file:
        if error:
            file.write(json.dumps({"error": error}).encode() + b"\n")
            return
        arrays = [np.ascontiguousarray(cloud.points, np.float64) for cloud in clouds]
        shapes = [array.shape for array in arrays if array.ndim != 2 or array.shape[1] != 3]
        if shapes:
            file.write(json.dumps({"error": f"the reader gave an array {shapes[0]}, expected (N, 3); its plugin is "
                                            "broken"}).encode() + b"\n")  # fmt: skip
            return
        entries = [{**_to_json(cloud), "rows": len(array)} for cloud, array in zip(clouds, arrays, strict=True)]
        file.write(json.dumps({"clouds": entries}).encode() + b"\n")
        for array, cloud in zip(arrays, clouds, strict=True):
            file.write(array.data)
            for values in cloud.fields.values():
                file.write(np.ascontiguousarray(values).data)


def _to_json(cloud: RawCloud) -> dict[str, Any]:
    """What a cloud holds beside its points, as JSON values; of its fields only the types and shapes."""
    values = {field.name: getattr(cloud, field.name) for field in fields(cloud) if field.name != "points"}
    values["fields"] = {name: (array.dtype.str, array.shape) for name, array in cloud.fields.items()}
    values["field_names"] = list(cloud.field_names)
    if cloud.sensor is not None:
        values["sensor"] = {name: value.tolist() for name, value in asdict(cloud.sensor).items()}
    return {name: value.tolist() if isinstance(value, np.ndarray) else value for name, value in values.items()}
