"""Configs that cannot work are refused when they are planned; those that ship can be."""

from dataclasses import replace
from pathlib import Path

import pytest
from editing import edited

from z2p_core import registry
from z2p_core.config import ConfigError, PipelineConfig, parse_config
from z2p_core.interfaces import ScanError
from z2p_renderer.workflows.plan import list_meshes, make_plan

CONFIGS = Path(__file__).parents[2] / "configs"
PIPELINES = sorted(set(CONFIGS.glob("*.toml")) - set(CONFIGS.glob("report*.toml")) - {CONFIGS / "ablations.toml"})


@pytest.mark.parametrize(
    "path, value, message",
    [
        ("shard.resolution", 100, "divisor of render.resolution"),
        ("render.views", 0, "from 1 to"),
        ("render.chunk", 0, "from 1 to"),
        ("render.controls", ("color", "color"), "different"),
        ("render.denoise", "fst", r"render\.denoise: expected one of .*, got 'fst'"),
        ("render.passes", ("x",), r"render\.passes\[0\]: expected one of .*, got 'x'"),
        ("train.noise", "gausian", r"train\.noise: expected one of .*, got 'gausian'"),
        ("train.points", (500, 100), r"train\.points: expected 1 <= smallest"),
        ("train.resolutions", (100,), r"train\.resolutions: expected divisors"),
        ("train.reuse", 0, r"train\.reuse: expected a whole number from 1"),
        ("train.teacher_share", 1.5, r"train\.teacher_share: expected a number from 0 to 1"),
        ("train.network.kind", "adain_unet", "expected unshuffle = 1, got 4"),
        ("train.network.widths", (4096,) * 9, "at most 500,000,000 weights"),
        ("train.loss.alpha_l1", float("nan"), r"train\.loss\.alpha_l1: expected a number"),
        ("evaluate.views", 0, r"evaluate\.views: expected a whole number from 1"),
        ("sample.points", 10**10, r"sample\.points: expected a whole number from 1 to"),
        ("name", "../up", "folder name"),
        ("name", "train", "another name"),
    ],
)
def test_a_config_that_cannot_work_is_refused(config, path, value, message):
    with pytest.raises(ConfigError, match=message):
        make_plan(edited(config, path, value))


@pytest.mark.parametrize(
    "path", ["render.controls", "sample.sampler", "train.network.zbuffer", "train.network.encoder", "evaluate.sampler"]
)
def test_an_unknown_plugin_is_refused_before_anything_runs(config, path):
    value = ("metalic",) if path == "render.controls" else "metalic"
    with pytest.raises(registry.PluginError, match="metalic"):
        make_plan(edited(config, path, value))


def test_a_single_render_is_too_few_to_train_on(config, meshes):
    config = edited(config, "render.views", 1)
    assert make_plan(config), "one of each of two meshes will do"
    (meshes / "meshes" / "bee.obj").unlink()
    with pytest.raises(ConfigError, match=r"render\.views: expected two renders or more in all"):
        make_plan(config)


@pytest.mark.parametrize("field", ["start", "teacher"])
def test_weights_to_learn_from_that_are_not_there_are_refused(config, field):
    with pytest.raises(ConfigError, match=rf"train\.{field}: unknown weights 'nosuch'; shipped: "):
        make_plan(edited(config, f"train.{field}", "nosuch"))


@pytest.mark.parametrize("field, weights, message", [
    ("start", "material", "got color, light, elevation, metallic, roughness in material"),
    ("teacher", "material", "got color, light, elevation, metallic, roughness in material"),
    ("teacher", "regular", "color, light, elevation, metallic, got color, light, elevation in regular"),
])  # fmt: skip
def test_pretrained_weights_with_other_controls_are_refused(
    config, field, weights, message
):
    if weights == "regular":
        config = edited(config, "render.controls", ("color", "light", "elevation", "metallic"))
        assert make_plan(edited(config, "train.start", weights))  # the last of the controls is learnt
    with pytest.raises(ConfigError, match=rf"train\.{field}: expected weights whose controls are .*{message}"):
        make_plan(edited(config, f"train.{field}", weights))


@pytest.mark.parametrize("folder, message", [("nowhere", "no folder"), ("", "no mesh")])
def test_a_folder_without_meshes_is_refused(tmp_path, folder, message):
    (tmp_path / "readme.txt").write_text("no mesh")
    with pytest.raises(ScanError, match=message):
        list_meshes(tmp_path / folder)


def test_quick_toml_spells_out_the_defaults():
    assert parse_config((CONFIGS / "quick.toml").read_text()) == PipelineConfig()


@pytest.mark.parametrize("path", PIPELINES, ids=lambda path: path.stem)
def test_every_shipped_config_can_be_planned(path, meshes, monkeypatch):
    monkeypatch.chdir(meshes)
    config = parse_config(path.read_text(), path.name)
    assert config.name == path.stem and (config.meshes, config.evaluate_meshes) == ("builtin", "")
    assert make_plan(replace(config, meshes=str(meshes / "meshes"))).steps["evaluate"]
