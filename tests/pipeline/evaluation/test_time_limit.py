"""A baseline that takes too long is stopped with all that it has started, and the others go on."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from z2p_core.interfaces import Baseline, Painter, ScanError
from z2p_core.scene import SceneDescription
from z2p_renderer.pipeline.cli.commands.evaluate import _print_table
from z2p_renderer.pipeline.evaluation import baselines as module
from z2p_renderer.pipeline.evaluation.baselines import run_baseline
from z2p_renderer.pipeline.evaluation.evaluate import summarise
from z2p_renderer.pipeline.evaluation.time_limit import StoppableProcess, TimeLimitError
from z2p_renderer.pipeline.render import RenderSettings


def start_sleeper() -> int:
    return subprocess.Popen([sys.executable, "-c", "import time; time.sleep(1000)"]).pid


def has_ended(process: int) -> bool:
    """Whether a process ends within 20 s."""
    status = Path(f"/proc/{process}/stat")
    for _ in range(200):
        try:
            if status.read_text().split(") ")[1][0] == "Z":
                return True
        except OSError:
            return True
        time.sleep(0.1)
    return False


class Sleepy(Baseline):
    """Sleeps over clouds of more than 50 points."""

    name, version = "sleepy", "1"

    def reconstruct(self, cloud: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        if len(cloud) == 60:
            time.sleep(1000)
        if len(cloud) < 3:
            raise ScanError("too few")
        with self.timed("think"):
            return cloud[:3].astype(float), np.array([[0, 1, 2]])


class Grey(Painter):
    name, version = "grey", "1"

    def paint(self, cloud: np.ndarray, camera: Any, scene: Any) -> np.ndarray:
        return np.full((camera.height, camera.width, 4), 0.5, np.float32)


def test_means_are_of_the_clouds_that_were_not_stopped_and_the_table_says_so(
    capsys: pytest.CaptureFixture[str],
) -> None:
    done = {"mesh": "a", "seed": 0, "view": 0, "flip": 0.25}
    own = summarise([done, {"mesh": "b", "seed": 0, "view": 0, "stopped_after": 120.0}])
    assert own["means"] == {"flip": 0.25} and own["meshes"]["b"] == {}
    _print_table({"z2p": summarise([done]), "bpa": own}, "")
    assert "bpa: stopped after 120 s on 1 of 2 clouds; its means are of the others" in capsys.readouterr().out


def test_a_slow_call_is_stopped_with_its_children_and_the_next_one_works() -> None:
    with StoppableProcess(60) as process:
        first = process.call(os.getpid)
        assert first == process.call(os.getpid) != os.getpid()
        with pytest.raises(ZeroDivisionError):
            process.call(divmod, 1, 0)
        sleeper = process.call(start_sleeper)
        with pytest.raises(TimeLimitError, match=r"stopped after 0\.3 s"):
            process.call(time.sleep, 1000, within=0.3)
        assert has_ended(first) and has_ended(sleeper)
        second = process.call(os.getpid)
        with pytest.raises(ScanError, match="died"):
            process.call(os._exit, 3)
    assert has_ended(second)


@pytest.mark.slow
def test_a_stopped_baseline_is_stored_and_tried_again_with_more_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    settings = RenderSettings((40, 32), samples=1)
    scene = SceneDescription(floor=-0.5)
    cloud = np.random.default_rng(0).uniform(-0.5, 0.5, (60, 3)).astype(np.float32)

    def draw(mesh: object, jobs: Any, out: Path, *others: object, **more: object) -> None:
        for stem, _ in jobs:
            Image.fromarray(np.full((32, 40, 4), 90, np.uint8)).save(out / f"{stem}.png")

    def run(competitor: Any, points: int, process: StoppableProcess | None) -> Any:
        rng = np.random.default_rng(0)
        return run_baseline(competitor, cloud[:points], {"n": points}, rng, scene, settings, tmp_path, process=process)

    monkeypatch.setattr(module, "render_mesh", draw)
    with StoppableProcess(2) as process:
        stopped = run(Sleepy, 60, process)
        assert stopped.stopped_after == 2 and stopped.error == "stopped after 2 s" and not stopped.picture.any()
        done = run(Sleepy, 40, process)
        assert done.stopped_after == 0 and done.picture.any() and done.steps.keys() == {"think"}
        assert run(Sleepy, 2, process).error == "too few"
        assert run(Grey, 60, process).picture.mean() == pytest.approx(0.5, abs=0.01)
        monkeypatch.setattr(process, "call", None)
        assert run(Sleepy, 60, process).stopped_after == 2  # from the store
    monkeypatch.setattr(Sleepy, "reconstruct", lambda self, cloud, rng: (cloud[:3] * 1.0, np.array([[0, 1, 2]])))
    assert run(Sleepy, 60, None).picture.any()
