"""Garbage collection: lists and removes the results that no kept configuration and no running pipeline needs.

The results in use are those of the newest run of every configuration (`.kept`), those of every running pipeline
(`.running`), the targets of links such as ``runs/regular/weights.safetensors`` with everything upstream of them, and
those that are being written. Ground truth under ``truth/`` is never removed, since future weights can use it.
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
"""Partly written results without a lock are kept for at least this time."""


@dataclass(frozen=True)
class Garbage:
    """A folder or file that can be removed."""

    path: Path
    name: str
    size: int
    """Size in bytes; hard-linked files count in full."""


def find_garbage(store: Store, drop: Iterable[str] = ()) -> list[Garbage]:
    """Everything that can be removed. `drop` has the names of kept configurations that are no longer wanted.

    Raises:
        StoreError: a file that says what is in use is damaged.
    """
    needed = _needed_folders(store, set(drop))
    garbage: list[Garbage] = []
    for stage in store.stages():
        names = {folder: str(manifest.get("name", "")) for folder, manifest in store.iter_all_manifests(stage)}
        for folder in store.folders(stage):
            if folder not in needed and not store.is_locked(stage, folder.name):
                garbage.append(_garbage(folder, names.get(folder) or f"{stage}, damaged"))
    return garbage + [_garbage(path, name) for path, name in _iter_leftovers(store, needed)]


def collect_garbage(store: Store, drop: Iterable[str] = ()) -> list[Garbage]:
    """Remove the garbage and return what was removed. Pipelines that start meanwhile wait until it is done."""
    drop = set(drop)
    with collection_lock(store, shared=False):
        remove_dead_notes(store)
        garbage = find_garbage(store, drop)
        trash = store.root / ".trash" / uuid.uuid4().hex
        trash.mkdir(parents=True)
        for number, item in enumerate(garbage):
            item.path.rename(trash / str(number))
        for name in drop:
            (store.root / ".kept" / f"{name}.json").unlink(missing_ok=True)
    # also the trash of collections that were killed; another process may be deleting its own at the same time
    for folder in list(trash.parent.iterdir()):
        shutil.rmtree(folder, ignore_errors=folder != trash)
    with suppress(OSError):  # not empty while another collection is at work
        trash.parent.rmdir()
    return garbage


def _needed_folders(store: Store, drop: set[str]) -> set[Path]:
    """Folders of all results that must be kept.

    Raises:
        StoreError: a file that says what is in use is damaged.
    """
    notes = [*iter_running(store), *kept_results(store, drop).values()]
    needed = {store.root / folder for note in notes for folder in note["results"]}
    provenance = _Provenance(store)
    noted = {str(note.get("name")) for note in notes}
    for link in store.root.glob("[!.]*/*"):
        if link.is_symlink() and link.parent.name not in drop:
            folder = link.resolve().parent
            if folder.is_dir() and link.parent.name not in noted and not provenance.knows(folder):
                raise StoreError(f"{folder}: damaged, so that nobody can tell what {link} was made from, and nothing "
                                 f"may go before that is mended: run its pipeline again, or --drop {link.parent.name}")
            needed |= provenance.with_upstream(folder)
    return needed


def _iter_leftovers(store: Store, needed: set[Path]) -> Iterator[tuple[Path, str]]:
    """(path, description) of the files that killed runs and quarantines have left behind."""
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
    """The upstream results of each result in a store."""

    def __init__(self, store: Store) -> None:
        self._fields: dict[Path, Mapping[str, Any]] = {}
        self._folders: dict[str, set[Path]] = {}
        for stage in store.stages():
            for folder, manifest in store.iter_all_manifests(stage):
                fields = manifest["fields"]
                self._fields[folder] = fields
                shared = {key: value for key, value in fields.items() if key not in VIEW_RANGE}
                for digest in (fingerprint(fields), fingerprint(shared)):
                    self._folders.setdefault(digest, set()).add(folder)

    def knows(self, folder: Path) -> bool:
        """Whether the folder has a readable manifest, so that its upstream results are known."""
        return folder in self._fields

    def with_upstream(self, folder: Path) -> set[Path]:
        """The result's folder and the folders of all its direct and indirect upstream results that exist."""
        visited: set[Path] = set()
        pending = {folder}
        while pending:
            current = pending.pop()
            visited.add(current)
            strings = _iter_strings(self._fields.get(current, {}))
            pending |= {origin for string in strings for origin in self._folders.get(string, ())} - visited
        return visited


def _iter_strings(value: Any) -> Iterator[str]:
    """All strings in a nested value, keys excepted."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, Mapping | list):
        for item in value.values() if isinstance(value, Mapping) else value:
            yield from _iter_strings(item)
