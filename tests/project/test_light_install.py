"""What a wheel brings, on every Python that the machine has: a picture without torch or a compiler, in little space."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path

import pytest
from PIL import Image

from z2p_renderer.pipeline.export import export_onnx

ROOT = Path(__file__).parents[2]
SERIES = ("3.11", "3.12", "3.13", "3.14")
THIS = "{}.{}".format(*sys.version_info)
LARGEST = 320e6
HEAVY = ("torch", "openvino", "onnx", "kornia", "h5py", "bpy", "luigi", "scipy", "sympy")
LIGHT = (
    *(f"z2p_core/{name}.py" for name in (
        "test_camera", "config/test_config", "placement/test_bounding_sphere", "test_interfaces",
        "native/test_light_kernels", "native/test_avx512", "test_registry", "test_splatting",
        "placement/test_outliers", "test_parallel", "placement/test_viewpoint")),
    *(f"plugins/{name}.py" for name in (
        "readers/test_readers_meshes", "readers/test_readers_scanners", "readers/test_readers_text", "test_zbuffers")),
    *(f"storage/{name}.py" for name in (
        "results/test_locks", "test_meshes", "images/test_image_files", "images/test_png")),
)  # fmt: skip
"""Tests that need no more than a light install and take little time."""
SCRIPT = """
import numpy
import z2p_core

towards = numpy.random.default_rng(0).normal(size=(2000, 3))
picture = z2p_core.render(towards / numpy.linalg.norm(towards, axis=1, keepdims=True), resolution=64)
picture.save("picture.png")
"""
pytestmark = pytest.mark.slow


def run(*command: str | Path, cwd: Path) -> subprocess.CompletedProcess[str]:
    """A command as its user runs it who has no compiler and whose folders tell no Python where we are."""
    kept = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    return subprocess.run(command, cwd=cwd, capture_output=True, text=True, env={**kept, "PATH": "", "CC": "none"})


def copied(folder: Path) -> Path:
    """A copy of the checkout, without what was built in it."""
    leave = shutil.ignore_patterns(".git", ".venv*", "runs", "previews", "build", "*.egg-info", "*.so", "__pycache__")
    return shutil.copytree(ROOT, folder, ignore=leave)


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel, built by this Python, once for all others."""
    folder = tmp_path_factory.mktemp("wheel")
    build = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--wheel-dir", folder]
    subprocess.run([*build, copied(folder / "source")], check=True)
    [built] = folder.glob("*.whl")
    return built


@pytest.fixture(scope="module")
def installed(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """Function that gives the folder of a virtual environment of a Python such as 3.13, with the wheel in it."""

    @cache
    def install(series: str) -> Path:
        find = ["sh", ROOT / "scripts" / "python.sh", f"python{series}"]
        path = subprocess.run(find, capture_output=True, text=True, check=True).stdout.strip()
        python = sys.executable if series == THIS else path
        if not python:
            pytest.skip(f"there is no Python {series} on this machine")
        environment = tmp_path_factory.mktemp("venv")
        subprocess.run([python, "-m", "venv", "--without-pip", environment], check=True)
        pip = [sys.executable, "-m", "pip", "--python", environment / "bin" / "python", "install", "--quiet"]
        subprocess.run([*pip, "--constraint", ROOT / "constraints.txt", "--only-binary", ":all:", wheel], check=True)
        return environment

    return install


def test_wheel_tag_fits_every_python_and_names_its_glibc(wheel: Path) -> None:
    name = wheel.name.removesuffix(".whl").split("-")
    assert name[2:4] == ["py3", "none"]
    assert sys.platform != "linux" or name[4].startswith(("manylinux_2_17_", "linux_"))  # the latter with musl


@pytest.mark.parametrize("series", SERIES)
def test_a_light_install_is_small_and_draws_the_samples(
    installed: Callable[[str], Path], series: str, tmp_path: Path
) -> None:
    environment = installed(series)
    [packages] = environment.glob("lib/python*/site-packages")
    assert not [name for name in HEAVY if (packages / name).exists()]
    size = sum(file.stat().st_size for file in packages.rglob("*") if file.is_file())
    assert size < LARGEST, f"{size / 1e6:.0f} MB"
    done = run(environment / "bin" / "z2p", "run-inference", ROOT / "samples", "-o", tmp_path / "out", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert len(list((tmp_path / "out").glob("*.png"))) == 5


@pytest.mark.parametrize("series", [series for series in SERIES if series != THIS])
def test_light_tests_pass(installed: Callable[[str], Path], series: str, tmp_path: Path) -> None:
    environment = installed(series)
    tested = shutil.copytree(environment, tmp_path / "venv", symlinks=True)  # what tests need must not be measured
    pip = [sys.executable, "-m", "pip", "--python", tested / "bin" / "python", "install", "--quiet"]
    subprocess.run([*pip, "--constraint", ROOT / "constraints.txt", "pytest", "hypothesis"], check=True)
    shutil.copytree(ROOT / "tests", tmp_path / "tests", ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copytree(ROOT / "samples", tmp_path / "samples")
    shutil.copy2(ROOT / "pyproject.toml", tmp_path)
    command = [tested / "bin" / "python", "-m", "pytest", "-m", "not slow", *(f"tests/{name}" for name in LIGHT)]
    done = run(*command, cwd=tmp_path)
    assert done.returncode == 0, done.stdout[-4000:] + done.stderr


@pytest.mark.parametrize("series", SERIES)
def test_a_script_may_have_neighbours_of_any_name(
    installed: Callable[[str], Path], series: str, tmp_path: Path
) -> None:
    for name in ("pipeline", "plugins", "workflows"):
        (tmp_path / f"{name}.py").write_text("raise RuntimeError('this is the user\\'s own')\n")
    (tmp_path / "storage").mkdir()
    (tmp_path / "storage" / "__init__.py").write_text("raise RuntimeError('this is the user\\'s own')\n")
    (tmp_path / "script.py").write_text(SCRIPT)
    done = run(installed(series) / "bin" / "python", tmp_path / "script.py", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert Image.open(tmp_path / "picture.png").size == (64, 64)


@pytest.mark.skipif(sys.version_info >= (3, 14), reason="luigi is not for this Python")
def test_luigi_finds_the_module_workflows_from_anywhere(
    installed: Callable[[str], Path], tmp_path: Path
) -> None:
    tested = shutil.copytree(installed(THIS), tmp_path / "venv", symlinks=True)
    pip = [sys.executable, "-m", "pip", "--python", tested / "bin" / "python", "install", "--quiet"]
    subprocess.run([*pip, "--constraint", ROOT / "constraints.txt", "luigi"], check=True)
    for python, folder in ((tested / "bin" / "python", tmp_path), (Path(sys.executable), ROOT)):
        done = run(python, "-m", "luigi", "--module", "workflows", "FullPipeline", "--help", cwd=folder)
        assert done.returncode == 0 and "--meshes" in done.stdout, done.stderr


def test_weights_of_ones_own_need_torch_or_an_export(
    make_weights: Callable[..., Path], installed: Callable[[str], Path], tmp_path: Path
) -> None:
    weights = make_weights()
    export_onnx(weights)
    z2p = [installed(THIS) / "bin" / "z2p", "run-inference", "--weights", weights, "--resolution", "96"]
    z2p += [ROOT / "samples", "-o", tmp_path / "out"]
    assert run(*z2p, cwd=tmp_path).returncode == 0
    weights.with_suffix(".onnx").unlink()
    completed = run(*z2p, cwd=tmp_path)
    assert completed.returncode == 2 and 'pip install -c constraints.txt ".[torch]"' in completed.stderr
    assert "z2p_renderer.pipeline.export" in completed.stderr
