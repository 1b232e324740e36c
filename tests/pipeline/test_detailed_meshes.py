"""Built-in meshes with fine relief: closed, of the size that is asked for, the same every time, and truly detailed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from z2p_core.meshes.triangle_sampling import triangle_areas
from z2p_renderer.pipeline.detailed_meshes.objects import DETAILED_MESHES, detailed_mesh, make_detailed_meshes
from z2p_renderer.pipeline.detailed_meshes.relief import letters, scales, woven_threads
from z2p_renderer.storage.meshes import read_mesh


def enclosed_volume(vertices: np.ndarray, faces: np.ndarray) -> float:
    a, b, c = (vertices[faces[:, corner]] for corner in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c))) / 6


@pytest.mark.parametrize("name", DETAILED_MESHES)
def test_mesh_is_closed_faces_outwards_and_has_the_size_asked_for(name: str) -> None:
    vertices, faces = detailed_mesh(name, 20_000)
    assert 18_000 < len(faces) < 22_000
    assert set(np.unique(faces)) == set(range(len(vertices)))
    directed = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2) @ [len(vertices), 1]
    backwards = faces[:, [1, 0, 2, 1, 0, 2]].reshape(-1, 2) @ [len(vertices), 1]
    assert len(np.unique(directed)) == len(directed)
    assert np.array_equal(np.sort(directed), np.sort(backwards))  # each edge has one triangle on each side
    assert triangle_areas(vertices, faces).min() > 0
    assert enclosed_volume(vertices, faces) > 0.05


def test_files_are_the_same_bytes_are_kept_and_read_back(tmp_path: Path) -> None:
    first = make_detailed_meshes(tmp_path / "a", ("vase",), 5000)["vase"]
    second = make_detailed_meshes(tmp_path / "b", ("vase",), 5000)["vase"]
    assert first.read_bytes() == second.read_bytes()
    assert np.array_equal(read_mesh(first).vertices, detailed_mesh("vase", 5000)[0])
    written = first.stat().st_mtime_ns
    make_detailed_meshes(tmp_path / "a", ("vase",), 6000)
    assert first.stat().st_mtime_ns == written
    assert [path.name for path in (tmp_path / "a").iterdir()] == ["vase.ply"]


def test_an_unknown_mesh_names_the_known() -> None:
    with pytest.raises(ValueError, match=r"unknown detailed mesh 'cow'; there are tablet, vase"):
        detailed_mesh("cow")


def test_letters_stand_upright_and_wide_lines_are_made_to_fit() -> None:
    ink = letters([("L", 0.5)], 1.0, 1.0, 64, 64)
    columns, rows = np.nonzero(ink > 0.5)
    assert rows.max() - rows.min() == pytest.approx(32, abs=3)
    left, right = ink[columns.min() : columns.min() + 4], ink[columns.max() - 3 :]
    assert left.sum(axis=0)[40] > 1 and right.sum(axis=0)[40] < 0.5  # an L's upper right is empty
    fitted = letters([("WIDE" * 8, 0.5)], 1.0, 1.0, 64, 64)
    assert 0 < np.nonzero(fitted.max(axis=1) > 0.3)[0].min() + 1 < 8


def test_relief_is_in_range_and_repeats() -> None:
    u, v = (np.arange(200)[:, None] + 0.3) / 200, (np.arange(120)[None] + 0.3) / 120
    for height in (scales(u, v, 6, 10), woven_threads(u, v, 0.1)):
        assert height.min() >= 0 and height.max() <= 1 and height.std() > 0.1
    assert np.allclose(scales(u, v, 6, 10), scales(u, v + 1, 6, 10))
