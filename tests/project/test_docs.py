"""The documentation: its commands and its Python run as they stand, its links lead somewhere, its site builds."""

from __future__ import annotations

import gzip
import json
import os
import re
import shutil
import subprocess
import sys
import tomllib
import warnings
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from click import Context, Group, Option, Parameter

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
EXTERNAL_PLUGIN_PAGES = ("writing-a-control.md", "writing-a-plugin.md")
"""Pages about plugins that are not installed. `tests/examples/test_coat_example.py` runs the first, a test below the
other."""
CODE_FOLDERS = ("benchmarks", "configs", "docs", "examples", "pipeline", "plugins", "scripts", "shims", "storage",
                "tests", "workflows", "z2p_core", "z2p_renderer")  # fmt: skip
EXAMPLE_FILES = {"mine_zbuffer.py", "mine_condition.py", "mine_reader.py", "test_mine.py", "mine.toml", "table.toml",
                 "z2p_core/native/TOPIC.py"}  # fmt: skip
EXAMPLE_FOLDERS = {"z2p_core/native/c/TOPIC/"}
"""Files and folders that a page names for the reader to make."""
RUN = re.compile(
    r"(cat \S+ \| )?"
    r"z2p (render|run-inference|animate|film|figure|rerender|info|formats|plugins|report|completion) "
)
"""Commands that are run; those of whole pipelines have tests of their own, and only their options are checked here."""


def blocks(page: Path, language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", page.read_text(), flags=re.MULTILINE | re.DOTALL)


def commands(page: Path) -> list[str]:
    """The lines that call z2p."""
    if page.name in EXTERNAL_PLUGIN_PAGES:
        return []
    lines = [line for block in blocks(page, "sh") for line in block.splitlines()]
    return [line for line in lines if re.match(r"(cat \S+ \| )?z2p ", line)]


def inline_commands(page: Path) -> list[str]:
    """Those amid the text that name an option, as ``z2p evaluate --meshes DIR``; a line may end within one."""
    text = re.sub(r"^```.*?^```", "", page.read_text(), flags=re.MULTILINE | re.DOTALL)
    return [" ".join(words.split()) for words in re.findall(r"`(z2p [^`]+)`", text) if " --" in words]


def parameters(command: str) -> list[Parameter]:
    """Of the subcommand that a line calls."""
    from z2p_renderer.pipeline.cli import main
    from z2p_renderer.pipeline.cli.commands.workspace import ForwardedCommand
    from z2p_renderer.workflows.commands import main as workspace_commands

    assert isinstance(main, Group)
    name = command.split()[1]
    command_object = main.get_command(Context(main), name)
    if isinstance(command_object, ForwardedCommand):
        command_object = workspace_commands.get_command(Context(workspace_commands), name)
    assert command_object is not None, command
    return command_object.get_params(Context(command_object))


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
    write_cameras(tmp_path)
    (tmp_path / "run").mkdir()
    for number, share in ((1, 0.0), (2, 0.5), (10, 1.0)):
        ball = cloud / np.linalg.norm(cloud, axis=1, keepdims=True)
        np.save(tmp_path / "run" / f"step_{number}.npy", (1 - share) * cloud + share * ball)
    for kind in ("csv", "toml"):
        (table,) = blocks(ROOT / "docs" / "figures.md", kind)
        (tmp_path / f"table.{kind}").write_text(table)
    weights = ROOT / "storage" / "weights" / "regular.safetensors"
    shutil.copy(weights, tmp_path / "runs" / "NAME" / "weights.safetensors")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def write_cameras(folder: Path) -> None:
    """A transforms.json and a COLMAP model of two cameras before bunny.ply."""
    pose = np.eye(4)
    frames = []
    for name, x in (("left.jpg", -0.5), ("right.jpg", 0.5)):
        pose[:3, 3] = (x, 0.3, 4)
        frames.append({"file_path": name, "transform_matrix": pose.tolist()})
    lens = {"w": 400, "h": 300, "fl_x": 400, "fl_y": 400, "cx": 200, "cy": 150}
    (folder / "transforms.json").write_text(json.dumps({**lens, "frames": frames}))
    (folder / "sparse").mkdir()
    (folder / "sparse" / "cameras.txt").write_text("1 PINHOLE 400 300 400 400 200 150\n")
    (folder / "sparse" / "images.txt").write_text(
        "1 0 1 0 0 0.5 0.3 4 1 left.jpg\n\n2 0 1 0 0 -0.5 0.3 4 1 right.jpg\n\n"
    )


def test_pages_contain_commands() -> None:
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
def test_documented_options_exist(page: Path) -> None:
    for command in [*commands(page), *inline_commands(page)]:
        words = re.sub(r"^cat \S+ \| ", "", command).split()
        known = {option for parameter in parameters(" ".join(words)) for option in parameter.opts}
        assert {word for word in words if word.startswith("--")} <= known, command


@pytest.mark.parametrize("page", PAGES, ids=stem)
def test_documented_commands_have_all_required_options(page: Path) -> None:
    for command in [*commands(page), *inline_commands(page)]:
        words = re.sub(r"^cat \S+ \| ", "", command).split()
        needed = [one for one in parameters(" ".join(words)) if isinstance(one, Option) and one.required]
        missing = [one.opts[0] for one in needed if not set(one.opts) & set(words)]
        assert not missing, f"{command}: lacks {', '.join(missing)}"


def test_inline_commands_are_recognized() -> None:
    assert any(command.startswith("z2p evaluate ") for command in inline_commands(ROOT / "README.md"))
    assert any("--points 2048" in command for command in inline_commands(ROOT / "docs" / "ablations.md"))


@pytest.mark.slow
def test_the_plugins_of_the_page_keep_their_contracts(tmp_path: Path) -> None:
    """Its blocks are files; installed, as their entry points say, the registry and a config find what is in them."""
    page = (ROOT / "docs" / "writing-a-plugin.md").read_text()
    files = dict(re.findall(r"^`([a-z_.]+)`:\n\n```\w+\n(.*?)^```", page, flags=re.MULTILINE | re.DOTALL))
    assert set(files) == {"mine_zbuffer.py", "mine_reader.py", "mine_condition.py", "pyproject.toml", "test_mine.py",
                          "mine.toml"}  # fmt: skip
    for name, text in files.items():
        (tmp_path / name).write_text(text)
    project = tomllib.loads(files["pyproject.toml"])
    metadata = tmp_path / "z2p_mine-0.1.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: z2p-mine\nVersion: 0.1.0\n")
    lines = [f"[{group}]\n" + "".join(f"{name} = {target}\n" for name, target in entries.items())
             for group, entries in project["project"]["entry-points"].items()]  # fmt: skip
    (metadata / "entry_points.txt").write_text("\n".join(lines))
    assert project["tool"]["setuptools"]["py-modules"] == ["mine_zbuffer", "mine_condition", "mine_reader"]
    use = """
from pathlib import Path
import numpy as np
from z2p_renderer.storage.scans.clouds import read_clouds
from z2p_core import registry
from z2p_core.config import parse_config
zbuffer = parse_config(Path("mine.toml").read_text()).train.network.zbuffer
assert registry.load("zbuffers", zbuffer).name == zbuffer
np.ones((4, 3)).cumsum(0).astype("<f4").tofile("scan.f32")
assert len(read_clouds(Path("scan.f32"))[0].points) == 4
"""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), str(ROOT)])}
    for words in (["-m", "pytest", "-q", "test_mine.py"], ["-c", use]):
        done = subprocess.run([sys.executable, *words], cwd=tmp_path, env=environment, capture_output=True, text=True)
        assert done.returncode == 0, done.stdout + done.stderr


def test_documented_sweeps_are_complete() -> None:
    from z2p_core.config.report import SWEEP_NAMES

    texts = [(ROOT / name).read_text() for name in ("configs/report.toml", "docs/paper-report.md")]
    texts += [str(option.help) for option in parameters("z2p report-paper") if "--sweeps" in option.opts
              and isinstance(option, Option)]  # fmt: skip
    assert len(texts) == 3
    for text in texts:
        assert [name for name in SWEEP_NAMES if name != "base" and not re.search(rf"\b{name}\b", text)] == []


def test_documented_fine_tuning_can_be_planned() -> None:
    from z2p_core.config import PipelineConfig, from_dict
    from z2p_renderer.workflows.plan import make_plan

    config = tomllib.loads((ROOT / "configs" / "regular.toml").read_text())
    (changes,) = (tomllib.loads(block) for block in blocks(ROOT / "docs" / "training.md", "toml") if "start" in block)
    assert "network" not in config["train"]
    config["train"] |= changes["train"]
    assert "train" in make_plan(from_dict(PipelineConfig, config | {"name": changes["name"]})).steps


@pytest.mark.slow
def test_the_python_page_runs(desk: Path) -> None:
    names: dict[str, object] = {}
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for block in blocks(ROOT / "docs" / "python.md", "python"):
            exec(block, names)
    assert (desk / "points.png").stat().st_size > 1000 and (desk / "sheet.png").exists()


def test_the_python_of_the_page_on_cameras_runs(desk: Path) -> None:
    names: dict[str, object] = {}
    for block in blocks(ROOT / "docs" / "cameras.md", "python"):
        exec(block, names)
    assert (desk / "posed_depth.npy").is_file() and (desk / "posed_camera.json").is_file()


def test_the_python_of_the_page_on_films_runs(desk: Path) -> None:
    (block,) = blocks(ROOT / "docs" / "films.md", "python")
    exec(block, {})
    assert all((desk / name).stat().st_size > 500 for name in ("ball.webp", "ball-run.webp", "balls.gif"))


@pytest.mark.parametrize("page", [*PAGES, ROOT / "ARCHITECTURE.md"], ids=stem)
def test_every_file_that_a_page_names_exists(page: Path) -> None:
    """A page may leave out leading folders; what it names is the end of the path of some file."""
    named = set(re.findall(r"(?<![\w./])([\w./-]*\w\.(?:py|c|h|md|toml))\b", inline_code(page))) - EXAMPLE_FILES
    assert [name for name in sorted(named) if not any(path.endswith(f"/{name}") for path in project_files())] == []


@pytest.mark.parametrize("page", [*PAGES, ROOT / "ARCHITECTURE.md"], ids=stem)
def test_every_folder_that_a_page_names_exists(page: Path) -> None:
    named = re.findall(rf"(?<![\w./-])((?:{'|'.join(CODE_FOLDERS)})/[\w/-]*)(?![\w./*{{<-])", inline_code(page))
    assert [name for name in sorted({*named} - EXAMPLE_FOLDERS) if not (ROOT / name).is_dir()] == []


def inline_code(page: Path) -> str:
    """The words of a page in single backticks."""
    text = re.sub(r"^```.*?^```", "", page.read_text(), flags=re.MULTILINE | re.DOTALL)
    return " ".join(re.findall(r"`([^`]+)`", text))


@cache
def project_files() -> tuple[str, ...]:
    """Paths of the project's files, each with a leading slash."""
    paths = [path for folder in CODE_FOLDERS for path in (ROOT / folder).rglob("*.*")]
    return tuple(f"/{path.relative_to(ROOT).as_posix()}" for path in [*paths, *ROOT.glob("*.*")])


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
