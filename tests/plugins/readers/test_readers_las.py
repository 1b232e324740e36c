"""LAS and LAZ: which of a survey's points are drawn."""

from __future__ import annotations

from pathlib import Path

import laspy
import numpy as np
import pytest
from copc_files import copc

from z2p_core.interfaces import RawCloud
from z2p_renderer.plugins.readers import las
from z2p_renderer.plugins.readers.las import Las
from z2p_renderer.storage.scans.clouds import read_clouds

POINTS = np.random.default_rng(1).uniform(0, 50, (300, 3)).round(3)


def survey(path: Path, form: int, points: np.ndarray = POINTS, offset: float = 0.0, **dimensions: np.ndarray) -> Path:
    version = "1.4" if form > 5 else "1.3" if form > 3 else "1.2"
    content = laspy.LasData(laspy.LasHeader(point_format=form, version=version))
    content.header.scales, content.header.offsets = np.full(3, 0.001), np.full(3, offset)
    content.x, content.y, content.z = points.T
    for name, values in dimensions.items():
        content[name] = values
    content.write(path)
    return path


def read(path: Path) -> RawCloud:
    [cloud] = Las().read(path)
    assert isinstance(cloud, RawCloud)
    return cloud


@pytest.mark.parametrize("suffix", [".las", ".laz"])
@pytest.mark.parametrize("form", range(11))
def test_every_point_format_is_read_without_noise(tmp_path: Path, form: int, suffix: str) -> None:
    if form in (4, 5, 9, 10) and suffix == ".laz":
        pytest.skip("wave packets are not packed here")
    classes = np.full(300, 2)
    classes[::10], classes[5::50] = 7, 18
    cloud = read(survey(tmp_path / f"a{suffix}", form, classification=classes))
    np.testing.assert_allclose(cloud.points, POINTS[classes == 2], atol=1e-9)
    assert cloud.note == "36 points of noise (classes 7 and 18) left out"


def test_withheld_points_are_dropped_and_synthetic_ones_kept(tmp_path: Path) -> None:
    withheld, synthetic = np.arange(300) % 30 == 0, np.arange(300) % 7 == 0
    cloud = read(survey(tmp_path / "a.las", 6, withheld=withheld, synthetic=synthetic))
    np.testing.assert_allclose(cloud.points, POINTS[~withheld], atol=1e-9)
    assert cloud.note == "10 withheld points left out"


def test_a_file_of_noise_alone_is_drawn(tmp_path: Path) -> None:
    cloud = read(survey(tmp_path / "a.las", 6, classification=np.full(300, 7)))
    assert len(cloud.points) == 300 and not cloud.note


def test_unmeasured_points_are_left_out(tmp_path: Path) -> None:
    survey(tmp_path / "a.las", 6, offset=1000.0)
    content = laspy.read(tmp_path / "a.las")
    content.X[:5], content.Z[5:8] = -(2**31), 2**31 - 1  # what a cast makes of NaN and of too large a number
    for axis in "XYZ":
        content[axis][100:125] = 0
    content.write(tmp_path / "a.las")
    cloud = read(tmp_path / "a.las")
    np.testing.assert_allclose(cloud.points, np.delete(POINTS, [*range(8), *range(100, 125)], axis=0), atol=1e-9)
    assert cloud.note == "33 points that stand for no measurement left out"


def test_large_files_are_subsampled(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = survey(tmp_path / "a.las", 0)
    assert Las().memory(path) > 300 * 170
    monkeypatch.setattr(las.Las, "max_rows", 100)
    monkeypatch.setattr(las, "_CHUNK_POINTS", 90)
    cloud = read(path)
    assert cloud.total == 300 and len(cloud.points) == 100
    rows = [int(np.abs(POINTS - point).sum(1).argmin()) for point in cloud.points]
    assert all(row // 3 == index for index, row in enumerate(rows))  # one of every three


@pytest.mark.parametrize(("words", "degrees"), [
    ("", False), ('GEOGCS["WGS 84",DATUM["WGS_1984"]]', True), ('COMPD_CS["x",GEOGCRS["WGS 84"],VERT_CS["y"]]', True),
    ('PROJCS["UTM 32",GEOGCS["WGS 84"]]', False), ((1, 1, 0, 1, 1024, 0, 1, 2), True),
    ((1, 1, 0, 1, 1024, 0, 1, 1), False),
])  # fmt: skip
def test_degrees_in_the_header_are_converted_to_metres(
    tmp_path: Path, words: str | tuple[int, ...], degrees: bool
) -> None:
    content = laspy.read(survey(tmp_path / "a.las", 6, POINTS / 500 + (7, 50, 0)))
    if words:
        keys = isinstance(words, tuple)
        blob = np.array(words, "<u2").tobytes() if keys else str(words).encode()
        content.header.vlrs.append(laspy.VLR("LASF_Projection", 34735 if keys else 2112, "", blob))
    content.write(tmp_path / "a.las")
    cloud = read(tmp_path / "a.las")
    north, height = np.ptp(cloud.points, axis=0)[1:]
    assert height == pytest.approx(np.ptp(POINTS[:, 2]) / 500, abs=0.01)
    assert bool(north > 5000) is degrees and ("longitude and latitude are laid out" in cloud.note) is degrees


def test_only_compressed_points_are_fragile(tmp_path: Path) -> None:
    assert not Las().is_fragile(survey(tmp_path / "a.las", 6))
    assert Las().is_fragile(survey(tmp_path / "a.laz", 6))


@pytest.mark.parametrize("levels", [1, 2])
def test_copc_is_read_in_full(tmp_path: Path, levels: int) -> None:
    points = np.random.default_rng(2).uniform(0, 50, (400, 3)).round(3)
    (tmp_path / "a.copc.laz").write_bytes(copc(points, levels))
    [scan] = read_clouds(tmp_path / "a.copc.laz")
    expected = points if levels == 2 else points[::10]
    assert scan.points.shape == expected.shape
    np.testing.assert_allclose(np.sort(scan.points, axis=0), np.sort(expected, axis=0), atol=1e-9)
