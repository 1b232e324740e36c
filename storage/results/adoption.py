"""Adoption: results of older code are taken over unchanged when a user states that the new code gives the same.

A result can be adopted for an entry if everything but code is equal: parameters, mesh contents, plugin versions, and
the same for all upstream results back to the meshes. The new entry gets the same files; its manifest records the old
fingerprint, the differences and the user's reason.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from z2p_renderer.storage.results.differences import CODE_FIELDS, compare_fields
from z2p_renderer.storage.results.fingerprints import RENDER_STAGES, STAGE_VERSIONS, fingerprint
from z2p_renderer.storage.results.manifests import read_manifest
from z2p_renderer.storage.results.store import Entry, Store, StoreError, check_result
from z2p_renderer.storage.results.work_note import read_note, write_note

VIEW_RANGE = ("first", "last")
"""Fields of a render that say which views it holds. Downstream results refer to a mesh's renders without them."""


@dataclass(frozen=True)
class Candidate:
    """A result that can be adopted: the entry that it would become, and where it lies now."""

    entry: Entry
    folder: Path
    old_fingerprint: str
    differences: tuple[str, ...]
    files: Mapping[str, Path] | None = None
    """New name -> file, for a result without a manifest; None: all files that the manifest lists."""
    unfinished: bool = False
    """True for a work folder: checkpoints of a training, views of an incomplete chunk."""


def find_candidates(store: Store, planned: Sequence[Entry], stages: Iterable[str]) -> list[Candidate]:
    """Results that can be adopted for those planned entries of `stages` that are not complete.

    `planned` is a whole plan, upstream first. Of several results that are equal but for code, the newest of the latest
    stage version is taken; results of a later stage version than the installed one are left out. Renders also
    match if their views were divided into other chunks.
    """
    wanted = set(stages)
    keys = _CodeFreeFingerprints()
    for stage in STAGE_VERSIONS:
        for _, manifest in store.manifests(stage):
            keys.add(manifest["fields"])
    for entry in planned:
        keys.add(entry.fields)
    candidates: dict[str, Candidate] = {}
    for stage in STAGE_VERSIONS:
        if stage not in wanted:
            continue
        wanted_entries = {keys.of(without_view_range(entry.fields)): entry for entry in planned if entry.stage == stage}
        for folder, manifest in sorted(store.manifests(stage), key=_preference):
            match = wanted_entries.get(keys.of(without_view_range(manifest["fields"])))
            candidate = _candidate(folder, manifest, match) if match else None
            if candidate and not store.complete(candidate.entry):
                candidates[candidate.entry.fingerprint] = candidate
        for candidate in _unfinished_candidates(store, stage, wanted_entries, keys):
            candidates.setdefault(candidate.entry.fingerprint, candidate)
    return list(candidates.values())


def adopt_result(store: Store, candidate: Candidate, because: str) -> None:
    """Publish the candidate's files as its entry's result.

    Raises:
        StoreError: a file is damaged, or another process has continued the unfinished work meanwhile.
        ValueError: no reason is given.
    """
    if not because.strip():
        raise ValueError("expected a reason why the results would be the same, got none")
    adopted = {
        "from": candidate.old_fingerprint,
        "differences": list(candidate.differences),
        "because": because.strip(),
        "when": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
    }
    entry = replace(candidate.entry, provenance={**candidate.entry.provenance, "adopted": adopted})
    if candidate.unfinished:
        with store.lock(entry), store.lock_named(entry.stage, candidate.folder.name):
            if not candidate.folder.exists() or store.work_folder(entry).exists():
                raise StoreError(f"{candidate.folder}: meanwhile the work on it has gone on, or that on {entry.name} "
                                 "has begun anew; adopt again what is left")
            write_note(candidate.folder, entry.name, entry.fields, adopted)
            candidate.folder.rename(store.work_folder(entry))
    elif candidate.files is None:
        check_result(candidate.folder)
        names = read_manifest(candidate.folder)["files"]
        store.link({name: candidate.folder / name for name in names}, entry)
    else:
        store.link(candidate.files, entry)


def _unfinished_candidates(
    store: Store, stage: str, wanted_entries: Mapping[str, Entry], keys: _CodeFreeFingerprints
) -> Iterator[Candidate]:
    """Interrupted work that no process holds, for entries that are neither complete nor begun."""
    for folder in store.unfinished(stage):
        note = read_note(folder)
        entry = wanted_entries.get(keys.of(without_view_range(note["fields"]))) if note else None
        if note is None or entry is None or store.is_locked(stage, folder.name):
            continue
        candidate = _candidate(folder, {**note, "fingerprint": fingerprint(note["fields"])}, entry)
        if note["adopted"] and fingerprint(note["fields"])[:32] != folder.name:  # cut off between note and rename
            adopted = note["adopted"]
            candidate = Candidate(entry, folder, adopted["from"], tuple(adopted["differences"]))
        if candidate and not store.complete(candidate.entry) and not store.work_folder(candidate.entry).exists():
            yield replace(candidate, unfinished=True)


def _candidate(folder: Path, manifest: Mapping[str, Any], entry: Entry) -> Candidate | None:
    fields = dict(entry.fields)
    ranged = entry.stage not in RENDER_STAGES or all(key in manifest["fields"] for key in VIEW_RANGE)
    if not ranged or manifest["fields"].get("stage_version", 0) > fields["stage_version"]:
        return None
    name = entry.name
    if entry.stage in RENDER_STAGES:
        fields |= {key: manifest["fields"][key] for key in VIEW_RANGE}
        name = f"{name.rpartition('/')[0]}/{fields['first']}-{fields['last']}"
    if fingerprint(fields) == manifest["fingerprint"]:
        return None
    changes = tuple(map(str, compare_fields(manifest["fields"], fields)))
    return Candidate(Entry(entry.stage, name, fields, entry.provenance), folder, manifest["fingerprint"], changes)


def _preference(result: tuple[Path, dict[str, Any]]) -> tuple[int, str]:
    """Sort key of (folder, manifest) that puts the preferred result last."""
    manifest = result[1]
    return int(manifest["fields"].get("stage_version", 0)), str(manifest.get("written"))


def without_view_range(fields: Mapping[str, Any]) -> dict[str, Any]:
    """The fields without the range of views: those that all chunks of a mesh's renders share."""
    is_render = fields.get("stage") in RENDER_STAGES
    return {key: value for key, value in fields.items() if not is_render or key not in VIEW_RANGE}


class _CodeFreeFingerprints:
    """Fingerprints of results without anything that depends on code, upstream results included."""

    def __init__(self) -> None:
        self._known: dict[str, str] = {}

    def add(self, fields: Mapping[str, Any]) -> None:
        """Register a result, so that results made from it can be compared; upstream results must come first."""
        for variant in (fields, without_view_range(fields)):
            self._known[fingerprint(variant)] = self.of(variant)

    def of(self, fields: Mapping[str, Any]) -> str:
        without_code = {key: self._plain(value) for key, value in fields.items() if key not in CODE_FIELDS}
        return fingerprint(without_code)

    def _plain(self, value: Any) -> Any:
        if isinstance(value, Mapping):
            kept = value if set(value) != {"name", "version", "code"} else {**value, "code": ""}
            return {key: self._plain(one) for key, one in kept.items()}
        if isinstance(value, list | tuple):
            plain = [self._plain(one) for one in value]
            upstream = all(isinstance(one, str) and one in self._known for one in value) and value
            return sorted(plain) if upstream else plain
        return self._known.get(value, value) if isinstance(value, str) else value
