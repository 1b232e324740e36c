"""Colors of points: their own, a field's through a colormap, or those of classes; and one scale for a series."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from z2p_core.coloring.class_palettes import label_color
from z2p_core.coloring.colormaps import colormap_lut
from z2p_core.coloring.options import ColorOptions
from z2p_core.coloring.scales import ClassColors, ColorScale
from z2p_core.interfaces import RawCloud, ScanError
from z2p_core.placement.viewpoint import Viewpoint, frame_points
from z2p_renderer.pipeline.coloring.color_points import MISSING_VALUE_COLOR, Coloring, color_points
from z2p_renderer.pipeline.coloring.common_scale import share_scale
from z2p_renderer.storage.scans.clouds import Scan, scan_from_raw

POINTS = np.random.default_rng(0).normal(size=(100, 3)) + np.array([5.0, 0.0, 40.0])
VIEWPOINT = frame_points(POINTS, np.eye(3), 20.0)


def scan(**fields: Any) -> Scan:
    return scan_from_raw(RawCloud(POINTS, fields={name: np.asarray(values) for name, values in fields.items()}), "")


def colored(options: ColorOptions, **fields: Any) -> Coloring:
    coloring = color_points(scan(**fields), VIEWPOINT, options)
    assert coloring is not None
    return coloring


def place(scan: Scan, suffix: str) -> Viewpoint:
    return VIEWPOINT


def test_own_colors_are_drawn_where_there_are_some() -> None:
    rgb = np.random.default_rng(1).random((100, 3), dtype=np.float32)
    rgb[::2] = np.nan
    assert np.array_equal(colored(ColorOptions(), rgb=rgb).srgb, rgb[1::2])
    assert color_points(scan(), VIEWPOINT, ColorOptions()) is None
    assert color_points(scan(rgb=rgb), VIEWPOINT, ColorOptions("none")) is None
    with pytest.raises(ScanError, match="expected points with colours of their own, got none"):
        color_points(scan(time=np.zeros(100)), VIEWPOINT, ColorOptions("rgb"))


def test_a_field_spans_its_percentiles() -> None:
    values = np.arange(100.0)
    values[0] = -1e9
    coloring = colored(ColorOptions("time"), time=values)
    assert isinstance(coloring.scale, ColorScale)
    assert 1 <= coloring.scale.low <= 3 and 96 <= coloring.scale.high <= 98
    assert np.array_equal(coloring.srgb[[0, -1]], colormap_lut("viridis")[[0, -1]])
    assert "2nd to 98th percentile" in coloring.description


def test_given_limits_and_colormap_count() -> None:
    coloring = colored(ColorOptions("time", "turbo", (0.0, 99.0)), time=np.arange(100.0))
    assert np.array_equal(coloring.srgb[[0, -1]], colormap_lut("turbo")[[0, -1]])
    assert coloring.to_json() == {"color_by": "time", "colormap": "turbo", "clim": [0, 99], "relight": 1.0}


def test_points_without_a_value_are_grey() -> None:
    coloring = colored(ColorOptions("time"), time=np.where(np.arange(100) < 4, np.nan, 7.0))
    assert np.allclose(coloring.srgb[:4], MISSING_VALUE_COLOR) and "4 points without a value" in coloring.description
    with pytest.raises(ScanError, match="'time' has no value at any point"):
        colored(ColorOptions("time"), time=np.full(100, np.nan))


def test_one_value_everywhere_has_one_color() -> None:
    coloring = colored(ColorOptions("time"), time=np.full(100, 5.0))
    assert len(np.unique(coloring.srgb, axis=0)) == 1 and "5 at every point" in coloring.description


def test_labels_have_the_color_of_their_class() -> None:
    coloring = colored(ColorOptions("label"), label=np.arange(100) % 2 * 3)
    assert np.allclose(coloring.srgb[:2], [label_color(0), label_color(3)])
    assert isinstance(coloring.scale, ClassColors) and [one.count for one in coloring.scale.entries] == [50, 50]
    assert isinstance(colored(ColorOptions("label", "turbo"), label=np.arange(100) % 2).scale, ColorScale)


def test_height_is_measured_from_the_lowest_point() -> None:
    turned = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])  # y points up
    coloring = color_points(scan(), frame_points(POINTS, turned, 20.0), ColorOptions("height"))
    assert coloring is not None and isinstance(coloring.scale, ColorScale)
    heights = POINTS[:, 1] - POINTS[:, 1].min()
    assert np.allclose([coloring.scale.low, coloring.scale.high], np.percentile(heights, (2, 98)), atol=1e-4)


def test_a_series_has_one_scale() -> None:
    series = [(scan(time=np.full(100, time)), "") for time in (0.0, 10.0)]
    options, scale = share_scale(series, ColorOptions("time"), place)
    assert options.limits == (0.0, 10.0) and not options.needs_common_scale
    assert isinstance(scale, ColorScale) and (scale.low, scale.high) == (0.0, 10.0)
    first, second = (color_points(one, VIEWPOINT, options) for one, _ in series)
    assert first is not None and second is not None
    assert np.array_equal([first.srgb[0], second.srgb[0]], colormap_lut("viridis")[[0, -1]])


def test_a_series_of_labels_lists_all_of_them() -> None:
    series = [(scan(label=np.full(100, label)), "") for label in (4, 2, 4)]
    options, scale = share_scale([*series, (scan(), "")], ColorOptions("label"), place)
    assert isinstance(scale, ClassColors) and [one.value for one in scale.entries] == [2, 4]
    assert options.is_categorical and not options.needs_common_scale


def test_a_series_without_the_field_has_no_scale() -> None:
    assert share_scale([(scan(), "")], ColorOptions("label"), place) == (ColorOptions("label"), None)
    assert share_scale([(scan(), "")], ColorOptions(), place) == (ColorOptions(), None)


def test_every_point_of_a_dense_cloud_keeps_its_color() -> None:
    points = np.random.default_rng(2).normal(size=(300_000, 3))
    colors = Coloring(points, np.full(points.shape, 0.5, np.float32), relight=1.0).place(VIEWPOINT)
    np.testing.assert_array_equal(colors.points, VIEWPOINT.place(points))
    assert len(colors.albedo) == len(points)
