"""Manifests, notes and shards of a workspace, torn and edited: told as damaged, and nothing falls over them."""

from __future__ import annotations

import json
from contextlib import suppress
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from changed_bytes import changed as changed_bytes
from changed_values import changed, json_text
from click.testing import CliRunner

from z2p_core.config import PipelineConfig, RenderConfig
from z2p_core.scene import SceneDescription
from z2p_renderer.storage.results.adoption import find_candidates
from z2p_renderer.storage.results.manifests import MANIFEST
from z2p_renderer.storage.results.store import Store, StoreError
from z2p_renderer.storage.results.work_note import NOTE
from z2p_renderer.storage.shards import Record, Shard, ShardError, write_shard
from z2p_renderer.workflows import commands
from z2p_renderer.workflows.plan import MeshInput, Plan, assemble_plan
from z2p_renderer.workflows.status import format_table, statuses_to_json, step_statuses
from z2p_renderer.workflows.upkeep.garbage_collection import find_garbage
from z2p_renderer.workflows.upkeep.runs_in_use import keep_results

SHARD, WORKSPACE = "shard.h5", "runs"
MEANING = ("fields", "files", "fingerprint")
"""Keys of a manifest that say what its result is."""
EDITED, BEFORE = "edited.json", "before.json"


def make(rng: np.random.Generator, folder: Path) -> None:
    """A shard that is changed, or a workspace in which one JSON file is."""
    if rng.random() < 0.4:
        _write_shard(folder / SHARD, rng)
        return
    store, plan = Store(folder / WORKSPACE), _plan()
    for step in plan.steps.values():
        if rng.random() < 0.7:
            store.produce(step.entry, lambda place: (place / "result.bin").write_text("made"))
        elif rng.random() < 0.3:
            store._opened_work_folder(step.entry)
    keep_results(store, plan, json.dumps({"config": "", "meshes": "", "evaluate_meshes": ""}))
    files = sorted(path for path in store.root.rglob("*") if path.name in (MANIFEST, NOTE) or path.suffix == ".json")
    chosen = files[rng.integers(len(files))]
    before = json.loads(chosen.read_text())
    text = json_text(changed(before, rng)).encode(errors="surrogatepass")
    chosen.write_bytes(changed_bytes(text, rng) if rng.random() < 0.2 else text)
    (folder / BEFORE).write_text(json.dumps(before))
    (folder / EDITED).write_text(json.dumps(chosen.relative_to(folder).as_posix()))


def check(folder: Path) -> str:
    """What came of it."""
    if (folder / SHARD).exists():
        return f"shard {_shard(folder / SHARD)}"
    store, plan = Store(folder / WORKSPACE), _plan()
    edited = folder / json.loads((folder / EDITED).read_text())
    same = _same(json.loads((folder / BEFORE).read_text()), edited)
    found = step_statuses(plan, store)
    format_table(found)
    json.loads(statuses_to_json(found))
    with suppress(StoreError):  # a note of what is in use that is damaged
        find_garbage(store, ())
    entries = [step.entry for step in plan.steps.values()]
    find_candidates(store, entries, [entry.stage for entry in entries])
    if edited.name == MANIFEST:
        place = edited.parent
        (state,) = (one.state for one in found if one.fingerprint.startswith(place.name))
        assert same or state != "fresh", "a manifest that was edited counts as fresh"
        if not same:
            done = _command("verify", "--workspace", str(store.root))
            assert done == 1 and not place.exists(), f"verify leaves a manifest that was edited (status {done})"
    else:
        _command("verify", "--workspace", str(store.root))
    _command("gc", "--workspace", str(store.root))
    return f"{'same' if same else 'changed'} {edited.name if edited.name in (MANIFEST, NOTE) else 'kept'}"


def _command(*words: str) -> int:
    done = CliRunner().invoke(commands.main, list(words))
    if done.exception is not None and not isinstance(done.exception, SystemExit | StoreError):  # told by `commands.run`
        raise done.exception
    return done.exit_code


def _same(before: Any, edited: Path) -> bool:
    """Whether a file says still what it said, as far as it matters."""
    try:
        now = json.loads(edited.read_text())
    except (ValueError, RecursionError):
        return False
    if edited.name != MANIFEST or not isinstance(now, dict):
        return bool(now == before)
    return all(key in now and _exact(now[key]) == _exact(before[key]) for key in MEANING)


def _exact(value: Any) -> str:
    """A text that tells 1 from 1.0 and from true."""
    return json.dumps(value, sort_keys=True)


@lru_cache(maxsize=1)
def _plan() -> Plan:
    """That of a small pipeline, for which no mesh has to be there."""
    meshes = [MeshInput(name, name[0] * 64, Path(f"/nowhere/{name}.ply")) for name in ("ape", "bee")]
    return assemble_plan(replace(PipelineConfig(), render=RenderConfig(views=2)), meshes, meshes[:1])


def _write_shard(path: Path, rng: np.random.Generator) -> None:
    import h5py

    scene = SceneDescription(rotation=((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)))
    record = Record(np.zeros((4, 4, 4), "u1"), np.zeros((4, 4), "u1"), np.zeros(2, "f4"), np.zeros(2, "f4"), scene)
    attributes = {"mesh": "ape", "controls": [{"name": "a", "version": "1", "size": 2}], "resolution": 4}
    write_shard(path, [record, record], np.zeros((5, 3), "f4"), attributes)
    match int(rng.integers(4)):
        case 0:
            path.write_bytes(changed_bytes(path.read_bytes(), rng))
        case 1:
            with h5py.File(path, "r+") as file:
                told = json.loads(bytes(file.attrs["z2p"]))
                file.attrs["z2p"] = np.bytes_(json_text(changed(told, rng)).encode(errors="surrogatepass")[:60_000])
        case 2:
            with h5py.File(path, "r+") as file:
                told = json.loads(json.dumps(scene.to_json()))
                file["scene"][0] = np.bytes_(json_text(changed(told, rng)).encode(errors="surrogatepass")[:1024])
        case _:
            _put_odd_data(path, rng)


def _put_odd_data(path: Path, rng: np.random.Generator) -> None:
    """Another data set, or none, under one of the names."""
    import h5py

    with h5py.File(path, "r+") as file:
        name = str(rng.choice(sorted(file)))
        del file[name]
        match int(rng.integers(6)):
            case 0:
                file[name] = h5py.SoftLink(f"/{name}")
            case 1:
                file.create_dataset(name, (2**40, 3), "f4", chunks=(1000, 3))
            case 2:
                file[name] = np.full((2, 4, 4, 4), 7, rng.choice(["u1", "f8", "S3"]))
            case 3:
                file[name] = 3.0
            case 4:
                file.create_group(name)
            case _:
                file.attrs["z2p"] = 5 if rng.random() < 0.5 else np.arange(3)


def _shard(path: Path) -> str:
    try:
        shard = Shard(path)
        try:
            for index in range(len(shard)):
                record = shard.read(index)
                assert np.isfinite(record.settings).all()
                json.dumps(record.scene.to_json(), allow_nan=False)
            assert np.isfinite(shard.pool).all() and np.isfinite(shard.elevations).all()
        finally:
            shard.close()
    except ShardError as error:
        assert "\n" not in str(error) and len(str(error)) < 1500, f"a message that is no line: {str(error)[:300]!r}"
        return "refused"
    return "read"
