"""Which results are in use: by pipelines that run now, and by configurations whose results are kept.

====================================  ===============================================================================
`<root>/.running/<host>-<pid>.json`   a running pipeline's results; locked while it lives, touched every few seconds
`<root>/.kept/<name>.json`            the results of a configuration's newest run
====================================  ===============================================================================
"""

from __future__ import annotations

import atexit
import fcntl
import json
import os
import time
import uuid
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Any

from z2p_renderer.storage.layout import Store
from z2p_renderer.storage.whole import write_whole
from z2p_renderer.workflows.plan import Planned

SILENT_SECONDS = 600.0
"""A pipeline of another machine counts as dead when it has been silent for so long."""


class Registration:
    """A pipeline's note of the results that it uses; it goes when the process ends."""

    def __init__(self, store: Store, plan: Planned, source: str) -> None:
        note = _note(store, plan, source)
        self._process = os.getpid()
        with gate(store, shared=True):
            name = f"{note['host']}-{os.getpid()}-{uuid.uuid4().hex[:6]}.json"
            self.path = _write(store.root / ".running" / name, note)
            self._file: IO[str] = self.path.open()
            fcntl.flock(self._file, fcntl.LOCK_SH)
            keep(store, plan, source)
        atexit.register(self.close)

    def touch(self) -> bool:
        """Say that the pipeline is alive; False when its note is gone."""
        with suppress(OSError):  # of a disk that is away for a moment
            if not self.path.exists():
                return False
            os.utime(self.path)
        return True

    def close(self) -> None:
        if os.getpid() == self._process:  # a forked task ends before its pipeline
            self.path.unlink(missing_ok=True)
            self._file.close()


def keep(store: Store, plan: Planned, source: str) -> None:
    """Note the plan's results as those of its configuration, in place of an earlier run's."""
    _write(store.root / ".kept" / f"{plan.config.name}.json", _note(store, plan, source))


def running(store: Store) -> Iterator[dict[str, Any]]:
    """Notes of the pipelines that are alive, as far as can be told."""
    for path in sorted((store.root / ".running").glob("*.json")):
        if _is_alive(path):
            yield json.loads(path.read_text(encoding="utf-8"))


def forget_dead(store: Store) -> None:
    """Remove the notes of pipelines that were killed."""
    for path in (store.root / ".running").glob("*.json"):
        if not _is_alive(path):
            path.unlink(missing_ok=True)


def kept(store: Store) -> dict[str, dict[str, Any]]:
    """Notes of the kept configurations, by name."""
    return {path.stem: json.loads(path.read_text(encoding="utf-8"))
            for path in sorted((store.root / ".kept").glob("*.json"))}  # fmt: skip


@contextmanager
def gate(store: Store, *, shared: bool) -> Iterator[None]:
    """Held shared by a pipeline that starts and alone by a sweep, so that neither is in the middle of the other."""
    path = store.root / ".locks" / "sweep"
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("a+") as file:  # NFS 4 locks shared what is open to be read, alone what is open to be written
        fcntl.flock(file, fcntl.LOCK_SH if shared else fcntl.LOCK_EX)
        yield


def _note(store: Store, plan: Planned, source: str) -> dict[str, Any]:
    folders = [store.folder(step.entry).relative_to(store.root).as_posix() for step in plan.steps.values()]
    return {"name": plan.config.name, "host": os.uname().nodename, "source": json.loads(source),
            "results": sorted(folders)}  # fmt: skip


def _is_alive(path: Path) -> bool:
    try:
        with path.open("r+" if os.access(path, os.W_OK) else "r") as file:
            silent = time.time() - path.stat().st_mtime
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                return True
            except OSError:  # another user's note, on NFS 4: its age alone tells
                return silent < SILENT_SECONDS
            own = json.load(file)["host"] == os.uname().nodename
            return not own and silent < SILENT_SECONDS
    except (FileNotFoundError, ValueError, KeyError):  # gone, or torn as its machine went down
        return False


def _write(path: Path, note: dict[str, Any]) -> Path:
    return write_whole((json.dumps(note, indent=1) + "\n").encode(), path, lasting=True)
