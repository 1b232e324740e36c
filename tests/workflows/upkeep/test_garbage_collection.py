"""What nobody needs is shown and then removed; what is kept, linked, written or in use stays."""

import errno
import fcntl
import json
import os
import subprocess
import sys
import time

import pytest
from editing import edited
from small_store import fill, link, listing

from z2p_renderer.storage.results.store import Store, StoreError
from z2p_renderer.workflows.plan import make_plan
from z2p_renderer.workflows.upkeep.garbage_collection import collect_garbage, find_garbage
from z2p_renderer.workflows.upkeep.runs_in_use import Registration, iter_running, keep_results


@pytest.fixture
def store(tmp_path):
    return Store(tmp_path / "runs")


def names(found):
    return {one.name for one in found}


def test_results_of_an_abandoned_setting_are_removed(config, store):
    old, new = make_plan(config), make_plan(edited(config, "train.steps", 7))
    fill(store, old)
    fill(store, new)
    keep_results(store, new, "{}")
    before = listing(store.root)
    assert names(find_garbage(store)) == {"train", "evaluate"}
    after = listing(store.root)
    assert {path for path in after if "/.locks" not in path} == {path for path in before if "/.locks" not in path}
    (store.root / ".trash" / "of one that was killed" / "0").mkdir(parents=True)
    assert names(collect_garbage(store)) == {"train", "evaluate"} and find_garbage(store) == []
    assert all(store.complete(step.entry) for step in new.steps.values())
    assert not store.complete(old.steps["train"].entry) and not (store.root / ".trash").exists()


def test_linked_results_and_their_upstream_are_kept(config, store):
    plan = make_plan(config)
    fill(store, plan)
    link(store, plan)
    assert names(find_garbage(store)) == {"evaluate"}
    assert len(find_garbage(store, drop=["quick"])) == len(plan.steps)


def test_a_configuration_can_be_dropped(config, store):
    plan = make_plan(config)
    fill(store, plan)
    keep_results(store, plan, "{}")
    assert find_garbage(store) == []
    assert len(collect_garbage(store, drop=["quick"])) == len(plan.steps)
    assert not list((store.root / ".kept").iterdir())


def test_results_of_a_running_pipeline_are_kept(config, store):
    plan = make_plan(config)
    fill(store, plan)
    registration = Registration(store, plan, "{}")
    (store.root / ".kept" / "quick.json").unlink()
    assert collect_garbage(store) == [] and [note["name"] for note in iter_running(store)] == ["quick"]
    registration.close()
    assert len(find_garbage(store)) == len(plan.steps)


@pytest.mark.parametrize("name", ["elsewhere", f"{os.uname().nodename}-2"])
def test_notes_of_killed_pipelines_expire_later_on_other_hosts(config, store, name):
    plan = make_plan(config)
    fill(store, plan)
    registration = Registration(store, plan, "{}")
    (store.root / ".kept" / "quick.json").unlink()
    registration._file.close()  # as the kernel does when the process is killed
    assert len(find_garbage(store)) == len(plan.steps)
    elsewhere = registration.path.rename(registration.path.with_name(f"{name}-1-abc.json"))
    elsewhere.write_text(json.dumps({**json.loads(elsewhere.read_text()), "host": name}))
    assert find_garbage(store) == []
    os.utime(elsewhere, (time.time() - 3600,) * 2)
    assert len(find_garbage(store)) == len(plan.steps) and elsewhere.exists()  # looking removes nothing
    assert len(collect_garbage(store)) == len(plan.steps) and not elsewhere.exists()


def locked_as_on_nfs4(monkeypatch):
    """From now on what NFS 4 asks of a file that is locked: to be open to be read if shared, to be written if alone."""
    flock = fcntl.flock

    def strict(file, how):
        given = fcntl.fcntl(file, fcntl.F_GETFL) & os.O_ACCMODE
        if not how & fcntl.LOCK_UN and given == (os.O_WRONLY if how & fcntl.LOCK_SH else os.O_RDONLY):
            raise OSError(errno.EBADF, os.strerror(errno.EBADF))
        flock(file, how)

    monkeypatch.setattr(fcntl, "flock", strict)


def test_live_and_dead_notes_are_distinguished_on_nfs4(config, store, monkeypatch):
    locked_as_on_nfs4(monkeypatch)
    note = Registration(store, make_plan(config), "{}")
    copy = note.path.with_name("copy.json")
    copy.write_bytes(note.path.read_bytes())  # as if its pipeline had been killed
    assert len(list(iter_running(store))) == 1
    note.close()
    assert list(iter_running(store)) == []
    monkeypatch.setattr(os, "access", lambda path, mode: False)  # another user's, but for root
    assert len(list(iter_running(store))) == 1, "believed while it is fresh"
    os.utime(copy, (0, 0))
    assert list(iter_running(store)) == []


def test_a_result_locked_by_another_process_is_kept(config, store):
    plan = make_plan(config)
    entry = plan.steps["train"].entry
    (store.work_folder(entry) / "checkpoints").mkdir(parents=True)
    with store.lock(entry):
        script = ("import sys; from pathlib import Path; from z2p_renderer.storage.results.store import Store; "
                  "from z2p_renderer.workflows.upkeep.garbage_collection import collect_garbage; "
                  "print(len(collect_garbage(Store(Path(sys.argv[1])))))")  # fmt: skip
        command = [sys.executable, "-c", script, str(store.root)]
        assert subprocess.run(command, capture_output=True, text=True, check=True).stdout.split() == ["0"]
    assert names(collect_garbage(store)) == {"unfinished train"} and not store.work_folder(entry).exists()


def test_leftovers_of_killed_runs_and_repairs_are_removed(config, store):
    plan = make_plan(config)
    fill(store, plan)
    keep_results(store, plan, "{}")
    store.quarantine(store.folder(plan.steps["sample/ape"].entry))
    fill(store, plan, "sample/ape")
    old, young = (store.root / ".tmp" / f"sample-0123456789abcdef-{name}" for name in ("old", "young"))
    for folder in (old, young):
        folder.mkdir(parents=True)
    os.utime(old, (time.time() - 7200,) * 2)
    assert names(collect_garbage(store)) == {"damaged sample", "left by a killed sample"}
    assert young.exists() and all(store.complete(step.entry) for step in plan.steps.values())


@pytest.mark.parametrize("torn", ["", "{", "[]", "3", '{"results": 3}', '{"results": [3]}', "[" * 100_000, "9" * 5000])
def test_a_damaged_note_of_kept_results_blocks_collection(config, store, torn):
    plan = make_plan(config)
    fill(store, plan)
    keep_results(store, plan, "{}")
    (store.root / ".kept" / "quick.json").write_text(torn)
    for look in (find_garbage, collect_garbage):
        with pytest.raises(StoreError, match=r"quick\.json.*damaged.*run its pipeline again.*--drop quick"):
            look(store)
    assert all(store.complete(step.entry) for step in plan.steps.values())
    assert len(collect_garbage(store, drop=["quick"])) == len(plan.steps)


@pytest.mark.parametrize("torn", ["", "[]", '{"results": 3}', "[" * 100_000])
def test_a_damaged_note_of_a_live_pipeline_blocks_collection(config, store, torn):
    plan = make_plan(config)
    fill(store, plan)
    registration = Registration(store, plan, "{}")
    registration.path.write_text(torn)
    with pytest.raises(StoreError, match="wait until its pipeline has ended"):
        find_garbage(store, drop=["quick"])
    registration._file.close()
    assert len(collect_garbage(store, drop=["quick"])) == len(plan.steps)


def test_a_link_to_a_damaged_result_blocks_collection(config, store):
    plan = make_plan(config)
    fill(store, plan)
    link(store, plan)
    (store.folder(plan.steps["train"].entry) / "manifest.json").write_text("{")
    with pytest.raises(StoreError, match=r"damaged, so that nobody can tell what .* was made from"):
        find_garbage(store)
    assert find_garbage(store, drop=["quick"])
    keep_results(store, plan, "{}")  # says by itself what is needed
    assert find_garbage(store) == []
