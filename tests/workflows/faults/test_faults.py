"""Processes killed, disks filled, schedulers gone, for real: the next run ends with an undisturbed run's very bytes."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import time
from pathlib import Path

import pytest
from soak import soak
from world import World, luigid, made

pytestmark = pytest.mark.slow

AFTER = {
    "sample/tetra": {"shard/tetra", "train", "evaluate"}, "render/tetra/0-2": {"shard/tetra", "train", "evaluate"},
    "shard/tetra": {"train", "evaluate"}, "train": {"evaluate"}, "evaluate": set(),
}  # fmt: skip
"""Step -> what depends on it."""


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    world = World(tmp_path_factory.mktemp("undisturbed"), code=False)
    world.make()
    return world


@pytest.fixture
def world(undisturbed, tmp_path):
    """A finished world of the test's own."""
    shutil.copytree(undisturbed.workspace, tmp_path / "runs", symlinks=True)
    return World(tmp_path, code=False)


def lose(world: World, step: str) -> None:
    """Take a step's result away, and those of all that depends on it."""
    manifests = world.manifests()
    for name in (step, *AFTER[step]):
        shutil.rmtree(manifests[name].parent)


def finish(world: World, undisturbed: World) -> list[str]:
    """What a run makes that nothing disturbs; afterwards all is as in the undisturbed world."""
    found = world.make()
    assert world.digests() == undisturbed.digests()
    assert not list(world.workspace.glob(".work/*/*"))
    return found


KILLS = {
    "in sampling": ("sample/tetra", "open 1 pool\\.npy$"),
    "in Cycles": ("render/tetra/0-2", "os.rename 1 /view_00001\\.png$"),
    "mid-shard": ("shard/tetra", "open 2 /render/[0-9a-f]{32}/view_00001\\.png$"),
    "before a shard has its name": ("shard/tetra", "os.rename 1 /shard\\.h5$"),
    "in training": ("train", "open 2 /checkpoints/\\.z2p-"),
    "in evaluation": ("evaluate", "os.rename 1 /metrics\\.json$"),
    "between manifest and rename": ("train", "os.rename 1 /train/[0-9a-f]{32}$"),
    "between a sample's manifest and rename": ("sample/tetra", "os.rename 1 /sample/[0-9a-f]{32}$"),
}


@pytest.mark.parametrize("moment", KILLS)
def test_everything_killed(world, undisturbed, moment):
    step, rule = KILLS[moment]
    lose(world, step)
    status, said = world.run(Z2P_FAULT=f"kill {rule}")
    assert status == -signal.SIGKILL and f"{step}: started" in said and f"{step}: done" not in said
    assert step in world.predicted()
    work = sorted(path.name for path in world.workspace.glob(".work/*/*/*"))
    status, said = world.run()
    assert status == 0 and set(made(said)) == {step, *AFTER[step]}, said
    assert world.digests() == undisturbed.digests()
    if moment == "in Cycles":
        assert "view_00000.png" in work and "view_00000 rendered" not in said  # finished renders stay
    if moment == "in training":
        assert "going on from step 2" in said
    if moment == "between manifest and rename":
        assert "going on from step 4" in said  # all of the training is still there


@pytest.mark.parametrize("step, rule", [
    ("render/tetra/0-2", "os.rename 1 /mesh\\.npz$"),  # which Blender would read
    ("train", "open 2 /checkpoints/\\.z2p-"),
])  # fmt: skip
def test_one_process_killed_ends_with_an_exit_status(world, undisturbed, step, rule):
    lose(world, step)
    status, said = world.run(Z2P_FAULT=f"die {rule}")
    assert status == 30 and f"FAILED {step}" in said and "died" in said and ".log" in said
    assert set(finish(world, undisturbed)) == {step, *AFTER[step]}


def test_blender_killed_while_it_renders(world, undisturbed):
    lose(world, "render/tetra/0-2")
    pipeline = world.start()
    while pipeline.poll() is None:
        found = subprocess.run(["pgrep", "-g", str(pipeline.pid), "-f", "pipeline.blender"], capture_output=True,
                               text=True, check=False).stdout.split()  # fmt: skip
        if found:
            os.kill(int(found[0]), signal.SIGKILL)
            break
    said = pipeline.communicate()[1]
    assert pipeline.returncode == 30 and "FAILED render/tetra/0-2" in said and "Blender exited with -9" in said
    finish(world, undisturbed)


@pytest.mark.parametrize("sent", [signal.SIGTERM, signal.SIGINT])
@pytest.mark.parametrize("step, moment, rule", [
    ("render/tetra/0-2", "view_00000 rendered", "os.rename 1 /view_00001\\.png$"),
    ("train", "step 2: checkpoint", "open 2 /checkpoints/\\.z2p-"),
])  # fmt: skip
def test_a_pipeline_told_to_stop_stops_all_that_it_has_started(world, undisturbed, step, moment, rule, sent):
    """SIGTERM goes to one process, as of `kill` or `timeout`; Ctrl-C to all that the terminal has."""
    lose(world, step)
    heard = ["env", "--default-signal=INT"]  # what runs in a shell's background hears no Ctrl-C, these tests perhaps
    pipeline = world.start(on=lambda words: [*heard, *words], Z2P_FAULT=f"pause {rule}")
    said = ""
    for line in pipeline.stderr:
        said += line
        if moment in line:
            (os.kill if sent == signal.SIGTERM else os.killpg)(pipeline.pid, sent)
            break
    said += pipeline.communicate(timeout=60)[1]
    assert pipeline.returncode in (130, -signal.SIGINT) and f"{step}: interrupted" in said, said
    assert "Traceback" not in said and "the same command goes on" in said
    left = ["pgrep", "-l", "-g", str(pipeline.pid)]
    deadline = time.monotonic() + 20
    while (found := subprocess.run(left, capture_output=True, text=True, check=False).stdout):
        assert time.monotonic() < deadline, f"still there: {found}"
        time.sleep(0.2)
    finish(world, undisturbed)


def test_a_dead_parents_orphan_publishes_late_and_harmlessly(world, undisturbed):
    lose(world, "train")
    pipeline = world.start()
    for line in pipeline.stderr:
        if line.startswith("train: started"):
            break
    pipeline.kill()  # luigi alone: the task goes on
    pipeline.stderr.close()  # nobody listens to the orphan
    assert set(world.make()) <= {"train", "evaluate"} and world.digests() == undisturbed.digests()
    assert world.make() == []


def test_two_pipelines_on_one_workspace_make_everything_once(undisturbed, tmp_path):
    world = World(tmp_path, code=False)
    status, said = world.run(processes=2)
    assert status == 0, said
    rendered = [line.split(" rendered")[0] for line in said.splitlines() if " rendered, " in line]
    assert len(rendered) == len(set(rendered)) == 5
    assert said.count("wrote ") == 1
    assert world.digests() == undisturbed.digests()


@pytest.fixture
def small_disk(tmp_path):
    """A folder on a filesystem of its own, of 24 MB."""
    folder = tmp_path / "disk"
    folder.mkdir()
    mounted = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=24m", "tmpfs", str(folder)], check=False,
                             capture_output=True, text=True)  # fmt: skip
    if mounted.returncode:
        pytest.skip(f"a small filesystem cannot be mounted here: {mounted.stderr.strip()}")
    yield folder
    subprocess.run(["umount", "--lazy", str(folder)], check=True)


@pytest.mark.parametrize("step", ["sample/tetra", "shard/tetra", "train"])
def test_a_full_disk(world, undisturbed, small_disk, step):
    lose(world, step)
    shutil.copytree(world.workspace, small_disk / "runs", symlinks=True)
    shutil.rmtree(world.workspace)
    world.workspace.symlink_to(small_disk / "runs")
    stage = step.split("/")[0]
    ballast = small_disk / "ballast"
    status, said = world.run(Z2P_FAULT=f"fill os.mkdir 1 /\\.(tmp|work)/{stage}", Z2P_BALLAST=str(ballast))
    assert ballast.exists() and status == 75, said
    assert f"FAILED {step}: no space left on the disk" in said and "Traceback" not in said, said
    assert step in world.predicted()
    ballast.unlink()
    finish(world, undisturbed)


def test_a_disk_that_fills_up_inside_blender(world, undisturbed, small_disk):
    step, ballast = "render/tetra/0-2", small_disk / "ballast"
    lose(world, step)
    shutil.copytree(world.workspace, small_disk / "runs", symlinks=True)
    shutil.rmtree(world.workspace)
    world.workspace.symlink_to(small_disk / "runs")
    status, said = world.run(Z2P_FAULT="fill open 1 /bl_operators/", Z2P_BALLAST=str(ballast))  # as bpy is imported
    assert ballast.exists() and status == 75 and said.rstrip().endswith("the same command goes on"), said
    assert f"FAILED {step}: no space left on the disk" in said and "KeyError" not in said, said
    ballast.unlink()
    finish(world, undisturbed)


@pytest.mark.parametrize("options, words", [("ro", "read-only"), ("nr_inodes=3", "no inodes left")])
def test_a_disk_that_takes_nothing(tmp_path, options, words):
    world, disk = World(tmp_path, code=False), tmp_path / "runs"
    disk.mkdir()
    mounted = subprocess.run(["mount", "-t", "tmpfs", "-o", options, "tmpfs", str(disk)], check=False)
    if mounted.returncode:
        pytest.skip("a small filesystem cannot be mounted here")
    try:
        status, said = world.run()
    finally:
        subprocess.run(["umount", "--lazy", str(disk)], check=True)
    lines = said.strip().splitlines()
    assert status == 75 and len(lines) == 1 and lines[0].startswith("FAILED FullPipeline: ") and words in lines[0], said


def test_no_scheduler_at_the_start_and_none_midway(world, undisturbed, monkeypatch):
    (world.root / "luigi.cfg").write_text("[core]\nrpc-retry-attempts = 2\nrpc-retry-wait = 1\n")
    monkeypatch.setenv("LUIGI_CONFIG_PATH", str(world.root / "luigi.cfg"))
    lose(world, "render/tetra/0-2")
    world.scheduler = 9  # nobody listens there
    status, said = world.run()
    assert status not in (0, None) and made(said) == []
    with luigid(world) as server:
        pipeline = world.start()
        for line in pipeline.stderr:
            if line.startswith("render/tetra/0-2: started"):
                server.kill()
                break
        pipeline.communicate()
        assert pipeline.returncode != 0
    assert "train" in finish(world, undisturbed)


def test_a_worker_dies_and_another_one_takes_over(undisturbed, tmp_path, monkeypatch):
    world = World(tmp_path, code=False)
    (tmp_path / "luigid.cfg").write_text("[scheduler]\nworker_disconnect_delay = 5\nretry_delay = 1\n")
    monkeypatch.setenv("LUIGI_CONFIG_PATH", str(tmp_path / "luigid.cfg"))
    with luigid(world):
        first = world.start()
        for line in first.stderr:
            if line.startswith("render/") and ": started" in line:
                break
        second = world.start()
        os.killpg(first.pid, signal.SIGKILL)
        said = second.communicate(timeout=240)[1]
        assert second.returncode == 0, said
    assert world.digests() == undisturbed.digests()


def test_three_kills_at_random_moments(tmp_path):
    lines: list[str] = []
    soak(tmp_path, kills=3, seed=1, say=lines.append)
    assert lines[-1].startswith("3 kills") and "same digests" in lines[-1]


def test_logs_and_progress_tell_how_it_went(undisturbed):
    """A finished task's log is beside its files; the manifest does not list it."""
    manifest = undisturbed.manifest("train")
    log = (manifest.parent / "task.log").read_text()
    assert "train: started" in log and "step 4: checkpoint" in log
    assert "task.log" not in json.loads(manifest.read_text())["files"]
    assert len(list(Path(undisturbed.workspace / ".logs").glob("*/*.log"))) == 8


def test_the_progress_line_is_readable_in_a_log_file(tmp_path, monkeypatch):
    world = World(tmp_path, code=False)
    (tmp_path / "luigi.cfg").write_text("[z2p]\nprogress_seconds = 0.3\n")
    monkeypatch.setenv("LUIGI_CONFIG_PATH", str(tmp_path / "luigi.cfg"))
    began = time.monotonic()
    status, said = world.run()
    lines = [line for line in said.splitlines() if line.startswith("progress: ")]
    assert status == 0 and 3 <= len(lines) <= (time.monotonic() - began) / 0.3
    assert any("running render/" in line and "images" in line for line in lines)
    assert any(line.startswith("progress: 6 of 8 done; running train") for line in lines)
    assert "\r" not in said
