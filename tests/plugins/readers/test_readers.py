"""Readers of ply, pcd and vertices give back what was written and refuse what lies about its size."""

from __future__ import annotations

import struct
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from pypcd4 import Encoding, PointCloud
from reader_files import PLY_TYPES, cloud, ply, read, refused

from z2p_core import registry
from z2p_core.interfaces import Sensor
from z2p_core.placement.background import foreground_mask
from z2p_renderer.plugins.readers.pcd import Pcd


@pytest.mark.parametrize("encoding", ["ascii", "binary_little_endian", "binary_big_endian"])
@pytest.mark.parametrize("kind", ["float", "double"])
def test_ply_round_trip_is_exact_and_keeps_nan_rows(tmp_path: Path, encoding: str, kind: str) -> None:
    points = cloud(dtype=PLY_TYPES[kind])
    points[3] = np.nan
    path = tmp_path / "scan.PLY"
    path.write_bytes(ply(points, encoding, kind))
    assert np.array_equal(read(path)[0], points.astype("f8"), equal_nan=True)


def test_ply_of_a_mesh_with_mixed_polygons_gives_all_vertices(tmp_path: Path) -> None:
    points = cloud(9)
    faces = struct.pack("<B3iB4i", 3, 0, 1, 2, 4, 3, 4, 5, 6)
    faces_head = "element face 2\nproperty list uchar int vertex_indices\n"
    path = tmp_path / "mesh.ply"
    path.write_bytes(ply(points, "binary_little_endian", extra=faces_head) + faces)
    assert np.array_equal(read(path)[0], points)  # vertices 7 and 8, which no face uses, included


def test_ply_vertices_after_another_element_and_with_colours(tmp_path: Path) -> None:
    rows = np.zeros(4, dtype=[("r", "u1"), ("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("quality", "<i2")])
    for axis, values in zip("xyz", cloud(4).T, strict=True):
        rows[axis] = values
    head = ("ply\r\nformat binary_little_endian 1.0\r\nelement camera 2\r\nproperty double fov\r\nelement vertex 4\r\n"
            "property uchar r\r\nproperty float32 x\r\nproperty float y\r\nproperty float z\r\n"
            "property int16 quality\r\nend_header\r\n")  # fmt: skip
    path = tmp_path / "scan.ply"
    path.write_bytes(head.encode() + np.zeros(2).tobytes() + rows.tobytes())
    assert np.array_equal(read(path)[0], np.column_stack([rows[axis] for axis in "xyz"]))


def test_reading_ply_does_not_import_trimesh(tmp_path: Path) -> None:
    path = tmp_path / "scan.ply"
    path.write_bytes(ply(cloud(5), "ascii", "float"))
    code = "import sys; from z2p_renderer.storage.scans.clouds import Path, read_clouds"
    code += f"; read_clouds(Path({str(path)!r}))"
    code += "; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "z2p_renderer.plugins.readers.ply" in done.stdout.split() and "trimesh" not in done.stdout.split()


def test_ply_lines_of_uneven_length_are_refused(tmp_path: Path) -> None:
    whole = ply(cloud(5), "ascii", "float")
    refused(tmp_path / "uneven.ply", whole.rstrip() + b" 7\n", "cannot be read")


@pytest.mark.parametrize("encoding", ["ascii", "binary_little_endian"])
def test_a_false_ply_header_is_refused_before_loading(tmp_path: Path, encoding: str, monkeypatch) -> None:
    monkeypatch.setattr("trimesh.exchange.ply.load_ply", lambda *_: pytest.fail("the size was not checked first"))
    refused(tmp_path / "a.ply", ply(cloud(), encoding, count=10**15), "promises 1000000000000000 vertex")
    faces = "element face 1000000000\nproperty list uchar int vertex_indices\n"
    refused(tmp_path / "b.ply", ply(cloud(), encoding, extra=faces), "1000000000 face")


def test_ply_refusals(tmp_path: Path) -> None:
    path, binary = tmp_path / "a.ply", "binary_little_endian"
    refused(path, b"solid not a ply", "another format")
    refused(path, b"ply\nformat ascii 1.0\n", "end_header")
    refused(path, b"ply\nelement vertex 0\nend_header\n", "no line 'format'")
    refused(path, b"ply\nformat ascii 1.0\nelement vertex many\nend_header\n", "element vertex many")
    refused(path, b"ply\nformat ascii 1.0\nelement vertex -3\nend_header\n", "element vertex -3")
    refused(path, b"ply\nformat binary_little_endian 1.0\nend_header\n", "no element 'vertex' .elements: none")
    refused(path, b"ply\nformat ascii 1.0\nelement face 0\nend_header\n", "no element 'vertex'")
    refused(path, b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nend_header\n1\n", "need x, y and z")
    refused(path, ply(cloud(), binary)[:-1], "cut short")
    refused(path, ply(cloud(), binary) + bytes(50), "1200 bytes, but 1250 follow it; the file is 50 bytes longer")
    refused(path, ply(cloud(9), binary) + bytes(9), "9 bytes longer, so its header is wrong")  # a lost uchar
    refused(path, ply(cloud(9), "ascii").replace(b"-", b"?"), "cannot be read|expected 9")
    text = ply(cloud(), "ascii")
    refused(path, text[: text.rindex(b"\n", 0, -1)], "49 lines came")


@pytest.mark.parametrize("encoding", list(Encoding)[:3])
@pytest.mark.parametrize("dtype", ["f4", "f8"])
def test_pcd_round_trip_is_exact(tmp_path: Path, encoding: Encoding, dtype: str) -> None:
    points = cloud(dtype=dtype)
    points[7] = np.nan
    kinds = (np.float32, np.uint8, np.float64 if dtype == "f8" else np.float32)
    columns = [np.arange(50, dtype="f4"), np.arange(50, dtype="u1"), *points.T]
    types = [kinds[0], kinds[1], kinds[2], kinds[2], kinds[2]]
    path = tmp_path / "scan.pcd"
    PointCloud.from_points(columns, ("intensity", "ring", "x", "y", "z"), types).save(path, encoding)
    expected = points.astype("f8")
    if encoding == Encoding.ASCII:  # the writer keeps ten digits after the point
        np.testing.assert_allclose(read(path)[0], expected, rtol=0, atol=1e-9)
    else:
        assert np.array_equal(read(path)[0], expected, equal_nan=True)


def pcd(body: bytes, *, fields: str = "x y z", points: int = 4, width: int = 2, data: str = "ascii") -> bytes:
    count = len(fields.split())
    return (
        f"# made by hand\nVERSION .7\nFIELDS {fields}\nSIZE {'4 ' * count}\nTYPE {'F ' * count}\n"
        f"COUNT {'1 ' * count}\nWIDTH {width}\nHEIGHT 2\n# between\nVIEWPOINT 0 0 0 1 0 0 0\n"
        f"POINTS {points}\nDATA {data}\n"
    ).encode() + body


def test_pcd_ascii_accepts_any_blanks_and_organised_clouds(tmp_path: Path) -> None:
    path = tmp_path / "scan.pcd"
    path.write_bytes(pcd(b"9 1  2\t3 \nnan nan nan nan\n\n8 4 5 6\r\n7 -1e-3 0.5 2", fields="rgb x y z"))
    assert np.array_equal(read(path)[0], [[1, 2, 3], [np.nan] * 3, [4, 5, 6], [-1e-3, 0.5, 2]], equal_nan=True)


def test_pcd_of_one_point_and_without_count_line(tmp_path: Path) -> None:
    path = tmp_path / "scan.pcd"
    head = b"VERSION .5\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH 1\nHEIGHT 1\nPOINTS 1\n"
    for data, body in (("ascii", b"1 2 3\n"), ("binary", struct.pack("<3f", 1, 2, 3))):
        path.write_bytes(head + f"DATA {data}\n".encode() + body)
        assert np.array_equal(read(path)[0], [[1, 2, 3]])


def test_a_false_pcd_header_is_refused_before_loading(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr(PointCloud, "from_fileobj", lambda *_: pytest.fail("the size was not checked first"))
    path, huge = tmp_path / "a.pcd", {"points": 2 * 10**12, "width": 10**12}
    refused(path, pcd(b"1 2 3\n" * 4, **huge), "promises 2000000000000 points")
    refused(path, pcd(bytes(48), data="binary", **huge), "promises 2000000000000 points")
    refused(path, pcd(bytes(47), data="binary"), "cut short")
    refused(path, pcd(b"\1" * 52, data="binary"), "4 bytes longer, so its header is wrong")
    bomb = struct.pack("<II", 16, 24 * 10**7) + bytes(16)
    refused(path, pcd(bomb, data="binary_compressed", points=2 * 10**7, width=10**7), "do not hold")
    refused(path, pcd(struct.pack("<II", 999, 48) + bytes(16), data="binary_compressed"), "do not hold")
    refused(path, pcd(b"\1", data="binary_compressed"), "do not hold")


def test_pcd_refusals(tmp_path: Path) -> None:
    path, rows = tmp_path / "a.pcd", b"1 2 3\n" * 4
    refused(path, b"\x00\xff garbage", "lines FIELDS, SIZE")
    refused(path, pcd(rows, points=5), "POINTS 5")
    refused(path, pcd(rows, fields="x y w"), "fields x, y and z")
    refused(path, pcd(rows, data="zipped"), "got 'zipped'")
    refused(path, pcd(b"1 2 3\n" * 3 + b"       "), "3 lines came")
    refused(path, pcd(b"1 2 3\n1 2 3 4\n1 2 3\n1 2 3"), "point 2: expected 3 numbers, got 4")
    refused(path, pcd(b"1 2 3\n1 2 three\n1 2 3\n1 2 3"), "cannot be read")
    refused(path, pcd(rows).replace(b"WIDTH 2", b"WIDTH two"), "numbers cannot be read")
    refused(path, pcd(rows).replace(b"SIZE 4", b"SIZE 0"), "numbers cannot be read")
    refused(path, pcd(struct.pack("<II", 16, 48) + b"\xff" * 16, data="binary_compressed"), "cannot be read")


def sensor(path: Path, blob: bytes) -> Sensor | None:
    path.write_bytes(blob)
    (raw,) = Pcd().read(path)
    return raw.sensor


def test_organised_pcd_without_viewpoint_has_sensor_at_origin(tmp_path: Path) -> None:
    ahead = sensor(tmp_path / "a.pcd", pcd(b"1 2 3\nnan nan nan\n1 2 4\n5 1 2"))
    assert ahead is not None
    assert np.array_equal(ahead.position, [0, 0, 0]) and np.array_equal(ahead.rotation, np.eye(3))
    behind = sensor(tmp_path / "a.pcd", pcd(b"1 2 -3\nnan nan nan\n1 2 -4\n5 1 -2"))
    assert behind is not None and np.array_equal(behind.rotation, np.diag([1, -1, -1]))
    flat = pcd(b"1 2 3\n" * 4).replace(b"HEIGHT 2", b"HEIGHT 1").replace(b"WIDTH 2", b"WIDTH 4")
    assert sensor(tmp_path / "a.pcd", flat) is None


def test_pcd_viewpoint_is_the_sensors_pose(tmp_path: Path) -> None:
    flat = pcd(b"9 2 3\n" * 4).replace(b"HEIGHT 2", b"HEIGHT 1").replace(b"WIDTH 2", b"WIDTH 4")
    half = 0.5**0.5

    def posed(numbers: str) -> Sensor | None:
        return sensor(tmp_path / "a.pcd", flat.replace(b"0 0 0 1 0 0 0", numbers.encode()))

    moved = posed("1 2 -3 1 0 0 0")
    assert moved is not None and np.array_equal(moved.position, [1, 2, -3])
    turned = posed(f"0 0 0 {half} 0 {half} 0")  # a quarter turn about Y: forward is +X
    assert turned is not None
    np.testing.assert_allclose(turned.rotation @ [0, 0, 1], [1, 0, 0], atol=1e-12)
    assert posed("0 0 0 0 0 0 0") is None  # left unset
    for broken in ("0 0 0 1 0 0", "0 0 0 one 0 0 0", "nan 0 0 1 0 0 0"):
        blob = flat.replace(b"VIEWPOINT 0 0 0 1 0 0 0", f"VIEWPOINT {broken}".encode())
        refused(tmp_path / "a.pcd", blob, "tx ty tz qw qx qy qz")


@pytest.mark.parametrize("stray", [b"", b"\n", b"\r\n", bytes(3)])
def test_a_few_trailing_bytes_are_ignored_with_a_note(tmp_path: Path, stray: bytes) -> None:
    points = cloud(4, "<f4")
    for name, blob in {"a.ply": ply(points, "binary_little_endian", "float"),
                       "a.pcd": pcd(points.tobytes(), data="binary")}.items():  # fmt: skip
        path = tmp_path / name
        path.write_bytes(blob + stray)
        (raw,) = registry.load("readers", name[2:])().read(path)
        assert np.array_equal(raw.points, points)
        padding = not stray or (name == "a.pcd" and not any(stray))
        assert raw.note == ("" if padding else f"stray bytes at the file's end ignored: {len(stray)}")


def test_a_pcd_file_may_be_padded_to_pages_with_zeros(tmp_path: Path) -> None:
    points, path = cloud(4, "<f4"), tmp_path / "a.pcd"
    blob = pcd(points.tobytes(), data="binary")
    for zeros in (17, 4095):
        path.write_bytes(blob + bytes(zeros))
        (raw,) = Pcd().read(path)
        assert np.array_equal(raw.points, points) and not raw.note
    refused(path, blob + bytes(4096), "4096 bytes longer")
    refused(path, blob + bytes(400) + b"\1", "401 bytes longer")


def list_ply(encoding: str, lengths: list[int], before: int) -> bytes:
    """Vertices with a list among their properties, behind `before` rows of names."""
    head = (f"ply\nformat {encoding} 1.0\nelement name {before}\nproperty list uchar uchar letters\n"
            f"element vertex {len(lengths)}\nproperty float x\nproperty list uchar double weights\n"
            "property double y\nproperty short z\nproperty list uint uchar more\n"
            "element face 1\nproperty list uchar int vertex_indices\nend_header\n")  # fmt: skip
    order = ">" if "big" in encoding else "<"
    if encoding == "ascii":
        rows = [f"{i} {n}{' 0.5' * n} {-i} 7 {n}{' 1' * n}" for i, n in enumerate(lengths)]
        return (head + "3 1 2 3\n" * before + "\n".join([*rows, "3 0 1 2", ""])).encode()
    names = b"".join(bytes([index % 2, *[9] * (index % 2)]) for index in range(before))
    each = [struct.pack(f"{order}fB{n}ddhI{n}s", i, n, *[0.5] * n, -i, 7, n, bytes(n)) for i, n in enumerate(lengths)]
    return head.encode() + names + b"".join(each) + struct.pack(f"{order}B3i", 3, 0, 1, 2)


@pytest.mark.parametrize("encoding", ["ascii", "binary_little_endian", "binary_big_endian"])
@pytest.mark.parametrize("before", [0, 5])
@pytest.mark.parametrize("lengths", [[2] * 6, [0, 1, 2, 3, 0, 7], [0] * 6])
def test_ply_lists_before_and_among_the_vertices(
    tmp_path: Path, encoding: str, before: int, lengths: list[int]
) -> None:
    path = tmp_path / "a.ply"
    blob = list_ply(encoding, lengths, before)
    path.write_bytes(blob)
    assert np.array_equal(read(path)[0], [[i, -i, 7] for i in range(6)])
    assert registry.load("readers", "ply")().memory(path) >= 6 * 24
    if encoding == "ascii":
        refused(path, blob.replace(b"-3 7", b"-3 7 1 1 1"), "vertex 4: .* numbers expected")
    elif lengths[1] < 2:
        refused(path, blob[:-30] + b"\xff" * 30, "past the end")
        refused(path, blob[:-40], "past the end|cut short")


def test_ply_axes_in_capitals(tmp_path: Path) -> None:
    path = tmp_path / "a.ply"
    for encoding in ("ascii", "binary_little_endian"):
        blob = ply(cloud(), encoding)
        for axis in b"x", b"y", b"z":
            blob = blob.replace(b" " + axis + b"\n", b" " + axis.upper() + b"\n")
        path.write_bytes(blob)
        assert np.array_equal(read(path)[0], cloud())
        refused(path, blob.replace(b" Z\n", b" z\n"), "need x, y and z once each, got X, Y, z")


def test_obj_keeps_vertices_without_faces(tmp_path: Path) -> None:
    points = cloud(12)
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in points.tolist()]
    path = tmp_path / "scan.obj"
    for extra in ([], ["vn 0 0 1", "vt 0 0", "f 1/1/1 2/1/1 3/1/1"]):
        path.write_text("\n".join(["# hello", "o thing", *lines, *extra]))
        assert np.array_equal(read(path)[0], points)
    path.write_text("\n".join(f"{line} 1.0 0.5 0.5" for line in lines))  # vertex colours
    assert np.array_equal(read(path)[0], points)
    path.write_bytes("\n".join(lines).replace(" ", " \\\r\n").encode())  # lines that go on after a backslash
    assert np.array_equal(read(path)[0], points)


def test_off_keeps_vertices_without_faces(tmp_path: Path) -> None:
    points = cloud(5)
    rows = "\n".join(" ".join(map(repr, row)) for row in points.tolist())
    path = tmp_path / "scan.off"
    for text in (f"OFF\n5 0 0\n{rows}\n", f"OFF\n# made\n5 1 0\n{rows}\n3 0 1 2\n"):
        path.write_text(text)
        assert np.array_equal(read(path)[0], points)


def test_obj_and_off_refusals(tmp_path: Path) -> None:
    refused(tmp_path / "a.obj", "hello\n", "found none")
    refused(tmp_path / "a.obj", "v 1 2 3\nv 1 2\n", "three numbers")
    refused(tmp_path / "a.obj", "v 1 2 x\n", "three numbers")
    refused(tmp_path / "a.off", "hello", "begins with 'OFF'")
    refused(tmp_path / "a.off", "OFF\n9999999999 0 0\n1 2 3\n", "cannot be read")
    refused(tmp_path / "a.off", "OFF\n", "cannot be read")


@pytest.mark.parametrize("data", ["ascii", "binary", "binary_compressed"])
def test_pcd_odd_fields_are_read_as_pcl_reads_them(tmp_path: Path, data: str) -> None:
    points = cloud(50, "f4")
    names = ("intensity", "Z", "_", "X", "Y", "_")
    rows = np.zeros(50, [("intensity", "<f4"), ("Z", "<f4"), ("p", "u1", 3), ("X", "<f4"), ("Y", "<f4"), ("q", "u1")])
    for axis, column in zip("XYZ", points.T, strict=True):
        rows[axis] = column
    head = "VERSION 0.7\nFIELDS _ {}\nSIZE 1 4 4 1 4 4 1\nTYPE U F F U F F U\nCOUNT 0 1 1 3 1 1 1\nWIDTH 50\nHEIGHT 1\n"
    head = head.format(" ".join(names)) + f"VIEWPOINT 0 0 0 1 0 0 0\nPOINTS 50\nDATA {data}\n"
    if data == "ascii":
        body = "".join(f"1 {z!r} 0 0 0 {x!r} {y!r} 9\n" for x, y, z in points.astype("f8").tolist()).encode()
    elif data == "binary":
        body = rows.tobytes()
    else:
        fields = b"".join(np.ascontiguousarray(rows[name]).tobytes() for name in rows.dtype.names)
        literal = b"".join(bytes([len(part) - 1]) + part for part in
                           (fields[start : start + 32] for start in range(0, len(fields), 32)))  # fmt: skip
        body = struct.pack("<II", len(literal), len(fields)) + literal
    path = tmp_path / "a.pcd"
    path.write_bytes(head.encode() + body)
    assert np.array_equal(read(path)[0], points.astype("f8"))


def test_pcd_types_are_checked(tmp_path: Path) -> None:
    path, whole = tmp_path / "a.pcd", pcd(bytes(64), fields="x y z rgb", data="binary")
    for line, message in ((b"TYPE F F F Q", "field rgb has TYPE Q and SIZE 4"), (b"SIZE 4 4 4 3", "TYPE F and SIZE 3")):
        kind = line.split()[0]
        changed = [line if row.startswith(kind) else row for row in whole.split(b"\n")[:-1]]
        refused(path, b"\n".join([*changed, bytes(64)]), message.replace("field rgb", "field .*"))
    path.write_bytes(whole)
    assert Pcd().read(path)[0].note == "all its colours are 0, and taken as none"


@pytest.mark.parametrize("height", [1, 2])
def test_few_points_in_front_of_a_sensor_are_kept(tmp_path: Path, height: int) -> None:
    rows = np.array([[0, 0, 1], [0.1, 0.2, 1.1], [0.3, 0.1, 3], [0.2, 0.5, 6], [0.4, 0.3, 1.5], [1, 1, 2]], "f4")
    head = pcd(b"", points=6, width=6 // height, data="binary").replace(b"HEIGHT 2", b"HEIGHT %d" % height)
    (tmp_path / "a.pcd").write_bytes(head.replace(b"VIEWPOINT 0 0 0 1", b"VIEWPOINT 0 0 -1 1") + rows.tobytes())
    [scan] = Pcd().read(tmp_path / "a.pcd")
    assert scan.sensor is not None and foreground_mask(scan.points, scan.sensor).all()


@pytest.mark.parametrize("encoding", ["binary_little_endian", "binary_big_endian", "ascii"])
def test_ply_capital_axes_and_whole_numbers(tmp_path: Path, encoding: str) -> None:
    points = (1000 * cloud(30)).round()
    head = "".join(f"property short {axis}\n" for axis in "XYZ")
    order = ">" if "big" in encoding else "<"
    body = points.astype(f"{order}i2").tobytes()
    if encoding == "ascii":
        body = "".join(f"{x:g} {y:g} {z:g}\n" for x, y, z in points.tolist()).encode()
    path = tmp_path / "a.ply"
    path.write_bytes(f"ply\nformat {encoding} 1.0\nelement vertex 30\n{head}end_header\n".encode() + body)
    assert np.array_equal(read(path)[0], points)
