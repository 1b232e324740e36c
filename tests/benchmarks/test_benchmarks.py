"""The benchmarks run and write what they document; their numbers are not tested."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from z2p_renderer.storage.models.checkpoints import find_weights, load_weights

ROOT = Path(__file__).parents[2]


@pytest.mark.slow
def test_picture_benchmark_times_every_stage(tmp_path: Path) -> None:
    words = ["--weights", "random", "--busy", "--quick", "--points", "5e3", "--output", str(tmp_path)]
    command = [sys.executable, str(ROOT / "benchmarks" / "picture.py"), *words]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    content = json.loads((tmp_path / "picture.json").read_text())
    timings = {timing["what"]: timing for timing in content["figures"]}
    for stage in ("z-buffer, 5k points", "G-buffer, 5k points", "network, onnxruntime, 512", "encode, 512, .png"):
        assert timings[stage]["median"] > 0 and f"| {stage} |" in done.stdout
    assert timings["z-buffer, 5k points"]["median"] < timings[timings["z-buffer, 5k points"]["baseline"]]["median"]
    assert {"points.png", "resolution.png"} <= {file.name for file in tmp_path.iterdir()}


def test_random_weights_have_the_shape_of_shipped_ones(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))
    import inputs

    monkeypatch.setattr("z2p_renderer.pipeline.export.export_onnx", lambda path: None)
    ours, shipped = (load_weights(path) for path in (inputs.random_weights(tmp_path), find_weights("regular")))
    assert {name: one.shape for name, one in ours.tensors.items()} == {
        name: one.shape for name, one in shipped.tensors.items()
    }
    for part in ("network", "zbuffer", "gbuffer", "encoder", "controls"):
        assert ours.card[part] == shipped.card[part]


def run_benchmark(script: str, out: Path, *words: object) -> tuple[str, Any]:
    """What a benchmark printed, and the JSON that it wrote."""
    command = [sys.executable, str(ROOT / "benchmarks" / script), *map(str, words), "--output", str(out)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout, json.loads((out / script).with_suffix(".json").read_text())


@pytest.mark.slow
def test_memory_benchmark_measures_peak_and_growth(
    tmp_path: Path, make_weights: Callable[..., Path]
) -> None:
    printed, rows = run_benchmark(
        "memory.py", tmp_path, "--weights", make_weights(), "--pictures", 30, "--points", 20_000
    )
    most, growth, huge = rows
    assert 50 < most["MB"] < 600 and len(most["curve"]) == 30 and abs(growth["MB"]) < most["MB"]
    assert 50 < huge["MB"] < 1000 and "a cloud of 20000 points" in printed
    assert {path.name for path in tmp_path.iterdir()} == {"memory.json", "memory.png"}


@pytest.mark.slow
def test_training_benchmark_measures_the_waiting_share(tmp_path: Path) -> None:
    from sphere_shards import sphere_shard

    sphere_shard(tmp_path / "shards" / "one" / "shard.h5", 4, 32)
    words = [tmp_path / "shards", "--config", "configs/tiny.toml", "--steps", 3, "--threads", 1]
    printed, content = run_benchmark("training.py", tmp_path, *words)
    assert [row["samples a second"] > 0 for row in content["rows"]] == [True] * 3
    assert 0 <= content["rows"][-1]["waiting"] <= 1 and "both, as a training runs" in printed
    assert any(name.startswith("kernel ") for name in content["share of making a batch"])


@pytest.mark.slow
def test_rendering_benchmark_times_the_parts_of_a_picture(tmp_path: Path) -> None:
    printed, content = run_benchmark("rendering.py", tmp_path, "--resolution", 48, "--views", 2, "--samples", 2)
    parts = content["seconds, processors' seconds"]
    # Parts are differences between runs, which a busy machine may turn around: no figure is held against a bound.
    assert "a picture" in parts and np.isfinite(list(parts.values())).all()
    assert "images a minute" in printed and len(parts) == 7
