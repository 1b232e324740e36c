"""E57: colors of any depth by their limits, intensities and further fields, through each scan's pose."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from reader_files import read_fields

pye57 = pytest.importorskip("pye57")

COUNT = 70
POINTS = np.random.default_rng(1).normal(size=(COUNT, 3))
COLORS = np.random.default_rng(2).integers(0, 256, (COUNT, 3)).astype("u1")
DEEP = np.random.default_rng(3).integers(0, 65536, (COUNT, 3))
INTENSITY = np.random.default_rng(4).random(COUNT).astype("f4")
AXES = ("cartesianX", "cartesianY", "cartesianZ")
CHANNELS = ("colorRed", "colorGreen", "colorBlue")


def columns(points: np.ndarray, colors: np.ndarray | None = None, **others: np.ndarray) -> dict[str, np.ndarray]:
    table = dict(zip(AXES, points.T.copy(), strict=True)) | others
    return table if colors is None else table | dict(zip(CHANNELS, colors.T.copy(), strict=True))


def by_library(path: Path, *scans: dict[str, np.ndarray], **pose: np.ndarray) -> Path:
    file = pye57.E57(str(path), mode="w")
    for scan in scans:
        file.write_scan_raw(scan, **pose)
    file.close()
    return path


def deep(path: Path, full: int, table: np.ndarray, kinds: dict[str, tuple[str, np.ndarray]]) -> Path:
    """A scan with integer colors up to `full`, and further fields, which pye57's own writer refuses."""
    lib = pye57.libe57
    file = pye57.E57(str(path), mode="w")
    image = file.image_file
    scan, prototype, limits = (lib.StructureNode(image) for _ in range(3))
    scan.set("guid", lib.StringNode(image, "{0}"))
    buffers, held = lib.VectorSourceDestBuffer(), []
    fields = {axis: ("d", values) for axis, values in zip(AXES, POINTS.T, strict=True)}
    fields |= {name: ("q", values) for name, values in zip(CHANNELS, table.T, strict=True)} | kinds
    for name, (kind, values) in fields.items():
        top = full if name in CHANNELS else 1 << 40
        node = lib.IntegerNode(image, 0, 0, top) if kind == "q" else lib.FloatNode(image, 0.0)
        prototype.set(name, node)
        held.append(np.empty(COUNT, kind))
        held[-1][:] = values
        buffers.append(lib.SourceDestBuffer(image, name, held[-1], COUNT, True, True))
    for name in CHANNELS:
        limits.set(f"{name}Minimum", lib.IntegerNode(image, 0))
        limits.set(f"{name}Maximum", lib.IntegerNode(image, full))
    scan.set("colorLimits", limits)
    points = lib.CompressedVectorNode(image, prototype, lib.VectorNode(image, True))
    scan.set("points", points)
    file.data3d.append(scan)
    writer = points.writer(buffers)
    writer.write(COUNT)
    writer.close()
    file.close()
    return path


def test_colors_and_intensity_of_a_scan(tmp_path: Path) -> None:
    path = by_library(tmp_path / "a.e57", columns(POINTS, COLORS, intensity=INTENSITY))
    [cloud] = read_fields(path)
    np.testing.assert_allclose(cloud.fields["rgb"], COLORS / 255, atol=1e-6)
    np.testing.assert_allclose(cloud.fields["intensity"], INTENSITY, atol=1e-6)
    assert cloud.color_kind == "8-bit" and not cloud.note and set(cloud.field_names) == {"rgb", "intensity"}
    [some] = read_fields(path, ("intensity",))
    assert list(some.fields) == ["intensity"] and some.field_names == cloud.field_names


@pytest.mark.parametrize(("full", "shift", "kind"), [(65535, 0, "16-bit"), (4095, 4, "12-bit"), (1023, 9, "10-bit")])
def test_deep_colors_are_scaled_by_their_limits(tmp_path: Path, full: int, shift: int, kind: str) -> None:
    table, times = DEEP >> shift, 1e9 + np.arange(COUNT) / 8
    path = deep(tmp_path / "a.e57", full, table, {"timeStamp": ("d", times), "returnIndex": ("q", np.arange(COUNT))})
    [cloud] = read_fields(path)
    np.testing.assert_allclose(cloud.fields["rgb"], table / full, atol=1e-6)
    assert np.array_equal(cloud.fields["timeStamp"], times) and cloud.units == {"timeStamp": "s"}
    assert np.array_equal(cloud.fields["returnIndex"], np.arange(COUNT)) and cloud.color_kind == kind


def test_invalid_points_and_colors(tmp_path: Path) -> None:
    bad, plain = np.arange(COUNT) % 5 == 0, np.arange(COUNT) % 3 == 0
    states = {"cartesianInvalidState": ("q", bad), "isColorInvalid": ("q", plain)}
    [cloud] = read_fields(deep(tmp_path / "a.e57", 255, COLORS, states))
    expected = np.where(plain[:, None], np.nan, COLORS / 255)[~bad]
    np.testing.assert_allclose(cloud.fields["rgb"], expected, atol=1e-6)
    assert len(cloud.points) == (~bad).sum()


def test_scans_without_colors_get_nan(tmp_path: Path) -> None:
    path = by_library(tmp_path / "a.e57", columns(POINTS), columns(POINTS + 1, COLORS))
    [cloud] = read_fields(path)
    assert np.isnan(cloud.fields["rgb"][:COUNT]).all()
    np.testing.assert_allclose(cloud.fields["rgb"][COUNT:], COLORS / 255, atol=1e-6)


def test_poses_and_points_are_those_of_the_library(tmp_path: Path) -> None:
    turn, shift = np.array([0.5, 0.5, -0.5, 0.5]), np.array([10.0, 20, 30])
    path = by_library(tmp_path / "a.e57", columns(POINTS, COLORS), rotation=turn, translation=shift)
    file = pye57.E57(str(path))
    expected = file.read_scan(0, colors=True, ignore_missing_fields=True)
    file.close()
    [cloud] = read_fields(path)
    np.testing.assert_allclose(cloud.points, np.column_stack([expected[axis] for axis in AXES]), atol=1e-9)
    np.testing.assert_allclose(255 * cloud.fields["rgb"], np.column_stack([expected[name] for name in CHANNELS]),
                               atol=1e-4)  # fmt: skip
