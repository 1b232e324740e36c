"""The whole pipeline at its smallest, with real Blender, as a user starts it: the bare `luigi` command."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

CONFIG = Path(__file__).parents[2] / "configs" / "tiny.toml"

pytestmark = pytest.mark.slow


def write_off(path: Path, vertices: list, faces: list) -> None:
    rows = [" ".join(map(str, row)) for row in [*vertices, *([len(face), *face] for face in faces)]]
    path.write_text("\n".join(["OFF", f"{len(vertices)} {len(faces)} 0", *rows]) + "\n")


def write_meshes(folder: Path) -> None:
    """A tetrahedron and a pyramid."""
    folder.mkdir()
    tetrahedron = [(1, 1, 1), (1, -1, -1), (-1, 1, -1), (-1, -1, 1)]
    write_off(folder / "tetra.off", tetrahedron, [(0, 1, 2), (0, 3, 1), (0, 2, 3), (1, 3, 2)])
    pyramid = [(1, 1, 0), (-1, 1, 0), (-1, -1, 0), (1, -1, 0), (0, 0, 2)]
    write_off(folder / "pyramid.off", pyramid, [(0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4), (0, 2, 1), (0, 3, 2)])


def luigi(cwd: Path, *arguments: str) -> subprocess.CompletedProcess:
    command = [str(Path(sys.executable).parent / "luigi"), "--module", "workflows", "FullPipeline", "--local-scheduler"]
    environment = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"} | {"OMP_NUM_THREADS": "1"}
    return subprocess.run([*command, *arguments], cwd=cwd, env=environment, capture_output=True, text=True, check=False)


def tiny(cwd: Path, *more: str) -> subprocess.CompletedProcess:
    return luigi(cwd, "--config", str(CONFIG), "--meshes", "meshes", *more)


def made(result: subprocess.CompletedProcess) -> set[str]:
    """Steps that ran, from the log."""
    return {line.split(":")[0] for line in result.stderr.splitlines() if ": done in " in line}


def manifests(cwd: Path) -> dict[str, int]:
    return {str(path): path.stat().st_mtime_ns for path in (cwd / "runs").rglob("manifest.json")}


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A folder elsewhere than the project, with meshes and the results of one run."""
    cwd = tmp_path_factory.mktemp("elsewhere")
    write_meshes(cwd / "meshes")
    result = tiny(cwd)
    assert result.returncode == 0, result.stderr
    return cwd, result


def test_it_makes_weights_metrics_and_pictures(finished):
    cwd, result = finished
    assert made(result) == {
        "sample/tetra", "sample/pyramid", "render/tetra/0-2", "render/tetra/2-3", "render/pyramid/0-2",
        "render/pyramid/2-3", "shard/tetra", "shard/pyramid", "train", "evaluate",
    }
    shown = cwd / "runs" / "tiny"
    assert {path.name for path in shown.iterdir()} == {"weights.safetensors", "metrics.json", "sheet.png", "curve.png"}
    assert all(path.stat().st_size > 100 for path in shown.iterdir())
    assert all(str(path) in result.stderr for path in shown.iterdir())
    assert np.isfinite(json.loads((shown / "metrics.json").read_text())["means"]["psnr_foreground"])
    assert "memory" in result.stderr  # no meshes kept aside
    assert not list((cwd / "runs" / ".tmp").glob("*")) and not list((cwd / "runs" / ".work").glob("*/*"))


def test_a_second_run_runs_nothing(finished):
    cwd, _ = finished
    before = manifests(cwd)
    again = tiny(cwd)
    assert again.returncode == 0 and made(again) == set() and "up to date" in again.stderr
    assert len(before) > 9 and manifests(cwd) == before
    assert str(cwd / "runs" / "tiny" / "metrics.json") in again.stderr


def test_deleted_results_are_made_again_and_nothing_else(finished):
    cwd, _ = finished
    shard = next((cwd / "runs" / "shard").iterdir())
    digest = json.loads((shard / "manifest.json").read_text())["files"]["shard.h5"]["sha256"]
    shutil.rmtree(shard)
    again = tiny(cwd)
    assert again.returncode == 0, again.stderr
    assert len(made(again)) == 1 and made(again) < {"shard/tetra", "shard/pyramid"}
    assert json.loads((shard / "manifest.json").read_text())["files"]["shard.h5"]["sha256"] == digest
    assert made(tiny(cwd)) == set()


def test_views_are_copied_when_their_number_or_chunks_change(finished):
    cwd, _ = finished
    (cwd / "more.toml").write_text(CONFIG.read_text().replace("chunk = 2", "chunk = 3"))
    again = luigi(cwd, "--config", "more.toml", "--meshes", "meshes")
    assert again.returncode == 0, again.stderr
    assert made(again) == {"render/tetra/0-3", "render/pyramid/0-3"}
    assert "images a minute" not in again.stderr  # not one picture was rendered


def test_a_broken_mesh_fails_and_is_named_and_the_rest_goes_on(tmp_path):
    write_meshes(tmp_path / "meshes")
    (tmp_path / "meshes" / "pyramid.off").unlink()
    (tmp_path / "meshes" / "torn.off").write_text("OFF\n3 1 0\n0 0 0\n1 0 0\n")
    result = tiny(tmp_path)
    assert result.returncode == 30, result.stderr
    assert "FAILED sample/torn" in result.stderr and "torn.off" in result.stderr
    assert "Traceback" not in result.stderr and "Execution Summary" not in result.stderr
    assert {"sample/tetra", "shard/tetra"} <= made(result)
    assert not {"shard/torn", "train", "evaluate"} & made(result)


@pytest.mark.parametrize(
    "arguments, message",
    [(["--meshes", "nowhere"], "nowhere"), (["--config", "nowhere.toml"], "nowhere.toml")],
)
def test_missing_input_exits_non_zero_and_says_what_is_missing(tmp_path, arguments, message):
    result = luigi(tmp_path, *arguments)
    assert result.returncode == 35, result.stderr
    assert message in result.stderr and not (tmp_path / "runs").exists()
