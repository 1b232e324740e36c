"""Inputs tried one by one in a process of their own, with limits: one that ends it, hangs or floods it is a finding."""

from __future__ import annotations

import importlib
import json
import os
import re
import resource
import select
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import traceback
import warnings
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

TARGETS = ("readers", "records", "weights", "results", "configs", "render", "commands")
"""What can be attacked: each is a module ``fuzz_<name>`` with ``make(rng, folder)``, which writes one input into an
empty folder, and ``check(folder)``, which tries it and gives a few words on what came of it, or raises what is wrong.
A module's ``WARNINGS`` are kinds of warnings that its calls may give."""
SECONDS, SLOW, STARTING = 60.0, 20.0, 120.0
"""After how long an input is given up, how long it may take, and a process until it is ready for it."""
ROOM = 3 << 30
"""Bytes of data that one input may take beside what a process has from the start."""


@dataclass(frozen=True)
class Outcome:
    """What came of one input: a word on what it did, or the fault that it found."""

    label: str = ""
    fault: str = ""
    """All that is known of it, the traceback for one; empty where all is well."""

    @property
    def kind(self) -> str:
        """What faults of one cause have in common."""
        lines = [line.strip() for line in self.fault.splitlines() if line.strip()]
        frames = [line for line in lines if line.startswith("File ") and "/fuzz/" not in line]
        last = re.sub(r"[\d.e+-]*\d[\d.e+-]*|'[^']*'|\"[^\"]*\"|/\S+", "_", lines[-1] if lines else "")[:110]
        return f"{last} {re.sub(r'.*/', '', frames[-1]) if frames else ''}".strip()


class Worker:
    """A process that tries inputs; it is started again after one that ends it."""

    def __init__(self, seconds: float = SECONDS) -> None:
        self._seconds = seconds
        self._process: subprocess.Popen[str] | None = None
        self._folder = Path(tempfile.mkdtemp(prefix="z2p-fuzz-"))

    def attempt(self, target: str, seed: tuple[int, int] | Path, keep: Path | None = None) -> Outcome:
        """The outcome of an input: of the one that a seed and a number make, or of one kept in a folder.

        One that finds a fault is kept in the folder `keep`, the fault beside it.
        """
        given = {"again": str(seed)} if isinstance(seed, Path) else {"seed": list(seed)}
        place = self._folder / "input"
        outcome = self._asked({"target": target, "folder": str(place), **given})
        if outcome.fault and keep is not None:
            shutil.rmtree(keep, ignore_errors=True)
            shutil.copytree(place, keep, symlinks=True)
            (keep / "fault.txt").write_text(outcome.fault, errors="replace")
        return outcome

    def close(self) -> None:
        """End the process and forget its files."""
        self._end()
        shutil.rmtree(self._folder, ignore_errors=True)

    def _asked(self, question: dict[str, object]) -> Outcome:
        process = self._started()
        assert process.stdin is not None and process.stdout is not None
        with suppress(OSError):  # it has died: told below
            process.stdin.write(json.dumps(question) + "\n")
            process.stdin.flush()
        if not select.select([process.stdout], [], [], self._seconds)[0]:
            self._end()
            return Outcome(fault=f"no answer within {self._seconds:g} s\n{self._noise()}")
        line = process.stdout.readline()
        if not line:
            self._end()
            return Outcome(fault=f"the process ended with status {process.returncode}\n{self._noise()}")
        return Outcome(**json.loads(line))

    def _started(self) -> subprocess.Popen[str]:
        if self._process is None or self._process.poll() is not None:
            command = [sys.executable, __file__, str(self._folder / "noise.txt")]
            self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
                                             start_new_session=True, cwd=Path(__file__).parents[2])  # fmt: skip
            assert self._process.stdout is not None
            if not select.select([self._process.stdout], [], [], STARTING)[0] or not self._process.stdout.readline():
                self._end()
                raise RuntimeError(f"the process that tries inputs does not start: {self._noise()}")
        return self._process

    def _end(self) -> None:
        """The process and all that it has started."""
        if self._process is not None:
            with suppress(ProcessLookupError):
                os.killpg(self._process.pid, signal.SIGKILL)
            self._process.wait()

    def _noise(self) -> str:
        noise = self._folder / "noise.txt"
        return noise.read_text(errors="replace")[-4000:] if noise.exists() else ""


def serve(noise: Path) -> None:
    """Answer questions from standard input, a line each, with an outcome each."""
    answers = os.fdopen(os.dup(1), "w")
    with noise.open("w") as file:  # where all that anybody prints goes, so that it is seen
        os.dup2(file.fileno(), 1)
        os.dup2(file.fileno(), 2)
    os.environ.update(Z2P_CACHE="", OMP_NUM_THREADS="1")
    print("ready", file=answers, flush=True)
    for line in sys.stdin:
        question = json.loads(line)
        outcome = _tried(question, noise)
        print(json.dumps({"label": outcome.label, "fault": outcome.fault}), file=answers, flush=True)


def _tried(question: dict[str, object], noise: Path) -> Outcome:
    target = importlib.import_module(f"fuzz_{question['target']}")
    folder = Path(str(question["folder"]))
    shutil.rmtree(folder, ignore_errors=True)
    if "again" in question:
        shutil.copytree(str(question["again"]), folder)
    else:
        folder.mkdir()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            target.make(np.random.default_rng(question["seed"]), folder)
    os.truncate(noise, 0)
    _limit()
    fault, label, said = "", "", []
    begin = time.monotonic()
    try:
        with warnings.catch_warnings(record=True) as warned:
            warnings.simplefilter("always")
            label = target.check(folder)
        allowed = getattr(target, "WARNINGS", ())
        said = [f"{one.category.__name__}: {one.message} ({one.filename}:{one.lineno})" for one in warned
                if not issubclass(one.category, tuple(allowed))]  # fmt: skip
    except BaseException:  # whatever it is, it is a finding
        fault = traceback.format_exc()
    sys.stdout.flush()
    sys.stderr.flush()
    printed = noise.read_text(errors="replace").replace("\0", "")
    os.truncate(noise, 0)
    if not fault and (said or printed):
        fault = "\n".join(["something was said that nobody asked for", *said, printed[-2000:]])
    if not fault and (took := time.monotonic() - begin) > SLOW:
        fault = f"{took:.0f} s, expected {SLOW:g} at most"
    return Outcome(label, fault)


def _limit() -> None:
    """Leave room for no more data than one input needs, once; libraries that are loaded later do not count as data."""
    if resource.getrlimit(resource.RLIMIT_DATA)[0] == resource.RLIM_INFINITY:
        pages = int(Path("/proc/self/statm").read_text().split()[5])
        most = pages * os.sysconf("SC_PAGE_SIZE") + ROOM
        resource.setrlimit(resource.RLIMIT_DATA, (most, resource.RLIM_INFINITY))


if __name__ == "__main__":
    sys.path.append(str(Path(__file__).parents[1] / "helpers"))
    serve(Path(sys.argv[1]))
