"""Meshes: colors of the vertices of OBJ, OFF, GLB and glTF, of any depth, in linear light if the format says so."""

from __future__ import annotations

import io
import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from reader_files import read_fields

from z2p_core.images import srgb_from_linear
from z2p_core.interfaces import RawCloud

COUNT = 40
RNG = np.random.default_rng(1)
POINTS = RNG.normal(size=(COUNT, 3)).astype("<f4")
BYTES = RNG.integers(0, 256, (COUNT, 3))
SHORTS = RNG.integers(0, 65536, (COUNT, 3))
SHARES = RNG.random((COUNT, 3)).astype("<f4")
NORMALS = POINTS / np.linalg.norm(POINTS, axis=1, keepdims=True)
COMPONENTS = {"u1": 5121, "<u2": 5123, "<f4": 5126}


def read(path: Path, *wanted: str) -> RawCloud:
    [cloud] = read_fields(path, wanted or None)
    return cloud


def test_obj_colors_follow_the_vertex(tmp_path: Path) -> None:
    rows = [f"v {x} {y} {z} {r} {g} {b}\n" for (x, y, z), (r, g, b) in zip(POINTS, SHARES, strict=True)]
    rows[3] = "v 1 2 3\n"
    (tmp_path / "a.obj").write_text("".join(rows) + "f 1 2 3\n")
    cloud = read(tmp_path / "a.obj")
    expected = SHARES.copy()
    expected[3] = np.nan
    np.testing.assert_allclose(cloud.fields["rgb"], expected, atol=1e-6)
    [plain] = read_fields(tmp_path / "a.obj", ())
    assert not plain.fields and plain.field_names == ("rgb",) and np.array_equal(plain.points, cloud.points)


@pytest.mark.parametrize("head", ["COFF", "CNOFF", "STCNOFF", "C4OFF"])
@pytest.mark.parametrize(("table", "scale"), [(BYTES, 255), (SHARES, 1)])
def test_off_colors_come_in_the_order_of_its_first_word(tmp_path, head, table, scale) -> None:
    parts = [POINTS, *([np.ones((COUNT, 1))] if "4" in head else []), *([NORMALS] if "N" in head else []), table,
             np.full((COUNT, 1), scale), *([SHARES[:, :2]] if "ST" in head else [])]  # fmt: skip
    rows = [" ".join(repr(number) for part in parts for number in part[row].tolist()) for row in range(COUNT)]
    (tmp_path / "a.off").write_text(f"{head}\n{COUNT} 0 0\n" + "\n".join(rows) + "\n")
    cloud = read(tmp_path / "a.off")
    np.testing.assert_allclose(cloud.fields["rgb"], table / scale, atol=1e-6)
    assert ("normal" in cloud.fields) == ("N" in head)
    if "N" in head:
        np.testing.assert_allclose(cloud.fields["normal"], NORMALS, atol=1e-6)


def gltf(parts: list[dict[str, tuple[str, np.ndarray]]], **more: Any) -> tuple[dict[str, Any], bytes]:
    """A tree and its bytes: a mesh for each part, whose attributes are arrays of a type."""
    binary, views, accessors, meshes = b"", [], [], []
    for part in parts:
        attributes = {}
        for name, (kind, values) in part.items():
            row = np.zeros((len(values), -(-values.shape[1] * np.dtype(kind).itemsize // 4) * 4), "u1")
            content = np.ascontiguousarray(values.astype(kind)).view("u1").reshape(len(values), -1)
            row[:, : content.shape[1]] = content  # rows of whole words
            views.append({"buffer": 0, "byteOffset": len(binary), "byteLength": row.size, "byteStride": row.shape[1]})
            attributes[name] = len(accessors)
            accessors.append({"bufferView": len(views) - 1, "componentType": COMPONENTS[kind], "count": len(values),
                              "normalized": kind != "<f4" and name == "COLOR_0",
                              "type": {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4"}[values.shape[1]]})  # fmt: skip
            binary += row.tobytes()
        meshes.append({"primitives": [{"attributes": attributes, "mode": 0, "material": len(meshes)}]})
    nodes = [{"mesh": index, "translation": [10 * index, 0, 0]} for index in range(len(parts))]
    tree = {"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": list(range(len(parts)))}], "nodes": nodes,
            "meshes": meshes, "materials": [{} for _ in parts], "accessors": accessors, "bufferViews": views,
            "buffers": [{"byteLength": len(binary)}]}  # fmt: skip
    return tree | more, binary


def write(path: Path, tree: dict[str, Any], binary: bytes) -> Path:
    if path.suffix == ".gltf":
        path.with_suffix(".bin").write_bytes(binary)
        tree["buffers"][0]["uri"] = path.with_suffix(".bin").name
        path.write_text(json.dumps(tree))
        return path
    text = json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    binary += bytes(-len(binary) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(binary), b"BIN\0") + binary
    path.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks)
    return path


@pytest.mark.parametrize("suffix", [".glb", ".gltf"])
@pytest.mark.parametrize(("kind", "table", "full"), [("u1", BYTES, 255), ("<u2", SHORTS, 65535), ("<f4", SHARES, 1)])
@pytest.mark.parametrize("channels", [3, 4])
def test_gltf_colors_of_any_depth_are_linear(tmp_path, suffix, kind, table, full, channels) -> None:
    whole = np.column_stack([table, np.full(COUNT, full)])[:, :channels]
    cloud = read(write(tmp_path / f"a{suffix}", *gltf([{"POSITION": ("<f4", POINTS), "COLOR_0": (kind, whole)}])))
    np.testing.assert_allclose(cloud.fields["rgb"], srgb_from_linear(table / full), atol=1e-5)
    assert cloud.color_kind.endswith(", linear") and np.array_equal(cloud.points, POINTS.astype("f8"))


def test_gltf_of_writers_of_srgb_is_taken_as_such(tmp_path: Path) -> None:
    tree, binary = gltf([{"POSITION": ("<f4", POINTS), "COLOR_0": ("u1", BYTES)}],
                        asset={"version": "2.0", "generator": "https://github.com/mikedh/trimesh"})  # fmt: skip
    cloud = read(write(tmp_path / "a.glb", tree, binary))
    np.testing.assert_allclose(cloud.fields["rgb"], BYTES / 255, atol=1e-5)


def test_what_trimesh_writes_is_read(tmp_path: Path) -> None:
    trimesh = pytest.importorskip("trimesh")
    trimesh.PointCloud(POINTS, colors=BYTES.astype("u1")).export(tmp_path / "a.glb")
    np.testing.assert_allclose(read(tmp_path / "a.glb").fields["rgb"], BYTES / 255, atol=1e-5)


def test_parts_of_a_scene_keep_their_own_fields(tmp_path: Path) -> None:
    parts = [{"POSITION": ("<f4", POINTS), "COLOR_0": ("<u2", SHORTS), "_ERROR": ("<f4", SHARES[:, :1])},
             {"POSITION": ("<f4", POINTS), "NORMAL": ("<f4", NORMALS)}, {"POSITION": ("<f4", POINTS)}]  # fmt: skip
    tree, binary = gltf(parts)
    tree["materials"][2] = {"pbrMetallicRoughness": {"baseColorFactor": [0.5, 0.25, 0.75, 1]}}
    cloud = read(write(tmp_path / "a.glb", tree, binary))
    at = [np.argsort(np.abs(cloud.points[:, 0] - POINTS[0, 0] - 10 * index))[0] for index in range(3)]
    assert cloud.field_names == ("rgb", "normal", "_ERROR")
    np.testing.assert_allclose(cloud.fields["rgb"][at[0]], srgb_from_linear(SHORTS[0] / 65535), atol=1e-5)
    np.testing.assert_allclose(cloud.fields["rgb"][at[1]], 1)
    np.testing.assert_allclose(cloud.fields["rgb"][at[2]], srgb_from_linear(np.array([0.5, 0.25, 0.75])), atol=1e-5)
    assert cloud.fields["_ERROR"][at[0]] == SHARES[0, 0] and np.isnan(cloud.fields["_ERROR"][at[1]])
    np.testing.assert_allclose(cloud.fields["normal"][at[1]], NORMALS[0], atol=1e-6)


def test_doubled_vertices_lose_their_fields_too(tmp_path: Path) -> None:
    twice = {"POSITION": ("<f4", np.repeat(POINTS, 2, axis=0)), "COLOR_0": ("u1", np.repeat(BYTES, 2, axis=0))}
    cloud = read(write(tmp_path / "a.glb", *gltf([twice])))
    assert np.array_equal(cloud.points, POINTS.astype("f8"))
    np.testing.assert_allclose(cloud.fields["rgb"], srgb_from_linear(BYTES / 255), atol=1e-5)


def test_a_picture_is_sampled_at_the_vertices(tmp_path: Path) -> None:
    image = pytest.importorskip("PIL.Image")
    picture = RNG.integers(0, 256, (8, 8, 3)).astype("u1")
    buffer = io.BytesIO()
    image.fromarray(picture).save(buffer, "PNG")
    column, row = RNG.integers(0, 8, (2, COUNT))
    uv = np.column_stack([column / 7, row / 7]).astype("f4")  # the library samples between the middles of outer pixels
    tree, binary = gltf([{"POSITION": ("<f4", POINTS[:39]), "TEXCOORD_0": ("<f4", uv[:39])}])
    binary += bytes(-len(binary) % 4)
    tree["bufferViews"].append({"buffer": 0, "byteOffset": len(binary), "byteLength": len(buffer.getvalue())})
    binary += buffer.getvalue()
    tree["buffers"][0]["byteLength"] = len(binary)
    tree |= {"images": [{"bufferView": len(tree["bufferViews"]) - 1, "mimeType": "image/png"}],
             "textures": [{"source": 0}],
             "materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}]}  # fmt: skip
    tree["meshes"][0]["primitives"][0]["mode"] = 4
    cloud = read(write(tmp_path / "a.glb", tree, binary))
    np.testing.assert_allclose(255 * cloud.fields["rgb"], picture[row[:39], column[:39]], atol=1)


def test_a_mesh_without_colors_has_none(tmp_path: Path) -> None:
    cloud = read(write(tmp_path / "a.glb", *gltf([{"POSITION": ("<f4", POINTS)}])))
    assert not cloud.fields and not cloud.field_names
