"""`z2p pipeline` and `z2p evaluate`, and the processes that the pipeline starts."""

from __future__ import annotations

import importlib.util
import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import pytest
from click.testing import Result

from z2p_core.config import EvaluateConfig


def test_evaluate_passes_its_options_on_and_prints_means(
    z2p: Callable[..., Result], tiny_weights: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    called: list[tuple[object, ...]] = []
    limits: list[float] = []

    def measure(
        meshes: object, weights: object, out: Path, config: object, truth_root: Path, log: object,
        baselines: tuple[str, ...], engine: str, baseline_seconds: float,
    ) -> None:
        limits.append(baseline_seconds)
        called.append((meshes, weights, out, config, truth_root, engine))
        out.mkdir(exist_ok=True)
        data = {"rows": [], "means": {"psnr_white": 26.5, "ssim": 0.85}, "spread_over_seeds": {}, "seeds": {"0": {}}}
        theirs = {"means": {"ssim": 0.5, "render_seconds": 2}, "spread_over_seeds": {}}
        (out / "metrics.json").write_text(json.dumps({**data, "baselines": dict.fromkeys(baselines, theirs)}))

    monkeypatch.setitem(sys.modules, "z2p_renderer.pipeline.evaluation.evaluate", SimpleNamespace(evaluate=measure))
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: name)
    meshes, out = tmp_path / "meshes", tmp_path / "out"
    meshes.mkdir()
    words = ("evaluate", "--meshes", meshes, "--output", out, "--weights", tiny_weights)
    assert "holds no mesh" in z2p(*words).stderr
    for name in ("a.ply", "b.ply", "b.obj", "readme.md"):
        (meshes / name).touch()
    result = z2p(*words, "--views", 3, "--noise", "0.01", "--elevation", "random", "--resolution", 64)
    assert result.exit_code == 0, result.output
    assert result.stdout.split() == ["psnr_white", "26.5000", "ssim", "0.8500"]
    [(found, weights, _, config, truth, engine)] = called
    assert found == {"a": meshes / "a.ply", "b.obj": meshes / "b.obj", "b.ply": meshes / "b.ply"}
    assert (weights, truth, engine) == (tiny_weights, out / "truth", "torch")
    assert config == EvaluateConfig(
        views=3, points=5000, noise=0.01, resolution=64, samples=64, elevation=None, seed=0, sampler="uniform"
    )
    beside = [line.split() for line in z2p(*words, "--baseline", "balls, bpa,balls").stdout.splitlines()]
    assert beside[0] == ["z2p", "balls", "bpa"] and beside[1] == ["psnr_white", "26.5000", "-", "-"]
    assert beside[3] == ["render_seconds", "-", "2.0000", "2.0000"]
    unknown = z2p(*words, "--baseline", "bpa,nosuch")
    known = "balls, bpa, hpr, poisson, splats"
    assert unknown.exit_code == 2 and f"unknown baseline 'nosuch'; installed: {known}" in unknown.stderr
    assert z2p(*words, "--engine", "onnxruntime").exit_code == 0 and called[-1][-1] == "onnxruntime"
    z2p(*words, "--baseline-seconds", 7)
    assert (limits[0], limits[-1]) == (120, 7)
    assert "unknown engine 'abacus'" in z2p(*words, "--engine", "abacus").stderr
    assert z2p(*words, "--elevation", "90").exit_code == 2
    (out / "sheet.png").write_bytes(b"mine")
    runs = len(called)
    refused = z2p(*words)
    assert refused.exit_code == 2 and "sheet.png is there already" in refused.stderr and len(called) == runs
    (out / "sheet.png").unlink()
    assert z2p("evaluate", "--meshes", meshes, "--output", out, "--weights", "nosuch").exit_code == 2


def test_pipeline_passes_only_given_options_to_luigi(
    z2p: Callable[..., Result], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from z2p_renderer.pipeline.cli.commands import train_pipeline

    started: list[tuple[list[str], dict[str, str]]] = []

    def record(command: list[str], environment: dict[str, str]) -> int:
        started.append((command, environment))
        return 30

    monkeypatch.setattr(train_pipeline, "run_process", record)
    assert z2p("pipeline").exit_code == 30
    assert z2p("pipeline", "--meshes", tmp_path, "--workers", 2, "--workspace", tmp_path / "w").exit_code == 30
    plain = [sys.executable, "-m", "luigi", "--module", "workflows", "FullPipeline", "--local-scheduler"]
    assert started[0][0] == plain
    assert started[1][0] == [*plain, "--meshes", str(tmp_path), "--workspace", str(tmp_path / "w"), "--workers", "2"]
    assert (Path(started[0][1]["PYTHONPATH"].split(os.pathsep)[0]) / "workflows" / "luigi.cfg").is_file()
    assert z2p("pipeline", "--config", tmp_path / "missing.toml").exit_code == 2


@pytest.mark.parametrize(
    ("statuses", "end"),
    [([10] * 30 + [0], 0), ([25] * 10 + [0], 0), ([25] * 11 + [0], 25), ([10, 25, 30], 30), ([10, 25] * 10 + [0], 0)],
    ids=["others work for long", "left undone for a while", "left undone for good", "failed at last", "both"],
)
def test_a_worker_waits_while_other_workers_run_tasks(
    statuses: list[int], end: int, z2p: Callable[..., Result], monkeypatch: pytest.MonkeyPatch
) -> None:
    from z2p_renderer.pipeline.cli.commands import train_pipeline

    left = iter(statuses)
    monkeypatch.setattr(train_pipeline, "run_process", lambda command, environment: next(left))
    monkeypatch.setattr(train_pipeline.time, "sleep", lambda seconds: None)
    assert z2p("pipeline", "--scheduler", "http://127.0.0.1:8082").exit_code == end


def test_child_processes_import_nothing_from_the_working_folder(tmp_path: Path) -> None:
    from z2p_renderer.pipeline.child_process import child_environment

    (tmp_path / "storage").mkdir()
    (tmp_path / "storage" / "__init__.py").write_text("raise SystemExit('the wrong storage')")
    done = subprocess.run(
        [sys.executable, "-c", "import z2p_renderer.storage"],
        cwd=tmp_path, env=child_environment(), capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr


def test_blenders_process_runs_no_file_of_the_working_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from z2p_renderer.pipeline.render import RenderError, _run_blender

    for name in ("pipeline", "numpy", "json"):
        (tmp_path / f"{name}.py").write_text("print('a file of the user')\n")
    monkeypatch.chdir(tmp_path)
    with pytest.raises(RenderError, match=r"job\.json") as error:  # ours was started, and has nothing to do
        list(_run_blender(tmp_path, "mesh"))
    assert "a file of the user" not in str(error.value)


def test_the_exit_status_of_a_child_process_is_returned() -> None:
    from z2p_renderer.pipeline.cli.commands.train_pipeline import run_process

    assert run_process([sys.executable, "-c", "raise SystemExit(30)"], dict(os.environ)) == 30
    assert run_process([sys.executable, "-c", "import os; os.kill(os.getpid(), 9)"], dict(os.environ)) == 137


@pytest.mark.parametrize("name", ["pipeline", "evaluate"])
def test_a_missing_pipeline_extra_is_reported(
    z2p: Callable[..., Result], tiny_weights: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    (tmp_path / "a.ply").touch()
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    words = ["--meshes", tmp_path, "--output", tmp_path / "out", "--weights", tiny_weights]
    result = z2p(name, *(words if name == "evaluate" else []))
    assert result.exit_code == 2
    assert 'pip install -c constraints.txt ".[pipeline]"' in result.stderr


@pytest.mark.parametrize("words", [("pipeline", "--dry-run"), ("status",), ("ablate", "--dry-run")])
def test_a_config_that_is_not_utf8_is_refused_in_one_line(tmp_path: Path, words: tuple[str, ...]) -> None:
    config = tmp_path / "latin.toml"
    config.write_bytes('name = "a" # Größe\n'.encode("latin-1"))
    result = subprocess.run([sys.executable, "-m", "z2p_renderer.pipeline.cli", *words, "--config", str(config)],
                          check=False,
                          capture_output=True, text=True, cwd=tmp_path)  # fmt: skip
    assert result.returncode not in (0, 1) and "Traceback" not in result.stdout + result.stderr
    assert "is not UTF-8" in result.stdout + result.stderr
