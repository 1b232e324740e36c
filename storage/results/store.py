"""The store: results under `<root>/<stage>/<fingerprint>/`, each with a manifest, published atomically.

A result is written in another folder of the same filesystem: files, fsync, the manifest last, then one rename. A kill
at any moment leaves either the complete result or none. The first writer wins; results are never overwritten.

=======================================  =====================================================================
`<root>/<stage>/<fingerprint>/`          a finished result and its `manifest.json`
`<root>/.tmp/`                           results being written
`<root>/.work/<stage>/<fingerprint>/`    what a resumable stage has so far; it survives kills
`<root>/.locks/`                         a lock for each result, so that two pipelines do not make the same one
`<root>/.logs/`                          a log for each result, also for those that failed
`<root>/.quarantine/`                    damaged results, moved aside when they are made again
=======================================  =====================================================================
"""

from __future__ import annotations

import fcntl
import os
import re
import shutil
import time
import uuid
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from z2p_renderer.storage.files.disk_errors import DiskError, full_disk_message
from z2p_renderer.storage.results.fingerprints import STAGE_VERSIONS, fingerprint
from z2p_renderer.storage.results.manifests import (
    FOLDER_NAME_DIGITS,
    MANIFEST,
    find_faults,
    fsync_path,
    read_manifest,
    seal,
)
from z2p_renderer.storage.results.manifests import remove_path as _remove
from z2p_renderer.storage.results.work_note import NOTE, read_note, write_note

_FOLDER_NAME = re.compile(rf"[0-9a-f]{{{FOLDER_NAME_DIGITS}}}")
"""Name of a result's folder: the first half of its fingerprint."""


class StoreError(RuntimeError):
    """A result is missing or damaged, or cannot be written; the message names it."""


@dataclass(frozen=True, eq=False)
class Entry:
    """One result: its name, and the fields of its fingerprint."""

    stage: str
    name: str
    """Logical name such as ``render/bunny/0-10``: for people; not in the fingerprint."""
    fields: Mapping[str, Any]
    """JSON-able; two entries with equal fields have equal results."""
    provenance: Mapping[str, Any] = field(default_factory=dict)
    """Paths and the like: written into the manifest, but not part of the fingerprint."""

    @cached_property
    def fingerprint(self) -> str:
        """sha256 of the fields, 64 hex digits."""
        return fingerprint(self.fields)


class Store:
    """The results under one root folder."""

    def __init__(self, root: Path) -> None:
        self.root = Path(root)

    def folder(self, entry: Entry) -> Path:
        """Folder of the entry's result, whether or not it exists yet."""
        return self.root / entry.stage / entry.fingerprint[:FOLDER_NAME_DIGITS]

    def complete(self, entry: Entry) -> bool:
        """Whether the result exists and is intact: manifest, fields, sizes of files.

        Reads only files that were modified after they were published.
        """
        return not self.faults(entry)

    def faults(self, entry: Entry) -> list[str]:
        """Why the result is not `complete`; empty when it is."""
        return find_faults(self.folder(entry), entry.fingerprint)

    def verify(self, entry: Entry) -> list[str]:
        """Faults of a result, empty when none; reads every file and compares its sha256."""
        return find_faults(self.folder(entry), entry.fingerprint, verify_digests=True)

    def manifest(self, entry: Entry) -> dict[str, Any]:
        """The finished entry's manifest.

        Raises:
            StoreError: the result is missing or damaged.
        """
        faults = self.faults(entry)
        if faults:
            raise StoreError(f"{entry.name}: {faults[0]}; run the pipeline again to make it")
        return read_manifest(self.folder(entry))

    def stages(self) -> list[str]:
        """Stages that have results."""
        return [stage for stage in STAGE_VERSIONS if (self.root / stage).is_dir()]

    def folders(self, stage: str) -> list[Path]:
        """Folders of all results of a stage, intact or not."""
        return sorted(folder for folder in (self.root / stage).glob("*") if _FOLDER_NAME.fullmatch(folder.name))

    def manifests(self, stage: str) -> Iterator[tuple[Path, dict[str, Any]]]:
        """Folder and manifest of every intact result of a stage, also those with a manifest without `listing`."""
        for folder in self.folders(stage):
            if not find_faults(folder, allow_unlisted=True):
                yield folder, read_manifest(folder)

    def iter_all_manifests(self, stage: str) -> Iterator[tuple[Path, dict[str, Any]]]:
        """Folder and manifest of every result, damaged and quarantined ones included.

        Callers must check the sha256 of each file that they use.
        """
        for folder in [*self.folders(stage), *sorted((self.root / ".quarantine" / stage).glob("*"))]:
            with suppress(OSError, ValueError):
                manifest = read_manifest(folder)
                if fingerprint(manifest["fields"]) == manifest["fingerprint"]:  # else it was edited
                    yield folder, manifest

    def damaged(self) -> Iterator[tuple[Path, str]]:
        """Folder and first fault of every damaged result, judged by its manifest and the files' sizes."""
        for stage in self.stages():
            for folder in self.folders(stage):
                faults = find_faults(folder)
                if faults and not self.is_locked(stage, folder.name):
                    yield folder, faults[0]

    def produce(
        self,
        entry: Entry,
        write: Callable[[Path], object],
        *,
        resumable: bool = False,
        leftovers: Sequence[str] = (),
    ) -> Path:
        """Folder of the entry's result, made by `write(folder)` unless it is complete already.

        A resumable stage gets the same folder again after a kill or a failure. `leftovers` are glob patterns of files
        and folders that only serve to resume. They are not part of the result, and are deleted once it is published;
        not before, so that no work is lost if publishing fails (on a full disk, for example).
        """
        with self.lock(entry):
            if not self.complete(entry):
                folder = self._opened_work_folder(entry) if resumable else self._temporary_folder(entry)
                try:
                    write(folder)
                    note = read_note(folder)
                    if note and note["adopted"]:
                        entry = replace(entry, provenance={**entry.provenance, "adopted": note["adopted"]})
                    self.publish(folder, entry, (NOTE, *leftovers))
                except BaseException as error:
                    disk_message = full_disk_message(folder)  # first, because removing the folder may free the disk
                    if not resumable:
                        _remove(folder)
                    if disk_message and isinstance(error, Exception) and not isinstance(error, ValueError):
                        raise DiskError(disk_message) from error  # a full disk shows in many errors, but not ValueError
                    raise
        return self.folder(entry)

    def publish(self, folder: Path, entry: Entry, leftovers: Sequence[str] = ()) -> bool:
        """Publish `folder` as the entry's result; False if another writer was first, after which `folder` is deleted.

        `leftovers`, as in `produce`, move with the folder and are deleted afterwards; one that cannot be deleted does
        no harm, because the manifest does not list it.

        Raises:
            StoreError: the folder holds no file.
        """
        left = sorted({path.relative_to(folder) for pattern in leftovers for path in folder.glob(pattern)})
        try:
            seal(folder, entry.name, entry.fields, entry.provenance, left)
        except FileNotFoundError as error:
            raise StoreError(str(error)) from error
        target = self.folder(entry)
        target.parent.mkdir(parents=True, exist_ok=True)
        if os.path.lexists(target) and not self.complete(entry):
            self.quarantine(target)
        try:
            folder.rename(target)
        except OSError:
            if not self.complete(entry):
                raise
            _remove(folder)
            return False
        fsync_path(target.parent)
        for path in left:
            with suppress(OSError):
                _remove(target / path)
        return True

    def link(self, files: Mapping[str, Path], entry: Entry) -> None:
        """Publish existing files as the entry's result, as hard links where possible."""

        def write(folder: Path) -> None:
            for name, path in files.items():
                (folder / name).parent.mkdir(parents=True, exist_ok=True)
                try:
                    os.link(path, folder / name)
                except OSError:  # another filesystem, or one without hard links
                    shutil.copy2(path, folder / name)

        self.produce(entry, write)

    def quarantine_if_damaged(self, entry: Entry) -> None:
        """Quarantine the entry's result unless all its digests are right; waits while it is being written."""
        with self.lock(entry):
            if self.verify(entry) and os.path.lexists(self.folder(entry)):
                self.quarantine(self.folder(entry))

    def quarantine(self, folder: Path) -> Path:
        """Move a damaged result's folder aside, so that the result counts as missing; returns the new path."""
        target = self.root / ".quarantine" / folder.parent.name / f"{folder.name}-{time.time_ns()}"
        target.parent.mkdir(parents=True, exist_ok=True)
        folder.rename(target)
        return target

    def work_folder(self, entry: Entry) -> Path:
        """Where a resumable stage collects the entry's files until they are published."""
        return self.root / ".work" / entry.stage / entry.fingerprint[:FOLDER_NAME_DIGITS]

    def _lock_file(self, stage: str, name: str) -> Path:
        return self.root / ".locks" / f"{stage}-{name}"

    def log(self, entry: Entry) -> Path:
        """Log file of the process that writes the entry."""
        return self.root / ".logs" / entry.stage / f"{entry.fingerprint[:FOLDER_NAME_DIGITS]}.log"

    def _opened_work_folder(self, entry: Entry) -> Path:
        folder = self.work_folder(entry)
        folder.mkdir(parents=True, exist_ok=True)
        if os.path.lexists(folder / MANIFEST):
            _remove(folder / MANIFEST)  # left by a run that was killed between manifest and rename
        note = read_note(folder)
        if note is None or fingerprint(note["fields"]) != entry.fingerprint:  # e.g. of an interrupted adoption
            write_note(folder, entry.name, entry.fields)
        return folder

    def _temporary_folder(self, entry: Entry) -> Path:
        folder = self.root / ".tmp" / f"{entry.stage}-{entry.fingerprint[:16]}-{uuid.uuid4().hex[:12]}"
        folder.mkdir(parents=True)
        return folder

    def is_locked(self, stage: str, name: str) -> bool:
        """Whether a process is writing the result in the folder `name` of a stage."""
        path = self._lock_file(stage, name)
        if not path.exists():
            return False
        with path.open() as file:
            try:
                fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
            except OSError:
                return True
            fcntl.flock(file, fcntl.LOCK_UN)  # closing is not enough: a process forked just now has the lock as well
        return False

    def unfinished(self, stage: str) -> list[Path]:
        """Work folders of a stage."""
        return sorted((self.root / ".work" / stage).glob("*"))

    def lock(self, entry: Entry) -> AbstractContextManager[None]:
        """Holds the entry's lock; the kernel releases it when the process dies."""
        return self.lock_named(entry.stage, entry.fingerprint[:FOLDER_NAME_DIGITS])

    @contextmanager
    def lock_named(self, stage: str, name: str) -> Iterator[None]:
        """Holds the lock of the result in the folder `name` of a stage."""
        path = self._lock_file(stage, name)
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("w") as file:
            fcntl.flock(file, fcntl.LOCK_EX)
            yield


def check_result(folder: Path) -> None:
    """Check the digests of all files of the result in a folder.

    Raises:
        StoreError: the result is damaged.
    """
    faults = find_faults(folder, verify_digests=True, allow_unlisted=True)
    if faults:
        raise StoreError(faults[0])
