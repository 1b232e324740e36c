"""The mutation matrix on the local scheduler: after each change exactly the steps run that depend on it.

For each: the dry run predicts it and writes nothing, nothing is left to run, and going back runs nothing.
"""

from __future__ import annotations

import os
import shutil

import pytest
from mutations import ALL, INPUTS, OUTPUTS, change_and_go_back, flipped, lose_and_mend
from small_store import listing
from world import World

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def world(tmp_path_factory):
    """A world whose pipeline has run; each test leaves it as it was."""
    world = World(tmp_path_factory.mktemp("world"))
    assert world.make() == sorted(ALL)
    return world


@pytest.mark.parametrize("name", INPUTS)
def test_a_changed_input_runs_only_what_depends_on_it(world, tmp_path, name):
    change_and_go_back(world, name, tmp_path)


@pytest.mark.parametrize("name", OUTPUTS)
def test_a_damaged_output_is_remade_with_the_same_bytes(world, name):
    lose_and_mend(world, name)


@pytest.mark.parametrize("words", [("--workers", "2"), ("--log-level", "DEBUG"), ("--explain",)], ids=" ".join)
def test_how_it_is_run_runs_nothing(world, words):
    assert world.make(*words) == []


def test_a_dry_run_writes_nothing_and_says_what_a_run_then_does(world):
    toml = world.root / "small.toml"
    text = toml.read_text()
    toml.write_text(text.replace("[evaluate]\nviews = 1", "[evaluate]\nviews = 2"))
    before = listing(world.root)
    status, said = world.run("--dry-run")
    assert status == 0 and "STALE   evaluate" in said and "views 1 -> 2" in said and "would make 1 of" in said
    assert "Execution Summary" not in said
    assert listing(world.root) == before
    assert world.make() == ["evaluate"]
    toml.write_text(text)
    assert world.make() == []


def test_a_flipped_bit_is_found_by_verify_and_before_reading(world):
    """Only then: nothing tells it from sound data but its digest."""
    before = world.digests()
    path = world.manifest("sample/tetra").parent / "pool.npy"
    for found_by in ("verify", "a reader"):
        stamp = path.stat()
        flipped("sample/tetra", "pool.npy")(world)
        os.utime(path, ns=(stamp.st_atime_ns, stamp.st_mtime_ns))
        assert world.predicted() == set()
        if found_by == "verify":
            result = world.workflows("verify", "--workspace", "runs")
            assert result.returncode == 1 and "pool.npy" in result.stdout and "1 damaged" in result.stdout
            assert world.make() == ["sample/tetra"]
        else:
            shutil.rmtree(world.manifest("shard/tetra").parent)
            assert world.make() == ["sample/tetra", "shard/tetra"]
        assert world.digests() == before
    assert world.workflows("verify", "--workspace", "runs").returncode == 0
