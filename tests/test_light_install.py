"""What `pip install .` brings: a picture without torch, in a folder of packages that stays small."""

from __future__ import annotations

import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from z2p_renderer.pipeline.export import export_onnx

ROOT = Path(__file__).parents[1]
LARGEST = 300e6
HEAVY = ("torch", "openvino", "onnx", "kornia", "h5py", "bpy", "luigi", "scipy", "sympy")


@pytest.mark.slow
def test_a_light_install_draws_without_torch_and_stays_small(make_weights: Callable[..., Path], tmp_path: Path) -> None:
    source = tmp_path / "source"
    leave = shutil.ignore_patterns(".git", ".venv*", "runs", "previews", "build", "*.egg-info", "*.so", "__pycache__")
    shutil.copytree(ROOT, source, ignore=leave)
    subprocess.run([sys.executable, "-m", "venv", tmp_path / "venv"], check=True)
    python = tmp_path / "venv" / "bin" / "python"
    install = [python, "-m", "pip", "install", "--quiet", "--constraint", source / "constraints.txt", source]
    subprocess.run(install, check=True, cwd=tmp_path)
    [packages] = (tmp_path / "venv").glob("lib/python*/site-packages")
    assert not [name for name in HEAVY if (packages / name).exists()]
    size = sum(file.stat().st_size for file in packages.rglob("*") if file.is_file())
    assert size < LARGEST, f"{size / 1e6:.0f} MB"
    weights = make_weights()
    export_onnx(weights)
    z2p = [tmp_path / "venv" / "bin" / "z2p", "run-inference", "--weights", weights, "--resolution", "96"]
    z2p += [source / "samples", "-o", tmp_path / "out"]
    done = subprocess.run(z2p, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert len(list((tmp_path / "out").glob("*.png"))) == 4
    weights.with_suffix(".onnx").unlink()
    told = subprocess.run(z2p, cwd=tmp_path, capture_output=True, text=True)
    assert told.returncode == 2 and 'pip install -c constraints.txt ".[torch]"' in told.stderr
    assert "z2p_renderer.pipeline.export" in told.stderr
