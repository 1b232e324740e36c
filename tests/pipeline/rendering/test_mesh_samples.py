"""Sampling stage: pools and clouds lie on the mesh, in the mesh's own sphere, and follow from bytes and seed alone."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from z2p_core.config import SampleConfig
from z2p_core.interfaces import ScanError
from z2p_core.placement.bounding_sphere import Sphere, bounding_sphere
from z2p_core.registry import PluginError
from z2p_renderer.pipeline.rendering.mesh_samples import sample_cloud, sample_pool
from z2p_renderer.storage.meshes import find_meshes
from z2p_renderer.storage.scans.clouds import read_mesh, write_mesh

CORNERS = np.array([(0, 0, 0), (4, 0, 0), (0, 4, 0), (0, 0, 4)], dtype=np.float64) + 1e7  # far off, as UTM coordinates
FACES = np.array([(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)])


@pytest.fixture
def tetrahedron(tmp_path: Path) -> Path:
    write_mesh(tmp_path / "tetrahedron.ply", CORNERS, FACES)
    return tmp_path / "tetrahedron.ply"


def pool(mesh: Path, out: Path, seed: int = 0, points: int = 3000) -> np.ndarray:
    path = sample_pool(mesh, SampleConfig(points=points), seed, out)
    assert path == out / "pool.npy"
    stored: np.ndarray = np.load(path, allow_pickle=False)
    return stored


def test_pool_lies_on_the_mesh_in_its_unit_sphere(tetrahedron: Path, tmp_path: Path) -> None:
    points = pool(tetrahedron, tmp_path / "out")
    assert points.shape == (3000, 3) and points.dtype == np.float32
    sphere = bounding_sphere(CORNERS)
    corners = sphere.normalise(CORNERS).astype(np.float64)
    off = [
        np.abs((points - corners[a]) @ (lambda n: n / np.linalg.norm(n))(np.cross(corners[b] - corners[a],
                                                                                  corners[c] - corners[a])))
        for a, b, c in FACES
    ]  # fmt: skip
    assert np.min(off, axis=0).max() < 1e-6
    assert 0.5 < np.linalg.norm(points, axis=1).max() <= 1 + 1e-6


def test_pool_follows_from_bytes_and_seed_not_from_the_name(tetrahedron: Path, tmp_path: Path) -> None:
    first = pool(tetrahedron, tmp_path / "a")
    renamed = tmp_path / "renamed.ply"
    shutil.copy(tetrahedron, renamed)
    assert np.array_equal(first, pool(renamed, tmp_path / "b"))
    assert not np.array_equal(first, pool(tetrahedron, tmp_path / "c", seed=1))
    write_mesh(renamed, CORNERS + 1.0, FACES)
    assert not np.array_equal(first, pool(renamed, tmp_path / "d"))


def test_cloud_is_normalised_by_the_mesh_and_noise_is_in_radii(tetrahedron: Path) -> None:
    mesh = read_mesh(tetrahedron)
    twice = Sphere(tuple(CORNERS[0].tolist()), 8.0)
    cloud = sample_cloud(mesh, twice, "uniform", 2000, "none", 0.0, np.random.default_rng(0))
    assert cloud.dtype == np.float32 and cloud.min() >= 0 and 0.45 < cloud.max() <= 0.5
    noisy = sample_cloud(mesh, twice, "uniform", 2000, "gaussian", 0.03, np.random.default_rng(0))
    assert (noisy - cloud).std() == pytest.approx(0.03, rel=0.05)


def test_wrong_requests_are_clear_errors(tetrahedron: Path, tmp_path: Path) -> None:
    with pytest.raises(PluginError, match=r"unknown sampler 'nosuch'; installed: .*uniform"):
        sample_pool(tetrahedron, SampleConfig(sampler="nosuch"), 0, tmp_path / "out")
    with pytest.raises(ScanError, match="expected at least 1, got 0"):
        pool(tetrahedron, tmp_path / "out", points=0)
    assert not (tmp_path / "out").exists()


def test_meshes_are_found_sorted_and_named_apart(tmp_path: Path) -> None:
    for name in ("b.ply", "a.OFF", "b.obj", "notes.txt", "c.stl", "._c.stl", ".hidden.ply", "b.ply.ply"):
        (tmp_path / name).touch()
    (tmp_path / "folder.ply").mkdir()
    meshes = find_meshes(tmp_path)
    assert list(meshes) == ["a", "b.obj", "b.ply", "b.ply.ply", "c"]
    assert meshes["a"] == tmp_path / "a.OFF"


def test_a_folder_without_meshes_is_a_clear_error(tmp_path: Path) -> None:
    with pytest.raises(ScanError, match=r"holds no mesh; readable: .*\.ply"):
        find_meshes(tmp_path)
    with pytest.raises(ScanError, match="which is no folder"):
        find_meshes(tmp_path / "nosuch")
