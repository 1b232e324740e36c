"""Renders that are there already: under another cut into chunks, or in a result that was damaged in part."""

from __future__ import annotations

import shutil
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from z2p_renderer.storage.results.adoption import VIEW_RANGE
from z2p_renderer.storage.results.fingerprints import file_digest, fingerprint
from z2p_renderer.storage.results.store import Entry, Store


def copy_existing_views(store: Store, entry: Entry, views: Iterable[int], out: Path) -> None:
    """Copy into `out` the entry's views that other renders of the same fields hold, each if all its files are sound."""
    wanted = _without_range(entry.fields)
    stems = [f"view_{index:05d}" for index in views]
    for folder, manifest in store.iter_all_manifests("render"):
        if _without_range(manifest["fields"]) != wanted:
            continue
        for stem in stems:
            files = {name: record for name, record in manifest["files"].items() if name.split(".")[0] == stem}
            picture = f"{stem}.png"
            if picture in files and not (out / picture).exists() and _are_sound(folder, files):
                # the picture last: the renderer takes its presence for the view's
                for name in sorted(files, key=lambda name: (name == picture, name)):
                    shutil.copyfile(folder / name, out / f".{name}")
                    (out / f".{name}").replace(out / name)


def _are_sound(folder: Path, files: Mapping[str, Any]) -> bool:
    return all(
        (folder / name).is_file() and file_digest(folder / name) == record["sha256"] for name, record in files.items()
    )


def _without_range(fields: Mapping[str, Any]) -> str:
    return fingerprint({name: value for name, value in fields.items() if name not in VIEW_RANGE})
