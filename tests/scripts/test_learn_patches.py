"""The script that teaches neighbours to agree: its network is the one that is compiled, and it learns."""

from __future__ import annotations

import dataclasses
import re
import sys
from pathlib import Path

import numpy as np
import pytest
import torch

from z2p_core import native
from z2p_renderer.pipeline.shapes import shape
from z2p_renderer.storage.meshes import write_mesh

sys.path.insert(0, str(Path(__file__).parents[2] / "scripts"))
import learn_patches
import patch_network
import scanned_clouds


@pytest.fixture
def meshes(tmp_path: Path) -> Path:
    folder = tmp_path / "meshes"
    folder.mkdir()
    write_mesh(folder / "vase.ply", *shape("vase"))
    return folder


@pytest.mark.parametrize(("noise", "neighbors"), [(0.0, 16), (0.02, 21)])
def test_kernel_matches_the_network_of_the_shipped_header(
    meshes: Path, noise: float, neighbors: int
) -> None:
    rng = np.random.default_rng(1)
    points, normals = scanned_clouds.sample_shape(scanned_clouds.read_shape(meshes / "vase.ply"), 2000, rng)
    noisy = (points + noise * rng.normal(size=points.shape)).astype(np.float32)
    cloud = learn_patches.make_batch(points, normals, noisy)
    found = cloud.neighbors[:, :neighbors]  # the last block of 16 may be half full
    cloud = dataclasses.replace(cloud, neighbors=found, share=torch.full(found.shape, 1 / neighbors))
    with torch.no_grad():
        *_, (moved, turned) = patch_network.read_header(learn_patches.HEADER)(cloud)
    given = (cloud.points.numpy(), cloud.normals.numpy(), cloud.neighbors.numpy(), cloud.scale.numpy())
    kernel_moved, kernel_turned = native.refine_normals(*given, float(cloud.noise[0]))
    np.testing.assert_allclose(kernel_moved, moved.numpy(), atol=1e-5)
    np.testing.assert_allclose(kernel_turned, turned.numpy(), atol=1e-4)


@pytest.mark.parametrize(("rounds", "width"), [(3, 16), (2, 32)])
def test_a_header_holds_a_network_of_any_size(tmp_path: Path, rounds: int, width: int) -> None:
    torch.manual_seed(3)
    network = patch_network.NormalNetwork(rounds, width)
    patch_network.write_header(tmp_path / "some.h", network)
    back = patch_network.read_header(tmp_path / "some.h")
    assert (len(back.rounds), back.width) == (rounds, width)
    for name, value in back.state_dict().items():
        if not name.startswith(f"rounds.{rounds - 1}.next"):  # after the last round nothing is remembered
            torch.testing.assert_close(value, network.state_dict()[name], rtol=1e-3, atol=1e-6)


@pytest.mark.parametrize(
    ("defined", "error"),
    [("", "expected a header that defines ROUNDS and WIDTH"),
     ("#define ROUNDS 3\n#define WIDTH 16\n", r"expected \d+ numbers for 3 rounds of 16 units, got 3")],
)  # fmt: skip
def test_a_header_of_another_network_is_refused(tmp_path: Path, defined: str, error: str) -> None:
    (tmp_path / "some.h").write_text(defined + "static const Network NORMAL_GNN_WEIGHTS = { 1, 2.5e-3, -4 };")
    with pytest.raises(ValueError, match=r"some\.h: " + error):
        patch_network.read_header(tmp_path / "some.h")


@pytest.mark.parametrize(("rounds", "width"), [(4, 8), (2, 12), (3, 12)])
def test_a_grown_network_says_what_the_small_one_says(meshes: Path, rounds: int, width: int) -> None:
    torch.manual_seed(4)
    small = _trained_a_little(patch_network.NormalNetwork(2, 8))
    cloud = learn_patches.make_batch(*scanned_clouds.sample_scan(
        scanned_clouds.read_shape(meshes / "vase.ply"), np.random.default_rng(2)
    ))  # fmt: skip
    with torch.no_grad():
        *_, before = small(cloud)
        *_, after = patch_network.grow_network(small, rounds, width)(cloud)
    assert float((before[1] - cloud.normals).abs().max()) > 0.01  # it says something
    for was, became in zip(before, after, strict=True):
        torch.testing.assert_close(became, was, rtol=0, atol=1e-5)


def test_a_network_does_not_grow_smaller() -> None:
    with pytest.raises(ValueError, match="expected 3 rounds of 16 units or more, got 2 of 16"):
        patch_network.grow_network(patch_network.NormalNetwork(3, 16), 2, 16)


def test_clouds_of_a_group_do_not_hear_each_other(meshes: Path) -> None:
    """A group's losses and answers are those of its clouds alone, though one has fewer neighbours a point."""
    torch.manual_seed(6)
    vase, network = scanned_clouds.read_shape(meshes / "vase.ply"), _trained_a_little(patch_network.NormalNetwork(2, 8))
    generators = [np.random.default_rng(seed) for seed in range(3)]
    clouds = [learn_patches.make_batch(*scanned_clouds.sample_scan(vase, rng)) for rng in generators]
    clouds[1] = dataclasses.replace(
        clouds[1], neighbors=(few := clouds[1].neighbors[:, :9]), share=torch.full(few.shape, 1 / 9)
    )  # fmt: skip
    group = patch_network.merge_clouds(clouds)
    with torch.no_grad():
        alone = [list(network(cloud))[-1] for cloud in clouds]
        *_, found = network(group)
        for together, single in zip(found, zip(*alone, strict=True), strict=True):
            torch.testing.assert_close(together, torch.cat(single), rtol=0, atol=1e-5)
        losses = [learn_patches.compute_loss(network, cloud) for cloud in clouds]
        torch.testing.assert_close(learn_patches.compute_loss(network, group), sum(losses) / 3)


def _trained_a_little(network: patch_network.NormalNetwork) -> patch_network.NormalNetwork:
    """A network that begins with votes that count."""
    for each in network.rounds:
        torch.nn.init.normal_(each.vote.weight, std=0.1)
    return network


def test_it_learns_and_the_same_seed_learns_the_same(
    meshes: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    headers = []
    for run in ("first.h", "second.h"):
        monkeypatch.setattr(scanned_clouds, "MAX_POINTS", 1200)
        monkeypatch.setattr(sys, "argv", [
            "", str(meshes), "--steps", "12", "--rounds", "2", "--width", "16", "--output", str(tmp_path / run)
        ])  # fmt: skip
        learn_patches.main()
        headers.append((tmp_path / run).read_bytes())
    assert headers[0] == headers[1]
    learnt = patch_network.read_header(tmp_path / "first.h")
    torch.manual_seed(1)
    fresh, rng = patch_network.NormalNetwork(2, 16), np.random.default_rng(5)
    vase = scanned_clouds.read_shape(meshes / "vase.ply")
    clouds = [learn_patches.make_batch(*scanned_clouds.sample_scan(vase, rng)) for _ in range(8)]
    with torch.no_grad():
        before, after = (
            sum(learn_patches.compute_loss(network, cloud) for cloud in clouds) for network in (fresh, learnt)
        )
    assert after < before


def test_what_it_has_learnt_is_measured(meshes: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The shipped network, on a shape that it has never seen."""
    monkeypatch.setattr(learn_patches, "MEASURED_CASES", ((1500, 0.0), (1500, 0.01)))
    vase = scanned_clouds.read_shape(meshes / "vase.ply")
    lines = "\n".join(learn_patches.measure_angles(patch_network.read_header(learn_patches.HEADER), [vase]))
    rows = re.findall(r"1500 points, noise [0.]*1?: ([\d.]+) degrees alone, ([\d.]+) together", lines)
    assert len(rows) == 2
    for alone, together in rows:
        assert float(together) < 0.95 * float(alone)


@pytest.mark.parametrize("seed", range(12))
def test_clouds_to_learn_from_lie_near_the_shape(meshes: Path, seed: int) -> None:
    """In single cells and from one side as well: as many true points and normals as noisy ones, and a unit each."""
    points, normals, cloud = scanned_clouds.sample_scan(
        scanned_clouds.read_shape(meshes / "vase.ply"), np.random.default_rng(seed)
    )
    assert len(points) == len(normals) == len(cloud) >= 100
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1, atol=1e-6)
    off = np.linalg.norm(cloud - points, axis=1)
    assert np.median(off) < 2.5 * scanned_clouds.MAX_NOISE_TO_SPACING * np.sqrt(6 / len(points))


def test_the_network_and_the_kernel_share_constants() -> None:
    folder = learn_patches.HEADER.parent
    text = "".join((folder / name).read_text() for name in ("normal_gnn.c", "normal_gnn.h"))
    for name in ("MAX_STEP", "FEATURES"):
        in_c = re.search(rf"#define {name} ([\d.]+)f?\b", text)
        assert in_c and float(in_c[1]) == getattr(patch_network, name)
