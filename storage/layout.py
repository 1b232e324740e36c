"""Where results lie: `<root>/<stage>/<fingerprint>/` with a manifest, published whole or not at all.

A result is written in a folder beside its place, on the same filesystem: files, fsync, manifest last, then one rename.
A kill at any moment leaves either the whole result or none. The first writer wins; results are never overwritten.

=======================================  =====================================================================
`<root>/<stage>/<fingerprint>/`          a finished result and its `manifest.json`
`<root>/.tmp/`                           results being written
`<root>/.work/<stage>/<fingerprint>/`    what a resumable stage has so far; it survives kills
`<root>/.locks/`                         one lock a result, so that two pipelines do not make the same one twice
`<root>/.quarantine/`                    damaged results, moved aside when they are made again
=======================================  =====================================================================
"""

from __future__ import annotations

import fcntl
import json
import os
import platform
import shutil
import time
import uuid
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from importlib import metadata
from pathlib import Path
from typing import Any

from storage.fingerprints import file_digest, fingerprint

MANIFEST = "manifest.json"

_PACKAGES = ("z2p", "numpy", "torch", "bpy", "open3d-cpu", "open3d", "h5py", "trimesh", "kornia", "luigi")


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
        """Whether the result is there: manifest parses, its fields match, files have their sizes. Reads no file."""
        return not _cheap_faults(self.folder(entry), entry.fingerprint)

    def verify(self, entry: Entry) -> list[str]:
        """Faults of a result, empty when none; reads every file and compares its sha256."""
        folder = self.folder(entry)
        faults = _cheap_faults(folder, entry.fingerprint)
        if faults:
            return faults
        return [
            f"{folder / name}: its bytes are not those that were written (sha256 differs)"
            for name, record in _read_manifest(folder)["files"].items()
            if file_digest(folder / name) != record["sha256"]
        ]

    def manifest(self, entry: Entry) -> dict[str, Any]:
        """The finished entry's manifest.

        Raises:
            StoreError: the result is not there, or is damaged.
        """
        faults = _cheap_faults(self.folder(entry), entry.fingerprint)
        if faults:
            raise StoreError(f"{entry.name}: {faults[0]}; run the pipeline again to make it")
        return _read_manifest(self.folder(entry))

    def manifests(self, stage: str) -> Iterator[tuple[Path, dict[str, Any]]]:
        """Folder and manifest of every finished, undamaged entry of a stage."""
        folders = sorted((self.root / stage).iterdir()) if (self.root / stage).is_dir() else []
        for folder in folders:
            if not _cheap_faults(folder, None):
                yield folder, _read_manifest(folder)

    def produce(
        self,
        entry: Entry,
        write: Callable[[Path], object],
        *,
        resumable: bool = False,
        leftovers: Sequence[str] = (),
    ) -> Path:
        """Folder of the entry's result, made by `write(folder)` unless it is complete already.

        A resumable stage gets the same folder again after a kill; `leftovers` are glob patterns of files and folders
        in it that served only to resume, removed before publishing.
        """
        with self._lock(entry):
            if not self.complete(entry):
                folder = self._work_folder(entry) if resumable else self._temporary_folder(entry)
                write(folder)
                for pattern in leftovers:
                    for path in list(folder.glob(pattern)):
                        _remove(path)
                self.publish(folder, entry)
        return self.folder(entry)

    def publish(self, folder: Path, entry: Entry) -> bool:
        """Whether `folder` became the entry's result; False when another writer was first, and `folder` is dropped.

        Raises:
            StoreError: the folder holds no file.
        """
        _seal(folder, entry)
        target = self.folder(entry)
        target.parent.mkdir(parents=True, exist_ok=True)
        if target.exists() and not self.complete(entry):
            self._quarantine(target)
        try:
            folder.rename(target)
        except OSError:
            if not self.complete(entry):
                raise
            _remove(folder)
            return False
        _sync(target.parent)
        return True

    def _work_folder(self, entry: Entry) -> Path:
        folder = self.root / ".work" / entry.stage / entry.fingerprint[:32]
        folder.mkdir(parents=True, exist_ok=True)
        (folder / MANIFEST).unlink(missing_ok=True)  # there when a run was killed between manifest and rename
        return folder

    def _temporary_folder(self, entry: Entry) -> Path:
        folder = self.root / ".tmp" / f"{entry.stage}-{entry.fingerprint[:16]}-{uuid.uuid4().hex[:12]}"
        folder.mkdir(parents=True)
        return folder

    def _quarantine(self, folder: Path) -> None:
        place = self.root / ".quarantine" / folder.parent.name / f"{folder.name}-{time.time_ns()}"
        place.parent.mkdir(parents=True, exist_ok=True)
        folder.rename(place)

    @contextmanager
    def _lock(self, entry: Entry) -> Iterator[None]:
        """Hold the entry's lock; the kernel lets go of it when the process dies, however it dies."""
        path = self.root / ".locks" / f"{entry.stage}-{entry.fingerprint[:32]}"
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("w") as file:
            fcntl.flock(file, fcntl.LOCK_EX)
            yield


def _cheap_faults(folder: Path, expected: str | None) -> list[str]:
    """Faults that show without reading files: no manifest, other fields, files missing or of another size."""
    try:
        manifest = _read_manifest(folder)
        actual = fingerprint(manifest["fields"])
        files = {str(name): int(record["size"]) for name, record in manifest["files"].items()}
    except FileNotFoundError:
        return [f"{folder}: no result"]
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        return [f"{folder / MANIFEST}: unreadable ({type(error).__name__}: {error})"]
    if actual != (expected or manifest.get("fingerprint")):
        return [f"{folder / MANIFEST}: its fields are not those of this result"]
    faults = []
    for name, size in files.items():
        path = folder / name
        found = path.stat().st_size if path.is_file() else None
        if found != size:
            faults.append(f"{path}: expected {size} bytes, found {'no file' if found is None else found}")
    return faults


def _seal(folder: Path, entry: Entry) -> None:
    """Bring every file of the folder to the disk, then write the manifest."""
    (folder / MANIFEST).unlink(missing_ok=True)
    paths = sorted(path for path in folder.rglob("*") if path.is_file())
    if not paths:
        raise StoreError(f"{entry.name}: the stage wrote no file into {folder}")
    files = {}
    for path in paths:
        _sync(path)
        files[path.relative_to(folder).as_posix()] = {"size": path.stat().st_size, "sha256": file_digest(path)}
    manifest = {
        "name": entry.name,
        "fingerprint": entry.fingerprint,
        "fields": dict(entry.fields),
        "files": files,
        "provenance": dict(entry.provenance),
        "environment": _environment(),
        "written": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
    }
    (folder / MANIFEST).write_text(json.dumps(manifest, indent=1, sort_keys=True) + "\n", encoding="utf-8")
    _sync(folder / MANIFEST)
    for path in [folder, *(path for path in folder.rglob("*") if path.is_dir())]:
        _sync(path)


def _read_manifest(folder: Path) -> dict[str, Any]:
    manifest: dict[str, Any] = json.loads((folder / MANIFEST).read_text(encoding="utf-8"))
    return manifest


def _sync(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _remove(path: Path) -> None:
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


@lru_cache(maxsize=1)
def _environment() -> dict[str, Any]:
    """What made the result: interpreter, machine and package versions; provenance, of no weight."""
    versions = {}
    for package in _PACKAGES:
        try:
            versions[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            continue
    return {"python": platform.python_version(), "platform": platform.platform(), "packages": versions}
