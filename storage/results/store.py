"""Where results lie: `<root>/<stage>/<fingerprint>/` with a manifest, published whole or not at all.

A result is written in a folder beside its place, on the same filesystem: files, fsync, manifest last, then one rename.
A kill at any moment leaves either the whole result or none. The first writer wins; results are never overwritten.

=======================================  =====================================================================
`<root>/<stage>/<fingerprint>/`          a finished result and its `manifest.json`
`<root>/.tmp/`                           results being written
`<root>/.work/<stage>/<fingerprint>/`    what a resumable stage has so far; it survives kills
`<root>/.locks/`                         one lock a result, so that two pipelines do not make the same one twice
`<root>/.logs/`                          a log a result, of those that failed too
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
"""Name of a result's folder: the fingerprint's first half."""


class StoreError(RuntimeError):
    """A result that cannot be written or found; the message says which."""


@dataclass(frozen=True, eq=False)
class Entry:
    """One result: what it is called, and all that it depends on."""

    stage: str
    name: str
    """Logical name such as ``render/bunny/0-10``: for people; not in the fingerprint."""
    fields: Mapping[str, Any]
    """JSON-able; two entries with equal fields have equal results."""
    provenance: Mapping[str, Any] = field(default_factory=dict)
    """Written into the manifest beside the fields, but of no weight: paths and the like."""

    @cached_property
    def fingerprint(self) -> str:
        """sha256 of the fields, 64 hex digits."""
        return fingerprint(self.fields)


class Store:
    """The results under one root folder."""

    def __init__(self, root: Path) -> None:
        self.root = Path(root)

    def folder(self, entry: Entry) -> Path:
        """Where the entry's finished result lies, or will."""
        return self.root / entry.stage / entry.fingerprint[:32]

    def complete(self, entry: Entry) -> bool:
        """Whether the result is there: manifest parses, its fields match, files have their sizes.

        Reads no file, but those that were written to since they were published.
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
            StoreError: the result is not there, or is damaged.
        """
        found = self.faults(entry)
        if found:
            raise StoreError(f"{entry.name}: {found[0]}; run the pipeline again to make it")
        return read_manifest(self.folder(entry))

    def stages(self) -> list[str]:
        """Stages that have results."""
        return [stage for stage in STAGE_VERSIONS if (self.root / stage).is_dir()]

    def folders(self, stage: str) -> list[Path]:
        """Folders of all results of a stage, sound or not."""
        return sorted(folder for folder in (self.root / stage).glob("*") if _FOLDER_NAME.fullmatch(folder.name))

    def manifests(self, stage: str) -> Iterator[tuple[Path, dict[str, Any]]]:
        """Folder and manifest of every finished, undamaged entry of a stage; old ones too, which `complete` refuses."""
        for folder in self.folders(stage):
            if not find_faults(folder, allow_unlisted=True):
                yield folder, read_manifest(folder)

    def iter_all_manifests(self, stage: str) -> Iterator[tuple[Path, dict[str, Any]]]:
        """Folder and manifest of every entry, damaged and quarantined ones too: check the sha256 of what you take."""
        for folder in [*self.folders(stage), *sorted((self.root / ".quarantine" / stage).glob("*"))]:
            with suppress(OSError, ValueError):
                manifest = read_manifest(folder)
                if fingerprint(manifest["fields"]) == manifest["fingerprint"]:  # edited ones tell nothing
                    yield folder, manifest

    def damaged(self) -> Iterator[tuple[Path, str]]:
        """Folder and first fault of every result that is not sound, by a look at its manifest and the files' sizes."""
        for stage in self.stages():
            for folder in self.folders(stage):
                found = find_faults(folder)
                if found and not self.is_locked(stage, folder.name):
                    yield folder, found[0]

    def produce(
        self,
        entry: Entry,
        write: Callable[[Path], object],
        *,
        resumable: bool = False,
        leftovers: Sequence[str] = (),
    ) -> Path:
        """Folder of the entry's result, made by `write(folder)` unless it is complete already.

        A resumable stage gets the same folder again after a kill or a failure; what another has written by then goes.
        `leftovers` are glob patterns of files and folders in it that served only to resume. They are no part of the
        result, and go once it is published: what stops the publishing, a full disk say, costs no work.
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
                    refused = full_disk_message(folder)  # asked before it goes, which may be all that fills the disk
                    if not resumable:
                        _remove(folder)
                    if refused and isinstance(error, Exception) and not isinstance(error, ValueError):
                        raise DiskError(refused) from error  # however it showed; users' errors are ValueErrors
                    raise
        return self.folder(entry)

    def publish(self, folder: Path, entry: Entry, leftovers: Sequence[str] = ()) -> bool:
        """Whether `folder` became the entry's result; False when another writer was first, and `folder` is dropped.

        `leftovers`, as of `produce`, go with the folder and are then removed; one that stays harms no result.

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
        """Publish files that lie elsewhere as the entry's, as hard links where they can be."""

        def write(folder: Path) -> None:
            for name, path in files.items():
                (folder / name).parent.mkdir(parents=True, exist_ok=True)
                try:
                    os.link(path, folder / name)
                except OSError:  # another filesystem, or one without hard links
                    shutil.copy2(path, folder / name)

        self.produce(entry, write)

    def quarantine_if_damaged(self, entry: Entry) -> None:
        """Quarantine the entry's result unless every byte of it is right; one that is being made is waited for."""
        with self.lock(entry):
            if self.verify(entry) and os.path.lexists(self.folder(entry)):
                self.quarantine(self.folder(entry))

    def quarantine(self, folder: Path) -> Path:
        """Where a damaged result's folder now lies; it counts as missing from here on."""
        place = self.root / ".quarantine" / folder.parent.name / f"{folder.name}-{time.time_ns()}"
        place.parent.mkdir(parents=True, exist_ok=True)
        folder.rename(place)
        return place

    def work_folder(self, entry: Entry) -> Path:
        """Where a resumable stage collects the entry's files until they are published."""
        return self.root / ".work" / entry.stage / entry.fingerprint[:32]

    def _lock_file(self, stage: str, name: str) -> Path:
        return self.root / ".locks" / f"{stage}-{name}"

    def log(self, entry: Entry) -> Path:
        """Where the one who writes the entry may tell about it."""
        return self.root / ".logs" / entry.stage / f"{entry.fingerprint[:32]}.log"

    def _opened_work_folder(self, entry: Entry) -> Path:
        folder = self.work_folder(entry)
        folder.mkdir(parents=True, exist_ok=True)
        if os.path.lexists(folder / MANIFEST):
            _remove(folder / MANIFEST)  # there when a run was killed between manifest and rename
        note = read_note(folder)
        if note is None or fingerprint(note["fields"]) != entry.fingerprint:  # or of an adoption that was cut off
            write_note(folder, entry.name, entry.fields)
        return folder

    def _temporary_folder(self, entry: Entry) -> Path:
        folder = self.root / ".tmp" / f"{entry.stage}-{entry.fingerprint[:16]}-{uuid.uuid4().hex[:12]}"
        folder.mkdir(parents=True)
        return folder

    def is_locked(self, stage: str, name: str) -> bool:
        """Whether the result in the folder `name` of a stage is being written by someone."""
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
        """Work folders of a stage, in which something is or was being made."""
        return sorted((self.root / ".work" / stage).glob("*"))

    def lock(self, entry: Entry) -> AbstractContextManager[None]:
        """Holds the entry's lock; the kernel lets go of it when the process dies, however it dies."""
        return self.lock_named(entry.stage, entry.fingerprint[:32])

    @contextmanager
    def lock_named(self, stage: str, name: str) -> Iterator[None]:
        """Holds the lock of the result in the folder `name` of a stage."""
        path = self._lock_file(stage, name)
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("w") as file:
            fcntl.flock(file, fcntl.LOCK_EX)
            yield


def check_result(folder: Path) -> None:
    """Nothing, when every byte of the result in a folder is right.

    Raises:
        StoreError: it is damaged.
    """
    found = find_faults(folder, verify_digests=True, allow_unlisted=True)
    if found:
        raise StoreError(found[0])
