"""Reuses existing renders: from chunks with other ranges of views, or from a result that is damaged in part."""

from __future__ import annotations

import shutil
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from z2p_renderer.storage.results.adoption import VIEW_RANGE
from z2p_renderer.storage.results.fingerprints import file_digest, fingerprint
from z2p_renderer.storage.results.store import Entry, Store


def copy_existing_views(store: Store, entry: Entry, views: Iterable[int], out: Path) -> None:
    """Copy into `out` those `views` that exist in results which differ in the range of views only.

    A view is copied if the sha256 of all its files is right.
    """
    wanted = _range_free_fingerprint(entry.fields)
    stems = [f"view_{index:05d}" for index in views]
    for folder, manifest in store.iter_all_manifests(entry.stage):
        if _range_free_fingerprint(manifest["fields"]) != wanted:
            continue
        for stem in stems:
            files = {name: record for name, record in manifest["files"].items() if name.split(".")[0] == stem}
            image = f"{stem}.png"
            if image in files and not (out / image).exists() and _are_intact(folder, files):
                # the image last, because the renderer takes a view for complete once its image exists
                for name in sorted(files, key=lambda name: (name == image, name)):
                    shutil.copyfile(folder / name, out / f".{name}")
                    (out / f".{name}").replace(out / name)


def _are_intact(folder: Path, files: Mapping[str, Any]) -> bool:
    return all(
        (folder / name).is_file() and file_digest(folder / name) == record["sha256"] for name, record in files.items()
    )


def _range_free_fingerprint(fields: Mapping[str, Any]) -> str:
    return fingerprint({name: value for name, value in fields.items() if name not in VIEW_RANGE})
