"""What no kept configuration needs, to be shown and then removed; never what a pipeline uses that runs.

Needed are the results of the newest run of every configuration (`.kept`), of every running pipeline (`.running`), what
links such as ``runs/regular/weights.safetensors`` lead to with all that it was made from, and what is being written.
Ground truth under ``truth/`` serves weights to come and is left alone.
"""

from __future__ import annotations

import shutil
import time
import uuid
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from z2p_renderer.storage.results.adoption import VIEW_RANGE
from z2p_renderer.storage.results.fingerprints import fingerprint
from z2p_renderer.storage.results.store import Store, StoreError
from z2p_renderer.workflows.upkeep.runs_in_use import collection_lock, iter_running, kept_results, remove_dead_notes

MIN_TEMPORARY_AGE_SECONDS = 3600.0
"""Half-written results that nobody holds are left alone for so long."""


@dataclass(frozen=True)
class Garbage:
    """A folder or file that can go."""

    path: Path
    name: str
    size: int
    """Bytes, each hard-linked file in full."""


def find_garbage(store: Store, drop: Iterable[str] = ()) -> list[Garbage]:
    """What can go, `drop` naming kept configurations that are no longer wanted."""
    needed = _needed_folders(store, set(drop))
    found: list[Garbage] = []
    for stage in store.stages():
        names = {folder: str(manifest.get("name", "")) for folder, manifest in store.iter_all_manifests(stage)}
        for folder in store.folders(stage):
            if folder not in needed and not store.is_locked(stage, folder.name):
                found.append(_garbage(folder, names.get(folder) or f"{stage}, damaged"))
    return found + [_garbage(path, what) for path, what in _iter_leftovers(store, needed)]


def collect_garbage(store: Store, drop: Iterable[str] = ()) -> list[Garbage]:
    """What was removed; pipelines that start meanwhile wait, and those that run keep all they use."""
    drop = set(drop)
    with collection_lock(store, shared=False):
        remove_dead_notes(store)
        found = find_garbage(store, drop)
        trash = store.root / ".trash" / uuid.uuid4().hex
        trash.mkdir(parents=True)
        for number, one in enumerate(found):
            one.path.rename(trash / str(number))
        for name in drop:
            (store.root / ".kept" / f"{name}.json").unlink(missing_ok=True)
    for left in list(trash.parent.iterdir()):  # of sweeps that were killed too; others may be at theirs right now
        shutil.rmtree(left, ignore_errors=left != trash)
    with suppress(OSError):  # not empty: another's
        trash.parent.rmdir()
    return found


def _needed_folders(store: Store, drop: set[str]) -> set[Path]:
    """Folders of all results that must stay.

    Raises:
        StoreError: what tells so is damaged.
    """
    notes = [*iter_running(store), *kept_results(store, drop).values()]
    needed = {store.root / folder for note in notes for folder in note["results"]}
    made = _Provenance(store)
    noted = {str(note.get("name")) for note in notes}
    for link in store.root.glob("[!.]*/*"):
        if link.is_symlink() and link.parent.name not in drop:
            folder = link.resolve().parent
            if folder.is_dir() and link.parent.name not in noted and not made.knows(folder):
                raise StoreError(f"{folder}: damaged, so that nobody can tell what {link} was made from, and nothing "
                                 f"may go before that is mended: run its pipeline again, or --drop {link.parent.name}")
            needed |= made.with_ancestors(folder)
    return needed


def _iter_leftovers(store: Store, needed: set[Path]) -> Iterator[tuple[Path, str]]:
    """What killed runs and repairs have left behind, with what it is."""
    for folder in sorted((store.root / ".work").glob("*/*")):
        stage = folder.parent.name
        if store.root / stage / folder.name not in needed and not store.is_locked(stage, folder.name):
            yield folder, f"unfinished {stage}"
    for folder in sorted((store.root / ".tmp").glob("*-*-*")):
        stage, prefix, _ = folder.name.rsplit("-", 2)
        locks = (store.root / ".locks").glob(f"{stage}-{prefix}*")
        held = any(store.is_locked(stage, lock.name.removeprefix(f"{stage}-")) for lock in locks)
        if not held and time.time() - folder.stat().st_mtime > MIN_TEMPORARY_AGE_SECONDS:
            yield folder, f"left by a killed {stage}"
    for log in sorted((store.root / ".logs").glob("*/*.log")):
        stage = log.parent.name
        result = store.root / stage / log.stem
        if result not in needed and not result.exists() and not store.is_locked(stage, log.stem):
            yield log, f"log of a {stage} that is gone"
    for folder in sorted((store.root / ".quarantine").glob("*/*")):
        yield folder, f"damaged {folder.parent.name}"


def _garbage(path: Path, name: str) -> Garbage:
    files = path.rglob("*") if path.is_dir() else [path]
    return Garbage(path, name, sum(file.stat().st_size for file in files if file.is_file()))


class _Provenance:
    """What each result in a store was made from."""

    def __init__(self, store: Store) -> None:
        self._fields: dict[Path, Mapping[str, Any]] = {}
        self._folders: dict[str, set[Path]] = {}
        for stage in store.stages():
            for folder, manifest in store.iter_all_manifests(stage):
                fields = manifest["fields"]
                self._fields[folder] = fields
                shared = {key: value for key, value in fields.items() if key not in VIEW_RANGE}
                for known in (fingerprint(fields), fingerprint(shared)):
                    self._folders.setdefault(known, set()).add(folder)

    def knows(self, folder: Path) -> bool:
        """Whether a result's manifest tells what it was made from."""
        return folder in self._fields

    def with_ancestors(self, folder: Path) -> set[Path]:
        """The result's folder and those of all that it was made from, as far as they are there."""
        found: set[Path] = set()
        waiting = {folder}
        while waiting:
            one = waiting.pop()
            found.add(one)
            texts = _iter_strings(self._fields.get(one, {}))
            waiting |= {origin for text in texts for origin in self._folders.get(text, ())} - found
        return found


def _iter_strings(value: Any) -> Iterator[str]:
    if isinstance(value, str):
        yield value
    elif isinstance(value, Mapping | list):
        for one in value.values() if isinstance(value, Mapping) else value:
            yield from _iter_strings(one)
