"""A result is there whole or not at all, whatever happens while it is written."""

import json
import os
import shutil
import signal
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from z2p_renderer.storage.results.manifests import MANIFEST
from z2p_renderer.storage.results.store import Entry, Store, StoreError, check_result
from z2p_renderer.storage.results.work_note import read_note


def entry(value=1):
    return Entry("sample", "sample/bunny", {"stage": "sample", "value": value}, {"mesh": "/somewhere/bunny.ply"})


def write(folder: Path) -> None:
    (folder / "pool.npy").write_bytes(b"0123456789")
    (folder / "more").mkdir(exist_ok=True)
    (folder / "more" / "curve.csv").write_text("step,loss\n")


def edit_manifest(folder: Path, old: str, new: str) -> None:
    text = (folder / MANIFEST).read_text()
    assert old in text
    (folder / MANIFEST).write_text(text.replace(old, new))


@pytest.fixture
def store(tmp_path):
    return Store(tmp_path / "runs")


def unfinished(store):
    return [path for path in (store.root / ".tmp").iterdir()] if (store.root / ".tmp").exists() else []


def test_a_produced_entry_is_complete_and_says_all_about_itself(store):
    assert not store.complete(entry())
    folder = store.produce(entry(), write)
    assert store.complete(entry()) and store.verify(entry()) == []
    manifest = store.manifest(entry())
    assert manifest["name"] == "sample/bunny" and manifest["fields"] == dict(entry().fields)
    assert manifest["files"]["more/curve.csv"]["size"] == 10
    assert set(manifest["files"]) == {"pool.npy", "more/curve.csv"}
    assert manifest["provenance"]["mesh"] == "/somewhere/bunny.ply" and manifest["environment"]["packages"]["numpy"]
    assert folder.parent == store.root / "sample" and unfinished(store) == []


def test_a_complete_entry_is_not_made_again(store):
    store.produce(entry(), write)
    store.produce(entry(), lambda folder: pytest.fail("made again"))


def test_other_fields_are_another_entry(store):
    store.produce(entry(1), write)
    assert not store.complete(entry(2))
    store.produce(entry(2), write)
    assert store.complete(entry(1)) and store.folder(entry(1)) != store.folder(entry(2))


def test_provenance_and_name_are_not_in_the_fingerprint():
    renamed = Entry("sample", "sample/hare", dict(entry().fields), {"mesh": "/elsewhere/hare.ply"})
    assert renamed.fingerprint == entry().fingerprint


@pytest.mark.parametrize(
    "damage",
    [
        lambda folder: (folder / "pool.npy").unlink(),
        lambda folder: (folder / "pool.npy").write_bytes(b"01234"),
        lambda folder: (folder / MANIFEST).unlink(),
        lambda folder: (folder / MANIFEST).write_text('{"name": '),
        lambda folder: (folder / MANIFEST).write_text("[]"),
        lambda folder: edit_manifest(folder, '"value": 1', '"value": 3'),
    ],
)
def test_damage_makes_an_entry_incomplete_and_it_is_made_again(store, damage):
    folder = store.produce(entry(), write)
    damage(folder)
    assert not store.complete(entry()) and store.verify(entry())
    with pytest.raises(StoreError, match="sample/bunny"):
        store.manifest(entry())
    store.produce(entry(), write)
    assert store.complete(entry()) and store.verify(entry()) == []
    assert len(list((store.root / ".quarantine" / "sample").iterdir())) == 1


def test_a_file_written_to_afterwards_is_read_and_found_damaged(store):
    folder = store.produce(entry(), write)
    (folder / "pool.npy").write_bytes(b"1123456789")
    assert not store.complete(entry()) and "sha256 differs" in store.faults(entry())[0]


def test_touching_and_copying_do_no_harm(store, tmp_path):
    folder = store.produce(entry(), write)
    (folder / "pool.npy").touch()
    assert store.complete(entry())
    shutil.copytree(store.root, tmp_path / "copy", copy_function=shutil.copyfile)
    assert Store(tmp_path / "copy").complete(entry())


def test_verify_finds_a_flipped_bit_that_left_no_trace(store):
    folder = store.produce(entry(), write)
    before = (folder / "pool.npy").stat()
    (folder / "pool.npy").write_bytes(b"1123456789")
    os.utime(folder / "pool.npy", ns=(before.st_atime_ns, before.st_mtime_ns))
    assert store.complete(entry())
    assert len(store.verify(entry())) == 1 and "pool.npy" in store.verify(entry())[0]


def test_a_quarantined_result_is_missing_but_still_listed(store):
    folder = store.produce(entry(), write)
    assert store.quarantine(folder).parent == store.root / ".quarantine" / "sample"
    assert not store.complete(entry()) and list(store.manifests("sample")) == []
    assert [manifest["name"] for _, manifest in store.iter_all_manifests("sample")] == ["sample/bunny"]


def test_linked_files_are_the_same_files(store):
    folder = store.produce(entry(1), write)
    store.link({"pool.npy": folder / "pool.npy", "some/more.csv": folder / "more" / "curve.csv"}, entry(2))
    assert store.complete(entry(2)) and (store.folder(entry(2)) / "pool.npy").samefile(folder / "pool.npy")
    assert (store.folder(entry(2)) / "some" / "more.csv").read_text() == "step,loss\n"


def test_a_damaged_result_does_not_pass_the_check(store):
    folder = store.produce(entry(1), write)
    check_result(folder)
    (folder / "pool.npy").write_bytes(b"1123456789")
    with pytest.raises(StoreError, match="sha256"):
        check_result(folder)


def test_moving_the_store_leaves_it_complete(store, tmp_path):
    store.produce(entry(), write)
    store.root.rename(tmp_path / "elsewhere")
    assert Store(tmp_path / "elsewhere").complete(entry())


def test_a_failing_stage_leaves_no_entry(store):
    def fail(folder):
        write(folder)
        raise OSError("disk full")

    with pytest.raises(OSError, match="disk full"):
        store.produce(entry(), fail)
    assert not store.folder(entry()).exists() and not store.complete(entry())
    assert not list((store.root / ".tmp").iterdir())
    store.produce(entry(), write)
    assert store.complete(entry())


def test_a_stage_that_writes_nothing_is_an_error(store):
    with pytest.raises(StoreError, match="no file"):
        store.produce(entry(), lambda folder: None)


def test_of_two_publishers_the_first_wins(store, tmp_path):
    folders = [tmp_path / "runs" / ".tmp" / name for name in "ab"]
    for number, folder in enumerate(folders):
        folder.mkdir(parents=True)
        (folder / "pool.npy").write_text(f"writer {number}")
    assert store.publish(folders[0], entry()) is True
    assert store.publish(folders[1], entry()) is False
    assert (store.folder(entry()) / "pool.npy").read_text() == "writer 0"
    assert not folders[1].exists()


def test_racing_producers_make_one_result_once(store):
    made, start = [], threading.Barrier(8)

    def produce():
        start.wait()
        store.produce(entry(), lambda folder: (made.append(folder), write(folder)))

    threads = [threading.Thread(target=produce) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(made) == 1 and store.complete(entry()) and unfinished(store) == []


def test_a_resumable_stage_resumes_and_drops_its_leftovers(store):
    def stop_halfway(folder):
        (folder / "view_0.png").write_text("first")
        (folder / ".half").write_text("x")
        raise KeyboardInterrupt

    def finish(folder):
        assert (folder / "view_0.png").read_text() == "first"
        (folder / "view_1.png").write_text("second")
        (folder / "checkpoints").mkdir()
        (folder / "checkpoints" / "1.pt").write_text("x")

    with pytest.raises(KeyboardInterrupt):
        store.produce(entry(), stop_halfway, resumable=True)
    folder = store.produce(entry(), finish, resumable=True, leftovers=(".*", "checkpoints"))
    assert sorted(path.name for path in folder.iterdir()) == [MANIFEST, "view_0.png", "view_1.png"]
    assert store.complete(entry())


def no_room(*_):
    raise OSError("No space left on device")


@pytest.mark.parametrize("broken", ["z2p_renderer.storage.results.manifests.fsync_path", "pathlib.Path.rename"])
def test_what_stops_the_publishing_costs_no_work(store, monkeypatch, broken):
    def train(folder):
        (folder / "checkpoints").mkdir(exist_ok=True)
        (folder / "checkpoints" / "1.pt").write_text("days of work")
        write(folder)

    with monkeypatch.context() as patch, pytest.raises(OSError, match="No space"):
        patch.setattr(broken, no_room)
        store.produce(entry(), train, resumable=True, leftovers=("**/.*", "checkpoints"))
    assert (store.work_folder(entry()) / "checkpoints" / "1.pt").read_text() == "days of work"
    assert read_note(store.work_folder(entry()))["name"] == "sample/bunny" and not store.complete(entry())
    folder = store.produce(entry(), write, resumable=True, leftovers=("**/.*", "checkpoints"))
    assert set(store.manifest(entry())["files"]) == {"pool.npy", "more/curve.csv"}
    assert sorted(path.name for path in folder.iterdir()) == [MANIFEST, "more", "pool.npy"]
    assert not store.work_folder(entry()).exists()


def test_leftovers_of_a_kill_after_publishing_are_harmless(store, monkeypatch):
    def train(folder):
        write(folder)
        (folder / "checkpoints").mkdir()
        (folder / "checkpoints" / "1.pt").write_text("x")

    monkeypatch.setattr("z2p_renderer.storage.results.store._remove", no_room)
    folder = store.produce(entry(), train, resumable=True, leftovers=("checkpoints",))
    assert (folder / "checkpoints" / "1.pt").exists() and store.complete(entry()) and store.verify(entry()) == []


@pytest.mark.parametrize("broken", ["z2p_renderer.storage.results.manifests.fsync_path", "pathlib.Path.rename"])
def test_a_result_that_cannot_be_published_leaves_nothing(store, monkeypatch, broken):
    with monkeypatch.context() as patch, pytest.raises(OSError, match="No space"):
        patch.setattr(broken, no_room)
        store.produce(entry(), write)
    assert unfinished(store) == [] and not store.complete(entry())
    with pytest.raises(StoreError, match="no file"):
        store.produce(entry(), lambda folder: None)
    assert unfinished(store) == []


@pytest.mark.parametrize("resumable", [False, True])
def test_a_kill_between_manifest_and_rename_leaves_no_entry(store, resumable):
    script = (
        "import os, signal, sys, pathlib\n"
        "from z2p_renderer.storage.results.store import Entry, Store\n"
        "pathlib.Path.rename = lambda *_: os.kill(os.getpid(), signal.SIGKILL)\n"
        "entry = Entry('sample', 'sample/bunny', {'stage': 'sample', 'value': 1})\n"
        "write = lambda folder: (folder / 'pool.npy').write_text('x')\n"
        f"Store(pathlib.Path(sys.argv[1])).produce(entry, write, resumable={resumable})\n"
    )
    killed = subprocess.run([sys.executable, "-c", script, str(store.root)], check=False, env=os.environ)
    assert killed.returncode == -signal.SIGKILL
    assert len(list(store.root.glob(".*/**/" + MANIFEST))) == 1  # it died where it was meant to
    assert not store.complete(entry()) and list(store.manifests("sample")) == []
    store.produce(entry(), write, resumable=resumable)
    assert store.complete(entry()) and store.verify(entry()) == []


def test_manifests_lists_finished_undamaged_entries(store):
    store.produce(entry(1), write)
    damaged = store.produce(entry(2), write)
    (damaged / "pool.npy").unlink()
    found = list(store.manifests("sample"))
    assert [manifest["fields"]["value"] for _, manifest in found] == [1]
    assert list(store.manifests("render")) == []


def test_the_manifest_is_readable_json(store):
    folder = store.produce(entry(), write)
    assert json.loads((folder / MANIFEST).read_text())["fingerprint"] == entry().fingerprint


def deep(count: int) -> str:
    return "[" * count + "]" * count


def resealed(folder: Path, change) -> None:
    """An edit that keeps every digest but the list's right."""
    manifest = json.loads((folder / MANIFEST).read_text())
    change(manifest)
    (folder / MANIFEST).write_text(json.dumps(manifest))


DAMAGE = {
    "fewer files": lambda folder: resealed(folder, lambda one: one["files"].pop("pool.npy")),
    "no files": lambda folder: resealed(folder, lambda one: one["files"].clear()),
    "more files": lambda folder: resealed(folder, lambda one: one["files"].update({"x": one["files"]["pool.npy"]})),
    "no digest of the list": lambda folder: resealed(folder, lambda one: one.pop("listing")),
    "a file elsewhere": lambda folder: resealed(
        folder, lambda one: one["files"].update({"../../x": one["files"]["pool.npy"]})
    ),
    "other fields": lambda folder: resealed(folder, lambda one: one["fields"].update(value=7)),
    "sizes that are none": lambda folder: resealed(folder, lambda one: one["files"]["pool.npy"].update(size=-1)),
    "lists of lists": lambda folder: (folder / MANIFEST).write_text(deep(100_000)),
    "deep fields": lambda folder: (folder / MANIFEST).write_text(
        (folder / MANIFEST).read_text().replace('"value": 1', f'"value": {deep(5000)}')
    ),
    "an endless number": lambda folder: edit_manifest(folder, '"value": 1', '"value": ' + "9" * 5000),
    "no number": lambda folder: edit_manifest(folder, '"value": 1', '"value": NaN'),
    "half of it": lambda folder: os.truncate(folder / MANIFEST, 100),
    "bytes": lambda folder: (folder / MANIFEST).write_bytes(b"\xff\xfe\0"),
    "a folder": lambda folder: ((folder / MANIFEST).unlink(), (folder / MANIFEST).mkdir()),
    "a file in place of the result": lambda folder: (shutil.rmtree(folder), folder.write_text("x")),
    "a link to nowhere": lambda folder: (shutil.rmtree(folder), folder.symlink_to("nowhere")),
    "a pipe in place of a file": lambda folder: ((folder / "pool.npy").unlink(), os.mkfifo(folder / "pool.npy")),
    "a result within it": lambda folder: shutil.copytree(folder, folder / "b" / ".." / "copy"),
    "another's": lambda folder: resealed(folder, lambda one: one.update(fingerprint="0" * 64, fields={"value": 3})),
}


@pytest.mark.parametrize("damage", DAMAGE)
def test_an_edited_manifest_is_detected_and_quarantined(store, damage):
    folder = store.produce(entry(), write)
    DAMAGE[damage](folder)
    assert store.faults(entry()) and store.verify(entry()) and not store.complete(entry())
    assert [path for path, _ in store.damaged()] == [folder]
    list(store.manifests("sample")), list(store.iter_all_manifests("sample"))  # nothing stumbles over it
    store.produce(entry(), write)
    assert store.complete(entry()) and not list(store.damaged())
    assert len(list((store.root / ".quarantine" / "sample").iterdir())) == 1


def test_a_result_under_another_ones_name_is_none(store):
    folder = store.produce(entry(1), write)
    folder.rename(store.folder(entry(2)))
    assert [path for path, _ in store.damaged()] == [store.folder(entry(2))] and not list(store.manifests("sample"))


def test_a_manifest_without_a_listing_digest_is_adoptable(store):
    folder = store.produce(entry(), write)
    resealed(folder, lambda one: one.pop("listing"))
    assert not store.complete(entry()) and [path for path, _ in store.manifests("sample")] == [folder]
    check_result(folder)
