"""Varied meshes: new shapes, the same for the same seed, readable, and some in company on one floor."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from z2p_renderer.pipeline.shapes import shape
from z2p_renderer.storage.meshes import read_mesh, write_mesh

sys.path.insert(0, str(Path(__file__).parents[2] / "scripts"))
import vary_meshes


@pytest.fixture
def meshes(tmp_path: Path) -> Path:
    folder = tmp_path / "meshes"
    folder.mkdir()
    for name in ("vase", "gear"):
        write_mesh(folder / f"{name}.ply", *shape(name))
    return folder


def run(monkeypatch: pytest.MonkeyPatch, meshes: Path, out: Path, *options: str) -> dict[str, bytes]:
    monkeypatch.setattr(sys, "argv", ["vary_meshes.py", str(meshes), str(out), *options])
    vary_meshes.main()
    return {path.name: path.read_bytes() for path in sorted(out.iterdir())}


def test_mesh_variations_are_new_and_seeded(
    meshes: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = run(monkeypatch, meshes, tmp_path / "a", "--each", "3")
    assert list(first) == [f"{name}-{number}.ply" for name in ("gear", "vase") for number in range(3)]
    assert len(set(first.values())) == 6
    assert run(monkeypatch, meshes, tmp_path / "b", "--each", "3") == first
    other = run(monkeypatch, meshes, tmp_path / "c", "--each", "3", "--seed", "1")
    assert not set(other.values()) & set(first.values())
    for name in first:
        assert len(read_mesh(tmp_path / "a" / name).faces) >= len(read_mesh(meshes / f"{name[:4]}.ply").faces)


def test_a_varied_mesh_keeps_about_its_size() -> None:
    vertices, _ = shape("gear")
    for seed in range(20):
        moved = vary_meshes.varied(vertices, np.random.default_rng(seed))
        assert moved.shape == vertices.shape and np.isfinite(moved).all()
        assert 0.3 < np.linalg.norm(moved - moved.mean(0), axis=1).max() < 3
    again = vary_meshes.varied(vertices, np.random.default_rng(3))
    assert np.array_equal(again, vary_meshes.varied(vertices, np.random.default_rng(3)))


def test_paired_meshes_share_a_floor_and_touch() -> None:
    cube = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])
    faces = np.array([[0, 1, 3], [4, 6, 7]])
    for seed in range(10):
        vertices, both = vary_meshes.place_beside((cube, faces), (0.3 * cube, faces), np.random.default_rng(seed))
        assert len(vertices) == 16 and both.tolist() == [*faces.tolist(), *(faces + 8).tolist()]
        assert vertices[8:, 2].min() == pytest.approx(-1)
        assert 1 < np.abs(vertices[8:, :2]).max() < 2.5
