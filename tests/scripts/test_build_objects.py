"""Objects built for training: readable, of about unit size, different from each other, the same for the same seed."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from z2p_renderer.storage.meshes import read_mesh

sys.path.insert(0, str(Path(__file__).parents[2] / "scripts"))
import build_objects
import mesh_parts


def build(monkeypatch: pytest.MonkeyPatch, out: Path, *options: str) -> dict[str, bytes]:
    monkeypatch.setattr(sys, "argv", ["build_objects.py", str(out), *options])
    build_objects.main()
    return {path.name: path.read_bytes() for path in sorted(out.iterdir())}


def test_objects_differ_and_are_reproducible(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = build(monkeypatch, tmp_path / "a", "--each", "2")
    assert len(set(first.values())) == 2 * len(build_objects.KINDS)
    assert build(monkeypatch, tmp_path / "b", "--each", "2") == first
    other = build(monkeypatch, tmp_path / "c", "--each", "2", "--seed", "1")
    assert not set(other.values()) & set(first.values())


def test_built_objects_stand_on_the_floor_at_unit_size(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in build(monkeypatch, tmp_path, "--each", "6"):
        vertices = read_mesh(tmp_path / name).vertices
        assert -0.3 < vertices[:, 2].min() < 0.5, name
        assert 0.3 < np.ptp(vertices, axis=0).max() < 2.5, name


def test_box_faces_share_no_vertices() -> None:
    vertices, faces = mesh_parts.joined(mesh_parts.box((1, 2, 3), (0, 0, 0)))
    corners = vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    for vertex in range(len(vertices)):
        meeting = normals[(faces == vertex).any(1)]
        assert np.allclose(meeting, meeting[0])
    assert np.ptp(vertices, axis=0).tolist() == [1, 2, 3]


def test_boxes_are_tilted_before_they_are_turned() -> None:
    vertices, _ = mesh_parts.joined(mesh_parts.box((1, 2, 3), (0, 0, 0), turn=np.pi / 2, tilt=np.pi / 2))
    assert np.ptp(vertices, axis=0) == pytest.approx([3, 1, 2])  # y went up, z went to y, and that to x


def test_bent_tubes_have_constant_thickness() -> None:
    path = mesh_parts.curve([(0, 0, 0), (0, 0, 1), (1, 1, 1)])
    side, *ends = mesh_parts.tube(path, 0.1)
    rings = side[0].reshape(len(path), -1, 3)
    assert np.linalg.norm(rings - path[:, None], axis=2) == pytest.approx(0.1)
    along = np.gradient(path, axis=0)
    assert np.abs(np.einsum("rca,ra->rc", rings - path[:, None], along)).max() < 1e-9
    assert len(ends) == 2
