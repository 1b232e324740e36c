"""The example plugin as a stranger meets it: installed into a fresh environment, it goes through the whole pipeline.

The heavy libraries are borrowed from the running environment; z2p-coat itself is only in the fresh one.
"""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import sysconfig
import venv
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from shutil import copytree, ignore_patterns

import numpy as np
import pytest
from PIL import Image

from z2p_renderer.storage.models.checkpoints import load_weights
from z2p_renderer.storage.scans.clouds import write_mesh

ROOT = Path(__file__).parents[2]
PACKAGE = ROOT / "examples" / "plugins" / "z2p-coat"
CONFIG = """
name = "coat"
[sample]
points = 2000
[render]
controls = ["color", "light", "elevation", "coat"]
views = 3
resolution = 48
samples = 1
denoise = "off"
[shard]
resolution = 48
[train]
steps = 3
batch = 2
warmup = 1
points = [200, 400]
validate_every = 3
checkpoint_every = 3
validation_share = 0.2
[train.network]
widths = [16, 16]
mapping = 16
[evaluate]
views = 1
points = 300
resolution = 48
samples = 1
denoise = "off"
"""
PAIR = """
from pathlib import Path

from z2p_renderer.pipeline.render import RenderSettings, render_scenes
from z2p_core import registry
from z2p_core.scene import SceneDescription

coat, scenes = registry.load("controls", "coat")(), []
for value in (0.0, 1.0):
    scene = SceneDescription(light=(3.5, 20.0, 45.0), material={"Base Color": (0.05, 0.1, 0.3, 1.0)})
    coat.apply((value,), scene)
    scenes.append((f"coat{value:.0f}", scene))
render_scenes(Path("meshes/ball.ply"), scenes, Path("pair"), RenderSettings((64, 64), 4, "off", seed=1))
"""


@dataclass(frozen=True)
class Stranger:
    """A fresh environment and the folder that its owner works in."""

    python: Path
    folder: Path

    def run(self, *command: str) -> subprocess.CompletedProcess[str]:
        environment = {key: value for key, value in os.environ.items() if not key.startswith("PYTHON")}
        environment |= {"OMP_NUM_THREADS": "1", "PYTHONSAFEPATH": "1"}
        return subprocess.run(
            [str(self.python), *command], cwd=self.folder, env=environment, capture_output=True, text=True, check=False
        )


@pytest.fixture(scope="module")
def stranger(tmp_path_factory: pytest.TempPathFactory) -> Stranger:
    """The fresh environment with z2p-coat installed, and two meshes, a config and a scan to work on."""
    folder = tmp_path_factory.mktemp("stranger")
    venv.create(folder / "env", with_pip=False)
    python = folder / "env" / "bin" / "python"
    site = Path(sysconfig.get_path("purelib", vars={"base": str(folder / "env"), "platbase": str(folder / "env")}))
    (site / "borrowed.pth").write_text(f"import site; site.addsitedir({sysconfig.get_path('purelib')!r})\n")
    copytree(PACKAGE, folder / "z2p-coat", ignore=ignore_patterns("build", "*.egg-info", "__pycache__"))
    pip = [sys.executable, "-m", "pip", "--python", str(python), "install", "--quiet", "--no-deps"]
    isolation = ["--no-build-isolation"] if _has_new_setuptools() else []
    subprocess.run([*pip, *isolation, str(folder / "z2p-coat")], check=True)
    (folder / "coat.toml").write_text(CONFIG)
    (folder / "meshes").mkdir()
    write_mesh(folder / "meshes" / "ball.ply", *ball(1.0))
    write_mesh(folder / "meshes" / "egg.ply", *ball(1.6))
    np.save(folder / "scan.npy", ball(1.3)[0])
    return Stranger(python, folder)


def _has_new_setuptools() -> bool:
    try:
        return int(version("setuptools").split(".")[0]) >= 77
    except PackageNotFoundError:
        return False


def ball(height: float, rings: int = 16) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and triangles of an ellipsoid of revolution about Z."""
    polar, around = np.meshgrid(np.linspace(0.02, np.pi - 0.02, rings), np.linspace(0, 2 * np.pi, 2 * rings + 1)[:-1])
    ring = np.stack([np.sin(polar) * np.cos(around), np.sin(polar) * np.sin(around), height * np.cos(polar)], axis=-1)
    corners = [
        (j * rings + i, j * rings + i + 1, (j + 1) % (2 * rings) * rings + i, (j + 1) % (2 * rings) * rings + i + 1)
        for j in range(2 * rings)
        for i in range(rings - 1)
    ]
    return ring.reshape(-1, 3), np.array([face for a, b, c, d in corners for face in ((a, b, c), (b, d, c))])


@pytest.mark.slow
def test_the_pipeline_and_inference_take_the_control(stranger: Stranger) -> None:
    workspace = stranger.folder / "runs"
    made = stranger.run(
        "-m", "luigi", "--module", "workflows", "FullPipeline", "--local-scheduler",
        "--config", "coat.toml", "--meshes", "meshes", "--workspace", str(workspace),
    )
    assert made.returncode == 0, made.stderr[-4000:]

    views = [json.loads(path.read_text()) for path in workspace.glob("render/*/view_*.json")]
    coats = [view["values"]["coat"][0] for view in views]
    assert len(coats) == 6 and len(set(coats)) == 6 and all(0 <= coat <= 1 for coat in coats)
    assert [view["scene"]["material"]["Coat Weight"] for view in views] == coats

    weights = workspace / "coat" / "weights.safetensors"
    card = load_weights(weights).card
    assert [control["name"] for control in card["controls"]] == ["color", "light", "elevation", "coat"]
    assert sum(control["size"] for control in card["controls"]) == 8

    infer = ("-m", "z2p_renderer.pipeline.cli", "run-inference", "scan.npy", "--weights", str(weights))
    infer += ("--resolution", "64")
    drawn = stranger.run(*infer, "--output", "pictures", "--coat", "0.8")
    assert drawn.returncode == 0, drawn.stderr
    assert len(list((stranger.folder / "pictures").glob("*.png"))) == 1
    refused = stranger.run(*infer, "--output", "refused", "--coat", "2")
    assert refused.returncode == 2
    assert re.search(r"--coat: coat is 2, expected 0 to 1", refused.stderr)
    assert not list(stranger.folder.glob("refused/*.png"))
    script = f"import numpy, z2p_core; points = numpy.load('scan.npy'); weights = {str(weights)!r}\n"
    script += "print(z2p_core.render(points, coat=0.8, weights=weights, size=64).record['controls']['coat'])"
    called = stranger.run("-c", script)
    assert called.returncode == 0, called.stderr
    assert called.stdout == "[0.8]\n"


@pytest.mark.slow
def test_the_coat_shows_in_the_renders(stranger: Stranger) -> None:
    rendered = stranger.run("-c", PAIR)
    assert rendered.returncode == 0, rendered.stderr[-4000:]
    pictures = (Image.open(stranger.folder / "pair" / f"coat{value}.png") for value in (0, 1))
    bare, coated = (np.asarray(picture).astype(int) for picture in pictures)
    cover = np.asarray(Image.open(stranger.folder / "pair" / "coat0.coverage.png")) > 250
    assert cover.sum() > 300
    brighter = (coated - bare)[cover][:, :3].mean(1)
    assert brighter.max() > 25  # the highlight
    assert np.abs(brighter).mean() > 1


@pytest.mark.slow
def test_it_is_listed_with_its_origin_and_passes_its_own_tests(stranger: Stranger) -> None:
    listed = stranger.run("-m", "z2p_renderer.pipeline.cli", "plugins")
    assert listed.returncode == 0 and re.search(r"coat.*z2p-coat 0\.1\.0", listed.stdout)
    tested = stranger.run("-m", "pytest", "-q", "-p", "no:cacheprovider", str(stranger.folder / "z2p-coat"))
    assert tested.returncode == 0 and "2 passed" in tested.stdout, tested.stdout


def test_no_line_of_z2p_knows_it() -> None:
    rooms = ("z2p_core", "storage", "pipeline", "plugins", "workflows")
    sources = [path for room in rooms for path in (ROOT / room).rglob("*.py")]
    assert len(sources) > 30
    assert [path for path in sources if "coat" in path.read_text().lower()] == []
    assert "coat" not in (ROOT / "pyproject.toml").read_text()


def test_the_tutorial_is_the_package() -> None:
    """Every block of code in the tutorial that follows a file's name is that file, to the letter."""
    tutorial = (ROOT / "docs" / "writing-a-control.md").read_text()
    blocks = dict(re.findall(r"`([\w./-]+)`:\n\n```\w+\n(.*?)```", tutorial, flags=re.DOTALL))
    assert {"z2p_coat.py", "pyproject.toml", "tests/test_coat.py", "coat.toml"} == set(blocks)
    for name, text in blocks.items():
        assert text == (PACKAGE / name).read_text(), f"docs/writing-a-control.md: {name} differs from the example's"
