"""Notes in a store about which results are in use: by running pipelines, and by configurations that are kept.

====================================  ===============================================================================
`<root>/.running/<host>-<pid>.json`   results of a running pipeline; it holds a lock and touches the file regularly
`<root>/.kept/<name>.json`            results of a configuration's newest run
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
"""A pipeline on another machine counts as dead when it has not touched its note for this time."""


class Registration:
    """A running pipeline's note of the results that it uses; deleted when the process ends."""

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
        """Update the note's time, as a sign that the pipeline is alive; False if the note no longer exists."""
        with suppress(OSError):  # such as a network disk that does not respond for a moment
            if not self.path.exists():
                return False
            os.utime(self.path)
        return True

    def close(self) -> None:
        """Delete the note; does nothing in forked processes, which end before the pipeline."""
        if os.getpid() == self._process:
            self.path.unlink(missing_ok=True)
            self._file.close()


def keep_results(store: Store, plan: AnyPlan, source: str) -> None:
    """Note the plan's results as those of its configuration, replacing the note of an earlier run."""
    _write(store.root / ".kept" / f"{plan.config.name}.json", _note(store, plan, source))


def iter_running(store: Store) -> Iterator[dict[str, Any]]:
    """Notes of the pipelines that appear to be alive.

    Raises:
        StoreError: a note is damaged, so that the results its pipeline uses are unknown.
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
    """Notes of the kept configurations by name, except of those named in `but`.

    Raises:
        StoreError: a note is damaged, so that the results its configuration needs are unknown.
    """
    advice = "run its pipeline again, which writes the note anew, or let go of it with --drop {}"
    return {name: _read(store.root / ".kept" / f"{name}.json", advice.format(name))
            for name in kept_names(store) if name not in but}  # fmt: skip


@contextmanager
def collection_lock(store: Store, *, shared: bool) -> Iterator[None]:
    """Lock against garbage collection: pipelines hold it shared while they start, a collection holds it exclusively."""
    path = store.root / ".locks" / "sweep"
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("a+") as file:  # NFS 4 needs a readable file for a shared lock, a writable one for an exclusive lock
        fcntl.flock(file, fcntl.LOCK_SH if shared else fcntl.LOCK_EX)
        yield


def _note(store: Store, plan: AnyPlan, source: str) -> dict[str, Any]:
    folders = [store.folder(step.entry).relative_to(store.root).as_posix() for step in plan.steps.values()]
    return {"name": plan.config.name, "host": os.uname().nodename, "source": json.loads(source),
            "results": sorted(folders)}  # fmt: skip


def _read(path: Path, advice: str) -> dict[str, Any]:
    """Read and check the note at a path; `advice` ends the message of an error.

    Raises:
        StoreError: the note is damaged, or lists no results.
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
    """Whether the pipeline that wrote a note seems to run, judged by the note's lock, and on other hosts by its age."""
    try:
        with path.open("r+" if os.access(path, os.W_OK) else "r") as file:
            age_seconds = time.time() - path.stat().st_mtime
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                return True
            except OSError:  # another user's note on NFS 4, which cannot be locked
                return age_seconds < DEAD_AFTER_SECONDS
            is_same_host = json.load(file)["host"] == os.uname().nodename
            return not is_same_host and age_seconds < DEAD_AFTER_SECONDS
    except (FileNotFoundError, ValueError, KeyError, TypeError, RecursionError):  # deleted, or damaged by a crash
        return False


def _write(path: Path, note: dict[str, Any]) -> Path:
    return atomic_write((json.dumps(note, indent=1) + "\n").encode(), path, durable=True)
