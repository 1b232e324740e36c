"""The commands on a workspace, as `z2p` starts them; results are files of no meaning, but for adopted ground truth."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner
from small_store import fill, listing
from world import World

import z2p_renderer.storage.results.stage_dependencies
from z2p_renderer.storage.results.store import Store
from z2p_renderer.workflows.ablation.plan import load_ablation_plan
from z2p_renderer.workflows.commands import main
from z2p_renderer.workflows.plan_loading import load_pipeline_plan
from z2p_renderer.workflows.report.plan import load_report_plan
from z2p_renderer.workflows.sources import ablation_source, pipeline_source, report_source
from z2p_renderer.workflows.upkeep.runs_in_use import keep_results

TINY = Path(__file__).parents[2] / "configs" / "report-tiny.toml"


@pytest.fixture
def world(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    load_pipeline_plan.cache_clear()
    yield World(tmp_path, code=False)
    load_pipeline_plan.cache_clear()


@pytest.fixture
def plan(world):
    return load_pipeline_plan(pipeline_source("small.toml", "meshes", "kept"))


def run(*words):
    load_pipeline_plan.cache_clear()
    load_ablation_plan.cache_clear()
    return CliRunner().invoke(main, list(words))


def test_status_as_table_and_json(world, plan):
    fill(Store(world.workspace), plan, "sample/tetra")
    table = run("status", *world.options)
    assert table.exit_code == 0 and "FRESH   sample/tetra" in table.stdout
    assert table.stdout.endswith("1 fresh, 0 stale, 7 missing\n")
    rows = json.loads(run("status", "--json", "--stale", *world.options).stdout)
    assert len(rows) == 7 and {row["state"] for row in rows} == {"missing"}


def test_adopting_lists_first_and_keeps_the_configuration(world, plan, monkeypatch):
    store = Store(world.workspace)
    fill(store, plan)
    monkeypatch.setitem(z2p_renderer.storage.results.stage_dependencies.PACKAGES, "render", ("numpy", "luigi"))
    before = listing(world.workspace)
    listed = run("adopt", "render", *world.options)
    assert listed.exit_code == 0 and "2 results could be taken over" in listed.stdout, listed.output
    assert "package luigi none -> " in listed.stdout and listing(world.workspace) == before
    assert "8 fresh" not in run("status", *world.options).stdout
    done = run("adopt", "render", "shard", "train", "evaluate", "--because", "luigi draws nothing", *world.options)
    assert "6 results taken over" in done.stdout and "8 fresh" in run("status", *world.options).stdout
    assert "6 of" in run("gc").stdout and list((world.workspace / ".kept").iterdir())


def test_adopting_takes_ground_truth_that_had_no_manifest(world, plan):
    from z2p_renderer.workflows.upkeep.adopt_ground_truth import iter_references

    [(entry, old)] = iter_references(plan, Store(world.workspace))
    assert old.parent.parent == world.workspace / "truth" and entry.fields["parameters"]["samples"] == 1
    old.parent.mkdir(parents=True)
    old.write_text("picture")
    old.with_suffix(".coverage.png").write_text("coverage")
    result = run("adopt", "reference", "--because", "they are the same", *world.options)
    assert "1 results taken over" in result.stdout, result.output
    folder = Store(world.workspace / "truth").folder(entry)
    assert (folder / "picture.png").samefile(old) and (folder / "picture.coverage.png").read_text() == "coverage"


def test_ground_truth_of_every_seed_can_be_adopted(world):
    from z2p_renderer.workflows.upkeep.adopt_ground_truth import iter_references

    config = world.root / "small.toml"
    config.write_text(config.read_text().replace("[evaluate]\n", "[evaluate]\nseed = 3\nseeds = 2\n"))
    plan = load_pipeline_plan(pipeline_source("small.toml", "meshes", "kept"))
    found = [entry.fields for entry, _ in iter_references(plan, Store(world.workspace))]
    assert [fields["parameters"]["seed"] for fields in found] == [3, 4]
    assert found[0]["scene"] != found[1]["scene"]


def test_verify_puts_damage_aside_and_says_so(world, plan):
    store = Store(world.workspace)
    fill(store, plan)
    assert run("verify").exit_code == 0
    assert "got none" in (nowhere := run("verify", "--workspace", "nosuch")).output and nowhere.exit_code == 2
    path = store.folder(plan.steps["train"].entry) / "result.bin"
    stamp = path.stat()
    path.write_text("TRAIN")
    os.utime(path, ns=(stamp.st_atime_ns, stamp.st_mtime_ns))
    result = run("verify")
    assert result.exit_code == 1 and "DAMAGED" in result.stdout and "8 results read, 1 damaged" in result.stdout
    assert "train" in {row["step"] for row in json.loads(run("status", "--json", "--stale", *world.options).stdout)}


def test_gc_shows_before_it_removes(world, plan):
    fill(Store(world.workspace), plan)
    shown = run("gc")
    store, train = Store(world.workspace), plan.steps["train"].entry
    assert "8 of" in shown.stdout and "--yes" in shown.stdout and store.complete(train)
    assert "removed" in run("gc", "--yes").stdout and not store.complete(train)
    assert run("gc").stdout.startswith("0 of") and run("gc", "--drop", "nosuch").exit_code == 1


@pytest.mark.parametrize("words, message", [
    (["status", "--config", "nowhere.toml"], "nowhere.toml"), (["status", "--meshes", "nowhere"], "nowhere"),
    (["adopt", "rendering"], "unknown stage 'rendering'"),
])  # fmt: skip
def test_what_a_user_can_mend_is_one_line_and_status_2(world, words, message):
    result = run(*words)
    assert result.exit_code == 2 and message in result.stderr and "Traceback" not in result.output


def test_z2p_hands_words_and_exit_status_on(world):
    def z2p(*words):
        command = [sys.executable, "-m", "z2p_renderer.pipeline.cli", "status", *words]
        return subprocess.run(
            command, cwd=world.root, env=world.environment, capture_output=True, text=True, check=False
        )

    good, bad = z2p(*world.options), z2p("--nonsense")
    assert good.returncode == 0 and good.stdout.endswith("0 fresh, 0 stale, 8 missing\n")
    assert bad.returncode == 2 and "--nonsense" in bad.stderr


@pytest.mark.slow
def test_a_reports_config_is_told_from_a_pipelines(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    load_report_plan.cache_clear()
    words = ("--config", str(TINY), "--weights", "regular")
    fill(Store(tmp_path / "runs"), load_report_plan(report_source(words[1], "", "", "regular", "")), "times")
    for more in ((), ("--report",)):
        result = run("status", *words, *more)
        assert result.exit_code == 0 and "FRESH   times\n" in result.stdout, result.output
        assert result.stdout.endswith("1 fresh, 0 stale, 35 missing\n")
    assert "measure/" in run("status", "--report").stdout and "measure/" not in run("status").stdout
    wrong = run("status", *words, "--evaluate-meshes", "kept")
    assert wrong.exit_code == 2 and "no option of a report" in wrong.stderr
    unknown = run("status", "--weights", "nosuch")
    assert unknown.exit_code == 2 and "unknown weights 'nosuch'" in unknown.stderr


def test_an_ablations_config_is_told_from_a_pipelines(world):
    config = world.root / "small.toml"
    config.write_text(config.read_text() + '[variants.other]\ntitle = "other"\nwhy = "to see"\ntrain.seed = 7\n')
    plan = load_ablation_plan(ablation_source("small.toml", "meshes", "kept"))
    fill(Store(world.workspace), plan, "train/other", "compare")
    result = run("status", *world.options)
    assert result.exit_code == 0 and "FRESH   train/other\n" in result.stdout, result.output
    assert "MISSING train/base" in result.stdout and result.stdout.endswith("2 fresh, 0 stale, 9 missing\n")
    assert "FRESH   compare" in result.stdout  # the command that it tells is z2p ablate's
    assert run("adopt", *world.options).exit_code == 0
    config.write_text(config.read_text().replace("train.seed", "train.sed"))
    wrong = run("status", *world.options)
    assert wrong.exit_code == 2 and "variants.other: train: unknown key 'sed'" in wrong.stderr


@pytest.mark.slow
def test_a_reports_results_are_adopted(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    load_report_plan.cache_clear()
    words = ("--config", str(TINY), "--weights", "regular")
    plan = load_report_plan(report_source(words[1], "", "", "regular", ""))
    fill(Store(tmp_path / "runs"), plan)
    monkeypatch.setitem(z2p_renderer.storage.results.stage_dependencies.PACKAGES, "measure", ("numpy", "luigi"))
    load_report_plan.cache_clear()
    assert f"{len(plan.steps)} fresh" not in run("status", *words).stdout
    load_report_plan.cache_clear()
    result = run("adopt", *words, "--because", "luigi draws nothing")
    assert result.exit_code == 0, result.output
    assert f"{len(plan.steps)} fresh" in run("status", *words).stdout


@pytest.mark.parametrize("text", ["", "{", "[" * 100_000, '{"name": NaN}', "[]", "7"])
def test_a_damaged_manifest_is_reported_and_quarantined(world, plan, text):
    store = Store(world.workspace)
    fill(store, plan)
    keep_results(store, plan, "{}")
    folder = store.folder(plan.steps["train"].entry)
    (folder / "manifest.json").write_text(text)
    rows = {row["step"]: row for row in json.loads(run("status", "--json", *world.options).output)}
    assert rows["train"]["state"] == "stale" and rows["train"]["reasons"][0].startswith("damaged: ")
    said = run("gc", "--workspace", "runs")
    assert said.exit_code == 0 and f"DAMAGED {folder}" in said.output
    said = run("verify", "--workspace", "runs")
    assert said.exit_code == 1 and f"DAMAGED {folder}" in said.output and "1 damaged" in said.output
    assert not folder.exists() and len(list((store.root / ".quarantine" / "train").iterdir())) == 1
    assert run("verify", "--workspace", "runs").exit_code == 0


def test_a_list_of_files_that_was_shortened_is_noticed(world, plan):
    store = Store(world.workspace)
    fill(store, plan)
    folder = store.folder(plan.steps["train"].entry)
    manifest = json.loads((folder / "manifest.json").read_text())
    (folder / "manifest.json").write_text(json.dumps({**manifest, "files": {}}))
    (folder / "result.bin").unlink()
    assert run("verify", "--workspace", "runs").exit_code == 1
