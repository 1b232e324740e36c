"""VTK's files: every way in which their points may be written gives the same points."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from reader_files import cloud, read, refused
from vtk_files import legacy, xml

from z2p_renderer.storage.scans.clouds import read_clouds

POINTS = cloud(47)


@pytest.mark.parametrize("kind", ["PolyData", "UnstructuredGrid"])
@pytest.mark.parametrize("binary", [True, False])
@pytest.mark.parametrize("extra", [b"", b"\nFIELD FieldData 1\nTIME 1 1 double\n" + bytes(8)])
def test_legacy_files(tmp_path: Path, kind: str, binary: bool, extra: bytes) -> None:
    path = tmp_path / "a.vtk"
    path.write_bytes(legacy(POINTS, binary, kind, extra))
    assert np.array_equal(read(path)[0], POINTS)


@pytest.mark.parametrize("header", ["UInt32", "UInt64"])
@pytest.mark.parametrize("packed", [True, False])
@pytest.mark.parametrize(("form", "appended_as"), [("ascii", ""), ("binary", ""), ("appended", "raw"),
                                                   ("appended", "base64")])  # fmt: skip
@pytest.mark.parametrize(("suffix", "kind"), [(".vtp", "PolyData"), (".vtu", "UnstructuredGrid")])
def test_xml_files(
    tmp_path: Path, suffix: str, kind: str, form: str, appended_as: str, packed: bool, header: str
) -> None:
    path = tmp_path / f"a{suffix}"
    path.write_bytes(xml(POINTS, form, packed, header, kind, pieces=2, appended_as=appended_as))
    assert np.array_equal(read(path)[0], POINTS)
    assert np.array_equal(read_clouds(path)[0].points, POINTS)


def test_false_headers_and_files_without_points_are_refused(tmp_path: Path) -> None:
    path, text = tmp_path / "a.vtk", legacy(POINTS, binary=False)
    refused(path, b"hello", "begins with '# vtk DataFile'")
    for binary in (True, False):
        whole = legacy(POINTS, binary)
        refused(path, whole[:300], "promises 47 points, and ends before them")
        refused(path, whole.replace(b"POINTS 47", b"POINTS 999999999999"), "promises 999999999999 points, and ends")
    refused(path, text.replace(b"POLYDATA", b"STRUCTURED_POINTS").replace(b"POINTS 47", b"ORIGIN 47"),
            "a data set STRUCTURED_POINTS without POINTS; save it as poly data")  # fmt: skip
    refused(path, text.replace(b"double", b"string"), "got 'string'")
    refused(path, text.replace(b"0.", b"0x", 1), "cannot be read|promises")
    path, whole = tmp_path / "a.vtp", xml(POINTS, "binary", packed=True)
    refused(path, whole.replace(b'NumberOfPoints="47"', b'NumberOfPoints="48"'), "1152 bytes of points expected")
    refused(path, whole.replace(b"vtkZLib", b"vtkLZ4"), "packed by vtkLZ4DataCompressor, .*ZLib")
    refused(path, whole.replace(b"PolyData", b"ImageData"), "got VTKFile of ImageData; save it as poly data")
    refused(path, whole[:200], "cannot be read")
    refused(path, b"<!DOCTYPE a [<!ENTITY b 'c'>]>" + whole, "no document type")
