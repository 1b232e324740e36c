"""The whole report at its smallest, with real Blender: what it holds, and that a rerun makes only what is new."""

from __future__ import annotations

import csv
import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from z2p_core import registry
from z2p_core.config import ConfigError
from z2p_core.registry import PluginError
from z2p_renderer.pipeline.evaluation.paper import real_scans
from z2p_renderer.storage.models.checkpoints import load_weights, save_weights
from z2p_renderer.storage.results import stage_dependencies
from z2p_renderer.workflows.report.plan import load_report_plan
from z2p_renderer.workflows.sources import report_source
from z2p_renderer.workflows.stage_task import Store, create_task
from z2p_renderer.workflows.upkeep.garbage_collection import find_garbage

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
CONFIGS = Path(__file__).parents[3] / "configs"
CONFIG = CONFIGS / "report-tiny.toml"
METHODS = ("truth", "regular", "splats", "screen")
PYRAMID = "OFF\n5 6 0\n1 1 0\n-1 1 0\n-1 -1 0\n1 -1 0\n0 0 2\n3 0 1 4\n3 1 2 4\n3 2 3 4\n3 3 0 4\n3 0 2 1\n3 0 3 2\n"
TETRA = "OFF\n4 4 0\n1 1 1\n1 -1 -1\n-1 1 -1\n-1 -1 1\n3 0 1 2\n3 0 3 1\n3 0 2 3\n3 1 3 2\n"


def report(cwd: Path, config: Path = CONFIG, *more: str) -> subprocess.CompletedProcess:
    command = [sys.executable, "-m", "luigi", "--module", "workflows", "PaperReport", "--local-scheduler",
               "--config", str(config), "--meshes", "meshes", *more]  # fmt: skip
    environment = {**os.environ, "PYTHONPATH": str(CONFIGS.parent), "OMP_NUM_THREADS": "1"}
    return subprocess.run(command, cwd=cwd, env=environment, capture_output=True, text=True, check=False)


def made(result: subprocess.CompletedProcess) -> set[str]:
    """Steps that ran, from what was said."""
    assert result.returncode == 0, result.stderr
    return {line.split(":")[0] for line in result.stderr.splitlines() if ": done in " in line}


def steps(*sweeps: str, methods: tuple[str, ...] = METHODS) -> set[str]:
    return {f"measure/{sweep}/{method}" for sweep in sweeps for method in methods}


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, subprocess.CompletedProcess]:
    """A folder with two meshes and the results of one run."""
    cwd = tmp_path_factory.mktemp("report")
    (cwd / "meshes").mkdir()
    (cwd / "meshes" / "pyramid.off").write_text(PYRAMID)
    (cwd / "meshes" / "tetra.off").write_text(TETRA)
    return cwd, report(cwd, CONFIG, "--weights", "regular")


ALL = {"base/pyramid", "base/tetra", "noise/pyramid", "scale/pyramid", "single/pyramid", "turning/pyramid",
       "texture/pyramid", "gap/shapes"}  # fmt: skip


@pytest.mark.slow
def test_it_makes_a_page_that_needs_nothing_else(finished) -> None:
    cwd, result = finished
    assert made(result) == steps(*ALL) | {"times", "trust/pyramid/regular", "report"}
    shown = cwd / "runs" / "tiny-report"
    page = (shown / "report.html").read_text()
    sources = re.findall(r'(?:src|href)="([^"]+)"', page)
    assert len(sources) > 40 and all(source.startswith(("data:", "#")) for source in sources)
    told = json.loads((shown / "report.json").read_text())
    assert told["lead"] in page.replace("&#39;", "'") and re.search("baseline|z2p wins", told["lead"])
    assert "--sweeps noise" in page and "Ablation" in page and "Table 1" in page
    assert set(told["abilities"]) == set(METHODS[1:])


@pytest.mark.slow
@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium here")
def test_a_browser_shows_it_offline(finished) -> None:
    cwd, _ = finished
    shot = cwd / "shot.png"
    page = (cwd / "runs" / "tiny-report" / "report.html").resolve().as_uri()
    command = [str(CHROMIUM), "--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars",
               f"--user-data-dir={cwd / 'profile'}", f"--screenshot={shot}", "--window-size=1200,6000"]  # fmt: skip
    subprocess.run([*command, page], capture_output=True, timeout=120, check=True)
    with Image.open(shot) as picture:
        pixels = np.asarray(picture.convert("RGB")).astype(int)
    assert ((np.abs(pixels - (0xD1, 0x49, 0x5B)).max(-1) < 8).sum()) > 100  # the first paragraph's bar
    colorful = np.ptp(pixels, axis=-1) > 60
    assert colorful.sum() > 5000  # pictures and curves are drawn, far down the page too
    assert colorful[3000:].sum() > 500


@pytest.mark.slow
def test_every_row_leads_to_the_result_that_it_comes_from(finished) -> None:
    cwd, _ = finished
    with (cwd / "runs" / "tiny-report" / "report.csv").open() as file:
        rows = list(csv.DictReader(file))
    told = json.loads((cwd / "runs" / "tiny-report" / "report.json").read_text())
    assert len(rows) == len(told["rows"]) == 4 * (2 + 2 + 1 + 1 + 2 + 2 + 2)
    for row in rows:
        folder = cwd / "runs" / row["result"]
        manifest = json.loads((folder / "manifest.json").read_text())
        assert manifest["name"].split("/")[1] == row["sweep"] and (folder / row["picture"]).is_file()
        assert row["method"] == "truth" or 0 < float(row["psnr_white"]) < 60


@pytest.mark.slow
def test_its_times_and_maps_are_measured(finished) -> None:
    told = json.loads((finished[0] / "runs" / "tiny-report" / "report.json").read_text())
    batches = told["times"]["weights"]["regular"]["rows"]
    assert [row["batch"] for row in batches] == [1, 2, 3, 4, 5, 6]
    assert all(row["forward"] > 0 and row["zbuffer"] > 0 for row in batches)
    assert told["times"]["baselines"]["splats"]["render"] > 0 == told["times"]["baselines"]["screen"]["render"]
    maps = told["trust"][0]["rows"][0]["maps"]
    assert set(maps) == {"disagreement", "edges", "sparseness"}
    assert all(-1 <= one["rank_correlation"] <= 1 and one["best_area"] <= one["area"] for one in maps.values())


@pytest.mark.slow
def test_a_second_run_runs_nothing_and_gc_keeps_what_it_made(finished) -> None:
    cwd, _ = finished
    again = report(cwd, CONFIG, "--weights", "regular")
    assert made(again) == set() and "up to date" in again.stderr
    assert find_garbage(Store(cwd / "runs")) == []


@pytest.mark.slow
def test_one_sweep_changed_is_one_sweep_made(finished) -> None:
    cwd, _ = finished
    (cwd / "changed.toml").write_text(CONFIG.read_text().replace("levels = [0, 0.02]", "levels = [0, 0.05]"))
    assert made(report(cwd, cwd / "changed.toml", "--weights", "regular")) == steps("noise/pyramid") | {"report"}


@pytest.mark.slow
def test_other_weights_leave_the_others_results_alone(finished, make_weights) -> None:
    cwd, _ = finished
    shutil.copy(make_weights(), cwd / "mine.safetensors")
    result = made(report(cwd, CONFIG, "--weights", "regular,mine.safetensors"))
    assert result == steps(*ALL, methods=("mine",)) | {"trust/pyramid/mine", "times", "report"}


@pytest.mark.slow
def test_a_dry_run_lists_the_steps_to_run_and_writes_nothing(tmp_path: Path) -> None:
    (tmp_path / "meshes").mkdir()
    (tmp_path / "meshes" / "tetra.off").write_text(TETRA)
    result = report(tmp_path, CONFIG, "--weights", "regular", "--dry-run")
    assert result.returncode == 0 and not (tmp_path / "runs").exists(), result.stderr
    lines = [line.split() for line in result.stderr.splitlines() if line.startswith("MISSING")]
    assert [lines[0][1], lines[-1][1]] == ["measure/base/tetra/truth", "report"]
    assert f"a run would make {len(lines)} of {len(lines)} results; nothing was written" in result.stderr
    assert made(result) == set()


def plan(tmp_path: Path, text: str = "", weights: str = "regular", sweeps: str = ""):
    config = tmp_path / "report.toml"
    config.write_text(text)
    load_report_plan.cache_clear()  # a process plans a file but once
    return load_report_plan(report_source(str(config), "", "", weights, sweeps))


def test_the_default_plan_covers_the_papers_evaluation(tmp_path: Path) -> None:
    found = plan(tmp_path)
    sweeps = {step.sweep for step in found.steps.values() if step.sweep}
    assert sweeps == {"base", "noise", "density", "sampling", "inner", "scale", "single", "lift", "light", "color",
                      "turning", "material", "texture", "sheet", "scene", "bumps", "gap"}  # fmt: skip
    assert {"times", "report", "shapes", "trust/bumpy_ball/regular"} <= set(found.steps)
    methods = ["regular", "bpa", "poisson", "hpr", "splats", "balls", "screen"]
    assert [method.name for method in found.methods] == methods


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(path.name for path in CONFIGS.glob("report*.toml")))
def test_the_configs_can_be_planned(name: str) -> None:
    assert "report" in load_report_plan(report_source(str(CONFIGS / name), "", "", "", "")).steps


@pytest.mark.slow
def test_only_what_a_setting_shapes_hangs_on_it(tmp_path: Path) -> None:
    def prints(text: str, **given: str) -> dict[str, str]:
        return {name: step.entry.fingerprint for name, step in plan(tmp_path, text, **given).steps.items()}

    before = prints("seed = 0")
    changed = {name for name, one in prints("seed = 0\n[light]\nlevels = [0]").items() if before.get(name) != one}
    assert changed and all(name == "report" or name.startswith("measure/light/") for name in changed)
    draws = {name for name, one in prints("seed = 0\ntrust_draws = 3").items() if before.get(name) != one}
    assert {name.split("/")[0] for name in draws} == {"trust", "report"}
    everything = {name for name, one in prints("seed = 1").items() if before.get(name) == one}
    assert everything == {"shapes"}


@pytest.mark.parametrize("part", [
    "z2p_core.network.unet", "z2p_core/native/c/surfels/surfel_raster.c", "z2p_core.surface.normals", "z2p_core.linalg",
    "z2p_core.native.images", "z2p_core/native/c/points/view_coverage.c",
])  # fmt: skip
@pytest.mark.slow
def test_network_code_is_not_in_fingerprints_of_baselines(tmp_path: Path, monkeypatch, part) -> None:
    def prints() -> dict[str, str]:
        return {name: step.entry.fingerprint for name, step in plan(tmp_path, "scans = 'scans'").steps.items()}

    (tmp_path / "scans").mkdir()
    np.savetxt(tmp_path / "scans" / "one.xyz", np.eye(3))
    monkeypatch.chdir(tmp_path)
    before = prints()
    real = stage_dependencies.cached_part_digest
    monkeypatch.setattr(stage_dependencies, "cached_part_digest", lambda one: "0" * 64 if one == part else real(one))
    changed = {name for name, one in prints().items() if before[name] != one}
    weights = {"denoise", "material", "regular"}
    expected = {name for name in before if name.split("/")[-1] in weights}
    if part in stage_dependencies.PLACEMENT_CODE:  # whoever draws a scan, it is placed first
        expected |= {name for name in before if name.startswith("scans/")}
    assert expected == changed - {"times", "report"}


@pytest.mark.slow
def test_a_method_edited_after_planning_is_refused(tmp_path: Path, monkeypatch) -> None:
    """What it renders would be kept under another's name."""
    source = report_source(str(CONFIG), "", "", "", "")
    step = load_report_plan(source).steps["measure/noise/bumpy_ball/splats"]
    task = create_task(step, source, str(tmp_path / "runs"))
    task._check_code()
    monkeypatch.setattr(registry.load("baselines", "splats"), "version", "changed")
    with pytest.raises(ConfigError, match="plugin splats changed since the pipeline started"):
        task._check_code()


def test_weights_edited_after_planning_are_refused(tmp_path: Path, make_weights) -> None:
    mine = tmp_path / "mine.safetensors"
    shutil.copy(make_weights(), mine)
    source = report_source(str(CONFIG), "", "", str(mine), "")
    steps = load_report_plan(source).steps
    names = ("measure/noise/bumpy_ball/mine", "times")
    tasks = [create_task(steps[name], source, str(tmp_path / "runs")) for name in names]
    for task in tasks:
        task._check_code()
    tensors = load_weights(mine)
    save_weights(mine, {name: tensor + 1 for name, tensor in tensors.tensors.items()}, tensors.card)
    for task, told in zip(tasks, ["mine changed since the report", "mine.*: the file changed since"], strict=True):
        with pytest.raises(ConfigError, match=told):
            task._check_code()


@pytest.mark.slow
def test_a_scan_edited_after_planning_is_refused(tmp_path: Path, monkeypatch) -> None:
    (tmp_path / "scans").mkdir()
    scan = tmp_path / "scans" / "one.xyz"
    np.savetxt(scan, np.eye(3))
    (tmp_path / "scans.toml").write_text("scans = 'scans'")
    monkeypatch.chdir(tmp_path)
    source = report_source("scans.toml", "", str(scan.parent), "", "")
    task = create_task(load_report_plan(source).steps["scans/splats"], source, str(tmp_path / "runs"))
    task._check_code()
    monkeypatch.setattr(real_scans, "draw_scans", lambda *_, **__: scan.write_text("1 2 3\n"))
    with pytest.raises(ConfigError, match=r"one\.xyz: the file changed since the pipeline started"):
        task.make(tmp_path)  # the file changed before its turn to be read
    with pytest.raises(ConfigError, match=r"one\.xyz: the file changed since the pipeline started"):
        task._check_code()


def test_weights_of_another_version_s_buffers_are_refused(tmp_path: Path, make_weights) -> None:
    older, weights = tmp_path / "older.safetensors", load_weights(make_weights())
    save_weights(older, weights.tensors, {**weights.card, "gbuffer": {"name": "surfels", "version": "0"}})
    with pytest.raises(ConfigError, match=r"weights need gbuffer 'surfels' version 0, installed is .*train again"):
        plan(tmp_path, weights=str(older))


@pytest.mark.slow
def test_weights_of_trainings_are_called_after_their_folders(tmp_path: Path, make_weights, monkeypatch) -> None:
    for folder in ("first", "second"):
        (tmp_path / folder).mkdir()
        shutil.copy(make_weights(), tmp_path / folder / "weights.safetensors")
    monkeypatch.chdir(tmp_path)
    files = [f"{folder}/weights.safetensors" for folder in ("first", "second")]
    assert [one.name for one in plan(tmp_path, "baselines = []", ",".join(files)).methods] == ["first", "second"]
    monkeypatch.chdir("first")
    named = plan(tmp_path, "baselines = []\nweights = ['weights.safetensors', 'regular']", "").methods
    assert [one.name for one in named] == ["first", "regular"]


def test_sweeps_can_be_chosen_and_the_plain_case_stays(tmp_path: Path) -> None:
    found = plan(tmp_path, "", sweeps="light,gap")
    assert {step.sweep for step in found.steps.values() if step.sweep} == {"base", "light", "gap"}
    assert found.command.endswith("--weights regular --sweeps light,gap")


@pytest.mark.parametrize(
    ("text", "given", "error", "message"),
    [
        ("", {"sweeps": "nosuch"}, ConfigError, "--sweeps: unknown 'nosuch'; known: base, noise"),
        ("", {"weights": "nosuch"}, ConfigError, "unknown weights 'nosuch'"),
        ("nosuch = 1", {}, ConfigError, "unknown key 'nosuch'"),
        ("views = 0", {}, ConfigError, "views: expected a whole number from 1 to 100,000, got 0"),
        ("trust_draws = 1", {}, ConfigError, "trust_draws: expected 0, or 2 or more"),
        ('name = "truth"', {}, ConfigError, "name: expected a plain folder name"),
        ('baselines = ["nosuch"]', {}, PluginError, "expected an installed baseline .*got 'nosuch'"),
        ('baselines = ["bpa", "bpa"]', {}, ConfigError, "baselines: expected a list of .*different values"),
        ("[base]\nlevels = []", {}, ConfigError, "base: expected levels"),
    ],
)
def test_what_cannot_be_made_is_said_before_anything_is(
    tmp_path: Path, text: str, given: dict[str, str], error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message):
        plan(tmp_path, text, **given)
