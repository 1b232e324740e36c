"""Training of the normal network: it equals the compiled kernel, learns, and is written and read without loss."""

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
import normal_network
import scan_simulation
import train_normal_gnn


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
    points, normals = scan_simulation.sample_shape(scan_simulation.read_shape(meshes / "vase.ply"), 2000, rng)
    noisy = (points + noise * rng.normal(size=points.shape)).astype(np.float32)
    cloud = train_normal_gnn.make_batch(points, normals, noisy)
    rows = cloud.neighbors[:, :neighbors]  # the last block of 16 may be half full
    cloud = dataclasses.replace(cloud, neighbors=rows, share=torch.full(rows.shape, 1 / neighbors))
    with torch.no_grad():
        *_, (points, normals) = normal_network.read_header(train_normal_gnn.HEADER)(cloud)
    inputs = (cloud.points.numpy(), cloud.normals.numpy(), cloud.neighbors.numpy(), cloud.scale.numpy())
    kernel_points, kernel_normals = native.refine_normals(*inputs, float(cloud.noise[0]))
    np.testing.assert_allclose(kernel_points, points.numpy(), atol=1e-5)
    np.testing.assert_allclose(kernel_normals, normals.numpy(), atol=1e-4)


@pytest.mark.parametrize(("rounds", "width"), [(3, 16), (2, 32)])
def test_a_header_holds_a_network_of_any_size(tmp_path: Path, rounds: int, width: int) -> None:
    torch.manual_seed(3)
    network = normal_network.NormalNetwork(rounds, width)
    normal_network.write_header(tmp_path / "weights.h", network)
    back = normal_network.read_header(tmp_path / "weights.h")
    assert (len(back.rounds), back.width) == (rounds, width)
    for name, value in back.state_dict().items():
        if not name.startswith(f"rounds.{rounds - 1}.next"):  # the last round has no state update
            torch.testing.assert_close(value, network.state_dict()[name], rtol=1e-3, atol=1e-6)


@pytest.mark.parametrize(
    ("defined", "error"),
    [("", "expected a header that defines ROUNDS and WIDTH"),
     ("#define ROUNDS 3\n#define WIDTH 16\n", r"expected \d+ numbers for 3 rounds of 16 units, got 3")],
)  # fmt: skip
def test_a_header_of_another_network_is_refused(tmp_path: Path, defined: str, error: str) -> None:
    (tmp_path / "weights.h").write_text(defined + "static const Network NORMAL_GNN_WEIGHTS = { 1, 2.5e-3, -4 };")
    with pytest.raises(ValueError, match=r"weights\.h: " + error):
        normal_network.read_header(tmp_path / "weights.h")


@pytest.mark.parametrize(("rounds", "width"), [(4, 8), (2, 12), (3, 12)])
def test_a_grown_network_equals_the_small_one(meshes: Path, rounds: int, width: int) -> None:
    torch.manual_seed(4)
    small = with_random_outputs(normal_network.NormalNetwork(2, 8))
    cloud = train_normal_gnn.make_batch(*scan_simulation.sample_scan(
        scan_simulation.read_shape(meshes / "vase.ply"), np.random.default_rng(2)
    ))  # fmt: skip
    with torch.no_grad():
        *_, before = small(cloud)
        *_, after = normal_network.grow_network(small, rounds, width)(cloud)
    assert float((before[1] - cloud.normals).abs().max()) > 0.01  # the outputs matter
    for was, became in zip(before, after, strict=True):
        torch.testing.assert_close(became, was, rtol=0, atol=1e-5)


def test_a_network_does_not_grow_smaller() -> None:
    with pytest.raises(ValueError, match="expected 3 rounds of 16 units or more, got 2 of 16"):
        normal_network.grow_network(normal_network.NormalNetwork(3, 16), 2, 16)


def test_clouds_of_a_group_are_independent(meshes: Path) -> None:
    """A group's losses and results are those of its clouds alone, though one has fewer neighbors per point."""
    torch.manual_seed(6)
    vase = scan_simulation.read_shape(meshes / "vase.ply")
    network = with_random_outputs(normal_network.NormalNetwork(2, 8))
    generators = [np.random.default_rng(seed) for seed in range(3)]
    clouds = [train_normal_gnn.make_batch(*scan_simulation.sample_scan(vase, rng)) for rng in generators]
    clouds[1] = dataclasses.replace(
        clouds[1], neighbors=(few := clouds[1].neighbors[:, :9]), share=torch.full(few.shape, 1 / 9)
    )  # fmt: skip
    group = normal_network.merge_clouds(clouds)
    with torch.no_grad():
        alone = [list(network(cloud))[-1] for cloud in clouds]
        *_, grouped = network(group)
        for together, single in zip(grouped, zip(*alone, strict=True), strict=True):
            torch.testing.assert_close(together, torch.cat(single), rtol=0, atol=1e-5)
        losses = [train_normal_gnn.compute_loss(network, cloud) for cloud in clouds]
        torch.testing.assert_close(train_normal_gnn.compute_loss(network, group), sum(losses) / 3)


def with_random_outputs(network: normal_network.NormalNetwork) -> normal_network.NormalNetwork:
    """The network with output weights that are not 0."""
    for each in network.rounds:
        torch.nn.init.normal_(each.output.weight, std=0.1)
    return network


@pytest.mark.slow
def test_training_lowers_the_loss_and_is_reproducible(
    meshes: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    headers = []
    for run in ("first.h", "second.h"):
        monkeypatch.setattr(scan_simulation, "MAX_POINTS", 1200)
        monkeypatch.setattr(sys, "argv", [
            "", str(meshes), "--steps", "12", "--rounds", "2", "--width", "16", "--output", str(tmp_path / run)
        ])  # fmt: skip
        train_normal_gnn.main()
        headers.append((tmp_path / run).read_bytes())
    assert headers[0] == headers[1]
    trained = normal_network.read_header(tmp_path / "first.h")
    torch.manual_seed(1)
    fresh, rng = normal_network.NormalNetwork(2, 16), np.random.default_rng(5)
    vase = scan_simulation.read_shape(meshes / "vase.ply")
    clouds = [train_normal_gnn.make_batch(*scan_simulation.sample_scan(vase, rng)) for _ in range(8)]
    with torch.no_grad():
        before, after = (
            sum(train_normal_gnn.compute_loss(network, cloud) for cloud in clouds) for network in (fresh, trained)
        )
    assert after < before


def test_the_shipped_network_improves_normals(meshes: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The shipped network, on a shape that is not among its training meshes."""
    monkeypatch.setattr(train_normal_gnn, "MEASURED_CASES", ((1500, 0.0), (1500, 0.01)))
    vase = scan_simulation.read_shape(meshes / "vase.ply")
    lines = "\n".join(train_normal_gnn.measure_angles(normal_network.read_header(train_normal_gnn.HEADER), [vase]))
    rows = re.findall(r"1500 points, noise [0.]*1?: ([\d.]+) degrees before, ([\d.]+) after the network", lines)
    assert len(rows) == 2
    for before, after in rows:
        assert float(after) < 0.95 * float(before)


@pytest.mark.parametrize("seed", range(12))
def test_simulated_scans_lie_near_the_shape(meshes: Path, seed: int) -> None:
    """Of all kinds of scans: as many true points and unit normals as noisy points."""
    points, normals, cloud = scan_simulation.sample_scan(
        scan_simulation.read_shape(meshes / "vase.ply"), np.random.default_rng(seed)
    )
    assert len(points) == len(normals) == len(cloud) >= 100
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1, atol=1e-6)
    distances = np.linalg.norm(cloud - points, axis=1)
    assert np.median(distances) < 2.5 * scan_simulation.MAX_NOISE_TO_SPACING * np.sqrt(6 / len(points))


def test_the_network_and_the_kernel_share_constants() -> None:
    folder = train_normal_gnn.HEADER.parent
    text = "".join((folder / name).read_text() for name in ("normal_gnn.c", "normal_gnn.h"))
    for name in ("MAX_STEP", "FEATURES"):
        in_c = re.search(rf"#define {name} ([\d.]+)f?\b", text)
        assert in_c and float(in_c[1]) == getattr(normal_network, name)
