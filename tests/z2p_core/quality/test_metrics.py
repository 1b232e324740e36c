"""Metrics of synthetic images with known values."""

from __future__ import annotations

import math

import numpy as np
import pytest

from z2p_core.quality import metrics
from z2p_core.quality.metrics import METRIC_NAMES, image_metrics, object_box, psnr, ssim_map

SIDE = 64


def scene() -> tuple[np.ndarray, np.ndarray]:
    """Picture (64, 64, 4) with a striped 20 x 30 object and a shadow of alpha 0.4 under it, and the coverage."""
    picture, coverage = np.zeros((SIDE, SIDE, 4), dtype=np.float32), np.zeros((SIDE, SIDE), dtype=np.float32)
    coverage[20:40, 16:46] = 1.0
    picture[20:40, 16:46] = (0.2, 0.5, 0.8, 1.0)
    picture[20:40, 16:46:3, :3] = 0.6
    picture[40:50, 10:40, 3] = 0.4
    return picture, coverage


def measure(change: str) -> dict[str, float]:
    truth, coverage = scene()
    prediction = truth.copy()
    if change == "object":
        prediction[20:40, 16:46, :3] += 0.1
    elif change == "shadow":
        prediction[40:50, 10:40, 3] += 0.1
    elif change == "invisible":
        prediction[0:10, :, :3] = 0.7  # colour where alpha is 0
    return image_metrics(prediction, truth, coverage)


def test_identical_pictures_have_the_best_metrics() -> None:
    assert measure("nothing") == pytest.approx(
        {"psnr_white": 100, "psnr_foreground": 100, "ssim": 1, "flip": 0, "alpha_l1": 0, "shadow_l1": 0}, abs=1e-6
    )
    assert tuple(measure("nothing")) == METRIC_NAMES


def test_colour_of_transparent_pixels_does_not_count() -> None:
    assert measure("invisible") == pytest.approx(measure("nothing"), abs=1e-6)


def test_error_on_the_object_alone_has_its_known_psnr() -> None:
    figures = measure("object")
    assert figures["psnr_foreground"] == pytest.approx(20.0, abs=1e-3)  # error 0.1 everywhere on it
    assert figures["psnr_white"] == pytest.approx(20.0 + 10 * math.log10(SIDE**2 / 600), abs=1e-3)
    assert figures["alpha_l1"] == figures["shadow_l1"] == 0
    assert figures["ssim"] < 0.999 and figures["flip"] > 0.01


def test_error_in_the_shadow_leaves_the_foreground() -> None:
    figures = measure("shadow")
    assert figures["psnr_foreground"] == 100
    assert figures["alpha_l1"] == pytest.approx(0.1 * 300 / SIDE**2, rel=1e-4)
    assert figures["shadow_l1"] == pytest.approx(0.1 * 300 / (SIDE**2 - 600), rel=1e-4)
    assert figures["psnr_white"] == pytest.approx(20.0 + 10 * math.log10(SIDE**2 / 300), abs=1e-3)


def test_object_box_grows_by_eight_pixels_to_the_edge() -> None:
    coverage = np.zeros((40, 50))
    coverage[3, 20] = coverage[10, 45] = 1e-3
    box = object_box(coverage)
    assert coverage[box].shape == (19, 38)
    inside = np.zeros_like(coverage)
    inside[box] = 1
    assert inside[:19, 12:].all() and inside.sum() == 19 * 38


def test_ssim_and_flip_are_measured_in_the_box_alone() -> None:
    truth, coverage = scene()
    far = truth.copy()
    far[60:64, 60:64] = (1.0, 0.0, 0.0, 1.0)  # more than a window away from the box
    figures = image_metrics(far, truth, coverage)
    assert figures["ssim"] == pytest.approx(1, abs=1e-3)
    assert figures["flip"] < 0.01 and figures["psnr_white"] < 30


def test_ssim_equals_wangs_formula_with_a_gaussian_window() -> None:
    """Double loop over one pixel's window: 11 wide, sigma 1.5, population variances."""
    rng = np.random.default_rng(0)
    first, second = rng.random((21, 21, 3)), rng.random((21, 21, 3))
    offsets = np.arange(11) - 5
    line = np.exp(-(offsets**2) / (2 * 1.5**2))
    window = np.outer(line, line) / line.sum() ** 2
    x, y = first[5:16, 5:16, 1], second[5:16, 5:16, 1]
    mx, my = (window * x).sum(), (window * y).sum()
    vx, vy = (window * x * x).sum() - mx**2, (window * y * y).sum() - my**2
    both = (window * x * y).sum() - mx * my
    c1, c2 = 0.01**2, 0.03**2
    expected = (2 * mx * my + c1) * (2 * both + c2) / ((mx**2 + my**2 + c1) * (vx + vy + c2))
    assert ssim_map(first, second)[10, 10, 1] == pytest.approx(expected, abs=1e-6)


def test_flip_is_large_for_black_and_white() -> None:
    white, black = np.ones((32, 32, 3)), np.zeros((32, 32, 3))
    assert metrics.flip_map(black, white).mean() > 0.9
    assert 0 < metrics.flip_map(white * 0.98, white).mean() < 0.1


def test_metric_without_pixels_is_nan() -> None:
    truth, coverage = scene()
    figures = image_metrics(truth, truth, coverage * 0.5)
    assert math.isnan(figures["psnr_foreground"]) and figures["psnr_white"] == 100
    assert math.isnan(image_metrics(truth, truth, np.ones_like(coverage))["shadow_l1"])
    assert math.isnan(psnr(np.zeros((0, 3)), np.zeros((0, 3))))


def test_wrong_pictures_are_refused() -> None:
    truth, coverage = scene()
    with pytest.raises(ValueError, match=r"coverage: expected an object"):
        image_metrics(truth, truth, coverage * 0)
    with pytest.raises(ValueError, match=r"expected prediction \(64, 64, 4\)"):
        image_metrics(truth[:32], truth, coverage)
    with pytest.raises(ValueError, match=r"prediction: expected floats in \[0, 1\]"):
        image_metrics((truth * 255).astype(np.uint8), truth, coverage)
    with pytest.raises(ValueError, match=r"prediction: expected floats in \[0, 1\]"):
        image_metrics(truth * np.nan, truth, coverage)
    with pytest.raises(ValueError, match=r"sides of 11 or more"):
        image_metrics(truth[:8], truth[:8], coverage[:8])
