"""Whatever holds points gives the same points; what holds none is refused with a word why."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import laspy
import numpy as np
import pytest
import torch
import trimesh
from pypcd4 import PointCloud

from z2p_core.api.point_arrays import PointArrays, point_arrays
from z2p_core.interfaces import ScanError

CLOUD = np.random.default_rng(0).normal(size=(20, 3)).astype(np.float32)
HOLDERS = {
    "array": CLOUD,
    "float64": CLOUD.astype(np.float64),
    "list": CLOUD.tolist(),
    "six columns": np.hstack([CLOUD, CLOUD]),
    "four columns": np.hstack([CLOUD, CLOUD[:, :1]]),
    "tensor": torch.from_numpy(CLOUD),
    "tensor with a gradient": torch.from_numpy(CLOUD).requires_grad_(),
    "trimesh cloud": trimesh.PointCloud(CLOUD),
    "pyvista-like": SimpleNamespace(points=CLOUD),
    "laspy-like": SimpleNamespace(xyz=CLOUD),
    "dict": {"xyz": CLOUD, "colors": CLOUD},
    "dict of lists": {"X": CLOUD[:, 0].tolist(), "Y": CLOUD[:, 1].tolist(), "Z": CLOUD[:, 2].tolist(), "label": "ab"},
    "dict of tensors": {"points": torch.from_numpy(CLOUD)},
    "pypcd4": PointCloud.from_xyz_points(CLOUD),
    "graph of torch's": SimpleNamespace(pos=torch.from_numpy(CLOUD)),
}


@pytest.mark.parametrize("name", HOLDERS)
def test_every_kind_of_cloud_object_gives_its_points(name: str) -> None:
    given = point_arrays(HOLDERS[name])
    assert not given.batched
    [cloud] = given.clouds
    assert cloud.dtype == np.float64
    np.testing.assert_allclose(cloud, CLOUD)
    assert given.unused_columns == {"four columns": 1, "six columns": 3}.get(name, 0)


def coloured_cloud(kind: str, coloured: bool) -> object:
    """Such a library's cloud, with colours or without."""
    colours = np.full((20, 3), 0.5)
    extra = [np.full(20, 7.0, np.float32)] if coloured else []
    names = ("x", "y", "z", *(["rgb"] if coloured else []))
    match kind:
        case "dict":
            return {"points": CLOUD, **({"colors": colours} if coloured else {"normals": colours})}
        case "trimesh":
            return trimesh.PointCloud(CLOUD, colors=colours if coloured else None)
        case "trimesh mesh":
            mesh = trimesh.creation.icosphere(1)
            if coloured:
                mesh.visual.vertex_colors = [200, 10, 10, 255]
            return mesh
        case "pypcd4":
            return PointCloud.from_points([*CLOUD.T, *extra], names, [np.float32] * len(names))
        case "pyvista-like":
            return SimpleNamespace(points=CLOUD, point_data={"RGB": colours} if coloured else {"quality": colours})
        case "laspy":
            header = laspy.LasHeader(point_format=2 if coloured else 0)
            content = laspy.LasData(header)
            content.x, content.y, content.z = CLOUD.T.astype(np.float64)
            if coloured:
                content.red = np.arange(20, dtype=np.uint16)
            return content
        case "records":
            colours = ("red", "green", "blue") if coloured else ("label",)
            return np.zeros(20, [(name, "f4") for name in ("x", "y", "z", *colours)])
    raise ValueError(kind)


def is_coloured(given: PointArrays) -> bool:
    return any("rgb" in fields for fields in given.fields)


@pytest.mark.parametrize("coloured", [True, False])
@pytest.mark.parametrize("kind", ["dict", "trimesh", "trimesh mesh", "pypcd4", "pyvista-like", "laspy", "records"])
def test_colors_of_an_object_are_detected(kind: str, coloured: bool) -> None:
    cloud_object = coloured_cloud(kind, coloured)
    assert is_coloured(point_arrays(cloud_object)) is coloured
    assert is_coloured(point_arrays([cloud_object, cloud_object])) is coloured or kind == "records"


def test_open3d_clouds_are_accepted() -> None:
    open3d = pytest.importorskip("open3d")
    legacy = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(CLOUD.astype(np.float64)))
    tensor = open3d.t.geometry.PointCloud(CLOUD)
    for holder in (legacy, tensor):
        np.testing.assert_allclose(point_arrays(holder).clouds[0], CLOUD)
        assert not is_coloured(point_arrays(holder))
    legacy.colors = open3d.utility.Vector3dVector(np.full((20, 3), 0.5))
    tensor.point.colors = open3d.core.Tensor(np.full((20, 3), 0.5))
    assert is_coloured(point_arrays(legacy)) and is_coloured(point_arrays(tensor))


def test_a_scene_gives_its_transformed_vertices() -> None:
    scene, moved = trimesh.Scene(), np.diag([2.0, 2.0, 2.0, 1.0])
    moved[:3, 3] = (5, 6, 7)
    scene.add_geometry(trimesh.PointCloud(CLOUD), geom_name="cloud", node_name="here")
    scene.graph.update("there", matrix=moved, geometry="cloud")
    [cloud] = point_arrays(scene).clouds
    assert len(cloud) == 2 * len(CLOUD)
    for wanted in (CLOUD, 2 * CLOUD + (5, 6, 7)):
        assert np.abs(cloud[:, None] - wanted).max(2).min(0).max() < 1e-5
    assert point_arrays([scene, CLOUD]).batched


def test_half_precision_is_read() -> None:
    [cloud] = point_arrays(torch.from_numpy(CLOUD).bfloat16()).clouds
    np.testing.assert_allclose(cloud, CLOUD, rtol=0.01)


@pytest.mark.parametrize("batch", [np.stack([CLOUD] * 4), torch.from_numpy(np.stack([CLOUD] * 4)), [CLOUD] * 4,
                                   [CLOUD, CLOUD[:5], torch.from_numpy(CLOUD), trimesh.PointCloud(CLOUD)]])  # fmt: skip
def test_batches(batch: object) -> None:
    given = point_arrays(batch)
    assert given.batched and len(given.clouds) == 4
    np.testing.assert_allclose(given.clouds[3], CLOUD)


def test_the_callers_array_is_unchanged() -> None:
    mine = CLOUD.astype(np.float64)
    point_arrays(mine).clouds[0][:] = 0
    np.testing.assert_array_equal(mine, CLOUD)


@pytest.mark.parametrize(
    ("cloud_object", "message"),
    [
        (np.zeros((3, 100)), "transpose"), (np.zeros(9), "expected points"), (np.zeros((9, 2)), "expected points"),
        (np.zeros((9, 129)), "expected points"), (np.zeros((2, 2, 9, 3)), "expected points"), (None, "expected points"),
        ([[1, 2, 3], [1, 2]], "expected points as an array"), (np.array([["a", "b", "c"]]), "numbers"),
        (np.zeros((4, 3), dtype=complex), "numbers"), (torch.zeros((4, 3), dtype=torch.complex64), "complex64"),
        (torch.zeros((4, 3), dtype=torch.bool), "bool"), (np.zeros((4, 3), dtype=bool), "numbers, got dtype bool"),
        (np.zeros(4, dtype=[("x", "U3"), ("y", "f4"), ("z", "f4")]), "as numbers, got dtype <U3"),
        (np.zeros(4, dtype=[("x", "f4"), ("y", "f4")]), "records with fields x, y and z, got x, y"),
        (np.zeros((4, 3), dtype=object), "numbers, got dtype object"), (np.ma.zeros((4, 3), dtype=complex), "complex"),
        ({"x": [1, 2], "y": ["a", "b"], "z": [3, 4]}, "numbers, got dtype"), ({}, "got nothing"),
        ({"x": [1.0], "y": [1.0, 2.0], "z": [1.0]}, "x, y and z of one shape"), (object(), "expected points"),
        ("cloud", "expected points"), (None, "got NoneType$"),
        ({"a": CLOUD}, "dict with points, .* or x, y and z, got a$"),
        ((row for row in CLOUD), "got generator$"),
        ([Path("a.ply"), Path("b.ply")], r"one path, got list of \w*Path$"), (("a.ply",), "got tuple of str$"),
        (5, "got int$"), ([CLOUD, None], r"cloud \[1\]: .* got NoneType$"),
        (trimesh.Scene(), "a Scene without geometry"), (torch.eye(3).to_sparse(), "got Tensor .*Sparse"),
    ],
)  # fmt: skip
def test_refusals(cloud_object: object, message: str) -> None:
    with pytest.raises(ScanError, match=message):
        point_arrays(cloud_object)


def point_map(height: int = 60, width: int = 80, scale: float = 1.0) -> np.ndarray:
    """What a pinhole camera sees of a wavy wall, (H, W, 3) float32, a point a pixel."""
    row, column = np.mgrid[:height, :width]
    across, down = (column - 0.48 * width) / width, (row - 0.55 * height) / width
    depth = 2 + 0.4 * np.sin(9 * across) * np.cos(7 * down) + 0.8 * (across > 0.1)
    return (scale * np.stack([across * depth, down * depth, depth], -1)).astype(np.float32)


def holed(points: np.ndarray, missing: float) -> np.ndarray:
    """The map where only a disc in its middle was measured."""
    row, column = np.mgrid[: points.shape[0], : points.shape[1]]
    seen = np.hypot(row - points.shape[0] / 2, column - points.shape[1] / 2) < 14
    return np.where(seen[..., None], points, missing)


def elsewhere(points: np.ndarray, noise: float = 0.0) -> np.ndarray:
    """The map in axes of the world's rather than the camera's, as networks give it that find several views' maps."""
    turn = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    return points @ turn + (1.0, -2.0, 3.0) + noise * np.random.default_rng(2).normal(size=points.shape)


@pytest.mark.parametrize(
    "given",
    [point_map(), -point_map(), point_map(900, 1300), holed(point_map(), np.nan), holed(point_map(), 0.0),
     (point_map() * 1000).astype(np.int16), torch.from_numpy(point_map()), point_map().astype(np.float16),
     np.concatenate([point_map(), np.ones((60, 80, 3))], -1), point_map(16, 2000), np.asfortranarray(point_map()),
     elsewhere(point_map()), elsewhere(point_map(), 0.005), elsewhere(holed(point_map(), np.nan)),
     elsewhere(point_map()).swapaxes(0, 1)],
    ids=lambda given: f"{tuple(given.shape)} {given.dtype}",
)  # fmt: skip
def test_a_depth_cameras_point_map_is_one_cloud(given: np.ndarray) -> None:
    arrays = point_arrays(given)
    assert not arrays.batched and len(arrays.clouds) == 1
    assert np.array_equal(arrays.clouds[0], np.asarray(given)[..., :3].reshape(-1, 3), equal_nan=True)


def frames() -> np.ndarray:
    """An ordered mesh (a sphere's vertices), 40 times as it walks, turns and swells."""
    vertices = trimesh.creation.uv_sphere(count=(12, 24)).vertices
    return np.stack([vertices * (1 + 0.01 * step) + [0.05 * step, 0, 4] for step in range(40)])


def sheets() -> np.ndarray:
    """40 grids (24 x 24) of one wavy plane, shifted."""
    grid = np.stack(np.meshgrid(np.linspace(-1, 1, 24), np.linspace(-1, 1, 24)), -1).reshape(-1, 2)
    plane = np.column_stack([grid, 3 + 0.1 * np.sin(5 * grid[:, 0])])
    return plane + np.linspace(0, 0.2, 40)[:, None, None]


RNG = np.random.default_rng(3)


@pytest.mark.parametrize(
    "batch",
    [RNG.normal(size=(64, 500, 3)), RNG.uniform(size=(16, 16, 3)), RNG.normal((0, 0, 50), size=(32, 100, 3)),
     np.stack([CLOUD] * 32), frames(), frames()[:, :, [2, 0, 1]], frames() * [1, 1, 0], frames()[:, ::-1] * 1e-3,
     np.sort(RNG.uniform(size=(32, 200, 3)), axis=1), sheets(), point_map()[:15], np.zeros((20, 50, 3)),
     elsewhere(frames()), elsewhere(sheets()), frames() * [1, 1, 1e-3], np.full((20, 50, 3), np.nan),
     np.where(RNG.uniform(size=(64, 64, 1)) < 0.01, RNG.normal(size=(64, 64, 3)), 0),
     np.stack([point_map(20, 30).reshape(-1, 3) * scale for scale in np.linspace(1, 2, 20)])],
    ids=lambda batch: str(batch.shape),
)  # fmt: skip
def test_a_batch_is_never_taken_for_a_point_map(batch: np.ndarray) -> None:
    arrays = point_arrays(batch)
    assert arrays.batched and len(arrays.clouds) == len(batch)


class Table:
    """What data frames have in common, of columns by name."""

    def __init__(self, columns: dict[object, np.ndarray]) -> None:
        self._columns, self.columns = columns, list(columns)

    def __getitem__(self, name: object) -> np.ndarray:
        return self._columns[name]

    def to_numpy(self) -> np.ndarray:
        return np.column_stack(list(self._columns.values()))


def test_columns_of_a_data_frame_are_selected_by_name() -> None:
    x, y, z = CLOUD.T
    noise = np.zeros(len(CLOUD))
    for table in ({"z": z, "y": y, "x": x}, {"r": noise, "g": noise, "b": noise, " X": x, "Y": y, "Z": z},
                  {0: x, 1: y, 2: z}):  # fmt: skip
        assert np.array_equal(point_arrays(Table(table)).clouds[0], CLOUD)
