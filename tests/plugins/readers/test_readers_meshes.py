"""The reader of STL and GLB: what exporters of today write, and files that hold no triangle."""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from reader_files import cloud, gltf, read, refused

from z2p_renderer.plugins.readers.meshes import Meshes
from z2p_renderer.plugins.readers.vertices import Vertices
from z2p_renderer.storage.scans.content_detection import suffix_of


def glb(tree: dict[str, Any], binary: bytes = b"") -> bytes:
    """A GLB file of one buffer, with a node for each mesh."""
    nodes = [{"mesh": index} for index in range(len(tree["meshes"]))]
    whole = {"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": list(range(len(nodes)))}], "nodes": nodes,
             "buffers": [{"byteLength": len(binary)}]}  # fmt: skip
    text = json.dumps(whole | tree).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(binary), b"BIN\0") + binary
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def points_of(accessor: int) -> dict[str, Any]:
    return {"primitives": [{"attributes": {"POSITION": accessor}, "mode": 0}]}


@pytest.mark.parametrize(("extension", "name"), [("KHR_draco_mesh_compression", "Draco"),
                                                 ("EXT_meshopt_compression", "meshopt")])  # fmt: skip
def test_compressed_glb_is_refused_naming_the_compression(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], extension: str, name: str
) -> None:
    tree = {"extensionsRequired": [extension], "meshes": [points_of(0)],
            "accessors": [{"componentType": 5126, "count": 9, "type": "VEC3"}]}  # fmt: skip
    refused(tmp_path / "a.glb", glb(tree), f"packed by {name} .*again without {name} compression")
    assert capfd.readouterr().err == ""  # the library would have logged its own failure


@pytest.mark.parametrize(("component", "kind", "one"), [(5122, "<i2", 32767), (5121, "u1", 255), (5120, "i1", 127)])
def test_glb_normalized_integer_positions_are_scaled(
    tmp_path: Path, component: int, kind: str, one: int
) -> None:
    rows = np.arange(27).reshape(9, 3).astype(kind)
    rows[0, 0] = one
    stride = 4 * rows.itemsize  # glTF pads each row to four bytes
    packed = np.zeros((9, 4), kind)
    packed[:, :3] = rows
    floats = cloud(5, "<f4") + 4
    binary = packed.tobytes() + floats.tobytes()
    views = [{"buffer": 0, "byteOffset": 0, "byteLength": 9 * stride, "byteStride": stride},
             {"buffer": 0, "byteOffset": 9 * stride, "byteLength": 60}]  # fmt: skip
    accessors = [{"bufferView": 0, "componentType": component, "normalized": True, "count": 9, "type": "VEC3"},
                 {"bufferView": 1, "componentType": 5126, "count": 5, "type": "VEC3"}]  # fmt: skip
    tree = {"meshes": [points_of(0), points_of(1)], "accessors": accessors, "bufferViews": views}
    path = tmp_path / "a.glb"
    for normalized, expected in ((True, rows / one), (False, rows.astype("f8"))):
        accessors[0]["normalized"] = normalized
        path.write_bytes(glb(tree, binary))
        points, both = read(path)[0], np.vstack([expected, floats])  # in any order of the nodes
        np.testing.assert_allclose(points[np.lexsort(points.T)], both[np.lexsort(both.T)], atol=1e-6)
    accessors[0]["normalized"] = True
    refused(path, glb(tree, binary)[:-200], "cannot be read")


@pytest.mark.parametrize("mode", range(7))
def test_glb_of_any_primitive_mode_is_read(tmp_path: Path, mode: int) -> None:
    rows = cloud(6, "<f4")
    accessors = [{"bufferView": 0, "componentType": 5126, "count": 6, "type": "VEC3"}]
    tree = {"meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "mode": mode}]}], "accessors": accessors,
            "bufferViews": [{"buffer": 0, "byteOffset": 0, "byteLength": 72}]}  # fmt: skip
    (tmp_path / "a.glb").write_bytes(glb(tree, rows.tobytes()))
    np.testing.assert_allclose(read(tmp_path / "a.glb")[0], rows, atol=1e-6)
    accessors[0]["sparse"] = {"count": 1}
    refused(tmp_path / "a.glb", glb(tree, rows.tobytes()), "kept sparse.* again without sparse accessors")


def test_glb_without_a_scene_shows_all_its_nodes_or_meshes(tmp_path: Path) -> None:
    rows = cloud(5, "<f4")
    accessor = {"bufferView": 0, "componentType": 5126, "count": 5, "type": "VEC3"}
    tree = {"meshes": [points_of(0)], "accessors": [accessor], "scenes": [],
            "bufferViews": [{"buffer": 0, "byteOffset": 0, "byteLength": 60}]}  # fmt: skip
    moved = [{"children": [1], "translation": [5, 0, 0]}, {"mesh": 0}]
    for nodes, expected in (([], rows), (moved, rows + np.float32([5, 0, 0]))):
        (tmp_path / "a.glb").write_bytes(glb(tree | {"nodes": nodes}, rows.tobytes()))
        np.testing.assert_allclose(read(tmp_path / "a.glb")[0], expected, atol=1e-6)


def test_stl_of_another_length_than_promised(tmp_path: Path) -> None:
    path = tmp_path / "a.stl"
    corners = cloud(12, "<f4").reshape(4, 3, 3)
    rows = b"".join(bytes(12) + triangle.tobytes() + bytes(2) for triangle in corners)
    blob = bytes(80) + struct.pack("<I", 4) + rows
    for stray in (b"", b"\n", bytes(16)):
        path.write_bytes(blob + stray)
        (raw,) = Meshes().read(path)
        assert np.array_equal(raw.points, corners.reshape(-1, 3)) and bool(raw.note) == bool(stray)
    refused(path, blob[:-1], "promises 4 triangles, which takes 200 bytes, but 199 follow it; the file is cut short")
    refused(path, blob + bytes(17), "17 bytes longer, so its header is wrong")
    refused(path, blob[:83], "84 bytes of header, got 83")


FACET = "facet normal 0 0 1\nouter loop\nvertex {0} 0 0\nvertex {0} 1 0\nvertex {0} 0 1\nendloop\nendfacet\n"


def test_ascii_stl_with_odd_layout_is_read(tmp_path: Path) -> None:
    first, second = (f"solid {name}\n{FACET.format(x)}endsolid {name}\n" for name, x in (("a", 0), ("b", 5)))
    both = np.array([[0, 0, 0], [0, 1, 0], [0, 0, 1], [5, 0, 0], [5, 1, 0], [5, 0, 1]])
    for text in (first + second, (first + second).upper(), "\n\n" + first + second):
        (tmp_path / "a.stl").write_text(text)
        assert np.array_equal(read(tmp_path / "a.stl")[0], both)
        assert suffix_of(text.encode(), len(text)) == ".stl"
    refused(tmp_path / "a.stl", (first + second)[:-30], "cut short: its last solid has no 'endsolid'")


def test_stl_without_triangles_says_so(tmp_path: Path) -> None:
    refused(tmp_path / "a.stl", bytes(84), "holds no triangle")
    refused(tmp_path / "a.stl", "solid a\nendsolid a\n", "holds no triangle")


def test_gltf_buffers_may_be_embedded_or_separate(tmp_path: Path) -> None:
    rows = cloud(30, "f4")
    (tmp_path / "some scan.bin").write_bytes(rows.tobytes())
    for uri in ("", "some%20scan.bin"):
        (tmp_path / "a.gltf").write_bytes(gltf(rows, uri))
        assert np.array_equal(read(tmp_path / "a.gltf")[0], rows)
    assert Meshes().memory(tmp_path / "a.gltf") > 30 * 170
    refused(tmp_path / "a.gltf", gltf(rows, "gone.bin"), "are in 'gone.bin', which is not beside it")
    for uri in ("../up.bin", "https://example.org/a.bin", "/etc/hosts"):
        refused(tmp_path / "a.gltf", gltf(rows, uri), "elsewhere than beside itself")
    (tmp_path / "some scan.bin").write_bytes(rows.tobytes()[:-1])
    refused(tmp_path / "a.gltf", gltf(rows, "some%20scan.bin"), "promises 360 bytes in buffer 0, 359 came")
    refused(tmp_path / "a.gltf", b'{"points": 3}', "another kind of JSON")


@pytest.mark.parametrize("head", ["OFF", "4OFF", "COFF", "NOFF", "STOFF", "CN4OFF", "OFF # made by hand\n"])
def test_off_vertices_may_be_followed_by_attributes(tmp_path: Path, head: str) -> None:
    points, weights = cloud(20), np.linspace(0.5, 2, 20)
    table = np.column_stack([points * weights[:, None], weights]) if "4" in head else points
    rest = " 0.25 0.5 0.75" if head[0] in "CNS" else ""
    rows = "".join(" ".join(map(repr, row)) + rest + "\n" for row in table.tolist())
    path = tmp_path / "a.off"
    for counts in ("\n20 1 0\n", " 20 1 0\n"):
        path.write_text(f"{head}{counts}{rows}3 0 1 2\n" if "#" not in head else f"{head}20 1 0\n{rows}3 0 1 2\n")
        np.testing.assert_allclose(read(path)[0], points, rtol=1e-12)
    refused(path, f"{head.partition(' ')[0]}\n20 1 0\n{rows}", "20 vertices and 1 faces promised, 20 lines came")


def test_off_of_other_kinds_is_refused(tmp_path: Path) -> None:
    refused(tmp_path / "a.off", b"OFF BINARY\n" + bytes(99), "binary OFF files are not read")
    refused(tmp_path / "a.off", "nOFF\n4\n1 0 0\n1 2 3 4\n", "other than three dimensions")


def test_obj_colors_and_weights_follow_the_vertex(tmp_path: Path) -> None:
    points, path = cloud(20), tmp_path / "a.obj"
    for rest, names in ((" 1.0", ()), (" 0.5 0.25 1", ("rgb",)), ("", ())):
        path.write_text("".join("v " + " ".join(map(repr, row)) + rest + "\n" for row in points.tolist()))
        [raw_cloud] = Vertices().read(path)
        assert np.array_equal(raw_cloud.points, points) and raw_cloud.field_names == names
