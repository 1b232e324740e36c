"""Manifests: the file that makes a folder a result. It tells all that shaped it, and every file's size and sha256."""

from __future__ import annotations

import json
import os
import platform
import time
from collections.abc import Iterable, Mapping
from functools import lru_cache
from importlib import metadata
from pathlib import Path
from typing import Any

from z2p_renderer.storage.fingerprints import file_digest, fingerprint

MANIFEST = "manifest.json"

_PACKAGES = ("z2p-renderer", "numpy", "torch", "bpy", "open3d-cpu", "open3d", "h5py", "trimesh", "kornia", "luigi")


def read_manifest(folder: Path) -> dict[str, Any]:
    """The manifest of a result's folder, as it is.

    Raises:
        OSError: there is none.
        ValueError: it is not JSON.
    """
    manifest: dict[str, Any] = json.loads((folder / MANIFEST).read_text(encoding="utf-8"))
    return manifest


def faults(folder: Path, expected: str | None = None, *, every_digest: bool = False) -> list[str]:
    """What is wrong with a result, empty when nothing; `expected` is the fingerprint that it should have.

    A file is read and its sha256 compared only where `every_digest` asks for it, or where the file was written to
    after its manifest: so looking at a sound result reads nothing but the manifest, and touching a file does no harm.
    """
    try:
        manifest = read_manifest(folder)
        actual = fingerprint(manifest["fields"])
        files = {str(name): (int(record["size"]), str(record["sha256"])) for name, record in manifest["files"].items()}
        sealed = (folder / MANIFEST).stat().st_mtime_ns
    except FileNotFoundError:
        return [f"{folder}: no result"]
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        return [f"{folder / MANIFEST}: unreadable ({type(error).__name__}: {error})"]
    if actual != (expected or manifest.get("fingerprint")):
        return [f"{folder / MANIFEST}: its fields are not those of this result"]
    return [fault for name, record in files.items() if (fault := _fault(folder / name, *record, sealed, every_digest))]


def seal(
    folder: Path, name: str, fields: Mapping[str, Any], provenance: Mapping[str, Any], leftovers: Iterable[Path] = ()
) -> None:
    """Bring every file of the folder to the disk, then write the manifest.

    `leftovers`, files and folders in it by their paths below it, are left as they are and are not in the manifest.

    Raises:
        FileNotFoundError: the folder holds no file.
    """
    (folder / MANIFEST).unlink(missing_ok=True)
    left = {folder / path for path in leftovers}
    kept = [path for path in folder.rglob("*") if not left & {path, *path.parents}]
    paths = sorted(path for path in kept if path.is_file())
    if not paths:
        raise FileNotFoundError(f"{name}: the stage wrote no file into {folder}")
    files = {}
    for path in paths:
        sync(path)
        files[path.relative_to(folder).as_posix()] = {"size": path.stat().st_size, "sha256": file_digest(path)}
    manifest = {
        "name": name,
        "fingerprint": fingerprint(fields),
        "fields": dict(fields),
        "files": files,
        "provenance": dict(provenance),
        "environment": _environment(),
        "written": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
    }
    (folder / MANIFEST).write_text(json.dumps(manifest, indent=1, sort_keys=True) + "\n", encoding="utf-8")
    sync(folder / MANIFEST)
    for path in [folder, *(path for path in kept if path.is_dir())]:
        sync(path)


def sync(path: Path) -> None:
    """Bring a file or folder to the disk."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _fault(path: Path, size: int, digest: str, sealed: int, every_digest: bool) -> str | None:
    try:
        found = path.stat()
    except OSError:
        return f"{path}: expected {size} bytes, found no file"
    if found.st_size != size:
        return f"{path}: expected {size} bytes, found {found.st_size}"
    if (every_digest or found.st_mtime_ns > sealed) and _digest(path, found.st_mtime_ns, every_digest) != digest:
        return f"{path}: its bytes are not those that were written (sha256 differs)"
    return None


def _digest(path: Path, changed: int, anew: bool) -> str:
    return file_digest(path) if anew else _known_digest(path, changed)


@lru_cache(maxsize=10_000)
def _known_digest(path: Path, changed: int) -> str:
    """Digest of a file that was last written to at `changed`: once a process, for results that were copied."""
    return file_digest(path)


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
