"""Every step is fresh, stale or missing, and the reason names the cause."""

import json
import shutil
from pathlib import Path

import pytest
from editing import edited
from small_store import fill, listing

from z2p_renderer.storage.results.store import Store
from z2p_renderer.workflows.plan import make_plan
from z2p_renderer.workflows.report.plan import load_report_plan
from z2p_renderer.workflows.sources import report_source
from z2p_renderer.workflows.status import StepStatus, format_table, statuses_to_json, step_statuses, steps_to_run

TINY = Path(__file__).parents[2] / "configs" / "report-tiny.toml"


@pytest.fixture
def store(tmp_path):
    return Store(tmp_path / "runs")


def told(store, plan):
    return {one.step: (one.state, *one.reasons) for one in step_statuses(plan, store)}


def test_a_new_workspace_misses_everything(config, store):
    found = told(store, make_plan(config))
    assert set(found.values()) == {("missing", "never made, or deleted")} and not store.root.exists()


def test_a_filled_one_is_fresh_and_looking_writes_nothing(config, store):
    fill(store, make_plan(config))
    before = listing(store.root)
    assert set(told(store, make_plan(config)).values()) == {("fresh",)}
    assert listing(store.root) == before


def test_reasons_name_what_changed_and_upstream_by_name(config, store, meshes):
    fill(store, make_plan(config))
    (meshes / "meshes" / "bee.obj").write_text("bee, but larger")
    found = told(store, make_plan(edited(config, "evaluate.views", 3)))
    assert found["sample/ape"] == found["shard/ape"] == ("fresh",)
    assert found["sample/bee"] == found["render/bee/0-10"] == ("stale", "mesh contents changed")
    assert found["shard/bee"] == ("stale", "upstream sample/bee", "upstream render/bee")
    assert found["train"] == ("stale", "upstream shard/bee")
    assert found["evaluate"] == ("stale", "views 2 -> 3", "upstream train")


def test_unchanged_built_in_shapes_are_no_reason(config, store):
    builtin = edited(edited(config, "meshes", "builtin"), "evaluate_meshes", "")
    fill(store, make_plan(builtin))
    found = told(store, make_plan(edited(builtin, "train.steps", 7)))
    assert found["shapes"] == ("fresh",)
    assert found["train"] == ("stale", "steps 150 -> 7") and found["evaluate"] == ("stale", "upstream train")


def test_renders_cut_anew_have_their_reason(config, store):
    fill(store, make_plan(config))
    recut = edited(config, "render.chunk", 6)
    assert told(store, make_plan(recut))["render/ape/0-6"] == ("stale", "views are cut into other chunks")
    assert told(store, make_plan(recut))["shard/ape"] == ("fresh",)
    found = told(store, make_plan(edited(recut, "render.samples", 5)))
    assert found["render/ape/0-6"] == ("stale", "samples 4 -> 5")
    assert found["shard/ape"] == ("stale", "upstream render/ape")


def test_deleted_and_damaged_results_are_told_apart(config, store):
    plan = make_plan(config)
    fill(store, plan)
    shutil.rmtree(store.folder(plan.steps["train"].entry))
    (store.folder(plan.steps["sample/ape"].entry) / "result.bin").write_text("shorter")
    store.quarantine(store.folder(plan.steps["sample/bee"].entry))
    found = told(store, plan)
    assert found["train"] == ("missing", "never made, or deleted")
    assert found["sample/ape"][0] == "stale" and "result.bin" in found["sample/ape"][1]
    assert found["sample/bee"] == ("stale", "damaged, and put aside in .quarantine")
    assert found["shard/ape"] == found["evaluate"] == ("fresh",)
    assert {one.step for one in steps_to_run(step_statuses(plan, store))} == {"train", "sample/ape", "sample/bee"}


def test_going_back_is_fresh(config, store):
    fill(store, make_plan(config))
    fill(store, make_plan(edited(config, "train.steps", 7)))
    assert {state for state, *_ in told(store, make_plan(config)).values()} == {"fresh"}


def test_table_and_json_say_the_same(config, store):
    plan = make_plan(config)
    fill(store, plan, "sample/ape")
    found = step_statuses(plan, store)
    lines = format_table(found)
    assert lines[0].split() == ["FRESH", "sample/ape"] and lines[-1] == f"1 fresh, 0 stale, {len(found) - 1} missing"
    assert len(format_table(found, with_fresh=False)) == len(lines) - 1
    rows = json.loads(statuses_to_json(found))
    assert [row["step"] for row in rows] == list(plan.steps) and rows[1]["state"] == "missing"


def test_a_table_shortens_upstream_reasons_but_json_does_not():
    many = tuple(f"upstream shard/{number}" for number in range(170))
    found = [StepStatus("train", "train", "stale", ("steps 5 -> 6", *many), "0")]
    line = format_table(found)[0]
    assert "steps 5 -> 6" in line and "upstream shard/0" in line and "and 166 more upstream" in line
    assert len(line) < 200
    assert json.loads(statuses_to_json(found))[0]["reasons"] == ["steps 5 -> 6", *many]


@pytest.fixture
def planned(tmp_path):
    """Function that plans a tiny report, with a part of its config replaced."""

    def plan(old="", new=""):
        text = TINY.read_text()
        assert old in text
        (tmp_path / "report.toml").write_text(text.replace(old, new))
        load_report_plan.cache_clear()
        return load_report_plan(report_source(str(tmp_path / "report.toml"), "", "", "regular", ""))

    return plan


def test_a_reports_results_are_known_as_well(store, planned):
    before = planned()
    assert {state for state, *_ in told(store, before).values()} == {"missing"}
    fill(store, before)
    assert {state for state, *_ in told(store, before).values()} == {"fresh"}
    more = told(store, planned("lift = {levels = []}", "lift = {levels = [0.0], meshes = 1}"))
    found = {name: one for name, one in more.items() if one[0] != "fresh"}
    assert found.pop("report")[0] == "stale"
    assert set(found) == {f"measure/lift/bumpy_ball/{method}" for method in ("truth", "regular", "splats", "screen")}
    assert {one for one, *_ in found.values()} == {"missing"}


def test_reasons_of_a_reports_results(store, planned):
    fill(store, planned())
    found = told(store, planned("levels = [0, 0.02]", "levels = [0, 0.05]"))
    assert found["measure/noise/bumpy_ball/splats"] == ("stale", "levels 0.0, 0.02 -> 0.0, 0.05")
    assert "upstream measure/noise/bumpy_ball/splats" in found["report"] and found["times"] == ("fresh",)
