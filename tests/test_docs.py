"""The documentation: its commands and its Python run as they stand, its links lead somewhere, its site builds."""

from __future__ import annotations

import gzip
import os
import re
import shutil
import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
STRANGERS = "writing-a-control.md"
"""The page about a control that is not installed; tests/test_coat_example.py runs it."""
RUN = re.compile(r"(cat \S+ \| )?z2p (run-inference|animate|rerender|info|formats|plugins|report|completion) ")
"""Commands that are run; those of whole pipelines have tests of their own, and only their options are checked here."""


def blocks(page: Path, language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", page.read_text(), flags=re.MULTILINE | re.DOTALL)


def commands(page: Path) -> list[str]:
    """The lines that call z2p."""
    if page.name == STRANGERS:
        return []
    lines = [line for block in blocks(page, "sh") for line in block.splitlines()]
    return [line for line in lines if re.match(r"(cat \S+ \| )?z2p ", line)]


def stem(page: Path) -> str:
    return page.stem


@pytest.fixture
def desk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Folder with the files that the pages speak of; the working folder."""
    samples = ROOT / "samples"
    shutil.copytree(samples, tmp_path / "samples")
    shutil.copy(samples / "suzanne.ply", tmp_path / "bunny.ply")
    for folder in ("scans/deeper", "frames", "runs/NAME"):
        (tmp_path / folder).mkdir(parents=True)
    shutil.copy(samples / "amphora.ply", tmp_path / "scans")
    (tmp_path / "scans" / "deeper" / "knot.xyz.gz").write_bytes(gzip.compress((samples / "knot.xyz").read_bytes()))
    cloud = np.random.default_rng(0).normal(size=(300, 3))
    np.savetxt(tmp_path / "six.xyz", np.hstack([cloud, cloud]))
    from pypcd4 import PointCloud

    for number in range(2):
        PointCloud.from_xyz_points((cloud + number / 2).astype("f4")).save(tmp_path / "frames" / f"{number}.pcd")
    weights = ROOT / "storage" / "weights" / "regular.safetensors"
    shutil.copy(weights, tmp_path / "runs" / "NAME" / "weights.safetensors")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_there_are_pages_with_commands() -> None:
    assert {"index.md", "your-scans.md", "figures.md", "python.md", "training.md", "limits.md"} <= {
        page.name for page in PAGES
    }
    assert sum(len(commands(page)) for page in PAGES) > 25


@pytest.mark.slow
@pytest.mark.parametrize("page", [one for one in PAGES if any(map(RUN.match, commands(one)))], ids=stem)
def test_the_commands_of_a_page_run(page: Path, desk: Path) -> None:
    environment = {**os.environ, "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"}
    for command in commands(page):
        if not RUN.match(command):
            continue
        done = subprocess.run(["bash", "-c", command], env=environment, capture_output=True, text=True)
        assert done.returncode == 0, f"{command}\n{done.stderr}"
        assert "Traceback" not in done.stderr


@pytest.mark.parametrize("page", PAGES, ids=stem)
def test_every_option_named_is_one(page: Path) -> None:
    from click import Context, Group

    from pipeline.cli import main
    from pipeline.commands.workspace import HandedOn
    from workflows.commands import main as workspace_commands

    assert isinstance(main, Group)
    for command in commands(page):
        words = re.sub(r"^cat \S+ \| ", "", command).split()
        found = main.get_command(Context(main), words[1])
        assert found is not None, command
        if isinstance(found, HandedOn):
            found = workspace_commands.get_command(Context(workspace_commands), words[1])
            assert found is not None, command
        known = {option for parameter in found.get_params(Context(found)) for option in parameter.opts}
        assert {word for word in words if word.startswith("--")} <= known, command


def test_the_python_page_runs(desk: Path) -> None:
    names: dict[str, object] = {}
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for block in blocks(ROOT / "docs" / "python.md", "python"):
            exec(block, names)
    assert (desk / "points.png").stat().st_size > 1000 and (desk / "sheet.png").exists()


@pytest.mark.parametrize("page", PAGES, ids=stem)
def test_links_and_pictures_lead_somewhere(page: Path) -> None:
    targets = re.findall(r"\]\(([^)#:]+)\)", page.read_text())
    assert [target for target in targets if not (page.parent / target).exists()] == []


def test_the_site_builds_without_a_warning(tmp_path: Path) -> None:
    pytest.importorskip("material")
    done = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", tmp_path / "site"],
        cwd=ROOT, capture_output=True, text=True, env={**os.environ, "NO_MKDOCS_2_WARNING": "1"},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    home = (tmp_path / "site" / "index.html").read_text()
    assert not re.search(r'(src|href)="https?://(?!squidfunk)[^"]*\.(js|css|woff2?)"', home)  # nothing from elsewhere
    assert (tmp_path / "site" / "limits" / "index.html").exists()
