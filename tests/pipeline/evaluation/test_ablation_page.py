"""Variants side by side: paired differences, what chance forbids to say, and files that agree with one another."""

from __future__ import annotations

import csv
import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from PIL import Image

from z2p_core.config.ablation import AblationsConfig, parse_ablations
from z2p_renderer.pipeline.evaluation.ablation.outcomes import (
    BETTER,
    NO_DIFFERENCE,
    WORSE,
    MetricDifference,
    paired_difference,
    read_curve,
    read_variant_results,
    seed_variation,
    training_seconds,
)
from z2p_renderer.pipeline.evaluation.ablation.page import write_ablations
from z2p_renderer.storage.models.checkpoints import load_weights

CONFIG = parse_ablations("""name = "small"
[train]
steps = 40
batch = 3
[variants.up]
title = "better one"
why = "hope"
train.loss.ssim = 1.0
[variants.down]
title = "worse one"
why = "fear"
train.loss.ssim = 0.0
[variants.same]
title = "idle one"
why = "doubt"
train.loss.alpha_l1 = 2.0
[variants.again]
title = "another seed"
why = "chance"
train.seed = 1
""")
SHIFTS = {"base": 0.0, "up": 1.0, "down": -2.0, "same": 0.2, "again": -0.3}
COMMAND = "z2p ablate --meshes m"


def results(folder: Path, weights: Path, shift: float) -> tuple[Path, Path]:
    """A training's and an evaluation's folder, with figures moved by `shift` dB."""
    train, evaluate = folder / "train" / "t", folder / "evaluate" / "e"
    train.mkdir(parents=True)
    evaluate.mkdir(parents=True)
    shutil.copy(weights, train / "weights.safetensors")
    (train / "task.log").write_text("12:00:00 train/x: started\n12:00:09 train/x: done in 9.5 s\n")
    (train / "curve.csv").write_text(f"step,samples,validation_psnr_foreground\n1,3,\n2,6,{20 + shift}\n4,12,22\n")
    rows = [
        {"mesh": mesh, "seed": 0, "view": view, "psnr_foreground": level + view + shift, "psnr_white": 30.0 + shift,
         "ssim": 0.9, "flip": 0.1, "alpha_l1": 0.01, "shadow_l1": None}
        for mesh, level in (("cow", 20.0), ("ape", 25.0)) for view in range(2)
    ]  # fmt: skip
    means = {"psnr_foreground": 23.0 + shift, "psnr_white": 30.0 + shift, "ssim": 0.9, "flip": 0.1, "seconds": 0.02}
    (evaluate / "metrics.json").write_text(json.dumps({"means": means, "rows": rows}))
    return train, evaluate


@pytest.fixture(scope="module")
def weights(make_weights: Callable[..., Path]) -> Path:
    return make_weights()


@pytest.fixture
def folders(tmp_path: Path, weights: Path) -> dict[str, tuple[Path, Path]]:
    return {name: results(tmp_path / name, weights, shift) for name, shift in SHIFTS.items()}


def test_differences_are_paired_with_error_over_meshes() -> None:
    base = {("a", 0, 0): {"x": 1.0}, ("a", 0, 1): {"x": 2.0}, ("b", 0, 0): {"x": 9.0}, ("b", 0, 1): {"x": None}}
    own = {("a", 0, 0): {"x": 2.0}, ("a", 0, 1): {"x": 5.0}, ("b", 0, 0): {"x": 13.0}, ("b", 0, 1): {"x": 1.0}}
    measured = paired_difference(own, base, "x")
    assert measured is not None and measured.mean == pytest.approx(3.0)  # of a: (1 + 3) / 2, of b: 4
    assert measured.error == pytest.approx(1.0)
    one = paired_difference({("a", 0, 0): {"x": 2.0}}, base, "x")
    assert one is not None and (one.mean, one.error) == (1.0, None)
    assert paired_difference(own, base, "y") is None


def test_difference_within_seed_variation_is_no_win(folders: dict[str, tuple[Path, Path]]) -> None:
    outcomes = read_variant_results(CONFIG, folders)
    chance = seed_variation(outcomes)
    assert chance == pytest.approx(0.3)
    verdicts = {one.variant.name: one.verdict(chance) for one in outcomes}
    assert verdicts == {
        "base": NO_DIFFERENCE,
        "up": BETTER,
        "down": WORSE,
        "same": NO_DIFFERENCE,
        "again": NO_DIFFERENCE,
    }
    assert outcomes[3].verdict(None) == BETTER  # without another seed only the meshes' spread speaks against it
    assert seed_variation(outcomes[:4]) is None


def test_one_mesh_and_one_seed_give_no_verdict(folders: dict[str, tuple[Path, Path]]) -> None:
    one = read_variant_results(CONFIG, folders)[2]
    alone = replace(one, differences={"psnr_foreground": MetricDifference(-2.0, None)})
    assert alone.verdict(None) == NO_DIFFERENCE and alone.verdict(0.3) == WORSE


def test_size_samples_and_seconds_are_those_of_the_run(folders: dict[str, tuple[Path, Path]], weights: Path) -> None:
    base = read_variant_results(CONFIG, folders)[0]
    assert base.weights == sum(tensor.size for tensor in load_weights(weights).tensors.values())
    assert (base.samples, base.seconds) == (120, 9.5)
    assert list(base.curve) == [(6.0, 20.0), (12.0, 22.0)] == read_curve(folders["base"][0] / "curve.csv")


def test_resumed_training_has_no_seconds(tmp_path: Path) -> None:
    log = tmp_path / "task.log"
    assert training_seconds(log) is None
    log.write_text("a: started\na: started\na: done in 3.0 s\n")
    assert training_seconds(log) is None


def test_page_csv_and_json_say_the_same(folders: dict[str, tuple[Path, Path]], tmp_path: Path) -> None:
    out = tmp_path / "out"
    assert {path.name for path in write_ablations(CONFIG, folders, COMMAND, out)} == {
        "ablations.md", "ablations.csv", "ablations.json", "curves.png"}  # fmt: skip
    content = json.loads((out / "ablations.json").read_text())
    with (out / "ablations.csv").open() as file:
        rows = list(csv.DictReader(file))
    page = (out / "ablations.md").read_text()
    assert content["command"] == COMMAND and COMMAND in page and "120 samples (40 steps of 3)" in page
    assert [row["name"] for row in rows] == [one["name"] for one in content["variants"]] == list(SHIFTS)
    for row, one in zip(rows, content["variants"], strict=True):
        assert row["train"] == one["results"][0] == "train/t"
        assert f"| {one['title']} |" in page and row["title"] == one["title"]
        if one["name"] != "base":
            assert one["why"] in page
            assert float(row["psnr_foreground_difference"]) == one["differences"]["psnr_foreground"]["mean"]
    assert "- better: better one (+1.00 ± 0.00 dB)" in page and "- worse: worse one (-2.00 ± 0.00 dB)" in page
    assert "- no difference that can be told: idle one" in page and "1 other seed moved the base by: 0.30 dB" in page
    assert "`loss.ssim` 0.2 → 1.0" in page
    with Image.open(out / "curves.png") as picture:
        assert picture.width > 1000


def test_page_says_that_seed_variation_is_unknown(folders: dict[str, tuple[Path, Path]], tmp_path: Path) -> None:
    write_ablations(AblationsConfig(CONFIG.base, CONFIG.variants[:2]), folders, COMMAND, tmp_path)
    assert "No other seed was tried" in (tmp_path / "ablations.md").read_text()
