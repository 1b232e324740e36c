"""Values to colors: between limits, at and beyond them, of any type; labels to the colors of their entries."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from z2p_core.coloring.colormaps import colormap_lut
from z2p_core.coloring.scales import ClassColors, ClassEntry, ColorScale
from z2p_core.interfaces import SettingError

LUT = colormap_lut("viridis")
SCALE = ColorScale("height", "viridis", 10.0, 20.0)


def test_limits_have_the_end_colors() -> None:
    assert np.array_equal(SCALE.colors_of(np.array([10, 20])), LUT[[0, -1]])


def test_values_beyond_the_limits_are_clamped() -> None:
    assert np.array_equal(SCALE.colors_of(np.array([-1e30, 9.9, 20.1, 1e30])), LUT[[0, 0, -1, -1]])


def test_values_that_are_not_finite_are_nan() -> None:
    colors = SCALE.colors_of(np.array([np.nan, np.inf, -np.inf, 15]))
    assert np.isnan(colors[:3]).all() and np.isfinite(colors[3]).all()


@pytest.mark.parametrize("dtype", ["u1", "i2", "<u8", ">i4", "f2", "f4", ">f8", "?"])
def test_any_numeric_type_has_the_same_colors(dtype: str) -> None:
    values = np.array([0, 1, 1, 0]).astype(dtype)
    colors = ColorScale("bit", "viridis", 0, 1).colors_of(values)
    assert colors.dtype == np.float32
    assert np.array_equal(colors, LUT[[0, -1, -1, 0]])


def test_colors_follow_the_map_evenly() -> None:
    values = 10 + 10 * (np.arange(256) + 0.5) / 256
    assert np.array_equal(SCALE.colors_of(values), LUT)


def test_equal_limits_have_the_middle_color() -> None:
    colors = ColorScale("height", "viridis", 3, 3).colors_of(np.array([3, 2, 4]))
    assert np.array_equal(colors, LUT[[128, 0, 255]])


@pytest.mark.parametrize(("low", "high"), [(-1e308, 1e308), (1e9, 1e9 + 1e-6), (0, 1e-300), (-1e-320, 1e-320)])
def test_extreme_limits_are_safe(low: float, high: float) -> None:
    with np.errstate(all="raise", under="ignore"):
        colors = ColorScale("time", "viridis", low, high).colors_of(np.array([low, high]))
    assert np.array_equal(colors, LUT[[0, -1]])


def test_the_smallest_numbers_are_safe() -> None:
    assert np.isfinite(ColorScale("time", "viridis", 0, 5e-324).colors_of(np.array([0, 5e-324, 1]))).all()


def test_large_times_keep_their_differences() -> None:
    times = 1.3e9 + np.linspace(0, 1, 256)
    colors = ColorScale("gps_time", "viridis", times[0], times[-1]).colors_of(times)
    assert len(np.unique(colors, axis=0)) > 250


@pytest.mark.parametrize("limits", [(1, 0), (np.nan, 1), (0, np.inf)])
def test_wrong_limits_are_refused(limits: tuple[float, float]) -> None:
    with pytest.raises(SettingError, match="two finite limits"):
        ColorScale("height", "viridis", *limits)


def test_an_empty_cloud_has_no_colors() -> None:
    assert SCALE.colors_of(np.array([])).shape == (0, 3)
    assert ClassColors("label", ()).colors_of(np.array([], dtype=int)).shape == (0, 3)


def test_labels_have_their_entries_colors() -> None:
    classes = ClassColors("label", (ClassEntry(6, "b", (0, 0, 1)), ClassEntry(-1, "u", (1, 0, 0))))
    colors = classes.colors_of(np.array([-1.0, 6.0, 6.5, 7.0, np.nan, np.inf, 1e300]))
    assert np.array_equal(colors[:2], [[1, 0, 0], [0, 0, 1]])
    assert np.isnan(colors[2:]).all()


def test_labels_of_64_bits_are_exact() -> None:
    large = 2**63 + 2**40
    classes = ClassColors("id", (ClassEntry(large, "a", (1, 0, 0)), ClassEntry(large + 1, "b", (0, 1, 0))))
    colors = classes.colors_of(np.array([large + 1, large, large + 2], dtype=np.uint64))
    assert np.array_equal(colors[:2], [[0, 1, 0], [1, 0, 0]])
    assert np.isnan(colors[2]).all()


def test_without_entries_all_colors_are_unknown() -> None:
    assert np.isnan(ClassColors("label", ()).colors_of(np.array([1, 2]))).all()


def test_the_module_imports_no_colormaps() -> None:
    code = ("import sys, z2p_core.coloring.class_palettes, z2p_renderer.pipeline.legends.draw_legend; "
            "sys.exit(bool({'cmap', 'matplotlib'} & set(sys.modules)))")  # fmt: skip
    assert subprocess.run([sys.executable, "-c", code], check=False, timeout=60).returncode == 0
