"""Hosts share a workspace; some are killed or cut off midway. Those that are left finish, and nothing is lost."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import threading
import time
from collections import Counter
from datetime import timedelta
from functools import partial

import pytest
from hosts import hosts
from luigi.rpc import RemoteScheduler
from luigi.worker import worker
from world import CONFIG, World, luigid

from z2p_renderer.workflows.plan_loading import load_plan
from z2p_renderer.workflows.sources import pipeline_source
from z2p_renderer.workflows.stage_task import create_task

pytestmark = pytest.mark.slow

SETTINGS = """[core]
rpc-connect-timeout = 2
rpc-retry-attempts = 3
rpc-retry-wait = 2
[scheduler]
worker_disconnect_delay = 6
retry_delay = 1
[worker]
max_keep_alive_idle_duration = 3 seconds
"""
MANY = CONFIG.replace("views = 2\nchunk = 2", "views = 6\nchunk = 2")


class Worker:
    """A pipeline on a host, and all that it has said so far."""

    def __init__(self, process: subprocess.Popen) -> None:
        self.process = process
        self.lines: list[str] = []
        self.reader = threading.Thread(target=lambda: self.lines.extend(iter(process.stderr.readline, "")))
        self.reader.start()

    def wait_for(self, text: str) -> None:
        deadline = time.monotonic() + 120
        while not any(text in line for line in self.lines):
            assert time.monotonic() < deadline and self.process.poll() is None, "".join(self.lines)
            time.sleep(0.02)

    def end(self, seconds: float) -> int:
        """Exit status; one that does not end in time is killed, and what it has said tells where it stood."""
        try:
            status = self.process.wait(seconds)
        except subprocess.TimeoutExpired:
            os.killpg(self.process.pid, signal.SIGKILL)
            raise AssertionError(f"not over after {seconds} s:\n{''.join(self.lines)}") from None
        self.reader.join()
        return status


def in_flight(lines: list[str]) -> set[str]:
    """Render steps that were started and not done."""
    steps = [line.split(":")[0] for line in lines if line.startswith("render/") and line.endswith(": started\n")]
    return {step for step in steps if not any(line.startswith(f"{step}: done") for line in lines)}


def views(lines: list[str]) -> list[str]:
    """Views that were rendered, each by its mesh and number."""
    return [line.split(" rendered")[0] for line in lines if " rendered, " in line]


def test_a_worker_lost_between_its_result_and_its_word(tmp_path, monkeypatch):
    """luigi's scheduler would give its task to nobody: the others have seen that the result is there."""
    assert worker().max_keep_alive_idle_duration > timedelta()  # by the settings that ship
    (tmp_path / "luigi.cfg").write_text(SETTINGS)
    monkeypatch.setenv("LUIGI_CONFIG_PATH", str(tmp_path / "luigi.cfg"))
    world = World(tmp_path, code=False)
    world.make()
    before = world.digests()
    for step in ("shard/tetra", "train", "evaluate"):
        shutil.rmtree(world.manifest(step).parent)
    source = pipeline_source(*(str(tmp_path / name) for name in ("small.toml", "meshes", "kept")))
    render = create_task(load_plan(source).steps["render/tetra/0-2"], source, str(world.workspace))
    assert render.complete()
    with luigid(world):
        scheduler = RemoteScheduler(f"http://{world.scheduler_address}:{world.scheduler}")
        scheduler.add_task(worker="lost", task_id=render.task_id, status="PENDING", runnable=True)
        assert scheduler.get_work(worker="lost", host="lost")["task_id"] == render.task_id
        left = Worker(world.start())
        assert left.end(120) == 0, "".join(left.lines)
    assert not any(line.startswith("render/") for line in left.lines)
    assert world.digests() == before


def test_three_hosts_of_which_one_is_killed_and_one_cut_off(tmp_path, monkeypatch):
    (tmp_path / "luigi.cfg").write_text(SETTINGS)
    monkeypatch.setenv("LUIGI_CONFIG_PATH", str(tmp_path / "luigi.cfg"))
    undisturbed, world = (World(tmp_path / name, code=False) for name in ("undisturbed", "shared"))
    for one in (undisturbed, world):
        (one.root / "small.toml").write_text(MANY)
    undisturbed.make()
    with hosts(3) as network:
        if network:
            world.scheduler_address = network.address
        with luigid(world):
            on = [partial(network.command, number) if network else list for number in (1, 2, 3)]
            killed, cut = Worker(world.start(on=on[0])), Worker(world.start(on=on[1]))
            killed.wait_for("render/")
            os.killpg(killed.process.pid, signal.SIGKILL)
            cut.wait_for("render/")
            if network:
                network.cut(2)
            else:  # on loopback: a process that stands still is as silent as one without a network
                os.killpg(cut.process.pid, signal.SIGSTOP)
            lost = in_flight(killed.lines) | in_flight(cut.lines)
            last = Worker(world.start(on=on[2]))
            if not network:
                time.sleep(10)
                os.killpg(cut.process.pid, signal.SIGCONT)
            assert last.end(240) == 0, "".join(last.lines)
            if network:
                assert cut.end(120) != 0, "".join(cut.lines)
            else:
                cut.end(120)
    killed.end(10)
    assert world.digests() == undisturbed.digests()
    rendered = Counter(views(killed.lines + cut.lines + last.lines))
    twice = {view for view, count in rendered.items() if count > 1}
    meshes = {step.split("/")[1] for step in lost}
    assert len(lost) >= 1 and all(view.split(":")[0] in meshes for view in twice), (twice, lost)
    assert len(rendered) == 2 * 6 + 1
