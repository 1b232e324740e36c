"""Manifests: the file that makes a folder a result. It holds the fingerprint's fields and each file's size and sha256.

The list of files has a digest of its own, `listing`, so a manifest that was edited to list fewer files is detected.
"""

from __future__ import annotations

import json
import os
import platform
import shutil
import stat
import time
from collections.abc import Iterable, Mapping
from functools import lru_cache
from importlib import metadata
from pathlib import Path, PurePosixPath
from typing import Any

from z2p_core.errors.value_limits import Count, JsonObject, MappingOf, Text, check_value, describe_value
from z2p_renderer.storage.files.atomic_write import file_kind
from z2p_renderer.storage.files.bounded_json import read_json
from z2p_renderer.storage.results.fingerprints import file_digest, fingerprint

MANIFEST = "manifest.json"
FOLDER_NAME_DIGITS = 32
"""Number of hex digits of the fingerprint that name a result's folder."""
MAX_MANIFEST_BYTES = 256 << 20
_NAME = Text("a text", r"(?s:.*)", 10_000)
_DIGEST = Text("64 hex digits", "[0-9a-f]{64}")
_MANIFEST = JsonObject(
    {"name": _NAME, "fingerprint": _DIGEST,
     "fields": JsonObject({}, {"stage": _NAME, "stage_version": Count(0, 10**6)}),
     "files": MappingOf(JsonObject({"size": Count(0, 1 << 60), "sha256": _DIGEST}), 10**6)},
    {"written": _NAME, "listing": _DIGEST, "provenance": JsonObject({})},
)  # fmt: skip

_PACKAGES = ("z2p-renderer", "numpy", "torch", "bpy", "open3d-cpu", "open3d", "h5py", "trimesh", "kornia", "luigi")


def read_manifest(folder: Path) -> dict[str, Any]:
    """The manifest of a result's folder; its structure is checked, not whether it fits the files.

    Raises:
        OSError: there is none.
        ValueError: it is not JSON, or does not have the structure of a manifest.
    """
    with (folder / MANIFEST).open("rb") as file:
        manifest = read_json(file.read(MAX_MANIFEST_BYTES + 1), MAX_MANIFEST_BYTES)
    check_value(manifest, _MANIFEST, "")
    for name in manifest["files"]:
        path = PurePosixPath(name)
        if path.is_absolute() or ".." in path.parts or "\0" in name or name in ("", ".", MANIFEST):
            raise ValueError(f"files: expected names of files in the folder, got {describe_value(name)}")
    return dict(manifest)


def find_faults(
    folder: Path, expected: str | None = None, *, verify_digests: bool = False, allow_unlisted: bool = False
) -> list[str]:
    """Faults of a result, a sentence each; empty for an intact one.

    `expected` is the fingerprint that it should have, by default that of the folder's name. A file is read and its
    sha256 compared only with `verify_digests`, or if the file was written to after its manifest. So checking an intact
    result reads its manifest alone, and touching a file does no harm. `allow_unlisted` accepts older manifests, which
    have no `listing`.
    """
    path = folder / MANIFEST
    try:
        manifest = read_manifest(folder)
        actual = fingerprint(manifest["fields"])
        files = {name: (record["size"], record["sha256"]) for name, record in manifest["files"].items()}
        sealed_ns = path.stat().st_mtime_ns
        subfolders = [nested.parent.name for nested in folder.glob(f"*/{MANIFEST}")]
    except FileNotFoundError:
        return [f"{folder}: no result"]
    except (OSError, ValueError, TypeError) as error:
        return [f"{path}: unreadable ({type(error).__name__}: {error})"]
    is_misnamed = len(folder.name) == FOLDER_NAME_DIGITS and actual[:FOLDER_NAME_DIGITS] != folder.name
    if actual != (expected or manifest["fingerprint"]) or is_misnamed:
        return [f"{path}: its fields are not those of this result"]
    if "listing" not in manifest and not allow_unlisted:
        return [f"{path}: written before lists of files were under a digest"]
    listing = _listing_digest(actual, manifest["files"])
    if manifest.get("listing", listing) != listing:
        return [f"{path}: its list of files is not the one that was written"]
    misplaced_results = [name for name in subfolders if f"{name}/{MANIFEST}" not in files]
    if misplaced_results:
        return [f"{folder / misplaced_results[0]}: a result within another one's folder"]
    faults = (_file_fault(folder / name, *record, sealed_ns, verify_digests) for name, record in files.items())
    return [fault for fault in faults if fault]


def _listing_digest(result: str, files: Mapping[str, Any]) -> str:
    """Digest of the list of a result's files and of the result's fingerprint."""
    return fingerprint({"fingerprint": result, "files": files})


def seal(
    folder: Path, name: str, fields: Mapping[str, Any], provenance: Mapping[str, Any], leftovers: Iterable[Path] = ()
) -> None:
    """Flush every file of the folder to the disk (fsync), then write the manifest.

    `leftovers` are paths of files and folders relative to `folder`; they stay there, and the manifest omits them.

    Raises:
        FileNotFoundError: the folder holds no file.
    """
    remove_path(folder / MANIFEST)
    omitted = {folder / path for path in leftovers}
    kept = [path for path in folder.rglob("*") if not omitted & {path, *path.parents}]
    paths = sorted(path for path in kept if path.is_file())
    if not paths:
        raise FileNotFoundError(f"{name}: the stage wrote no file into {folder}")
    files = {}
    for path in paths:
        fsync_path(path)
        files[path.relative_to(folder).as_posix()] = {"size": path.stat().st_size, "sha256": file_digest(path)}
    manifest = {
        "name": name,
        "fingerprint": fingerprint(fields),
        "fields": dict(fields),
        "files": files,
        "listing": _listing_digest(fingerprint(fields), files),
        "provenance": dict(provenance),
        "environment": _environment(),
        "written": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
    }
    (folder / MANIFEST).write_text(json.dumps(manifest, indent=1, sort_keys=True) + "\n", encoding="utf-8")
    fsync_path(folder / MANIFEST)
    for path in [folder, *(path for path in kept if path.is_dir())]:
        fsync_path(path)


def remove_path(path: Path) -> None:
    """Delete the file or folder at a path, if there is one."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


def fsync_path(path: Path) -> None:
    """Flush a file or folder to the disk."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _file_fault(path: Path, size: int, digest: str, sealed_ns: int, verify_digests: bool) -> str | None:
    try:
        status = path.stat()
    except OSError:
        return f"{path}: expected {size} bytes, found no file"
    if not stat.S_ISREG(status.st_mode):
        return f"{path}: expected a file, found {file_kind(path)}"
    if status.st_size != size:
        return f"{path}: expected {size} bytes, found {status.st_size}"
    if not verify_digests and status.st_mtime_ns <= sealed_ns:
        return None
    try:
        actual = file_digest(path) if verify_digests else _cached_file_digest(path, status.st_mtime_ns)
    except OSError as error:
        return f"{path}: cannot be read ({error.strerror})"
    return None if actual == digest else f"{path}: its bytes are not those that were written (sha256 differs)"


@lru_cache(maxsize=10_000)
def _cached_file_digest(path: Path, modified_ns: int) -> str:
    """sha256 of a file last modified at `modified_ns`; cached, because copied results are checked many times."""
    return file_digest(path)


@lru_cache(maxsize=1)
def _environment() -> dict[str, Any]:
    """Interpreter, machine and package versions; for information, not part of the fingerprint."""
    versions = {}
    for package in _PACKAGES:
        try:
            versions[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            continue
    return {"python": platform.python_version(), "platform": platform.platform(), "packages": versions}
