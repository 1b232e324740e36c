"""Colors, normals, scalars and labels of other libraries' clouds arrive exactly and in the points' order."""

from __future__ import annotations

import io
from types import SimpleNamespace
from typing import Any

import laspy
import numpy as np
import pytest
import torch
import trimesh
from pypcd4 import PointCloud

from z2p_core.api.point_arrays import PointArrays, point_arrays
from z2p_core.interfaces import ScanError

RNG = np.random.default_rng(0)
COUNT = 50
CLOUD = RNG.normal(size=(COUNT, 3))
BYTES = RNG.integers(0, 256, (COUNT, 3), dtype=np.uint8)
COLORS = BYTES / 255.0
NORMALS = RNG.normal(size=(COUNT, 3)).astype(np.float32)
SCALARS = RNG.random(COUNT)
LABELS = RNG.integers(0, 9, COUNT)
PACKED = (0xFF << 24 | BYTES[:, 0].astype(np.uint32) << 16 | BYTES[:, 1].astype(np.uint32) << 8 | BYTES[:, 2])


def only_fields(given: PointArrays) -> dict[str, np.ndarray]:
    """The fields of a single cloud, all loaded."""
    [fields] = given.fields
    return dict(fields)


def fields_of(source: Any) -> dict[str, np.ndarray]:
    return only_fields(point_arrays(source))


def assert_colors(fields: dict[str, np.ndarray], wanted: np.ndarray = COLORS) -> None:
    assert fields["rgb"].dtype == np.float32
    np.testing.assert_allclose(fields["rgb"], wanted, atol=1e-6)


def las_cloud(colors: np.ndarray | None = None, version: int = 7) -> laspy.LasData:
    """laspy's cloud of intensities, classes, and scaled and vector extra dimensions."""
    header = laspy.LasHeader(point_format=version)
    header.scales = np.full(3, 1e-4)
    header.add_extra_dim(laspy.ExtraBytesParams("range", "i2", scales=np.array([0.5]), offsets=np.array([10.0])))
    header.add_extra_dim(laspy.ExtraBytesParams("echo", "3f4"))
    las = laspy.LasData(header)
    las.x, las.y, las.z = CLOUD.T
    las.intensity, las.classification = np.arange(COUNT) * 7, LABELS
    las["range"], las.echo = np.arange(COUNT) + 10.0, NORMALS
    if colors is not None:
        las.red, las.green, las.blue = colors.T
    return las


def test_fields_of_an_open3d_cloud() -> None:
    open3d = pytest.importorskip("open3d")
    cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(CLOUD))
    assert fields_of(cloud) == {}
    cloud.colors, cloud.normals = (open3d.utility.Vector3dVector(part) for part in (COLORS, NORMALS))
    fields = fields_of(cloud)
    assert_colors(fields)
    np.testing.assert_array_equal(fields["normal"], NORMALS)
    cloud.colors = open3d.utility.Vector3dVector(COLORS[:9])
    given = point_arrays(cloud)
    assert "rgb" not in given.fields[0] and "(9, 3), for 50 points" in given.notes[0]


def test_fields_of_an_open3d_tensor_cloud() -> None:
    open3d = pytest.importorskip("open3d")
    for colors in (BYTES, COLORS, COLORS.astype(np.float32)):
        cloud = open3d.t.geometry.PointCloud(CLOUD)
        for name, part in {"colors": colors, "normals": NORMALS, "label": LABELS[:, None], "time": SCALARS}.items():
            cloud.point[name] = open3d.core.Tensor(part)
        fields = fields_of(cloud)
        assert_colors(fields)
        np.testing.assert_array_equal(fields["normal"], NORMALS)
        np.testing.assert_array_equal(fields["label"], LABELS)
        np.testing.assert_array_equal(fields["time"], SCALARS)
    cloud.point.colors = open3d.core.Tensor(BYTES // 128)  # bytes of 0 and 1 are almost black
    assert_colors(fields_of(cloud), BYTES // 128 / 255)


def test_fields_of_open3d_meshes() -> None:
    open3d = pytest.importorskip("open3d")
    triangles = open3d.utility.Vector3iVector([[0, 1, 2]])
    mesh = open3d.geometry.TriangleMesh(open3d.utility.Vector3dVector(CLOUD), triangles)
    assert fields_of(mesh) == {}
    mesh.vertex_colors = open3d.utility.Vector3dVector(COLORS)
    assert_colors(fields_of(mesh))
    assert_colors(fields_of(open3d.t.geometry.TriangleMesh.from_legacy(mesh)))


def test_colors_of_an_open3d_line_set_are_of_lines() -> None:
    open3d = pytest.importorskip("open3d")
    lines = open3d.geometry.LineSet(open3d.utility.Vector3dVector(CLOUD), open3d.utility.Vector2iVector([[0, 1]]))
    lines.colors = open3d.utility.Vector3dVector([[1, 0, 0]])
    assert not point_arrays(lines).notes and fields_of(lines) == {}


def test_fields_of_a_trimesh_cloud() -> None:
    metadata = {"intensity": SCALARS, "name": "x", "other": [1, 2], "ragged": [[1, 2], [3]]}
    cloud = trimesh.PointCloud(CLOUD, metadata=metadata)
    fields = fields_of(cloud)
    assert list(fields) == ["intensity"]
    np.testing.assert_array_equal(fields["intensity"], SCALARS)
    for colors in (BYTES, np.column_stack([BYTES, BYTES[:, 0]])):
        assert_colors(fields_of(trimesh.PointCloud(CLOUD, colors=colors)))


def test_fields_of_a_trimesh_mesh() -> None:
    mesh = trimesh.Trimesh(CLOUD, [[0, 1, 2], [2, 1, 3]], process=False)
    mesh.visual.vertex_colors  # noqa: B018  trimesh makes its default grey when asked
    assert list(fields_of(mesh)) == ["normal"]
    mesh.vertex_attributes["quality"] = SCALARS
    mesh.visual.vertex_colors = BYTES
    fields = fields_of(mesh)
    assert_colors(fields)
    np.testing.assert_array_equal(fields["quality"], SCALARS)
    assert (mesh.face_normals[0] @ fields["normal"][0]) > 0.999 * np.linalg.norm(fields["normal"][0]) > 0
    mesh.vertex_normals = NORMALS / np.linalg.norm(NORMALS, axis=1, keepdims=True)
    np.testing.assert_allclose(fields_of(mesh)["normal"], mesh.vertex_normals, atol=1e-6)


def colors_of(source: Any) -> np.ndarray:
    return point_arrays(source).fields[0]["rgb"]


def test_colors_of_faces_are_averaged_at_vertices() -> None:
    mesh = trimesh.Trimesh(CLOUD[:5], [[0, 1, 2], [2, 1, 3]], process=False)
    mesh.visual.face_colors = [[255, 0, 0, 255], [0, 0, 255, 255]]
    red, blue, both = (1, 0, 0), (0, 0, 1), (0.5, 0, 0.5)
    np.testing.assert_allclose(colors_of(mesh), [red, both, both, blue, [np.nan] * 3], atol=1e-6)


def textured_mesh(**looks: Any) -> trimesh.Trimesh:
    """Four vertices, two at the left and two at the right edge of a texture."""
    mesh = trimesh.Trimesh(CLOUD[:4], [[0, 1, 2], [0, 2, 3]], process=False)
    uv = np.array([[0.0, 0.5], [0.1, 0.5], [1.0, 0.5], [0.9, 0.5]])
    mesh.visual = trimesh.visual.TextureVisuals(uv=uv, **looks)
    return mesh


def test_colors_of_a_texture_at_the_vertices() -> None:
    image = pytest.importorskip("PIL.Image")
    pixels = np.zeros((2, 4, 3), dtype=np.uint8)
    pixels[:, :2, 0], pixels[:, 2:, 2] = 255, 255
    mesh = textured_mesh(image=image.fromarray(pixels))
    np.testing.assert_array_equal(colors_of(mesh), [[1, 0, 0], [1, 0, 0], [0, 0, 1], [0, 0, 1]])


def test_colors_of_a_material() -> None:
    materials = trimesh.visual.material
    simple = materials.SimpleMaterial(diffuse=[10, 20, 30, 255])
    np.testing.assert_allclose(colors_of(textured_mesh(material=simple))[3], np.divide([10, 20, 30], 255), atol=1e-6)
    linear = materials.PBRMaterial(baseColorFactor=[255, 55, 0, 255])  # as glTF stores it
    np.testing.assert_allclose(colors_of(textured_mesh(material=linear))[3], [1, 0.5, 0], atol=0.005)
    for default in ({}, {"material": materials.SimpleMaterial()}, {"material": materials.PBRMaterial()}):
        assert "rgb" not in point_arrays(textured_mesh(**default)).fields[0]


@pytest.mark.parametrize("with_face", [False, True])
@pytest.mark.parametrize("encoding", ["ascii", "binary_little_endian"])
def test_trimesh_keeps_what_a_ply_file_has(encoding: str, with_face: bool) -> None:
    names = [*"xyz", "red", "green", "blue", "intensity"]
    types = ["float"] * 3 + ["ushort"] * 3 + ["float"]
    kinds = {"float": "<f4", "ushort": "<u2"}
    rows = np.zeros(COUNT, [(name, kinds[kind]) for name, kind in zip(names, types, strict=True)])
    colors = RNG.integers(0, 65536, (COUNT, 3))
    for name, column in zip(names, [*CLOUD.T, *colors.T, SCALARS], strict=True):
        rows[name] = column
    properties = "".join(f"property {kind} {name}\n" for name, kind in zip(names, types, strict=True))
    face = "element face 1\nproperty list uchar int vertex_indices\n" if with_face else ""
    text = encoding == "ascii"
    body = "".join(" ".join(map(str, row.tolist())) + "\n" for row in rows).encode() if text else rows.tobytes()
    triangle = b"3 0 1 2\n" if text else b"\3" + np.arange(3, dtype="<i4").tobytes()
    header = f"ply\nformat {encoding} 1.0\nelement vertex {COUNT}\n{properties}{face}end_header\n".encode()
    loaded = trimesh.load(io.BytesIO(header + body + triangle * with_face), file_type="ply", process=False)
    fields = point_arrays(loaded).fields[0]
    assert_colors(dict(fields), colors / 65535)
    np.testing.assert_allclose(fields["intensity"], SCALARS, rtol=1e-6)
    loaded.vertices = loaded.vertices[::-1]
    assert "intensity" not in point_arrays(loaded).fields[0]


def test_fields_of_a_scene_follow_its_vertices() -> None:
    scene = trimesh.Scene()
    mesh = trimesh.creation.icosphere(1)
    turn = trimesh.transformations.rotation_matrix(np.pi / 2, [0, 0, 1])
    scene.add_geometry(trimesh.PointCloud(CLOUD, colors=BYTES), node_name="cloud")
    scene.add_geometry(mesh, node_name="ball", transform=turn)
    given = point_arrays(scene)
    fields = only_fields(given)
    vertices = given.clouds[0]
    assert_colors(fields, np.concatenate([COLORS, np.full((len(mesh.vertices), 3), np.nan)]))
    normals = fields["normal"][COUNT:] / np.linalg.norm(fields["normal"][COUNT:], axis=1, keepdims=True)
    np.testing.assert_allclose(normals, vertices[COUNT:], atol=0.05)


@pytest.mark.parametrize("version", [3, 7])
@pytest.mark.parametrize("factor", [1, 256, 257])
def test_fields_of_a_laspy_cloud(version: int, factor: int) -> None:
    colors = BYTES.astype(np.uint16) * factor
    given = point_arrays(las_cloud(colors, version))
    fields = only_fields(given)
    assert_colors(fields, colors / (255 if factor == 1 else 65535))
    np.testing.assert_array_equal(fields["intensity"], np.arange(COUNT) * 7)
    np.testing.assert_array_equal(fields["classification"], LABELS)
    np.testing.assert_array_equal(fields["range"], np.arange(COUNT) + 10.0)
    np.testing.assert_array_equal(fields["echo_1"], NORMALS[:, 1])
    assert {"return_number", "gps_time", "user_data"} <= fields.keys()
    assert not {"X", "x", "red", "green"} & fields.keys()
    assert given.class_names[0]["classification"][2] == "ground"


def test_fields_of_laspys_records() -> None:
    las = las_cloud(BYTES.astype(np.uint16))
    for source, count in ((las[:20], 20), (las.points, COUNT), (las.points[:20], 20)):
        given = point_arrays(source)
        np.testing.assert_allclose(given.clouds[0], CLOUD[:count], atol=1e-4)
        assert_colors(only_fields(given), COLORS[:count])
    assert point_arrays([las.points, las]).batched


def test_a_laspy_cloud_of_zeros_has_no_colors() -> None:
    given = point_arrays(las_cloud(np.zeros((COUNT, 3), np.uint16)))
    assert "rgb" not in given.fields[0] and not given.notes
    assert "red" not in given.fields[0]


@pytest.mark.parametrize("dtype", [np.float32, np.uint32])
def test_fields_of_a_pypcd4_cloud(dtype: type) -> None:
    columns = [*CLOUD.T.astype(np.float32), PACKED.view(dtype), SCALARS.astype(np.float32), LABELS.astype(np.uint16)]
    types = [np.float32] * 3 + [dtype, np.float32, np.uint16]
    fields = fields_of(PointCloud.from_points(columns, ("x", "y", "z", "rgb", "intensity", "label"), types))
    assert_colors(fields)
    np.testing.assert_array_equal(fields["intensity"], SCALARS.astype(np.float32))
    np.testing.assert_array_equal(fields["label"], LABELS)


@pytest.mark.parametrize("names", [("r", "g", "b"), ("Red", "Green", "Blue"), ("rgb",), ("colors",)])
@pytest.mark.parametrize("kind", ["u1", "u2", "f4"])
def test_fields_of_records(names: tuple[str, ...], kind: str) -> None:
    one = len(names) == 1
    records = np.zeros(COUNT, [(axis, "f8") for axis in "XYZ"] + [(name, kind, (3,) if one else ()) for name in names]
                       + [("nx", "f4"), ("ny", "f4"), ("nz", "f4"), ("Intensity", "f8")])  # fmt: skip
    for axis, column in zip("XYZ", CLOUD.T, strict=True):
        records[axis] = column
    for axis, column in zip(("nx", "ny", "nz"), NORMALS.T, strict=True):
        records[axis] = column
    records["Intensity"] = SCALARS
    colors = {"u1": BYTES, "u2": BYTES * np.uint16(257), "f4": COLORS}[kind]
    for name, column in zip(names, [colors] if one else colors.T, strict=True):
        records[name] = column
    given = point_arrays(records)
    fields = only_fields(given)
    assert_colors(fields)
    np.testing.assert_array_equal(fields["normal"], NORMALS)
    np.testing.assert_array_equal(fields["Intensity"], SCALARS)
    assert fields.keys() == {"rgb", "normal", "Intensity"} and given.unused_columns == 0


def test_fields_of_a_batch_of_records() -> None:
    records = np.zeros((2, COUNT), [(axis, "f8") for axis in ("x", "y", "z", "red", "green", "blue", "time")])
    for axis, column in zip(("x", "y", "z"), CLOUD.T, strict=True):
        records[axis] = column
    for axis, column in zip(("red", "green", "blue"), COLORS.T, strict=True):
        records[axis] = np.stack([column, 1 - column])
    records["time"] = np.stack([SCALARS, 2 * SCALARS])
    given = point_arrays(records)
    assert given.batched and len(given.fields) == 2
    assert_colors(dict(given.fields[1]), 1 - COLORS)
    np.testing.assert_array_equal(given.fields[1]["time"], 2 * SCALARS)


def test_fields_of_a_pandas_frame() -> None:
    pandas = pytest.importorskip("pandas")
    frame = pandas.DataFrame({"x": CLOUD[:, 0], "y": CLOUD[:, 1], "z": CLOUD[:, 2], "r": BYTES[:, 0], "g": BYTES[:, 1],
                              "b": BYTES[:, 2], "ok": LABELS > 4, "count": pandas.array(LABELS, dtype="Int64"),
                              "kind": ["tree", "house"] * (COUNT // 2)})  # fmt: skip
    frame.loc[3, "count"] = pandas.NA
    frame = frame.sample(frac=1, random_state=0)
    order = frame.index.to_numpy()
    given = point_arrays(frame)
    fields = only_fields(given)
    assert_colors(fields, COLORS[order])
    np.testing.assert_array_equal(fields["ok"], LABELS[order] > 4)
    np.testing.assert_array_equal(fields["count"], np.where(order == 3, np.nan, LABELS[order]))
    np.testing.assert_array_equal(fields["kind"], 1 - order % 2)
    assert given.class_names[0]["kind"] == {0: "house", 1: "tree"}


def test_fields_of_a_polars_frame() -> None:
    polars = pytest.importorskip("polars")
    columns = dict(zip(("x", "y", "z", "red", "green", "blue"), [*CLOUD.T, *BYTES.T], strict=True))
    given = point_arrays(polars.DataFrame({**columns, "kind": [None, "house"] * (COUNT // 2)}))
    fields = only_fields(given)
    assert_colors(fields)
    np.testing.assert_array_equal(fields["kind"], np.arange(COUNT) % 2 - 1)
    assert given.class_names[0]["kind"] == {0: "house"}


def test_named_columns_behind_the_first_three_are_fields() -> None:
    pandas = pytest.importorskip("pandas")
    table = np.column_stack([CLOUD, SCALARS])
    named = point_arrays(pandas.DataFrame(table, columns=["east", "north", "up", "time"]))
    np.testing.assert_array_equal(named.fields[0]["time"], SCALARS)
    assert named.unused_columns == 0
    assert point_arrays(pandas.DataFrame(table)).unused_columns == 1


def test_fields_of_a_pyvista_cloud() -> None:
    pyvista = pytest.importorskip("pyvista")
    for name, colors in {"RGB": BYTES, "RGBA": np.column_stack([BYTES, BYTES[:, 0]]), "anything": BYTES}.items():
        cloud = pyvista.PolyData(CLOUD)
        cloud[name], cloud["height"], cloud["Normals"] = colors, SCALARS, NORMALS
        fields = fields_of(cloud)
        assert_colors(fields)
        np.testing.assert_array_equal(fields["height"], SCALARS)
        np.testing.assert_array_equal(fields["normal"], NORMALS)
        assert fields.keys() == {"rgb", "height", "normal"}


def test_fields_of_a_dict() -> None:
    fields = fields_of({"points": CLOUD, "colors": COLORS.tolist(), "intensity": torch.from_numpy(SCALARS), "name": "a",
                        "normals": NORMALS, "labels": np.ma.array(LABELS, mask=LABELS == 0)})  # fmt: skip
    assert_colors(fields)
    np.testing.assert_array_equal(fields["intensity"], SCALARS)
    np.testing.assert_array_equal(fields["labels"], np.where(LABELS == 0, np.nan, LABELS))
    assert fields.keys() == {"rgb", "normal", "intensity", "labels"}


def test_fields_of_a_dict_of_a_batch() -> None:
    points, colors = np.stack([CLOUD] * 3), np.stack([COLORS, COLORS / 2, COLORS / 4])
    given = point_arrays({"points": points, "colors": colors, "label": LABELS, "category": [1, 2, 3]})
    assert_colors(dict(given.fields[2]), COLORS / 4)
    np.testing.assert_array_equal(given.fields[2]["label"], LABELS)
    assert "category" in given.left_out


def test_fields_of_a_point_map() -> None:
    row, column = np.mgrid[:30, :40] / 40.0
    depth = 2 + 0.3 * np.sin(9 * row)
    colors = RNG.random((30, 40, 3))
    given = point_arrays({"points": np.stack([(column - 0.5) * depth, (row - 0.5) * depth, depth], -1), "rgb": colors,
                          "confidence": colors[..., 0], "columns": np.arange(40)})  # fmt: skip
    assert not given.batched and "columns" in given.left_out
    assert_colors(only_fields(given), colors.reshape(-1, 3))
    np.testing.assert_array_equal(given.fields[0]["confidence"], colors[..., 0].reshape(-1))


def test_fields_of_graphs() -> None:
    graph = SimpleNamespace(pos=torch.from_numpy(CLOUD), x=torch.from_numpy(NORMALS[:, :2]), y=torch.from_numpy(LABELS),
                            color=torch.from_numpy(BYTES), edge_index=torch.zeros((2, 99)), name="x")  # fmt: skip
    fields = fields_of(graph)
    assert_colors(fields)
    np.testing.assert_array_equal(fields["y"], LABELS)
    np.testing.assert_array_equal(fields["x_1"], NORMALS[:, 1])
    assert fields.keys() == {"rgb", "x_0", "x_1", "y"}


def test_graphs_of_torch_geometric_and_their_batches() -> None:
    data = pytest.importorskip("torch_geometric.data")
    graphs = [data.Data(pos=torch.from_numpy(CLOUD), color=torch.from_numpy(BYTES), y=torch.from_numpy(LABELS) + add,
                        edge_index=torch.zeros((2, 9), dtype=torch.long)) for add in (0, 1)]  # fmt: skip
    assert_colors(fields_of(graphs[0]))
    for batch in (graphs, data.Batch.from_data_list(graphs)):
        given = point_arrays(batch)
        assert given.batched and given.fields[1].keys() == {"rgb", "y"}
        np.testing.assert_array_equal(given.fields[1]["y"], LABELS + 1)


def test_a_batch_of_pytorch3d_is_read() -> None:
    class Pointclouds:
        def points_list(self) -> list[torch.Tensor]:
            return [torch.from_numpy(CLOUD), torch.from_numpy(CLOUD[:20])]

        def features_list(self) -> list[torch.Tensor]:
            return [torch.from_numpy(COLORS), torch.from_numpy(COLORS[:20])]

        def normals_list(self) -> None:
            return None

    given = point_arrays(Pointclouds())
    assert given.batched and [len(cloud) for cloud in given.clouds] == [COUNT, 20]
    assert_colors(dict(given.fields[1]), COLORS[:20])


def test_some_clouds_of_a_list_have_colors() -> None:
    given = point_arrays([CLOUD, trimesh.PointCloud(CLOUD, colors=BYTES), {"points": CLOUD, "colors": COLORS[:9]}])
    assert [list(fields) for fields in given.fields] == [[], ["rgb"], []]
    assert given.notes == ("cloud [2]: the points' colours were left out: colors has shape (9, 3), for 50 points",)


@pytest.mark.parametrize(
    ("colors", "message"),
    [(COLORS[:9], r"colors has shape \(9, 3\), for 50 points"), (COLORS - 0.5, "0 to 1, 255 or 65535, got -0"),
     (np.full((COUNT, 3), np.nan), "no row is finite"), (COLORS * 1e6, "255 or 65535, got")],
)  # fmt: skip
def test_colors_that_are_none_are_told(colors: np.ndarray, message: str) -> None:
    given = point_arrays({"points": CLOUD, "colors": colors})
    assert "rgb" not in given.fields[0]
    with pytest.raises(ValueError, match=message):
        raise ValueError(*given.notes)


def test_a_field_of_another_length_is_named() -> None:
    given = point_arrays({"points": CLOUD, "intensity": SCALARS[:9]})
    assert not given.notes and "(9,), for 50 points" in given.left_out["intensity"]


def test_unknown_colors_stay_unknown() -> None:
    colors = COLORS.copy()
    colors[4, 1] = np.nan
    fields = fields_of({"points": CLOUD, "colors": colors})
    assert np.isnan(fields["rgb"][4]).all() and not np.isnan(np.delete(fields["rgb"], 4, 0)).any()


def test_averages_that_round_above_one_are_no_bytes() -> None:
    assert_colors(fields_of({"points": CLOUD, "colors": COLORS * (1 + 1e-9)}))


def test_an_objects_failure_is_a_note_or_a_scan_error() -> None:
    class Broken:
        points = CLOUD

        @property
        def point_data(self) -> dict[str, np.ndarray]:
            raise RuntimeError("no memory")

    given = point_arrays(Broken())
    assert len(given.clouds[0]) == COUNT and "no memory" in given.notes[0]
    values = point_arrays({"points": CLOUD, "size": np.array([object()] * COUNT)}).fields[0]
    with pytest.raises(ScanError, match="the points' size cannot be read"):
        values["size"]


def test_fields_cannot_change_the_callers_numbers() -> None:
    mine = SCALARS.copy()
    with pytest.raises(ValueError, match="read-only"):
        point_arrays({"points": CLOUD, "time": mine}).fields[0]["time"][0] = 5
    mine[0] = 5
