"""LAS and LAZ: colors, and every dimension of the points by name."""

from __future__ import annotations

from pathlib import Path

import laspy
import numpy as np
import pytest
from reader_files import read_fields

from z2p_core.interfaces import RawCloud
from z2p_renderer.plugins.readers import las

COUNT = 300
POINTS = np.random.default_rng(1).uniform(0, 50, (COUNT, 3)).round(3)
COLORS = np.random.default_rng(2).integers(0, 65536, (COUNT, 3))
INTENSITY = np.random.default_rng(3).integers(0, 65536, COUNT)
TIMES = 3e5 + np.random.default_rng(4).random(COUNT)


def survey(path: Path, form: int = 7, extra: dict[str, laspy.ExtraBytesParams] | None = None, **dimensions) -> Path:
    content = laspy.LasData(laspy.LasHeader(point_format=form, version="1.4" if form > 5 else "1.2"))
    content.header.scales = np.full(3, 0.001)
    for parameters in (extra or {}).values():
        content.add_extra_dim(parameters)
    content.x, content.y, content.z = POINTS.T
    for name, values in dimensions.items():
        content[name] = values
    content.write(path)
    return path


def colors(table: np.ndarray) -> dict[str, np.ndarray]:
    return dict(zip(("red", "green", "blue"), table.T, strict=True))


def read(path: Path, *wanted: str) -> RawCloud:
    [cloud] = read_fields(path, wanted or None)
    return cloud


@pytest.mark.parametrize("form", [2, 3, 7, 8])
@pytest.mark.parametrize("suffix", [".las", ".laz"])
@pytest.mark.parametrize(("table", "full", "kind"), [
    (COLORS, 65535, "16-bit"), (COLORS >> 8, 255, "8-bit, in 16-bit integers"), (COLORS & 0xFF00, 65535, "16-bit"),
])  # fmt: skip
def test_colors_of_both_ranges(tmp_path, form, suffix, table, full, kind) -> None:
    cloud = read(survey(tmp_path / f"a{suffix}", form, **colors(table)), "rgb")
    np.testing.assert_allclose(cloud.fields["rgb"], table / full, atol=1e-6)
    assert cloud.color_kind == kind and list(cloud.fields) == ["rgb"]


def test_black_everywhere_means_no_colors(tmp_path: Path) -> None:
    cloud = read(survey(tmp_path / "a.las", 7))
    assert "rgb" not in cloud.fields and "rgb" not in cloud.field_names and not cloud.note


@pytest.mark.parametrize("suffix", [".las", ".laz"])
def test_every_dimension_comes_by_name(tmp_path: Path, suffix: str) -> None:
    scaled = laspy.ExtraBytesParams("width", "i2", scales=np.array([0.01]), offsets=np.array([5.0]))
    extra = {"height": laspy.ExtraBytesParams("height", "f4"), "width": scaled}
    height, width = INTENSITY / 7.0, 5 + (INTENSITY % 100) / 100
    path = survey(tmp_path / f"a{suffix}", 7, extra, intensity=INTENSITY, gps_time=TIMES, height=height, width=width,
                  user_data=INTENSITY % 256, return_number=1 + INTENSITY % 3, scan_angle=INTENSITY % 1000)  # fmt: skip
    cloud = read(path)
    expected = {"intensity": INTENSITY, "gps_time": TIMES, "height": height.astype("f4"), "width": width,
                "user_data": INTENSITY % 256, "return_number": 1 + INTENSITY % 3,
                "scan_angle": 0.006 * (INTENSITY % 1000)}  # fmt: skip
    for name, values in expected.items():
        np.testing.assert_allclose(cloud.fields[name], values, rtol=1e-6, err_msg=name)
    assert cloud.units == {"gps_time": "s", "scan_angle": "degrees"}
    assert set(cloud.fields) == set(cloud.field_names)
    assert list(read(path, "Intensity").fields) == ["intensity"]


def test_classes_have_the_names_of_the_standard(tmp_path: Path) -> None:
    classes = np.arange(COUNT) % 7
    cloud = read(survey(tmp_path / "a.las", 6, classification=classes))
    assert np.array_equal(cloud.fields["classification"], classes)
    names = cloud.class_names["classification"]
    assert names[2] == "ground" and names[17] == "bridge deck"
    assert 17 not in read(survey(tmp_path / "a.las", 1)).class_names["classification"]


@pytest.mark.parametrize("suffix", [".las", ".laz"])
def test_fields_lose_the_rows_of_noise(tmp_path: Path, suffix: str, monkeypatch: pytest.MonkeyPatch) -> None:
    classes = np.where(np.arange(COUNT) % 10 == 0, 7, 2)
    path = survey(tmp_path / f"a{suffix}", 7, classification=classes, intensity=INTENSITY, **colors(COLORS))
    cloud = read(path)
    np.testing.assert_allclose(cloud.fields["rgb"], COLORS[classes == 2] / 65535, atol=1e-6)
    assert np.array_equal(cloud.fields["intensity"], INTENSITY[classes == 2])
    monkeypatch.setattr(las.Las, "max_rows", 100)
    monkeypatch.setattr(las, "_CHUNK_POINTS", 90)
    cloud = read(path)
    rows = [int(np.abs(POINTS - point).sum(1).argmin()) for point in cloud.points]
    np.testing.assert_allclose(cloud.fields["rgb"], COLORS[rows] / 65535, atol=1e-6)
    assert np.array_equal(cloud.fields["intensity"], INTENSITY[rows])
