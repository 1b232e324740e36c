"""Small scan files for the readers' tests, written by hand or by the formats' libraries."""

from __future__ import annotations

import base64
import json
from pathlib import Path

import laspy
import numpy as np
import pytest

from z2p_core import registry
from z2p_core.interfaces import RawCloud, ScanError
from z2p_core.testing import check_reader

SUFFIXES = [".ply", ".pcd", ".xyz", ".xyzn", ".xyzrgb", ".pts", ".txt", ".asc", ".csv", ".tsv", ".obj", ".off",
            ".npy", ".npz", ".las", ".laz", ".stl", ".glb", ".e57", ".ptx", ".bin",
            ".vtk", ".vtp", ".vtu", ".gltf"]  # fmt: skip
PLY_TYPES = {"float": "f4", "double": "f8"}


def read(path: Path) -> list[np.ndarray]:
    """What the registered reader of the file's suffix gives."""
    plugins = [registry.load("readers", name) for name in registry.names("readers")]
    (plugin,) = [plugin for plugin in plugins if path.suffix.lower() in plugin.suffixes]
    clouds = [getattr(cloud, "points", cloud) for cloud in plugin().read(path)]
    assert all(cloud.dtype == np.float64 and cloud.ndim == 2 and cloud.shape[1] == 3 for cloud in clouds)
    return clouds


def read_fields(
    path: Path, wanted: tuple[str, ...] | None = None, columns: tuple[str, ...] | None = None
) -> list[RawCloud]:
    """The clouds of a file with the fields that are wanted; with all of them, None, the contract is checked too."""
    plugins = [registry.load("readers", name) for name in registry.names("readers")]
    (plugin,) = [plugin for plugin in plugins if path.suffix.lower() in plugin.suffixes]
    reader = plugin()
    reader.wanted, reader.columns = wanted, columns
    clouds = [cloud if isinstance(cloud, RawCloud) else RawCloud(cloud) for cloud in reader.read(path)]
    for cloud in clouds:
        for name, values in cloud.fields.items():
            assert values.shape == ((len(cloud.points), 3) if name in ("rgb", "normal") else (len(cloud.points),))
            assert values.dtype.isnative and values.dtype.kind in "fiu"
        assert set(cloud.fields) <= set(cloud.field_names)
    if wanted is None and columns is None:
        check_reader(plugin, path)
    return clouds


def cloud(count: int = 50, dtype: str = "f8") -> np.ndarray:
    return np.random.default_rng(1).normal(size=(count, 3)).astype(dtype)


def refused(path: Path, blob: bytes | str, match: str) -> None:
    path.write_bytes(blob.encode() if isinstance(blob, str) else blob)
    with pytest.raises(ScanError, match=match) as caught:
        read(path)
    assert "\n" not in str(caught.value)


def ply(points: np.ndarray, encoding: str, kind: str = "double", count: int | None = None, extra: str = "") -> bytes:
    axes = "".join(f"property {kind} {axis}\n" for axis in "xyz")
    count = len(points) if count is None else count
    head = f"ply\nformat {encoding} 1.0\ncomment made by hand\nelement vertex {count}\n{axes}{extra}end_header\n"
    if encoding == "ascii":
        return head.encode() + "".join(" ".join(map(repr, row)) + "\n" for row in points.tolist()).encode()
    order = ">" if "big" in encoding else "<"
    return head.encode() + points.astype(order + PLY_TYPES[kind]).tobytes()


def las(path: Path, points: np.ndarray, offsets: tuple[float, ...] = (0.0, 0.0, 0.0)) -> None:
    header = laspy.LasHeader(point_format=3, version="1.2")
    header.scales, header.offsets = np.full(3, 0.001), np.array(offsets)
    content = laspy.LasData(header)
    content.x, content.y, content.z = points.T
    content.write(path)


def ptx(*scans: np.ndarray, matrix: np.ndarray | None = None) -> str:
    """A file of scans, each a line of cells, of which the last measured nothing."""
    rows = [" ".join(map(repr, row)) for row in (np.eye(4) if matrix is None else matrix).tolist()]
    text = ""
    for points in scans:
        cells = [" ".join(map(repr, [*row, 0.5, 10, 20, 30])) for row in [*points.tolist(), [0, 0, 0]]]
        text += "\n".join([f"{len(cells)}", "1", "4 5 6", "1 0 0", "0 1 0", "0 0 1", *rows, *cells]) + "\n"
    return text


def gltf(points: np.ndarray, uri: str = "") -> bytes:
    """A glTF file of points, which keeps them in its own text, or at the place that is named."""
    blob = points.astype("<f4").tobytes()
    uri = uri or "data:application/octet-stream;base64," + base64.b64encode(blob).decode()
    low, high = (end(points.astype("f4"), axis=0).tolist() for end in (np.min, np.max))
    accessor = {"bufferView": 0, "componentType": 5126, "count": len(points), "type": "VEC3", "min": low, "max": high}
    part = {"attributes": {"POSITION": 0}, "mode": 0, "material": 0}
    tree = {"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
            "meshes": [{"primitives": [part]}], "materials": [{}], "accessors": [accessor],
            "bufferViews": [{"buffer": 0, "byteLength": len(blob)}], "buffers": [{"byteLength": len(blob), "uri": uri}],
            "images": [{"uri": "nowhere.png"}]}  # fmt: skip
    return json.dumps(tree).encode()


def e57(path: Path, *scans: np.ndarray) -> None:
    import pye57

    file = pye57.E57(str(path), mode="w")
    for points in scans:
        columns = dict(zip(("cartesianX", "cartesianY", "cartesianZ"), points.T.copy(), strict=True))
        file.write_scan_raw(columns)
    file.close()
