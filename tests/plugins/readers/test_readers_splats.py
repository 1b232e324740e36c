"""Gaussian splats: those that show a surface, from plain files and from packed ones."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from reader_files import read_fields

from z2p_core.interfaces import RawCloud, ScanError
from z2p_renderer.plugins.readers.ply import Ply

PLAIN = ("x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1", "scale_2",
         "rot_0", "rot_1", "rot_2", "rot_3")  # fmt: skip


def read(path: Path) -> RawCloud:
    [cloud] = Ply().read(path)
    assert isinstance(cloud, RawCloud)
    return cloud


def plain(path: Path, points: np.ndarray, opacity: np.ndarray, scale: np.ndarray | None = None,
          encoding: str = "binary_little_endian") -> None:  # fmt: skip
    """A file as 3DGS writes it: opacity before its sigmoid, sizes as logarithms."""
    table = np.zeros((len(points), len(PLAIN)), np.float32)
    table[:, :3] = points
    table[:, PLAIN.index("opacity")] = np.log(opacity / (1 - opacity))
    table[:, PLAIN.index("scale_0") : PLAIN.index("rot_0")] = np.log(0.01 if scale is None else scale[:, None])
    head = "".join(f"property float {name}\n" for name in PLAIN)
    blob = table.tobytes()
    if encoding == "ascii":
        blob = "".join(" ".join(f"{number:.9g}" for number in row) + "\n" for row in table.tolist()).encode()
    path.write_bytes(f"ply\nformat {encoding} 1.0\nelement vertex {len(points)}\n{head}end_header\n".encode() + blob)


def packed_111011(shares: np.ndarray) -> np.ndarray:
    """Three numbers (N, 3) of 0 to 1 in 11, 10 and 11 bits."""
    x, y, z = np.rint(shares * (2047, 1023, 2047)).astype(np.uint32).T
    return (x << 21) | (y << 11) | z


def packed(path: Path, points: np.ndarray, opacity: np.ndarray, scale: np.ndarray, chunks: int | None = None) -> None:
    """A file as SuperSplat packs it: bounds for each 256 Gaussians, then four whole numbers a Gaussian."""
    names = [f"{end}_{kind}{axis}" for kind in ("", "scale_") for end in ("min", "max") for axis in "xyz"]
    bounds, rows = [], []
    for start in range(0, len(points), 256):
        part = slice(start, start + 256)
        numbers = (points[part], np.log(scale[part, None] * np.ones(3)))
        bounds.append(np.concatenate([end(values, axis=0) for values in numbers for end in (np.min, np.max)]))
        shares = [(values - values.min(0)) / np.maximum(np.ptp(values, axis=0), 1e-9) for values in numbers]
        alpha = np.rint(opacity[part] * 255).astype(np.uint32)
        rows.append(np.column_stack([packed_111011(shares[0]), np.zeros(len(alpha), np.uint32),
                                     packed_111011(shares[1]), alpha | np.uint32(0x80402000)]))  # fmt: skip
    bounds = bounds[:chunks]
    head = f"element chunk {len(bounds)}\n" + "".join(f"property float {name}\n" for name in names)
    kinds = "".join(f"property uint packed_{name}\n" for name in ("position", "rotation", "scale", "color"))
    head += f"element vertex {len(points)}\n{kinds}"
    blob = np.array(bounds, "<f4").tobytes() + np.concatenate(rows).astype("<u4").tobytes()
    path.write_bytes(f"ply\nformat binary_little_endian 1.0\n{head}end_header\n".encode() + blob)


@pytest.fixture
def scene() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A surface of 700 Gaussians, 200 faint ones about it, and ten opaque ones as large as all of it, in any order."""
    rng = np.random.default_rng(2)
    points = np.concatenate([rng.normal(size=(700, 3)), 5 * rng.normal(size=(210, 3))]).astype(np.float32)
    opacity = np.concatenate([rng.uniform(0.1, 0.99, 700), rng.uniform(0.001, 0.03, 200), np.full(10, 0.9)])
    scale = np.concatenate([np.full(900, 0.02), np.full(10, 9.0)])
    order = rng.permutation(910)
    return points[order], opacity[order], scale[order]


@pytest.mark.parametrize("encoding", ["binary_little_endian", "ascii"])
def test_faint_and_huge_gaussians_are_dropped_and_counted(tmp_path: Path, scene, encoding: str) -> None:
    points, opacity, scale = scene
    plain(tmp_path / "a.ply", points, opacity, scale, encoding)
    cloud = read(tmp_path / "a.ply")
    assert np.array_equal(cloud.points.astype(np.float32), points[(opacity > 0.05) & (scale < 1)])
    assert "200 nearly transparent Gaussians (opacity below 5%) and 10 huge ones left out" in cloud.note
    assert "f_dc" not in cloud.note
    assert (cloud.up, cloud.up_certain) == ("-Y", False)


def test_packed_gaussians_match_plain_ones(tmp_path: Path, scene) -> None:
    points, opacity, scale = scene
    packed(tmp_path / "a.compressed.ply", points, opacity, scale)
    cloud = read(tmp_path / "a.compressed.ply")
    expected = points[(opacity > 0.05) & (scale < 1)]
    assert cloud.points.shape == expected.shape
    step = np.ptp(points, axis=0) / 1023  # each group's bounds are narrower still
    assert (np.abs(cloud.points - expected) < step).all()
    assert "200 nearly transparent Gaussians (opacity below 5%) and 10 huge ones left out" in cloud.note
    assert (cloud.up, cloud.up_certain) == ("-Y", False)


def test_packed_gaussians_without_their_bounds_are_refused(tmp_path: Path, scene) -> None:
    packed(tmp_path / "a.ply", *scene, chunks=3)
    with pytest.raises(ScanError, match=r"910 packed Gaussian splats need a row of bounds .* each 256 .* got 3"):
        read(tmp_path / "a.ply")


def test_packed_gaussians_of_other_types_are_refused(tmp_path: Path, scene) -> None:
    path = tmp_path / "a.ply"
    packed(path, *scene)
    whole = path.read_bytes()
    for old, new in ((b"uint packed_color", b"float packed_color"), (b"uint packed_scale", b"float packed_scale"),
                     (b"packed_rotation", b"packed_scale"), (b"binary_little_endian", b"ascii")):  # fmt: skip
        path.write_bytes(whole.replace(old, new))
        with pytest.raises(ScanError, match="packed Gaussian splats are binary, whole numbers of 4 bytes"):
            read(path)


def test_a_scene_of_faint_gaussians_alone_keeps_them(tmp_path: Path) -> None:
    points = np.random.default_rng(3).normal(size=(40, 3))
    plain(tmp_path / "a.ply", points, np.full(40, 0.01))
    cloud = read(tmp_path / "a.ply")
    assert len(cloud.points) == 40 and "none was left out" in cloud.note


def test_a_mesh_with_an_opacity_is_no_splats(tmp_path: Path) -> None:
    points = np.random.default_rng(4).normal(size=(30, 3)).astype("<f4")
    rows = np.column_stack([points, np.full(30, -9)]).astype("<f4")
    head = "".join(f"property float {name}\n" for name in ("x", "y", "z", "opacity"))
    (tmp_path / "a.ply").write_bytes(
        f"ply\nformat binary_little_endian 1.0\nelement vertex 30\n{head}end_header\n".encode() + rows.tobytes())
    cloud = read(tmp_path / "a.ply")
    assert np.array_equal(cloud.points, points) and not cloud.up


def test_cameras_of_a_trained_model_give_up_and_viewpoint(tmp_path: Path, scene) -> None:
    folder = tmp_path / "model" / "point_cloud" / "iteration_7000"
    folder.mkdir(parents=True)
    plain(folder / "point_cloud.ply", *scene)
    upward, cameras = np.array([0.0, -0.6, 0.8]), []
    for angle in np.radians([0, 80, 160, 240]):
        place = 5 * (np.cos(angle) * np.array([1.0, 0, 0]) + np.sin(angle) * np.array([0, 0.8, 0.6])) + 2 * upward
        forward = -place / np.linalg.norm(place)
        right = np.cross(forward, upward) / np.linalg.norm(np.cross(forward, upward))
        axes = np.column_stack([right, np.cross(forward, right), forward])  # from the camera's axes to the model's
        cameras.append({"id": len(cameras), "position": place.tolist(), "rotation": axes.tolist()})
    (tmp_path / "model" / "cameras.json").write_text(json.dumps(cameras))
    cloud = read(folder / "point_cloud.ply")
    assert (cloud.up, cloud.up_certain) == ("+Z", True) and "4 cameras" in cloud.up_reason
    assert cloud.upward is not None and np.allclose(cloud.upward, upward)
    assert cloud.seen_from is not None and cloud.seen_from.tolist() in [camera["position"] for camera in cameras]
    for damaged in ("[]", "{", '[{"position": [1, 2], "rotation": [[1]]}]', "[1]", '[{"position": 1}]'):
        (tmp_path / "model" / "cameras.json").write_text(damaged)
        assert (read(folder / "point_cloud.ply").up, read(folder / "point_cloud.ply").up_certain) == ("-Y", False)


def test_colors_of_gaussians_follow_those_that_are_kept(tmp_path: Path, scene) -> None:
    points, opacity, scale = scene
    plain(tmp_path / "a.ply", points, opacity, scale)
    blob = (tmp_path / "a.ply").read_bytes()
    start = len(blob) - 4 * len(PLAIN) * len(points)
    table = np.frombuffer(blob[start:], "<f4").reshape(len(points), -1).copy()
    color = np.random.default_rng(5).random((len(points), 3))
    table[:, PLAIN.index("f_dc_0") : PLAIN.index("opacity")] = (color - 0.5) / 0.28209479177387814
    (tmp_path / "a.ply").write_bytes(blob[:start] + table.tobytes())
    [cloud] = read_fields(tmp_path / "a.ply")
    kept = (opacity > 0.05) & (scale < 1)
    np.testing.assert_allclose(cloud.fields["rgb"], color[kept], atol=1e-6)
    np.testing.assert_allclose(cloud.fields["opacity"], opacity[kept], atol=1e-6)
    assert cloud.color_kind == "spherical harmonics of degree 0" and "normal" not in cloud.fields
    assert list(read(tmp_path / "a.ply").fields) == ["rgb"]


@pytest.mark.parametrize("bounded", [False, True])
def test_colors_of_packed_gaussians_are_unpacked(tmp_path: Path, scene, bounded: bool) -> None:
    points, opacity, scale = scene
    packed(tmp_path / "a.ply", points, opacity, scale)
    blob = (tmp_path / "a.ply").read_bytes()
    rows = np.frombuffer(blob[-16 * len(points) :], "<u4").reshape(-1, 4).copy()
    color = np.random.default_rng(5).integers(0, 256, (len(points), 3)).astype(np.uint32)
    rows[:, 3] = color[:, 0] << 24 | color[:, 1] << 16 | color[:, 2] << 8 | rows[:, 3] & 255
    head, bounds = blob[: -16 * len(points)].split(b"end_header\n")
    low, high = np.zeros(3), np.ones(3)
    if bounded:
        low, high = np.array([0.1, 0.2, 0.3]), np.array([0.5, 0.7, 0.9])
        names = "".join(f"property float {end}_{name}\n" for end in ("min", "max") for name in "rgb").encode()
        head = head.replace(b"element vertex", names + b"element vertex")
        table = np.frombuffer(bounds, "<f4").reshape(-1, 12)
        bounds = np.column_stack([table, np.tile([*low, *high], (len(table), 1))]).astype("<f4").tobytes()
    (tmp_path / "a.ply").write_bytes(head + b"end_header\n" + bounds + rows.tobytes())
    [cloud] = read_fields(tmp_path / "a.ply")
    kept = (opacity > 0.05) & (scale < 1)
    np.testing.assert_allclose(cloud.fields["rgb"], (low + color / 255 * (high - low))[kept], atol=1e-6)
    np.testing.assert_allclose(cloud.fields["opacity"], opacity[kept], atol=0.003)
    assert list(read(tmp_path / "a.ply").fields) == ["rgb"]
