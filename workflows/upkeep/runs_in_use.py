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
from collections.abc import Container, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Any

from z2p_renderer.storage.files.atomic_write import atomic_write
from z2p_renderer.storage.results.store import Store, StoreError
from z2p_renderer.workflows.plan import AnyPlan

DEAD_AFTER_SECONDS = 600.0
"""A pipeline of another machine counts as dead when it has been silent for so long."""


class Registration:
    """A pipeline's note of the results that it uses; it goes when the process ends."""

    def __init__(self, store: Store, plan: AnyPlan, source: str) -> None:
        note = _note(store, plan, source)
        self._process = os.getpid()
        with collection_lock(store, shared=True):
            name = f"{note['host']}-{os.getpid()}-{uuid.uuid4().hex[:6]}.json"
            self.path = _write(store.root / ".running" / name, note)
            self._file: IO[str] = self.path.open()
            fcntl.flock(self._file, fcntl.LOCK_SH)
            keep_results(store, plan, source)
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


def keep_results(store: Store, plan: AnyPlan, source: str) -> None:
    """Note the plan's results as those of its configuration, in place of an earlier run's."""
    _write(store.root / ".kept" / f"{plan.config.name}.json", _note(store, plan, source))


def iter_running(store: Store) -> Iterator[dict[str, Any]]:
    """Notes of the pipelines that are alive, as far as can be told.

    Raises:
        StoreError: one is damaged, so that nobody can tell what its pipeline uses.
    """
    for path in sorted((store.root / ".running").glob("*.json")):
        if _is_alive(path):
            yield _read(path, "wait until its pipeline has ended")


def remove_dead_notes(store: Store) -> None:
    """Remove the notes of pipelines that were killed."""
    for path in (store.root / ".running").glob("*.json"):
        if not _is_alive(path):
            path.unlink(missing_ok=True)


def kept_names(store: Store) -> list[str]:
    """Names of the kept configurations."""
    return sorted(path.stem for path in (store.root / ".kept").glob("*.json"))


def kept_results(store: Store, but: Container[str] = ()) -> dict[str, dict[str, Any]]:
    """Notes of the kept configurations, by name, but for some.

    Raises:
        StoreError: one is damaged, so that nobody can tell what its configuration needs.
    """
    advice = "run its pipeline again, which writes the note anew, or let go of it with --drop {}"
    return {name: _read(store.root / ".kept" / f"{name}.json", advice.format(name))
            for name in kept_names(store) if name not in but}  # fmt: skip


@contextmanager
def collection_lock(store: Store, *, shared: bool) -> Iterator[None]:
    """Held shared by a pipeline that starts and alone by a sweep, so that neither is in the middle of the other."""
    path = store.root / ".locks" / "sweep"
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("a+") as file:  # NFS 4 locks shared what is open to be read, alone what is open to be written
        fcntl.flock(file, fcntl.LOCK_SH if shared else fcntl.LOCK_EX)
        yield


def _note(store: Store, plan: AnyPlan, source: str) -> dict[str, Any]:
    folders = [store.folder(step.entry).relative_to(store.root).as_posix() for step in plan.steps.values()]
    return {"name": plan.config.name, "host": os.uname().nodename, "source": json.loads(source),
            "results": sorted(folders)}  # fmt: skip


def _read(path: Path, advice: str) -> dict[str, Any]:
    """The note at a path.

    Raises:
        StoreError: it is torn, or lists no results.
    """
    try:
        note = json.loads(path.read_text(encoding="utf-8"))
        if isinstance(note["results"], list) and all(isinstance(one, str) for one in note["results"]):
            return dict(note)
        reason = "it lists no results"
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        reason = type(error).__name__
    raise StoreError(f"{path}: the note of what is in use is damaged ({reason}), and nothing may go before it is "
                     f"mended: {advice}")


def _is_alive(path: Path) -> bool:
    try:
        with path.open("r+" if os.access(path, os.W_OK) else "r") as file:
            silent = time.time() - path.stat().st_mtime
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                return True
            except OSError:  # another user's note, on NFS 4: its age alone tells
                return silent < DEAD_AFTER_SECONDS
            own = json.load(file)["host"] == os.uname().nodename
            return not own and silent < DEAD_AFTER_SECONDS
    except (FileNotFoundError, ValueError, KeyError, TypeError, RecursionError):  # gone, or torn by a crash
        return False


def _write(path: Path, note: dict[str, Any]) -> Path:
    return atomic_write((json.dumps(note, indent=1) + "\n").encode(), path, durable=True)
