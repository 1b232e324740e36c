"""luigi runs the steps once, runs again what is missing, and goes on past a failure. The stages are stand-ins."""

import inspect
import shutil
from pathlib import Path

import luigi
import pytest

import workflows
import z2p_renderer.workflows.stage_task
from z2p_core import registry
from z2p_core.config import ConfigError, parse_config
from z2p_renderer.storage.models.checkpoints import find_weights
from z2p_renderer.storage.results import stage_dependencies
from z2p_renderer.storage.results.store import Store
from z2p_renderer.workflows.full_pipeline import RESULTS
from z2p_renderer.workflows.plan import make_plan
from z2p_renderer.workflows.plan_loading import load_pipeline_plan
from z2p_renderer.workflows.stage_task import StageTask, create_task
from z2p_renderer.workflows.upkeep.reuse_views import copy_existing_views

TOML = "name = 'small'\nmeshes = 'meshes'\n[render]\nviews = 3\nchunk = 2\n"


@pytest.fixture
def ran(tmp_path, monkeypatch):
    """A working folder with two meshes, and the file that every stand-in stage notes its run in."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "small.toml").write_text(TOML)
    (tmp_path / "meshes").mkdir()
    for name in ("ape", "bee"):
        (tmp_path / "meshes" / f"{name}.ply").write_text(name)
    log = tmp_path / "ran.txt"
    log.touch()

    def make(task: luigi.Task, out: Path) -> None:
        with log.open("a") as file:
            file.write(f"{task.step_name}\n")
        if (tmp_path / "broken").exists() and task.step_name == "sample/bee":
            raise ValueError("bee.ply is broken")
        for name in [name for name, stage in RESULTS.items() if stage == task.step.entry.stage] or ["x"]:
            (out / name).write_text(task.step_name)

    monkeypatch.setattr(z2p_renderer.workflows.stage_task, "mesh_warnings", lambda path: [])
    for stage in StageTask.__subclasses__():
        monkeypatch.setattr(stage, "make", make)
    return log


def build() -> bool:
    load_pipeline_plan.cache_clear()
    luigi.task_register.Register.clear_instance_cache()
    task = workflows.FullPipeline(config="small.toml")
    result = luigi.build([task], local_scheduler=True, detailed_summary=True, log_level="ERROR")
    return result.status == luigi.LuigiStatusCode.SUCCESS


def steps_of(log: Path) -> list[str]:
    steps = log.read_text().split()
    log.write_text("")
    return steps


def test_every_step_runs_once_upstream_first(ran):
    assert build()
    steps = steps_of(ran)
    assert sorted(steps) == [
        "evaluate", "render/ape/0-2", "render/ape/2-3", "render/bee/0-2", "render/bee/2-3", "sample/ape", "sample/bee",
        "shard/ape", "shard/bee", "train",
    ]
    assert steps[-2:] == ["train", "evaluate"] and steps.index("shard/ape") > steps.index("render/ape/2-3")
    shown = Path("runs/small")
    assert {path.name: path.read_text() for path in shown.iterdir()} == RESULTS
    assert build() and steps_of(ran) == []


@pytest.mark.slow
def test_a_deleted_result_alone_is_made_again(ran):
    assert build() and steps_of(ran)
    shutil.rmtree(next(Path("runs/train").iterdir()))
    assert build() and steps_of(ran) == ["train"]
    Path("small.toml").write_text(TOML + "samples = 9\n")
    assert build() and len(steps_of(ran)) == 8
    Path("small.toml").write_text(TOML)
    assert build() and steps_of(ran) == []


@pytest.mark.slow
def test_links_lead_to_the_results_of_the_newest_config(ran):
    assert build()
    before = Path("runs/small/metrics.json").resolve()
    Path("small.toml").write_text(TOML + "[evaluate]\nviews = 5\n")
    assert build() and Path("runs/small/metrics.json").resolve() != before
    Path("small.toml").write_text(TOML)
    assert build() and Path("runs/small/metrics.json").resolve() == before
    Path("runs").rename("elsewhere")
    assert Path("elsewhere/small/metrics.json").read_text() == "evaluate"


@pytest.mark.slow
def test_a_failing_step_stops_only_what_needs_it(ran, capfd):
    Path("broken").touch()
    assert not build()
    steps = steps_of(ran)
    assert steps.count("sample/bee") == 1 and "shard/ape" in steps
    assert not {"shard/bee", "train", "evaluate"} & set(steps)
    assert "FAILED sample/bee: ValueError: bee.ply is broken" in capfd.readouterr().err
    Path("broken").unlink()
    assert build() and set(steps_of(ran)) == {"sample/bee", "shard/bee", "train", "evaluate"}


@pytest.mark.slow
def test_a_result_that_a_stage_did_not_write_is_a_failure(ran, monkeypatch):
    monkeypatch.setattr(z2p_renderer.workflows.stages.Train, "make", lambda task, out: None)
    assert not build()


def test_a_task_whose_inputs_changed_is_another_task(ran):
    config = parse_config(Path("small.toml").read_text())
    changed = parse_config(Path("small.toml").read_text() + "samples = 9\n")
    ids = [create_task(make_plan(c).steps["render/ape/0-2"], "{}", "runs").task_id for c in (config, changed)]
    assert ids[0] != ids[1]


@pytest.mark.slow
def test_code_edited_after_planning_is_refused(ran, monkeypatch, capfd):
    assert build() and steps_of(ran)
    shutil.rmtree(next(Path("runs/train").iterdir()))
    monkeypatch.setattr(stage_dependencies, "current_part_digest", lambda part: f"other {part}")
    assert not build() and steps_of(ran) == []
    assert "FAILED train: ConfigError: train: workflows.stages:Train changed since" in capfd.readouterr().err


@pytest.mark.parametrize(
    ("step", "group", "name"),
    [("sample/ape", "samplers", "uniform"), ("render/ape/0-2", "controls", "color"), ("train", "encoders", "none"),
     ("evaluate", "engines", "torch"), ("shard/bee", "controls", "light")],
)  # fmt: skip
def test_a_plugin_edited_after_planning_is_refused(ran, monkeypatch, tmp_path, step, group, name):
    """What it makes would be kept under another's fingerprint."""
    source = workflows.FullPipeline(config="small.toml").source
    load_pipeline_plan.cache_clear()
    steps = load_pipeline_plan(source).steps
    task = create_task(steps[step], source, str(tmp_path / "runs"))
    task._check_code()
    edited = tmp_path / "edited.py"
    plugin = registry.load(group, name)
    original = inspect.getsourcefile(plugin)
    edited.write_text(Path(original).read_text() + "\nEDITED = True\n")
    real = inspect.getsourcefile
    monkeypatch.setattr(inspect, "getsourcefile", lambda one: str(edited) if one is plugin else real(one))
    with pytest.raises(ConfigError, match=f"{step}: plugin {name} changed since the pipeline started"):
        task._check_code()


@pytest.mark.parametrize("name", ["start", "teacher"])
@pytest.mark.parametrize("edit", [lambda path: path.write_bytes(b"others"), Path.unlink])
def test_pretrained_weights_edited_after_planning_are_refused(ran, monkeypatch, tmp_path, name, edit):
    weights = tmp_path / "known.safetensors"
    shutil.copyfile(find_weights("regular"), weights)
    (tmp_path / "small.toml").write_text(f"{TOML}[train]\n{name} = 'known.safetensors'\n")
    source = workflows.FullPipeline(config="small.toml").source
    load_pipeline_plan.cache_clear()
    task = create_task(load_pipeline_plan(source).steps["train"], source, str(tmp_path / "runs"))
    weights.touch()
    task._check_code()
    edit(weights)
    with pytest.raises(ConfigError, match=r"known\.safetensors: the file changed since the pipeline started"):
        task._check_code()


def test_kernels_compiled_from_other_sources_are_refused(ran, monkeypatch, tmp_path):
    """The fingerprint holds the C files, and what runs is another thing."""
    source = workflows.FullPipeline(config="small.toml").source
    load_pipeline_plan.cache_clear()
    steps = load_pipeline_plan(source).steps
    shard, train = (create_task(steps[name], source, str(tmp_path / "runs")) for name in ("shard/ape", "train"))
    monkeypatch.setattr(z2p_renderer.workflows.stage_task, "are_kernels_outdated", lambda: False)
    train._check_code()
    monkeypatch.setattr(z2p_renderer.workflows.stage_task, "are_kernels_outdated", lambda: True)
    shard._check_code()  # it draws nothing
    with pytest.raises(ConfigError, match=r"train: the compiled kernels are not .*install z2p again"):
        train._check_code()


def test_the_safety_settings_apply_on_import():
    config = luigi.configuration.get_config()
    codes = [config.getint("retcode", name) for name in ("task_failed", "scheduling_error", "not_run", "missing_data")]
    assert all(codes) and config.getboolean("worker", "check_complete_on_run")


def test_views_of_other_chunks_are_copied_unless_damaged(ran, tmp_path):
    source = workflows.FullPipeline(config="small.toml").source
    load_pipeline_plan.cache_clear()
    store = Store(tmp_path / "runs")
    plan = load_pipeline_plan(source)

    def write(folder: Path) -> None:
        for index in (0, 1):
            for suffix in (".json", ".png", ".coverage.png"):
                (folder / f"view_{index:05d}{suffix}").write_text(f"{index}{suffix}")

    folder = store.produce(plan.steps["render/ape/0-2"].entry, write)
    (folder / "view_00000.png").write_text("!.png")  # the same size: only its digest tells
    (tmp_path / "small.toml").write_text(TOML.replace("chunk = 2", "chunk = 3"))
    load_pipeline_plan.cache_clear()
    (tmp_path / "out").mkdir()
    copy_existing_views(store, load_pipeline_plan(source).steps["render/ape/0-3"].entry, range(3), tmp_path / "out")
    copied = {path.name: path.read_text() for path in (tmp_path / "out").iterdir()}
    assert set(copied) == {"view_00001.json", "view_00001.png", "view_00001.coverage.png"}
    assert all(text == f"{int(name[5:10])}{name[10:]}" for name, text in copied.items())


@pytest.mark.slow
def test_links_work_in_a_workspace_that_is_a_link_itself(ran, tmp_path):
    (tmp_path / "far" / "away").mkdir(parents=True)
    Path("runs").symlink_to(tmp_path / "far" / "away")
    assert build() and steps_of(ran)
    assert Path("runs/small/metrics.json").read_text() == "evaluate"
    assert build() and steps_of(ran) == []
