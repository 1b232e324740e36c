"""The script that teaches neighbours to agree: its network is the one that is compiled, and it learns."""

from __future__ import annotations

import dataclasses
import re
import sys
from pathlib import Path

import numpy as np
import pytest
import torch

from pipeline.shapes import shape
from storage.meshes import write_mesh
from z2p_core import native

sys.path.insert(0, str(Path(__file__).parents[1] / "scripts"))
import learn_patches
import scanned_clouds


@pytest.fixture
def meshes(tmp_path: Path) -> Path:
    folder = tmp_path / "meshes"
    folder.mkdir()
    write_mesh(folder / "vase.ply", *shape("vase"))
    return folder


@pytest.mark.parametrize(("noise", "neighbours"), [(0.0, 16), (0.02, 21)])
def test_the_kernel_computes_what_the_network_of_the_shipped_header_does(
    meshes: Path, noise: float, neighbours: int
) -> None:
    rng = np.random.default_rng(1)
    points, normals = scanned_clouds.on_shape(scanned_clouds.shape_of(meshes / "vase.ply"), 2000, rng)
    cloud = learn_patches.example(points, normals, (points + noise * rng.normal(size=points.shape)).astype(np.float32))
    cloud = dataclasses.replace(cloud, found=cloud.found[:, :neighbours])  # the last block of 16 may be half full
    with torch.no_grad():
        *_, (moved, turned) = learn_patches.read_header(learn_patches.HEADER)(cloud)
    given = (cloud.points.numpy(), cloud.normals.numpy(), cloud.found.numpy().astype(np.int32), cloud.scale.numpy())
    kernel_moved, kernel_turned = native.refine(*given, cloud.noise)
    np.testing.assert_allclose(kernel_moved, moved.numpy(), atol=1e-5)
    np.testing.assert_allclose(kernel_turned, turned.numpy(), atol=1e-4)


def test_a_header_holds_a_network(tmp_path: Path) -> None:
    torch.manual_seed(3)
    network = learn_patches.Refinement()
    learn_patches.write_header(tmp_path / "some.h", network)
    back = learn_patches.read_header(tmp_path / "some.h")
    for name, value in back.state_dict().items():
        torch.testing.assert_close(value, network.state_dict()[name], rtol=1e-3, atol=1e-6)


def test_a_header_of_another_network_is_refused(tmp_path: Path) -> None:
    (tmp_path / "some.h").write_text("static const Network LEARNT = { 1, 2.5e-3, -4 };")
    with pytest.raises(ValueError, match=r"got 3 in .*some\.h"):
        learn_patches.read_header(tmp_path / "some.h")


def test_it_learns_and_the_same_seed_learns_the_same(
    meshes: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    headers = []
    for run in ("first.h", "second.h"):
        monkeypatch.setattr(scanned_clouds, "MOST", 1200)
        monkeypatch.setattr(sys, "argv", ["", str(meshes), "--steps", "12", "--output", str(tmp_path / run)])
        learn_patches.main()
        headers.append((tmp_path / run).read_bytes())
    assert headers[0] == headers[1]
    learnt = learn_patches.read_header(tmp_path / "first.h")
    torch.manual_seed(1)
    fresh, rng = learn_patches.Refinement(), np.random.default_rng(5)
    vase = scanned_clouds.shape_of(meshes / "vase.ply")
    clouds = [learn_patches.example(*scanned_clouds.drawn(vase, rng)) for _ in range(8)]
    with torch.no_grad():
        before, after = (sum(learn_patches.loss_of(network, cloud) for cloud in clouds) for network in (fresh, learnt))
    assert after < before


def test_what_it_has_learnt_is_measured(
    meshes: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The shipped network, on a shape that it has never seen."""
    monkeypatch.setattr(learn_patches, "MEASURED", ((1500, 0.0), (1500, 0.01)))
    vase = scanned_clouds.shape_of(meshes / "vase.ply")
    learn_patches.measure(learn_patches.read_header(learn_patches.HEADER), [vase])
    rows = re.findall(r"1500 points, noise [0.]*1?: ([\d.]+) degrees alone, ([\d.]+) together", capsys.readouterr().out)
    assert len(rows) == 2
    for alone, together in rows:
        assert float(together) < 0.95 * float(alone)


@pytest.mark.parametrize("seed", range(12))
def test_clouds_to_learn_from_lie_near_the_shape(meshes: Path, seed: int) -> None:
    """In single cells and from one side as well: as many true points and normals as noisy ones, and a unit each."""
    points, normals, cloud = scanned_clouds.drawn(
        scanned_clouds.shape_of(meshes / "vase.ply"), np.random.default_rng(seed)
    )
    assert len(points) == len(normals) == len(cloud) >= 100
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1, atol=1e-6)
    off = np.linalg.norm(cloud - points, axis=1)
    assert np.median(off) < 2.5 * scanned_clouds.NOISIEST * np.sqrt(6 / len(points))
