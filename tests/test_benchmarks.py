"""The benchmark of a picture runs and tells what it promises; what its figures are is not tested."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


@pytest.mark.slow
def test_the_benchmark_of_a_picture_times_every_stage(tmp_path: Path) -> None:
    words = ["--weights", "random", "--busy", "--quick", "--points", "5e3", "--output", str(tmp_path)]
    command = [sys.executable, str(ROOT / "benchmarks" / "picture.py"), *words]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    content = json.loads((tmp_path / "picture.json").read_text())
    told = {figure["what"]: figure for figure in content["figures"]}
    for stage in ("z-buffer, 5k points", "G-buffer, 5k points", "network, onnxruntime, 512", "encode, 512, .png"):
        assert told[stage]["median"] > 0 and f"| {stage} |" in done.stdout
    assert told["z-buffer, 5k points"]["median"] < told[told["z-buffer, 5k points"]["baseline"]]["median"]
    assert {"points.png", "resolution.png"} <= {file.name for file in tmp_path.iterdir()}
