"""Ablations at their smallest, with real Blender: what they leave, and that a changed variant alone runs again."""

from __future__ import annotations

import csv
import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from world import CONFIG as SMALL
from world import World, made

import z2p_renderer.workflows.ablation.plan
from z2p_core.config import ConfigError, PipelineConfig, from_dict, parse_config, to_dict
from z2p_core.registry import PluginError
from z2p_renderer.storage.results.store import Store
from z2p_renderer.workflows.ablation.plan import load_ablation_plan
from z2p_renderer.workflows.plan import make_plan
from z2p_renderer.workflows.plan_loading import load_pipeline_plan
from z2p_renderer.workflows.sources import ablation_source, variant_source
from z2p_renderer.workflows.upkeep.garbage_collection import find_garbage

CONFIGS = Path(__file__).parents[3] / "configs"
VARIANTS = """
[variants.input]
title = "settings as input channels"
why = "the plain way"
train.network.conditioning = "input"
[variants.no-ssim]
title = "no SSIM"
why = "is it worth its time?"
train.loss.ssim = 0.0
"""
OWN = {f"{stage}/{variant}" for stage in ("train", "evaluate") for variant in ("base", "input", "no-ssim")}
SHARED = {"sample/tetra", "sample/pyramid", "render/tetra/0-2", "render/pyramid/0-2", "shard/tetra", "shard/pyramid"}
RENDERS = ("sample", "render")


class Ablated(World):
    """A small world whose pipelines are ablations."""

    def command(self, *more: str) -> list[str]:
        return [sys.executable, "-m", "z2p_renderer.pipeline.cli", "ablate", *self.options, *more]


def world_at(root: Path, variants: str = VARIANTS) -> Ablated:
    found = Ablated(root, code=False)
    (root / "small.toml").write_text(SMALL.replace("resolution = 16", "resolution = 32") + variants)
    return found


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> tuple[Ablated, str]:
    """A world and what its first run said."""
    world = world_at(tmp_path_factory.mktemp("ablations"))
    status, said = world.run()
    assert status == 0, said
    return world, said


@pytest.mark.slow
def test_each_variant_is_trained_on_shared_shards(finished: tuple[Ablated, str]) -> None:
    world, said = finished
    assert set(made(said)) == SHARED | OWN | {"compare"}
    shown = world.workspace / "small"
    assert {path.name for path in shown.iterdir()} == {"ablations.md", "ablations.csv", "ablations.json", "curves.png"}
    told = json.loads((shown / "ablations.json").read_text())
    assert [one["name"] for one in told["variants"]] == ["base", "input", "no-ssim"]
    base, by_input, _ = told["variants"]
    assert {one["verdict"] for one in told["variants"][1:]} == {"no difference that can be told"}  # one mesh, one seed
    assert base["differences"] == {} and by_input["weights"] < base["weights"]  # no mapping, no affine layers
    for one in told["variants"]:
        assert one["samples"] == 8 and one["train_seconds"] > 0 and one["means"]["psnr_foreground"] > 0
        assert all((world.workspace / folder / "manifest.json").is_file() for folder in one["results"])
    assert told["command"] == "z2p ablate --config small.toml --meshes meshes --evaluate-meshes kept"
    with (shown / "ablations.csv").open() as file:
        assert len(list(csv.DictReader(file))) == 3


@pytest.mark.slow
def test_a_second_run_runs_nothing_and_gc_keeps_what_it_made(finished: tuple[Ablated, str]) -> None:
    world, _ = finished
    status, said = world.run()
    assert (status, made(said)) == (0, []) and "up to date" in said
    assert find_garbage(Store(world.workspace)) == []


@pytest.mark.slow
def test_a_changed_variant_runs_again_alone(finished: tuple[Ablated, str]) -> None:
    world, _ = finished
    config = world.root / "small.toml"
    before = config.read_text()
    config.write_text(before.replace("train.loss.ssim = 0.0", "train.loss.ssim = 0.1"))
    dry = subprocess.run(world.command("--dry-run"), cwd=world.root, env=world.environment, capture_output=True,
                         text=True, check=True)  # fmt: skip
    assert "a run would make 3 of 13 results" in dry.stderr and "loss.ssim" in dry.stderr
    assert world.make() == ["compare", "evaluate/no-ssim", "train/no-ssim"]
    config.write_text(before)
    assert world.make() == []  # the earlier variant's results are still there
    config.write_text(before.replace("is it worth", "is that worth"))
    assert world.make() == ["compare"]


@pytest.mark.slow
def test_a_mistake_is_one_line_before_anything_runs(tmp_path: Path) -> None:
    world = world_at(tmp_path, VARIANTS + "train.loss.sim = 1\n")
    status, said = world.run()
    assert status == 35 and not world.workspace.exists() and "Traceback" not in said
    assert "variants.no-ssim: train: loss: unknown key 'sim'; known: color_l2" in said


@pytest.fixture
def plain(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Plans made anew."""
    monkeypatch.setattr(z2p_renderer.workflows.ablation.plan, "log_line", lambda line: None)
    for cached in (load_pipeline_plan, load_ablation_plan):
        cached.cache_clear()
    yield
    for cached in (load_pipeline_plan, load_ablation_plan):
        cached.cache_clear()


@pytest.mark.usefixtures("plain")
def test_shipped_ablations_use_the_renders_of_regular() -> None:
    regular = make_plan(parse_config((CONFIGS / "regular.toml").read_text()))
    plan = load_ablation_plan(ablation_source("", "", ""))
    prints = {name: step.entry.fingerprint for name, step in plan.steps.items() if step.entry.stage in RENDERS}
    assert prints == {name: step.entry.fingerprint for name, step in regular.steps.items()
                      if step.entry.stage in RENDERS}  # fmt: skip
    assert len({step.entry.fingerprint for step in plan.steps.values()}) == len(plan.steps)  # no two variants alike


@pytest.mark.usefixtures("plain")
def test_a_variants_plan_equals_its_full_pipelines_plan() -> None:
    source = ablation_source("", "", "")
    ablations = load_ablation_plan(source).config
    for variant in ablations.variants[:3]:
        plan = load_pipeline_plan(variant_source(source, variant.name))
        alone = make_plan(from_dict(PipelineConfig, to_dict(variant.config)))
        assert plan.config == alone.config
        for stage in ("train", "evaluate"):
            own = plan.steps[f"{stage}/{variant.name}"]
            assert own.entry.fingerprint == alone.steps[stage].entry.fingerprint
            assert set(own.upstream) <= set(plan.steps)


@pytest.mark.usefixtures("plain")
def test_a_missing_config_is_named() -> None:
    with pytest.raises(ConfigError, match=r"expected a TOML file, got .*nowhere.toml"):
        load_ablation_plan(ablation_source("nowhere.toml", "", ""))


@pytest.mark.usefixtures("plain")
@pytest.mark.parametrize("change, error, message", [
    ('noise = "gausian"', ConfigError, r"train\.noise: expected one of .*, got 'gausian'"),
    ("even = 3.0", ConfigError, r"train\.even: expected a number from 0 to 1"),
    ('teacher = "nosuch"', ConfigError, r"train\.teacher: unknown weights 'nosuch'"),
    ('network.encoder = "nosuch"', PluginError, r"train\.network\.encoder: expected an installed .*, got 'nosuch'"),
])  # fmt: skip
def test_a_variant_that_cannot_work_is_refused_by_name(
    tmp_path: Path, change: str, error: type[Exception], message: str
) -> None:
    config = tmp_path / "ablations.toml"
    config.write_text(f'[variants.odd]\ntitle = "odd"\nwhy = "to be refused"\ntrain.{change}\n')
    with pytest.raises(error, match=rf"variants\.odd: {message}"):
        load_ablation_plan(ablation_source(str(config), "", ""))
