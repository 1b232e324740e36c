"""VTK: colors and values of the points, in every section and encoding."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from reader_files import read_fields
from vtk_files import encoded, legacy

from z2p_core.interfaces import RawCloud

COUNT = 50
RNG = np.random.default_rng(1)
POINTS = RNG.normal(size=(COUNT, 3))
COLORS = RNG.integers(0, 256, (COUNT, 3)).astype("u1")
HEIGHT = RNG.normal(size=COUNT).astype("f4")
LABELS = RNG.integers(-3, 9, COUNT).astype("i4")
NORMALS = RNG.normal(size=(COUNT, 3)).astype("f4")
VTK_NAMES = {"u1": "unsigned_char", "f4": "float", "i4": "int"}
XML_NAMES = {"u1": "UInt8", "f4": "Float32", "i4": "Int32", "f8": "Float64"}


def read(path: Path, *wanted: str) -> RawCloud:
    [cloud] = read_fields(path, wanted or None)
    return cloud


def body(values: np.ndarray, binary: bool) -> bytes:
    kind = values.dtype.str[1:]
    text = values.ravel().tolist()
    return (values.astype(">" + kind).tobytes() if binary else " ".join(map(repr, text)).encode()) + b"\n"


def sections(binary: bool, colored: str) -> bytes:
    """All kinds of sections of values behind cells and theirs."""
    color = {"COLOR_SCALARS": b"COLOR_SCALARS some 3\n" + body(COLORS if binary else (COLORS / 255), binary),
             "SCALARS": b"SCALARS paint unsigned_char 3\nLOOKUP_TABLE default\n" + body(COLORS, binary), "": b""}
    if not binary:
        color["COLOR_SCALARS"] = b"COLOR_SCALARS some 3\n" + body(COLORS / 255.0, False)
    parts = [b"CELL_DATA 1\nSCALARS cell float\nLOOKUP_TABLE default\n", body(HEIGHT[:1], binary),
             f"POINT_DATA {COUNT}\n".encode(), color[colored],
             b"SCALARS my%20height float 1\nLOOKUP_TABLE table\n", body(HEIGHT, binary),
             b"LOOKUP_TABLE table 2\n", body(COLORS[:2].ravel()[:6].repeat(2)[:8].reshape(2, 4), binary),
             b"NORMALS Normals float\n", body(NORMALS, binary),
             b"METADATA\nINFORMATION 0\n\n",
             b"FIELD FieldData 2\n", f"label 1 {COUNT} int\n".encode(), body(LABELS, binary),
             f"pair 2 {COUNT} float\n".encode(), body(NORMALS[:, :2], binary),
             b"VECTORS speed float\n", body(NORMALS, binary)]  # fmt: skip
    return b"".join(parts)


@pytest.mark.parametrize("binary", [True, False])
@pytest.mark.parametrize("colored", ["COLOR_SCALARS", "SCALARS", ""])
def test_values_of_legacy_files(tmp_path: Path, binary: bool, colored: str) -> None:
    (tmp_path / "a.vtk").write_bytes(legacy(POINTS, binary) + sections(binary, colored))
    cloud = read(tmp_path / "a.vtk")
    expected = ("my height", "normal", "label", "pair_0", "pair_1", "speed_0", "speed_1", "speed_2")
    assert cloud.field_names == (("rgb",) if colored else ()) + expected and not cloud.note
    assert np.array_equal(cloud.points, POINTS)
    if colored:
        np.testing.assert_allclose(cloud.fields["rgb"], COLORS / 255, atol=1e-6)
    np.testing.assert_allclose(cloud.fields["my height"], HEIGHT, rtol=1e-6)
    np.testing.assert_allclose(cloud.fields["normal"], NORMALS, rtol=1e-6)
    np.testing.assert_allclose(cloud.fields["speed_2"], NORMALS[:, 2], rtol=1e-6)
    assert np.array_equal(cloud.fields["label"], LABELS) and cloud.fields["label"].dtype == np.int32
    assert list(read(tmp_path / "a.vtk", "label").fields) == ["label"]


@pytest.mark.parametrize("binary", [True, False])
def test_values_that_are_cut_short(tmp_path: Path, binary: bool) -> None:
    whole = legacy(POINTS, binary) + sections(binary, "SCALARS")
    (tmp_path / "a.vtk").write_bytes(whole[: whole.index(b"FIELD") + 30])
    cloud = read(tmp_path / "a.vtk")
    assert cloud.field_names == ("rgb", "my height", "normal")


def xml(form: str, packed: bool) -> bytes:
    """Poly data in two pieces, with their values."""
    values = {"RGB": COLORS, "Normals": NORMALS, "label": LABELS, "": POINTS}
    text = ""
    for part in np.array_split(np.arange(COUNT), 2):
        arrays = {}
        for name, array in values.items():
            rows = array[part]
            kind = rows.dtype.str[1:]
            inner = " ".join(map(repr, rows.ravel().tolist())) if form == "ascii" else encoded(
                rows.astype("<" + kind).tobytes(), "base64", packed, "UInt32").decode()
            width = 1 if rows.ndim == 1 else rows.shape[1]
            arrays[name] = (f'<DataArray type="{XML_NAMES[kind]}" Name="{name}" NumberOfComponents="{width}" '
                            f'format="{form}">{inner}</DataArray>')  # fmt: skip
        points = arrays.pop("")
        words = '<DataArray type="String" Name="words" format="ascii">1 2</DataArray>'
        text += f'<Piece NumberOfPoints="{len(part)}"><Points>{points}</Points>'
        text += f"<PointData>{''.join(arrays.values())}{words}</PointData></Piece>"
    compressor = ' compressor="vtkZLibDataCompressor"' if packed else ""
    told = f'type="PolyData" byte_order="LittleEndian" header_type="UInt32"{compressor}'
    return f'<?xml version="1.0"?>\n<VTKFile {told}><PolyData>{text}</PolyData></VTKFile>'.encode()


@pytest.mark.parametrize(("form", "packed"), [("ascii", False), ("binary", False), ("binary", True)])
def test_values_of_xml_files(tmp_path: Path, form: str, packed: bool) -> None:
    (tmp_path / "a.vtp").write_bytes(xml(form, packed))
    cloud = read(tmp_path / "a.vtp")
    assert cloud.field_names == ("rgb", "normal", "label") and np.array_equal(cloud.points, POINTS)
    np.testing.assert_allclose(cloud.fields["rgb"], COLORS / 255, atol=1e-6)
    np.testing.assert_allclose(cloud.fields["normal"], NORMALS, rtol=1e-6)
    assert np.array_equal(cloud.fields["label"], LABELS)
    assert list(read(tmp_path / "a.vtp", "label").fields) == ["label"]
