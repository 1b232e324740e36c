"""Vouching: results made by other code are taken over as they are, when a user says that they would be the same.

Two results mean the same when all but code agrees: parameters, mesh contents and plugins' versions, and what they were
made of, back to the meshes. Only such results can be adopted. A new entry gets the same files, and its manifest tells
whose they were, what differed, and the user's reason.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from z2p_renderer.storage.results.differences import CODE_FIELDS, compare_fields
from z2p_renderer.storage.results.fingerprints import STAGE_VERSIONS, fingerprint
from z2p_renderer.storage.results.manifests import read_manifest
from z2p_renderer.storage.results.store import Entry, Store, StoreError, check_result
from z2p_renderer.storage.results.work_note import read_note, write_note

VIEW_RANGE = ("first", "last")
"""Fields of a render that say which views it holds; results made of renders name them by the other fields."""


@dataclass(frozen=True)
class Candidate:
    """A result that can be adopted: the entry that it would become, and where it lies now."""

    entry: Entry
    folder: Path
    old_fingerprint: str
    differences: tuple[str, ...]
    files: Mapping[str, Path] | None = None
    """New name -> file, of a result from before there were manifests; None for all that the manifest lists."""
    unfinished: bool = False
    """The folder is a work folder: checkpoints of a training, views of a chunk that is not whole."""


def find_candidates(store: Store, planned: Sequence[Entry], stages: Iterable[str]) -> list[Candidate]:
    """What can be adopted for the planned entries of some stages that are not complete.

    `planned` is a whole plan, upstream first. Of several results that mean the same, the newest of the latest stage
    version is taken, but none of a later version than the installed one. Renders are found however their views were cut
    into chunks.
    """
    wanted = set(stages)
    meanings = _CodeFreeFingerprints()
    for stage in STAGE_VERSIONS:
        for _, manifest in store.manifests(stage):
            meanings.learn(manifest["fields"])
    for entry in planned:
        meanings.learn(entry.fields)
    found: dict[str, Candidate] = {}
    for stage in STAGE_VERSIONS:
        if stage not in wanted:
            continue
        asked = {meanings.of(without_view_range(entry.fields)): entry for entry in planned if entry.stage == stage}
        for folder, manifest in sorted(store.manifests(stage), key=_preference):
            same = asked.get(meanings.of(without_view_range(manifest["fields"])))
            candidate = _candidate(folder, manifest, same) if same else None
            if candidate and not store.complete(candidate.entry):
                found[candidate.entry.fingerprint] = candidate
        for candidate in _unfinished_candidates(store, stage, asked, meanings):
            found.setdefault(candidate.entry.fingerprint, candidate)
    return list(found.values())


def adopt(store: Store, candidate: Candidate, because: str) -> None:
    """Publish the candidate's files as its entry's result.

    Raises:
        StoreError: one of them is damaged, or somebody has gone on with unfinished work meanwhile.
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


def _unfinished_candidates(store: Store, stage: str, asked: Mapping[str, Entry], meanings: _CodeFreeFingerprints) -> Iterator[Candidate]:
    """Work that was cut off and that nobody goes on with now, for entries that are neither made nor begun."""
    for folder in store.unfinished(stage):
        note = read_note(folder)
        same = asked.get(meanings.of(without_view_range(note["fields"]))) if note else None
        if note is None or same is None or store.is_locked(stage, folder.name):
            continue
        candidate = _candidate(folder, {**note, "fingerprint": fingerprint(note["fields"])}, same)
        if note["adopted"] and fingerprint(note["fields"])[:32] != folder.name:  # cut off between note and rename
            told = note["adopted"]
            candidate = Candidate(same, folder, told["from"], tuple(told["differences"]))
        if candidate and not store.complete(candidate.entry) and not store.work_folder(candidate.entry).exists():
            yield replace(candidate, unfinished=True)


def _candidate(folder: Path, manifest: Mapping[str, Any], entry: Entry) -> Candidate | None:
    fields = dict(entry.fields)
    ranged = entry.stage != "render" or all(key in manifest["fields"] for key in VIEW_RANGE)
    if not ranged or manifest["fields"].get("stage_version", 0) > fields["stage_version"]:
        return None
    name = entry.name
    if entry.stage == "render":
        fields |= {key: manifest["fields"][key] for key in VIEW_RANGE}
        name = f"{name.rpartition('/')[0]}/{fields['first']}-{fields['last']}"
    if fingerprint(fields) == manifest["fingerprint"]:
        return None
    told = tuple(map(str, compare_fields(manifest["fields"], fields)))
    return Candidate(Entry(entry.stage, name, fields, entry.provenance), folder, manifest["fingerprint"], told)


def _preference(found: tuple[Path, dict[str, Any]]) -> tuple[int, str]:
    """Sorts the result that is to be preferred last."""
    return int(found[1]["fields"].get("stage_version", 0)), str(found[1].get("written"))


def without_view_range(fields: Mapping[str, Any]) -> dict[str, Any]:
    """The fields that all chunks of a mesh's renders share."""
    return {key: value for key, value in fields.items() if fields.get("stage") != "render" or key not in VIEW_RANGE}


class _CodeFreeFingerprints:
    """Fingerprints of results with all that tells of code left out, back to the meshes."""

    def __init__(self) -> None:
        self._known: dict[str, str] = {}

    def learn(self, fields: Mapping[str, Any]) -> None:
        """Note what a result means, so that results made of it can be compared. Upstream results come first."""
        for known in (fields, without_view_range(fields)):
            self._known[fingerprint(known)] = self.of(known)

    def of(self, fields: Mapping[str, Any]) -> str:
        plain = {key: self._plain(value) for key, value in fields.items() if key not in CODE_FIELDS}
        return fingerprint(plain)

    def _plain(self, value: Any) -> Any:
        if isinstance(value, Mapping):
            kept = value if set(value) != {"name", "version", "code"} else {**value, "code": ""}
            return {key: self._plain(one) for key, one in kept.items()}
        if isinstance(value, list | tuple):
            plain = [self._plain(one) for one in value]
            upstream = all(isinstance(one, str) and one in self._known for one in value) and value
            return sorted(plain) if upstream else plain
        return self._known.get(value, value) if isinstance(value, str) else value
