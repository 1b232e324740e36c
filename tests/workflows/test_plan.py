"""What runs again: each change makes exactly the steps stale that depend on it. The expected sets are hand-written."""

import dataclasses
from dataclasses import replace
from pathlib import Path

import pytest
from editing import edited

import z2p_renderer.storage.results.fingerprints
import z2p_renderer.workflows.plan
import z2p_renderer.workflows.pretrained_weights
from z2p_core import registry
from z2p_core.config import PipelineConfig
from z2p_renderer.storage.results.code_digest import module_file
from z2p_renderer.workflows.plan import Plan, assemble_plan, make_plan

CONFIGS = Path(__file__).parents[2] / "configs"

SAMPLES = {"sample/ape", "sample/bee"}
RENDERS = {"render/ape/0-10", "render/ape/10-12", "render/bee/0-10", "render/bee/10-12"}
SHARDS = {"shard/ape", "shard/bee"}
AFTER_SHARDS = {"train", "evaluate"}
EVERYTHING = SAMPLES | RENDERS | SHARDS | AFTER_SHARDS


def prints(plan: Plan) -> dict[str, str]:
    return {name: step.entry.fingerprint for name, step in plan.steps.items()}


def stale(before: Plan, after: Plan) -> set[str]:
    """Steps of `after` whose results `before` did not make under any name."""
    known = set(prints(before).values())
    return {name for name, fingerprint in prints(after).items() if fingerprint not in known}


def test_the_plan_has_every_step_upstream_first(config):
    steps = make_plan(config).steps
    assert set(steps) == EVERYTHING
    seen = set()
    for name, step in steps.items():
        assert set(step.upstream) <= seen
        seen.add(name)
    assert steps["shard/bee"].upstream == ("sample/bee", "render/bee/0-10", "render/bee/10-12")
    assert steps["render/bee/10-12"].views == (10, 12)
    assert set(steps["train"].upstream) == SHARDS
    assert len(set(prints(make_plan(config)).values())) == len(EVERYTHING)


EFFECTS = {
    "name": ("other", set()),
    "sample.sampler": ("grid", SAMPLES | SHARDS | AFTER_SHARDS),
    "sample.points": (40_000, SAMPLES | SHARDS | AFTER_SHARDS),
    "sample.seed": (1, SAMPLES | SHARDS | AFTER_SHARDS),
    "render.controls": (("color", "light", "elevation", "roughness"), RENDERS | SHARDS | AFTER_SHARDS),
    "render.views": (13, {"render/ape/10-13", "render/bee/10-13"} | SHARDS | AFTER_SHARDS),
    "render.chunk": (5, {f"render/{m}/{c}" for m in ("ape", "bee") for c in ("0-5", "5-10")}),
    "render.resolution": (256, RENDERS | SHARDS | AFTER_SHARDS),
    "render.samples": (5, RENDERS | SHARDS | AFTER_SHARDS),
    "render.denoise": ("off", RENDERS | SHARDS | AFTER_SHARDS),
    "render.bounces": (4, RENDERS | SHARDS | AFTER_SHARDS),
    "render.upright": (1.0, RENDERS | SHARDS | AFTER_SHARDS),
    "render.passes": (("depth",), RENDERS | SHARDS | AFTER_SHARDS),
    "render.seed": (1, RENDERS | SHARDS | AFTER_SHARDS),
    "render.textures": (("stripes",), RENDERS | SHARDS | AFTER_SHARDS),
    "render.textured_share": (0.5, RENDERS | SHARDS | AFTER_SHARDS),
    "shard.resolution": (64, SHARDS | AFTER_SHARDS),
    "train.network.kind": ("adain_unet", AFTER_SHARDS),
    "train.network.widths": ((32, 32), AFTER_SHARDS),
    "train.network.unshuffle": (2, AFTER_SHARDS),
    "train.network.fine": (8, AFTER_SHARDS),
    "train.network.refine": (8, AFTER_SHARDS),
    "train.network.mapping": (64, AFTER_SHARDS),
    "train.network.conditioning": ("input", AFTER_SHARDS),
    "train.network.zbuffer": ("paper", AFTER_SHARDS),
    "train.network.gbuffer": ("none", AFTER_SHARDS),
    "train.network.encoder": ("fourier", AFTER_SHARDS),
    "train.network.conditions": (("albedo",), AFTER_SHARDS),
    "train.loss.color_l2": (1.0, AFTER_SHARDS),
    "train.loss.magnitude_l1": (1.0, AFTER_SHARDS),
    "train.loss.alpha_l1": (0.7, AFTER_SHARDS),
    "train.loss.color_l1": (0.5, AFTER_SHARDS),
    "train.loss.ssim": (0.0, AFTER_SHARDS),
    "train.loss.gradient_l1": (0.0, AFTER_SHARDS),
    "train.loss.visible": (1.0, AFTER_SHARDS),
    "train.loss.flip": (1.0, AFTER_SHARDS),
    "train.loss.foreground": (2.0, AFTER_SHARDS),
    "train.loss.masked": (True, AFTER_SHARDS),
    "train.start": ("regular", AFTER_SHARDS),
    "train.teacher": ("regular", AFTER_SHARDS),
    "train.teacher_share": (0.3, AFTER_SHARDS),
    "train.haze": (0.001, AFTER_SHARDS),
    "train.resolutions": ((64, 128), AFTER_SHARDS),
    "train.steps": (151, AFTER_SHARDS),
    "train.batch": (4, AFTER_SHARDS),
    "train.learning_rate": (2e-3, AFTER_SHARDS),
    "train.warmup": (10, AFTER_SHARDS),
    "train.points": ((5_000, 5_000), AFTER_SHARDS),
    "train.reuse": (3, AFTER_SHARDS),
    "train.even": (0.5, AFTER_SHARDS),
    "train.holes": (0.5, AFTER_SHARDS),
    "train.mirror": (True, AFTER_SHARDS),
    "train.noise": ("gaussian", AFTER_SHARDS),
    "train.noise_scale": (0.01, AFTER_SHARDS),
    "train.cropped": (True, AFTER_SHARDS),
    "train.average": (0.0, AFTER_SHARDS),
    "train.validate_every": (50, AFTER_SHARDS),
    "train.validation_share": (0.1, AFTER_SHARDS),
    "train.checkpoint_every": (10, set()),
    "train.seed": (1, AFTER_SHARDS),
    "evaluate.views": (3, {"evaluate"}),
    "evaluate.points": (4_000, {"evaluate"}),
    "evaluate.noise": (0.01, {"evaluate"}),
    "evaluate.sampler": ("grid", {"evaluate"}),
    "evaluate.resolution": (64, {"evaluate"}),
    "evaluate.samples": (8, {"evaluate"}),
    "evaluate.denoise": ("fast", {"evaluate"}),
    "evaluate.elevation": (None, {"evaluate"}),
    "evaluate.bounces": (1, {"evaluate"}),
    "evaluate.supersample": (2, {"evaluate"}),
    "evaluate.seed": (1, {"evaluate"}),
    "evaluate.seeds": (2, {"evaluate"}),
    "evaluate.textures": (("stripes",), {"evaluate"}),
}


def before(config, path):
    """The config in which the value at a dotted path may be replaced by the one in `EFFECTS`."""
    if path in ("render.textured_share", "train.network.conditions"):
        return edited(config, "render.textures", ("spots",))
    return edited(config, "train.network.unshuffle", 1) if path == "train.network.kind" else config


@pytest.mark.parametrize("path", EFFECTS)
def test_a_parameter_makes_exactly_what_depends_on_it_stale(config, path):
    value, expected = EFFECTS[path]
    config = before(config, path)
    changed = edited(config, path, value)
    assert changed != config
    assert stale(make_plan(config), make_plan(changed)) == expected


def test_every_parameter_is_in_the_table():
    def leaves(kind, prefix=""):
        for field in dataclasses.fields(kind):
            value = getattr(kind, field.name)
            yield from leaves(value, f"{prefix}{field.name}.") if dataclasses.is_dataclass(value) else [
                prefix + field.name
            ]

    assert set(leaves(PipelineConfig())) == set(EFFECTS) | {"meshes", "evaluate_meshes"}


def test_no_textures_leave_no_trace_in_the_fingerprint(config):
    plain, colored = (make_plan(edited(config, "evaluate.textures", value)) for value in ((), ("stripes",)))
    assert "textures" not in plain.steps["evaluate"].entry.fields["parameters"]
    assert colored.steps["evaluate"].entry.fields["parameters"]["textures"][0]["name"] == "stripes"
    renders = make_plan(config).steps["render/ape/0-10"].entry
    assert renders.stage == "render" and not {"textures", "textured_share"} & set(renders.fields["parameters"])
    assert "conditions" not in make_plan(config).steps["train"].entry.fields["parameters"]["network"]


def test_another_engine_of_the_teacher_trains_again(config, monkeypatch):
    taught = edited(config, "train.teacher", "regular")
    before, without = make_plan(taught), make_plan(config)
    monkeypatch.setattr(z2p_renderer.workflows.pretrained_weights, "teacher_engine", lambda: None)
    assert stale(before, make_plan(taught)) == AFTER_SHARDS
    assert stale(without, make_plan(config)) == set()


@pytest.mark.parametrize("key", ["version", "code"])
def test_a_plugin_that_only_the_teacher_uses_trains_again(config, monkeypatch, key):
    bare = edited(config, "train.network.gbuffer", "none")
    taught = edited(bare, "train.teacher", "regular")
    before, without = make_plan(taught), make_plan(bare)
    fields = z2p_renderer.workflows.pretrained_weights.plugin_fields
    changed = lambda plugin: fields(plugin) | ({key: "other"} if plugin.name == "surfels" else {})  # noqa: E731
    for module in (z2p_renderer.workflows.plan, z2p_renderer.workflows.pretrained_weights):
        monkeypatch.setattr(module, "plugin_fields", changed)
    assert stale(before, make_plan(taught)) == AFTER_SHARDS
    assert stale(without, make_plan(bare)) == set()


def test_plugins_that_the_teacher_shares_are_told_once(config):
    fields = make_plan(edited(config, "train.teacher", "regular")).steps["train"].entry.fields
    assert "teacher_plugins" not in fields["parameters"]  # trainings of before it was told can be adopted


def test_more_views_keep_every_finished_chunk(config):
    before, after = prints(make_plan(config)), prints(make_plan(edited(config, "render.views", 30)))
    assert after["render/ape/0-10"] == before["render/ape/0-10"]
    assert {name for name in after if name.startswith("render/ape")} == {
        "render/ape/0-10", "render/ape/10-20", "render/ape/20-30"
    }


def test_an_added_mesh_leaves_the_others_alone(config, meshes):
    before = make_plan(config)
    (meshes / "meshes" / "aardvark.ply").write_text("aardvark")
    new = {"sample/aardvark", "render/aardvark/0-10", "render/aardvark/10-12", "shard/aardvark"}
    assert stale(before, make_plan(config)) == new | AFTER_SHARDS


def test_an_edited_mesh_runs_its_own_chain(config, meshes):
    before = make_plan(config)
    (meshes / "meshes" / "bee.obj").write_text("bee, but larger")
    expected = {"sample/bee", "render/bee/0-10", "render/bee/10-12", "shard/bee"} | AFTER_SHARDS
    assert stale(before, make_plan(config)) == expected


def test_an_edited_mesh_kept_aside_is_measured_again_only(config, meshes):
    before = make_plan(config)
    (meshes / "kept" / "cow.ply").write_text("cow, but larger")
    assert stale(before, make_plan(config)) == {"evaluate"}


def test_renaming_touching_and_moving_meshes_runs_nothing(config, meshes):
    before = make_plan(config)
    (meshes / "meshes" / "ape.ply").touch()
    (meshes / "meshes" / "bee.obj").rename(meshes / "meshes" / "aa.obj")
    (meshes / "meshes").rename(meshes / "elsewhere")
    after = make_plan(replace(config, meshes=str(meshes / "elsewhere")))
    assert "shard/aa" in after.steps and stale(before, after) == set()


def test_a_renamed_mesh_kept_aside_is_measured_again_only(config, meshes):
    """The rows of its metrics bear the name."""
    before = make_plan(config)
    (meshes / "kept" / "cow.ply").rename(meshes / "kept" / "ox.ply")
    assert stale(before, make_plan(config)) == {"evaluate"}


def test_the_same_mesh_twice_is_used_once_with_a_warning(config, meshes):
    (meshes / "meshes" / "copy.ply").write_text("ape")
    plan = make_plan(config)
    assert set(plan.steps) == EVERYTHING
    assert "copy" in plan.warnings[0] and "ape" in plan.warnings[0]


def test_two_meshes_of_one_stem_are_told_apart(config, meshes):
    (meshes / "meshes" / "ape.obj").write_text("another ape")
    assert {"shard/ape.ply", "shard/ape.obj", "shard/bee"} <= set(make_plan(config).steps)


def plugin_edit(tmp_path, monkeypatch, edit):
    """Make the elevation control come from an edited copy of its file."""
    import importlib.util

    text = module_file(registry.load("controls", "elevation").__module__).read_text()
    changed = edit(text)
    assert changed != text
    copy = tmp_path / "elevation_copy.py"
    copy.write_text(changed)
    spec = importlib.util.spec_from_file_location("elevation_copy", copy)
    module = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(__import__("sys").modules, "elevation_copy", module)
    spec.loader.exec_module(module)
    load = registry.load
    monkeypatch.setattr(
        z2p_renderer.workflows.plan.registry, "load",
        lambda group, name: module.Elevation if (group, name) == ("controls", "elevation") else load(group, name),
    )


def test_a_comment_in_a_plugin_changes_nothing(config, tmp_path, monkeypatch):
    before = make_plan(config)
    plugin_edit(tmp_path, monkeypatch, lambda text: "# a comment\n" + text.replace('"""Camera elevation', '"""The'))
    assert stale(before, make_plan(config)) == set()


@pytest.mark.parametrize("old, new", [('version = "1"', 'version = "2"'), ("(10.0, 35.0)", "(12.0, 35.0)")])
def test_a_control_plugins_version_or_code_reruns_its_users(config, tmp_path, monkeypatch, old, new):
    before = make_plan(config)
    plugin_edit(tmp_path, monkeypatch, lambda text: text.replace(old, new))
    assert stale(before, make_plan(config)) == RENDERS | SHARDS | AFTER_SHARDS


@pytest.mark.parametrize(
    "stage, expected",
    [
        ("shapes", set()),
        ("sample", SAMPLES | SHARDS | AFTER_SHARDS),
        ("render", RENDERS | SHARDS | AFTER_SHARDS),
        ("shard", SHARDS | AFTER_SHARDS),
        ("train", AFTER_SHARDS),
        ("evaluate", {"evaluate"}),
    ],
)
def test_a_stages_version_reruns_it_and_what_follows(config, monkeypatch, stage, expected):
    before = make_plan(config)
    monkeypatch.setitem(z2p_renderer.storage.results.fingerprints.STAGE_VERSIONS, stage, 99)
    assert stale(before, make_plan(config)) == expected


def test_built_in_shapes_come_from_one_step():
    plan = make_plan(PipelineConfig())
    assert plan.training and plan.evaluation
    assert not {mesh.name for mesh in plan.training} & {mesh.name for mesh in plan.evaluation}
    assert all("shapes" in step.upstream for step in plan.steps.values() if step.entry.stage in ("sample", "render"))
    assert "shapes" in plan.steps["evaluate"].upstream and not plan.warnings


def test_another_built_in_shape_leaves_the_others_alone(config):
    shapes = make_plan(PipelineConfig()).training
    before, after = assemble_plan(config, shapes[:1], shapes[1:2]), assemble_plan(config, shapes[:3], shapes[1:2])
    name = shapes[0].name
    assert prints(before)[f"shard/{name}"] == prints(after)[f"shard/{name}"]


def test_training_meshes_as_evaluation_meshes_give_a_warning(config):
    plan = make_plan(replace(config, evaluate_meshes=""))
    assert plan.evaluation == plan.training and "memory" in plan.warnings[0]
