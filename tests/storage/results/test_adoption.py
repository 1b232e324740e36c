"""Results of older code are taken over when all else is the same, and never otherwise."""

from dataclasses import replace

import pytest

from z2p_renderer.storage.results.adoption import adopt_result, find_candidates
from z2p_renderer.storage.results.fingerprints import STAGE_VERSIONS, fingerprint
from z2p_renderer.storage.results.store import Entry, Store, StoreError

MESH = "a" * 64


def fields(stage, code="new", **more):
    common = {"schema": 2, "stage_version": 1, "code": {"module": code}, "packages": {"numpy": "1"}}
    return {"stage": stage} | common | more


def without_code(entry):
    """The entry as the schema before this one had it."""
    kept = {key: value for key, value in entry.fields.items() if key not in ("code", "packages")}
    return replace(entry, fields=kept | {"schema": 1})


def chain(code="new", mesh=MESH, samples=4, plugin="1", cut=2):
    """A plan: renders of four views, the shard made of them, and training."""
    control = {"name": "color", "version": plugin, "code": code}
    shared = fields("render", code, mesh=mesh, parameters={"samples": samples, "controls": [control]})
    renders = [Entry("render", f"render/ape/{first}-{first + cut}", shared | {"first": first, "last": first + cut})
               for first in range(0, 4, cut)]  # fmt: skip
    shard = Entry("shard", "shard/ape", fields("shard", code, renders=fingerprint(shared), views=4))
    train = Entry("train", "train", fields("train", code, shards=[shard.fingerprint], parameters={"steps": 1}))
    return [*renders, shard, train]


def make(store, entries):
    for entry in entries:
        store.produce(entry, lambda folder, entry=entry: (folder / "result.bin").write_text(f"{entry.name}"))


def take_over(store, planned, stages=tuple(STAGE_VERSIONS)):
    found = find_candidates(store, planned, stages)
    for candidate in found:
        adopt_result(store, candidate, "a refactoring")
    return [candidate.entry.name for candidate in found]


@pytest.fixture
def store(tmp_path):
    return Store(tmp_path / "runs")


def test_a_whole_chain_is_adopted_with_its_provenance(store):
    old, new = chain("old"), chain("new")
    make(store, old)
    assert not any(map(store.complete, new))
    assert take_over(store, new) == [entry.name for entry in new]
    assert all(map(store.complete, new)) and all(store.verify(entry) == [] for entry in [*new, *old])
    assert (store.folder(new[0]) / "result.bin").samefile(store.folder(old[0]) / "result.bin")
    told = store.manifest(new[0])["provenance"]["adopted"]
    assert told["from"] == old[0].fingerprint and told["because"] == "a refactoring" and told["when"]
    assert told["differences"] == ["code of module changed", "plugin color code changed"]
    assert store.manifest(new[0])["fields"] == new[0].fields
    assert take_over(store, new) == []


def test_entries_of_the_schema_without_code_can_be_taken_over(store):
    renders = [without_code(entry) for entry in chain("new")[:2]]
    make(store, renders)
    assert take_over(store, chain("new"), ("render",)) == ["render/ape/0-2", "render/ape/2-4"]


@pytest.mark.parametrize("other", [{"mesh": "b" * 64}, {"samples": 5}, {"plugin": "2"}])
def test_results_of_other_inputs_are_never_adopted(store, other):
    make(store, chain("old", **other))
    assert take_over(store, chain("new")) == []


def test_a_chain_is_judged_back_to_the_meshes(store):
    """A shard of other renders is another shard, though its own fields differ in a fingerprint alone."""
    make(store, chain("old", samples=5))
    make(store, chain("old")[:2])
    assert take_over(store, chain("new")) == ["render/ape/0-2", "render/ape/2-4"]


def test_only_the_stages_asked_for(store):
    make(store, chain("old"))
    assert take_over(store, chain("new"), ("shard",)) == ["shard/ape"]
    assert [store.complete(entry) for entry in chain("new")] == [False, False, True, False]


def test_renders_are_found_under_another_cut_into_chunks(store):
    make(store, chain("old", cut=1)[:4])
    found = find_candidates(store, chain("new", cut=4), ("render",))
    assert sorted(candidate.entry.name for candidate in found) == [f"render/ape/{n}-{n + 1}" for n in range(4)]


def test_the_latest_stage_version_up_to_ours_is_adopted(store):
    for version, code in ((3, "a"), (1, "b"), (2, "c")):
        make(store, [replace(entry, fields=entry.fields | {"stage_version": version}) for entry in chain(code)[:1]])
    planned = [replace(chain("new")[0], fields=chain("new")[0].fields | {"stage_version": 2})]
    (found,) = find_candidates(store, planned, ("render",))
    assert not any("version" in difference for difference in found.differences)
    planned = [replace(chain("new")[0], fields=chain("new")[0].fields | {"stage_version": 0})]
    assert find_candidates(store, planned, ("render",)) == []


def test_a_damaged_result_and_an_empty_reason_are_refused(store):
    make(store, chain("old")[:1])
    (candidate,) = find_candidates(store, chain("new"), ("render",))
    with pytest.raises(ValueError, match="reason"):
        adopt_result(store, candidate, "  ")
    (candidate.folder / "result.bin").write_text("other")
    with pytest.raises(StoreError, match=r"result\.bin"):
        adopt_result(store, candidate, "a refactoring")
    assert find_candidates(store, chain("new"), ("render",)) == []


def stop_halfway(folder):
    (folder / "checkpoint").write_text("half")
    raise KeyboardInterrupt


def test_unfinished_work_is_taken_over_and_told_in_the_end(store):
    old, new = chain("old")[-1], chain("new")[-1]
    make(store, chain("old")[:-1])
    with pytest.raises(KeyboardInterrupt):
        store.produce(old, stop_halfway, resumable=True)
    assert take_over(store, chain("new"))[-1] == "train"
    assert not store.work_folder(old).exists() and not store.complete(new)

    def finish(folder):
        assert (folder / "checkpoint").read_text() == "half"
        (folder / "weights").write_text("whole")

    store.produce(new, finish, resumable=True, leftovers=("**/.*", "checkpoint"))
    assert [path.name for path in sorted(store.folder(new).iterdir())] == ["manifest.json", "weights"]
    assert store.manifest(new)["provenance"]["adopted"]["from"] == old.fingerprint


def test_an_interrupted_adoption_is_offered_again(store, monkeypatch):
    old, new = chain("old")[-1], chain("new")[-1]
    make(store, chain("old")[:-1])
    with pytest.raises(KeyboardInterrupt):
        store.produce(old, stop_halfway, resumable=True)
    take_over(store, chain("new")[:-1])
    (candidate,) = find_candidates(store, chain("new"), ("train",))
    with monkeypatch.context() as patched, pytest.raises(KeyboardInterrupt):
        patched.setattr("pathlib.Path.rename", stop_renaming)
        adopt_result(store, candidate, "the same")
    (again,) = find_candidates(store, chain("new"), ("train",))
    assert (again.old_fingerprint, again.differences) == (candidate.old_fingerprint, candidate.differences)
    store.produce(old, lambda folder: (folder / "weights").write_text("old"), resumable=True)
    assert "adopted" not in store.manifest(old)["provenance"], "it was the old code that finished it"
    assert not store.complete(new)


def stop_renaming(*words):
    raise KeyboardInterrupt


def test_work_that_went_on_meanwhile_is_not_adopted(store):
    old = chain("old")[-1]
    make(store, chain("old")[:-1])
    with pytest.raises(KeyboardInterrupt):
        store.produce(old, stop_halfway, resumable=True)
    take_over(store, chain("new")[:-1])
    (candidate,) = find_candidates(store, chain("new"), ("train",))
    store.produce(old, lambda folder: (folder / "weights").write_text("whole"), resumable=True)
    with pytest.raises(StoreError, match="has gone on"):
        adopt_result(store, candidate, "the same")


def test_unfinished_work_that_continues_is_not_adopted(store):
    old, new = chain("old")[-1], chain("new")[-1]
    make(store, chain("old")[:-1])
    with pytest.raises(KeyboardInterrupt):
        store.produce(old, stop_halfway, resumable=True)
    with store.lock(old):
        assert [one.entry.stage for one in find_candidates(store, chain("new"), ("train",))] == []
    with pytest.raises(KeyboardInterrupt):
        store.produce(new, stop_halfway, resumable=True)
    assert find_candidates(store, chain("new"), ("train",)) == []
