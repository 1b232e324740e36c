"""scripts/measure_growth.py: configs that differ in one parameter, fits of known curves, and the report."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from z2p_core.config import PipelineConfig, parse_config, to_dict

sys.path.insert(0, str(Path(__file__).parents[2] / "scripts"))
import measure_growth as growth

BASE = parse_config((growth.ROOT / "configs" / "growth.toml").read_text())


def test_each_sweep_changes_one_quantity_in_proportion() -> None:
    assert growth.varied(BASE, "samples", 2).train.steps == 2 * BASE.train.steps
    learnt = 1 - growth.varied(BASE, "renders", 0.25).train.validation_share
    assert learnt == pytest.approx(0.25 * (1 - BASE.train.validation_share))
    assert growth.varied(BASE, "channels", 0.5).train.network.widths == (24, 32, 48, 64)
    for axis, all_times in growth.FACTORS.items():
        names = {growth.varied(BASE, axis, times).name for times in all_times}
        assert len(names) == len(all_times)
        assert growth.varied(BASE, axis, 1) == BASE, "the base is trained once for all axes"


def test_config_survives_toml() -> None:
    for config in (BASE, PipelineConfig(name='a "b"'), growth.varied(BASE, "channels", 1.5)):
        assert parse_config(growth.to_toml(to_dict(config))) == config


@pytest.mark.parametrize(("floor", "rate"), [(0.06, 0.5), (0.0, 0.3), (0.1, 1.2)])
def test_fit_recovers_a_curve_and_extrapolates(floor: float, rate: float) -> None:
    points = [(x, floor + 0.02 * x**-rate) for x in growth.FACTORS["samples"]]
    fit = growth.fit_curve(points)
    assert fit is not None and fit.error < 1e-5
    assert (fit.floor, fit.rate) == pytest.approx((floor, rate), abs=0.01)
    where = fit.reaches(floor + 0.005)
    assert where == pytest.approx((0.02 / 0.005) ** (1 / rate), rel=0.1)
    assert fit.reaches(fit.floor) is None


def test_too_few_points_make_no_growth_curve() -> None:
    assert growth.fit_curve([(1, 3), (2, 2), (4, 1)]) is None
    worse = growth.fit_curve([(x, 0.08 + 0.01 * x) for x in (0.25, 0.5, 1, 2)])
    assert worse is not None and worse.reaches(0.07) is None


def test_growth_report_lists_points_and_extrapolation() -> None:
    points = [{"times": x, "flip": 0.06 + 0.02 / x, "psnr_foreground": 30.0, "ssim": 0.9, "alpha_l1": 0.005}
              for x in growth.FACTORS["samples"]]  # fmt: skip
    text = growth.growth_report({"samples": points}, 0.07)
    assert text.count("\n| x ") == len(points)
    assert "0.07 at x 2." in text
    assert "no number of them" in growth.growth_report({"samples": points}, 0.05)
