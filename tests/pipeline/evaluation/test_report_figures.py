"""What the report's figures mean: gains, kept contrast, maps of doubt, winners, and the first paragraph."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from z2p_core.config.report import ReportConfig
from z2p_renderer.pipeline.evaluation.paper.capability_table import assess_capabilities
from z2p_renderer.pipeline.evaluation.paper.measure import ROWS_FILE, contrast_kept, least_squares_gain
from z2p_renderer.pipeline.evaluation.paper.methods import Method
from z2p_renderer.pipeline.evaluation.paper.page.report import _list_missing_parts
from z2p_renderer.pipeline.evaluation.paper.page.results import Results, compare_best, read_results
from z2p_renderer.pipeline.evaluation.paper.page.summary import summarize
from z2p_renderer.pipeline.evaluation.paper.page.tables import level_table, means_table, uncertainty_table
from z2p_renderer.pipeline.evaluation.paper.uncertainty import score_map
from z2p_renderer.storage.models.checkpoints import load_weights, save_weights

METHODS = (Method("regular", "weights", "regular"), Method("bpa", "baseline", "bpa"))


def row(sweep: str, level: str, method: str, object_psnr: float, **more: object) -> dict[str, object]:
    figures = {"psnr_foreground": object_psnr, "psnr_white": object_psnr + 2, "ssim": object_psnr / 40,
               "flip": 1 / object_psnr, "alpha_l1": 0.1, "shadow_l1": 0.1, "shadow_kept": 0.8}  # fmt: skip
    return {"sweep": sweep, "level": level, "method": method, "mesh": "cow", "view": 0, "result": "measure/x",
            **figures, **more}  # fmt: skip


def make_results(*rows: dict[str, object]) -> Results:
    return Results(rows, METHODS)


def test_gain_is_the_least_squares_slope() -> None:
    theirs = np.random.default_rng(0).normal(size=1000)
    assert least_squares_gain(theirs, theirs) == pytest.approx(1)
    assert least_squares_gain(0.3 * theirs, theirs) == pytest.approx(0.3)
    assert least_squares_gain(np.zeros(1000), theirs) == 0
    assert abs(least_squares_gain(np.random.default_rng(1).normal(size=1000), theirs)) < 0.1
    assert np.isnan(least_squares_gain(theirs, np.zeros(1000)))


def test_kept_contrast_ignores_errors_of_the_plain_picture() -> None:
    """A method that is darker everywhere keeps all of the change; one that shows the plain picture keeps none."""
    rng = np.random.default_rng(0)
    plain = np.dstack([rng.uniform(0.3, 0.6, (20, 20, 3)), np.ones((20, 20))])
    changed = plain + np.dstack([rng.uniform(-0.1, 0.1, (20, 20, 3)), np.zeros((20, 20))])
    darker = np.array([0.1, 0.1, 0.1, 0])
    assert contrast_kept(changed - darker, plain - darker, changed, plain) == pytest.approx(1)
    assert contrast_kept(plain, plain, changed, plain) == pytest.approx(0)
    assert contrast_kept((changed + plain) / 2, plain, changed, plain) == pytest.approx(0.5)


def test_uncertainty_gain_is_1_for_perfect_and_0_for_random() -> None:
    error = np.random.default_rng(0).exponential(size=(60, 60))
    perfect, worthless = (
        score_map(2 * error + 1, error),
        score_map(np.random.default_rng(1).normal(size=(60, 60)), error),
    )
    assert perfect["gain"] == pytest.approx(1) and perfect["rank_correlation"] == pytest.approx(1)
    assert perfect["area"] == perfect["best_area"] < 0.6
    assert abs(worthless["gain"]) < 0.1 and abs(worthless["rank_correlation"]) < 0.05
    assert score_map(-error, error)["gain"] < -0.2 and score_map(-error, error)["rank_correlation"] == pytest.approx(-1)
    assert score_map(np.ones((60, 60)), error)["rank_correlation"] == 0


def test_ties_share_their_rank() -> None:
    doubt, error = np.array([0.0, 0, 0, 1]), np.array([1.0, 2, 3, 4])
    assert score_map(doubt, error)["rank_correlation"] == pytest.approx(0.7746, abs=1e-4)  # Spearman's, by hand


def test_summary_names_a_winning_baseline_first() -> None:
    text = summarize(make_results(row("base", "0", "regular", 25.0), row("base", "0", "bpa", 27.0, ssim=0.5)), ["base"])
    assert text.startswith("In the plain case a baseline wins: PSNR on the object, bpa 27.00 dB against regular 25.00")
    assert "In the other figures z2p wins: SSIM, regular 0.6250 against bpa 0.5000" in text


def test_summary_counts_where_baselines_are_ahead() -> None:
    rows = [row("base", "0", "regular", 28.0), row("base", "0", "bpa", 20.0)]
    rows += [row("noise", level, "regular", 22.0) for level in ("0", "0.01")]
    rows += [row("noise", "0", "bpa", 23.0), row("noise", "0.01", "bpa", 12.0)]
    text = summarize(make_results(*rows), ["base", "noise"])
    assert text.startswith("In the plain case z2p wins: ") and "a baseline wins" not in text
    assert "ahead in 4 of 8 comparisons (sweep, level, figure): noise 4 of 8." in text


def test_less_is_better_for_flip() -> None:
    results = {
        one.metric: one
        for one in compare_best(
            make_results(row("base", "0", "regular", 25.0, flip=0.2), row("base", "0", "bpa", 25.0, flip=0.1)), "base"
        )
    }
    assert results["flip"].lost and not results["ssim"].lost


def test_kept_contrast_is_best_at_one_and_in_the_summary() -> None:
    plain = [row("base", "0", "regular", 25.0), row("base", "0", "bpa", 24.0)]
    rows = [row("gap", "0.1", "regular", 20.0, contrast_kept=0.9), row("gap", "0.1", "bpa", 20.0, contrast_kept=1.4)]
    results = make_results(*plain, *rows)
    assert [line[1] for line in level_table(results, "gap", "contrast_kept", "kept").rows] == ["*0.900", "1.400"]
    expected = "the contrast of bpa is farther from the truth's (off by 40% on average) than that of regular (10%)"
    assert f"Near surfaces: {expected}." in summarize(results, ["base", "gap"])


def test_tables_mark_the_best_and_give_spreads() -> None:
    results = make_results(row("base", "0", "regular", 25.0), row("base", "0", "regular", 27.0, mesh="spot"),
                     row("base", "0", "bpa", 24.0))  # fmt: skip
    table = means_table(results, "base", "means")
    assert table.rows[0][:2] == ("regular", "*26.00 ± 1") and table.rows[1][1] == "24.00"
    assert table.rows[0][-1] == "2"
    assert level_table(results, "base", "flip", "FLIP").rows[0][1].startswith("*0.039")


def test_capability_ticks_follow_from_metrics() -> None:
    rows = [row("base", "0", "regular", 25.0), row("base", "0", "bpa", 17.0, steps={"normals": 0.2}, shadow_kept=0.1)]
    rows += [row("inner", "0", "regular", 25.0), row("inner", "0.3", "regular", 24.5)]
    rows += [row("inner", "0", "bpa", 17.0), row("inner", "0.3", "bpa", 12.0)]
    ours, theirs = (assess_capabilities(make_results(*rows), name, name == "regular") for name in ("regular", "bpa"))
    assert all(ours[key].passed for key in ("raw", "normals", "unseen", "inner", "shadows"))
    assert not any(theirs[key].passed for key in ("normals", "unseen", "inner", "shadows"))
    assert "loses 0.125" in theirs["inner"].why and theirs["inner"].paper == "no"
    assert ours["points"].passed is None and ours["scenes"].passed is None and ours["colors"].passed is None


def test_colors_tick_needs_half_of_the_textures() -> None:
    rows = [row("texture", "none", "regular", 25.0), row("texture", "stripes", "regular", 25.0, contrast_kept=0.9)]
    rows += [row("texture", "stripes", "bpa", 25.0, contrast_kept=0.3)]
    ours, theirs = (assess_capabilities(make_results(*rows), name, name == "regular") for name in ("regular", "bpa"))
    assert ours["colors"].passed is True and ours["colors"].paper == "no" and "90%" in ours["colors"].why
    assert theirs["colors"].passed is False and theirs["colors"].paper == "yes"


def test_weights_of_one_color_get_no_colors_tick() -> None:
    undrawn = row("texture", "stripes", "regular", 1.0, error="these weights draw no colours of points")
    verdict = assess_capabilities(make_results(undrawn), "regular", True)["colors"]
    assert verdict.passed is False and "no colours" in verdict.why


def test_disagreement_must_beat_the_edge_map() -> None:
    def verdict(own: float, edges: float) -> str:
        maps = {name: {"rank_correlation": 0.5, "area": 0.5, "best_area": 0.3, "gain": value}
                for name, value in (("disagreement", own), ("edges", edges), ("sparseness", 0.1))}  # fmt: skip
        return uncertainty_table([{"mesh": "cow", "method": "regular", "rows": [{"view": 0, "maps": maps}]}])[1]

    assert "it earns its place" in verdict(0.7, 0.5)
    for own, edges in ((0.7, 0.65), (0.7, 0.8), (0.4, 0.1)):
        assert "does not earn" in verdict(own, edges)


def test_results_use_the_current_mesh_names(tmp_path: Path) -> None:
    """A result is kept when its mesh's file or its weights' file gets another name."""
    content = {"sweep": "base", "mesh": "bunny", "method": "old", "rows": [row("base", "plain", "regular", 30.0)]}
    for folder in ("m", "s"):
        (tmp_path / folder).mkdir()
        own = {"sweep": "scans", "mesh": ""} if folder == "s" else {}
        (tmp_path / folder / ROWS_FILE).write_text(json.dumps(content | own))
    results = read_results({"measure/base/rabbit/new": tmp_path / "m", "scans/new": tmp_path / "s"}, METHODS)
    assert [(one["sweep"], one["mesh"], one["method"]) for one in results.every] == [
        ("base", "rabbit", "new"), ("scans", "", "new")
    ]  # fmt: skip


def test_missing_parts_follow_from_weights_cards(make_weights, tmp_path: Path) -> None:
    def absent(*files: Path) -> set[str]:
        methods = tuple(Method(f"other{number}", "weights", str(file)) for number, file in enumerate(files))
        return {title for title, _ in _list_missing_parts(Results((), methods), ReportConfig())}

    plain = make_weights()
    named = shutil.copy(plain, tmp_path / "paper.safetensors")
    assert {"The paper's network", "Weights for noise"} <= absent(plain, Path(named))
    assert "The paper's network" not in absent(make_weights(kind="adain_unet", unshuffle=1, refine=0))
    noisy, weights = tmp_path / "weights.safetensors", load_weights(plain)
    save_weights(noisy, weights.tensors, {**weights.card, "training": {"noise": "uniform"}})
    assert "Weights for noise" not in absent(noisy)
