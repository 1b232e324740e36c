"""Readers of numpy and las give back what was written; no damaged file of any format ends in another error."""

from __future__ import annotations

import io
import struct
import sys
import zipfile
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import trimesh
from pypcd4 import Encoding, PointCloud
from reader_files import SUFFIXES, cloud, e57, gltf, las, ply, ptx, read, refused
from vtk_files import legacy, xml

from z2p_core import registry
from z2p_core.api.point_arrays import point_arrays
from z2p_core.interfaces import ScanError
from z2p_renderer.plugins.readers.e57 import E57
from z2p_renderer.storage.scans.clouds import read_clouds


@pytest.mark.parametrize("dtype", ["<f2", "<f4", ">f8", "<i4"])
def test_numpy_round_trip_is_exact(tmp_path: Path, dtype: str) -> None:
    table = (np.random.default_rng(3).normal(size=(30, 6)) * 100).astype(dtype)
    for columns in (3, 4, 6):
        for array in (table[:, :columns], np.asfortranarray(table[:, :columns])):
            np.save(tmp_path / "a.npy", array)
            np.savez(tmp_path / "a.npz", array)
            np.savez_compressed(tmp_path / "b.npz", xyz=array, colours=table)
            np.savez(tmp_path / "c.npz", labels=np.zeros(3), points=array, xyz=np.zeros((4, 3)))
            for name in ("a.npy", "a.npz", "b.npz", "c.npz"):
                (points,) = read(tmp_path / name)
                assert np.array_equal(points, table[:, :3].astype("f8"))


def test_records_with_x_y_and_z_are_points(tmp_path: Path) -> None:
    points = cloud(20, "<f4")
    records = np.zeros(20, [("id", "<i4"), ("X", "<f4"), ("Y", "<f4"), ("Z", "<f4")])
    records["X"], records["Y"], records["Z"] = points.T
    np.save(tmp_path / "a.npy", records)
    assert np.array_equal(read(tmp_path / "a.npy")[0], points)
    assert np.array_equal(point_arrays(records).clouds[0], points)
    np.save(tmp_path / "b.npy", records[["id", "X", "Y"]])
    refused(tmp_path / "b.npy", (tmp_path / "b.npy").read_bytes(), "got dtype")


def test_npz_arrays_under_usual_names_are_read(tmp_path: Path) -> None:
    points, other, path = cloud(20, "<f4"), np.ones((20, 3)), tmp_path / "a.npz"
    for arrays in (
        *({key: points, "a": other, "b": other} for key in ("positions", "pos", "vertices", "coord", "coords")),
        {"points": np.array(20), "xyz": points}, {"points": np.ones((3, 20)), "xyz": points},
        {"pointcloud": points, "normals": other, "Colors": other, "pose": np.eye(3), "face": np.ones((9, 3), int)},
        {"a": points, "label": np.zeros(20), "name": np.array("fox"), "object": np.array([None])},
    ):  # fmt: skip
        np.savez(path, **arrays)
        assert np.array_equal(read(path)[0], points), list(arrays)
    for arrays, match in (
        ({"points": np.ones((3, 20)), "a": points}, "transpose"),
        ({"a": points, "b": other}, "got a, b; save the points"),
        ({"pos": np.ones(3), "label": np.zeros(20)}, r"got \(3,\)"),
        ({"normals": other, "label": np.ones(20)}, "got norm"),
    ):  # fmt: skip
        np.savez(path, **arrays)
        refused(path, path.read_bytes(), match)


def test_a_depth_cameras_point_map_is_one_cloud(tmp_path: Path) -> None:
    row, column = np.mgrid[:40, :50]
    depth = 2 + np.sin(row * column / 99)
    seen = np.stack([(column - 25) / 50 * depth, (row - 20) / 50 * depth, depth], -1)
    seen[:6, :9] = np.nan
    np.save(tmp_path / "a.npy", seen)
    (points,) = read(tmp_path / "a.npy")
    assert np.array_equal(points, seen.reshape(-1, 3), equal_nan=True)


def test_numpy_batches_give_a_cloud_each(tmp_path: Path) -> None:
    batch = np.random.default_rng(4).normal(size=(5, 20, 7))
    np.save(tmp_path / "a.npy", batch)
    np.save(tmp_path / "b.npy", batch[:, :, :3])
    for name in ("a.npy", "b.npy"):
        clouds = read(tmp_path / name)
        assert len(clouds) == 5
        assert np.array_equal(np.stack(clouds), batch[:, :, :3])


@pytest.mark.parametrize(("shape", "match"), [((3, 100), "transpose"), ((2, 3, 100), "transpose"), ((9,), "expected"),
                                               ((9, 129), "depth map"), ((9, 2), "expected"), ((), "expected"),
                                               ((64, 480), "depth map"), ((2, 2, 2, 3), "expected")])  # fmt: skip
def test_numpy_shapes_that_are_no_cloud(tmp_path: Path, shape: tuple[int, ...], match: str) -> None:
    np.save(tmp_path / "a.npy", np.zeros(shape))
    with pytest.raises(ScanError, match=match):
        read(tmp_path / "a.npy")


def test_an_npz_of_separate_coordinates_is_read(tmp_path: Path) -> None:
    path, table = tmp_path / "a.npz", np.random.default_rng(4).normal(size=(20, 4))
    np.savez(path, x=table[:, 0], y=table[:, 1].astype(np.float32), z=table[:, 2], intensity=table[:, 3])
    np.testing.assert_allclose(read(path)[0], table[:, :3], rtol=1e-6)
    np.savez(path, x=np.ones((4, 5)), y=np.ones((4, 5)), z=np.arange(20).reshape(4, 5))  # a grid
    assert read(path)[0].shape == (20, 3)
    np.savez(path, x=table[:, 0], y=table[1:, 1], z=table[:, 2])
    refused(path, path.read_bytes(), r"x, y and z of one shape, got \(20,\), \(19,\), \(20,\)")
    np.savez(path, rotations=np.ones((9, 4)), names=np.arange(9))  # four columns under no name of points
    refused(path, path.read_bytes(), "one array of floats")


def npy_header(shape: tuple[int, ...], descr: str = "<f8") -> bytes:
    buffer = io.BytesIO()
    np.lib.format.write_array_header_1_0(buffer, {"descr": descr, "fortran_order": False, "shape": shape})
    return buffer.getvalue()


def test_numpy_refusals(tmp_path: Path, monkeypatch) -> None:
    path = tmp_path / "a.npy"
    np.save(path, np.array([{"evil": 1}], dtype=object), allow_pickle=True)
    refused(path, path.read_bytes(), "pickled objects")
    np.savez(tmp_path / "b.npz", np.array([None], dtype=object))
    refused(tmp_path / "b.npz", (tmp_path / "b.npz").read_bytes(), "pickled objects")
    np.save(path, np.array(["x y z"]))
    refused(path, path.read_bytes(), "array of numbers")
    np.savez(tmp_path / "c.npz", first=np.zeros((9, 3)), second=np.zeros((9, 3)))
    refused(tmp_path / "c.npz", (tmp_path / "c.npz").read_bytes(), "got first, second")
    refused(tmp_path / "c.npz", b"PK garbage", "expected a numpy file")
    refused(path, b"garbage", "expected a numpy file")
    monkeypatch.setattr(np.lib.format, "read_array", lambda *_, **__: pytest.fail("the size was not checked first"))
    refused(path, npy_header((10**14, 3)) + bytes(24), "promises")
    refused(path, npy_header((2, 3)) + bytes(47), "cut short")


def test_npz_bomb_is_refused_before_it_unpacks(tmp_path: Path, monkeypatch) -> None:
    path = tmp_path / "bomb.npz"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive, archive.open("points.npy", "w") as member:
        member.write(npy_header((5_000_000, 3)))
        for _ in range(120):
            member.write(bytes(1_000_000))
    assert path.stat().st_size < 1_000_000
    monkeypatch.setattr(zipfile.ZipFile, "open", lambda *_, **__: pytest.fail("it was unpacked"))
    refused(path, path.read_bytes(), "that is no cloud")


@pytest.mark.parametrize("suffix", [".las", ".laz"])
def test_las_round_trip_keeps_utm_digits(tmp_path: Path, suffix: str) -> None:
    raw = np.random.default_rng(5).integers(0, 100_000, size=(2000, 3))
    offsets = (5e5, 5.4e6, 300.0)
    points = raw * 0.001 + np.array(offsets)
    path = tmp_path / f"scan{suffix}"
    las(path, points, offsets)
    assert np.array_equal(read(path)[0], points)


def test_las_refusals(tmp_path: Path) -> None:
    good = tmp_path / "good.las"
    las(good, cloud(100))
    blob = bytearray(good.read_bytes())
    refused(tmp_path / "a.las", bytes(blob[:-1]), "promises 100 points")
    endless = bytes(blob[:100]) + struct.pack("<I", 4_000_000_000) + bytes(blob[104:])  # number of its records
    refused(tmp_path / "a.las", endless, "promises more than")
    blob[107:111] = struct.pack("<I", 4_000_000_000)  # number of points
    refused(tmp_path / "a.las", bytes(blob), "promises 4000000000 points")
    refused(tmp_path / "a.las", b"garbage", "begins with 'LASF'")
    las(tmp_path / "good.laz", cloud(100))
    packed = bytearray((tmp_path / "good.laz").read_bytes())
    packed[107:111] = struct.pack("<I", 4_000_000_000)
    refused(tmp_path / "a.laz", bytes(packed), "LAS")
    packed = bytearray((tmp_path / "good.laz").read_bytes())
    (points_at,) = struct.unpack_from("<I", packed, 96)
    (table_at,) = struct.unpack_from("<q", packed, points_at)
    packed[table_at + 4 : table_at + 8] = struct.pack("<I", 4_000_000_000)  # number of chunks
    refused(tmp_path / "a.laz", bytes(packed), "promises more than")


def samples(folder: Path) -> dict[str, bytes]:
    """A good small file of every suffix."""
    points = cloud(40)
    rows = "".join(" ".join(map(repr, row)) + "\n" for row in points.tolist())
    six = "".join(" ".join(map(repr, [*row, 0.0, 0.0, 1.0])) + "\n" for row in points.tolist())
    PointCloud.from_xyz_points(points.astype("f4")).save(folder / "a.pcd", Encoding.BINARY_COMPRESSED)
    np.save(folder / "a.npy", points)
    np.savez_compressed(folder / "a.npz", points)
    las(folder / "a.las", points)
    las(folder / "a.laz", points)
    files = {suffix: (folder / f"a{suffix}").read_bytes() for suffix in (".pcd", ".npy", ".npz", ".las", ".laz")}
    triangles = trimesh.Trimesh(points, np.arange(39).reshape(13, 3), process=False)
    files[".stl"] = triangles.export(file_type="stl")
    files[".glb"] = trimesh.PointCloud(points).export(file_type="glb")
    e57(folder / "a.e57", points)
    files[".e57"] = (folder / "a.e57").read_bytes()
    files[".ptx"] = ptx(points).encode()
    files[".bin"] = np.column_stack([points, np.full(40, 0.5)]).astype("<f4").tobytes()
    files |= {".vtk": legacy(points, binary=True), ".vtp": xml(points, "appended", packed=True),
              ".vtu": xml(points, "binary", kind="UnstructuredGrid"), ".gltf": gltf(points)}  # fmt: skip
    files[".ply"] = ply(points, "binary_little_endian")
    files |= {suffix: text.encode() for suffix, text in {
        ".xyz": rows, ".txt": rows, ".asc": rows, ".csv": rows, ".tsv": rows,
        ".pts": f"40\n{rows}", ".xyzn": six, ".xyzrgb": six, ".off": f"OFF\n40 0 0\n{rows}",
        ".obj": "".join(f"v {row}\n" for row in rows.splitlines())}.items()}  # fmt: skip
    return files


def test_damaged_files_raise_nothing_but_scan_errors(tmp_path: Path) -> None:
    rng = np.random.default_rng(6)
    good = samples(tmp_path)
    assert sorted(good) == sorted(SUFFIXES)
    for suffix, blob in good.items():
        path = tmp_path / f"damaged{suffix}"
        reader = next(plugin for plugin in map(partial(registry.load, "readers"), registry.names("readers"))
                      if suffix in plugin.suffixes)()  # fmt: skip
        path.write_bytes(blob)
        assert len(read(path)[0]) == (39 if suffix == ".stl" else 40)
        refusals = 0
        for trial in range(40):
            damaged = np.frombuffer(blob, dtype=np.uint8).copy()
            spots = rng.integers(0, min(len(blob), 400), size=rng.integers(1, 9))
            damaged[spots] = rng.integers(0, 256, size=len(spots))
            cut = rng.integers(0, len(blob)) if trial % 4 == 0 else len(blob)
            path.write_bytes(damaged.tobytes()[:cut])
            try:
                reader.memory(path)
                read(path)
            except ScanError:
                refusals += 1
        assert refusals > 5, suffix


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_garbage_is_a_scan_error(tmp_path: Path, suffix: str) -> None:
    refused(tmp_path / f"a{suffix}", np.random.default_rng(7).bytes(5000), ".")


def test_stl_and_glb_vertices_are_unique_and_transformed(tmp_path: Path) -> None:
    ball = trimesh.creation.icosphere(subdivisions=2)
    expected = {tuple(row) for row in ball.vertices.astype("f4").tolist()}
    for suffix in (".stl", ".glb"):
        path = tmp_path / f"ball{suffix}"
        path.write_bytes(ball.export(file_type=suffix[1:]))
        (points,) = read(path)
        assert {tuple(row) for row in points.astype("f4").tolist()} == expected and len(points) == len(expected)
    text = tmp_path / "text.stl"
    text.write_text(ball.export(file_type="stl_ascii"))
    assert len(read(text)[0]) == len(expected)
    scene = trimesh.Scene()
    scene.add_geometry(ball, transform=trimesh.transformations.translation_matrix([5, 0, 0]))
    scene.add_geometry(trimesh.PointCloud([[0.0, 0.0, 9.0], [1.0, 0.0, 9.0]]))
    (tmp_path / "scene.glb").write_bytes(scene.export(file_type="glb"))
    (points,) = read(tmp_path / "scene.glb")
    assert len(points) == len(expected) + 2
    assert points[:, 0].max() == pytest.approx(6, abs=1e-5) and points[:, 2].max() == 9


def test_e57_joins_its_scans_and_names_the_missing_extra(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first, second = cloud(30), cloud(30) + 9
    e57(tmp_path / "a.e57", first, second)
    np.testing.assert_allclose(read(tmp_path / "a.e57")[0], np.vstack([first, second]), atol=1e-5)
    blob = (tmp_path / "a.e57").read_bytes()
    assert E57().memory(tmp_path / "a.e57") == 60 * 170
    refused(tmp_path / "b.e57", blob[: len(blob) // 2], "cannot be read")
    monkeypatch.setitem(sys.modules, "pye57", None)
    refused(tmp_path / "a.e57", blob, r"needs an extra.*\[e57\]")


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_memory_is_at_least_that_of_the_points(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"a{suffix}"
    path.write_bytes(samples(tmp_path)[suffix])
    (reader,) = (plugin for plugin in map(partial(registry.load, "readers"), registry.names("readers"))
                 if suffix in plugin.suffixes)  # fmt: skip
    needed = reader().memory(path)
    assert 39 * 24 * 3 <= needed <= 100 * max(path.stat().st_size, 40 * 24)


@pytest.mark.parametrize("suffix", [".npy", ".ply"])
def test_very_large_clouds_are_subsampled(
    suffix: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plugin = registry.load("readers", {".npy": "numpy", ".ply": "ply"}[suffix])
    table = np.random.default_rng(0).normal(size=(5000, 6)).astype("<f4")
    table[17, 0] = np.nan
    path = tmp_path / f"large{suffix}"
    if suffix == ".npy":
        np.save(path, table)
    else:
        names = "".join(f"property float {name}\n" for name in ("x", "y", "z", "nx", "ny", "nz"))
        header = f"ply\nformat binary_little_endian 1.0\nelement vertex 5000\n{names}end_header\n"
        path.write_bytes(header.encode() + table.tobytes())
    [whole] = read_clouds(path)
    before = plugin().memory(path)
    monkeypatch.setattr(plugin, "max_rows", 1000)
    monkeypatch.setattr(sys.modules[plugin.__module__], "BLOCK_BYTES", 0)
    [some] = read_clouds(path)
    assert whole.total is None and len(whole.points) == 4999
    assert some.total == 5000 and 999 <= len(some.points) <= 1000
    assert {row.tobytes() for row in some.points} <= {row.tobytes() for row in whole.points}
    assert plugin().memory(path) < before / 4
