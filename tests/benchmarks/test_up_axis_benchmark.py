"""Synthetic objects have an up axis, and the benchmark of up axes prints every rule, pose and kind."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parents[2]
sys.path[:0] = [str(ROOT / "scripts"), str(ROOT / "benchmarks")]
import build_standing  # noqa: E402
import up_axis  # noqa: E402
import upright_clouds  # noqa: E402
from mesh_parts import joined  # noqa: E402

from z2p_renderer.storage.meshes import write_mesh  # noqa: E402


@pytest.mark.parametrize("kind", build_standing.KINDS)
def test_objects_stand_on_the_floor_and_differ(kind: str) -> None:
    made = [joined(build_standing.KINDS[kind](np.random.default_rng([3, number])))[0] for number in (0, 1)]
    again = joined(build_standing.KINDS[kind](np.random.default_rng([3, 0])))[0]
    assert (np.array_equal(made[0], again) and made[0].shape != made[1].shape) or not np.array_equal(*made)
    for vertices in made:
        size = float(np.ptp(vertices, axis=0).max())
        assert np.isfinite(vertices).all() and size > 0.2
        assert vertices[:, 2].min() < 0.35 * size + 0.2


def test_clouds_have_their_labels_and_are_the_same_for_a_seed(tmp_path: Path) -> None:
    vertices, faces = joined(build_standing.chair(np.random.default_rng(0)))
    write_mesh(tmp_path / "cow.ply", vertices @ np.array(upright_clouds.UP_ROTATIONS["+Y"], dtype=float), faces)
    write_mesh(tmp_path / "stranger.ply", vertices, faces)
    first, again = (upright_clouds.mesh_clouds(tmp_path, 4, 1) for _ in range(2))
    assert [cloud.name for cloud in first] == ["cow"] * 4
    assert all(np.array_equal(a.points, b.points) for a, b in zip(first, again, strict=True))
    assert not np.array_equal(first[0].points, upright_clouds.mesh_clouds(tmp_path, 1, 2)[0].points)
    hits = [up_axis.by_shape(cloud.points, ".ply")[0] == "+Z" for cloud in first]
    assert sum(hits) >= 3  # turned to +Z, as the label says


def test_what_lies_behind_is_not_seen() -> None:
    near, far = np.random.default_rng(0).uniform(-1, 1, (2, 3000, 3))
    wall = np.vstack([near * [0, 1, 1] + [2, 0, 0], far * [0, 1, 1] - [2, 0, 0]])
    visible = upright_clouds.visible_points(wall, 0.0, 0.0)
    assert visible[:3000].mean() > 0.95 and visible[3000:].mean() < 0.1


def test_the_table_names_every_rule_and_pose(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture) -> None:
    kinds = ("chair", "table", "beast")
    monkeypatch.setattr(upright_clouds, "KINDS", {kind: build_standing.KINDS[kind] for kind in kinds})
    monkeypatch.setattr(sys, "argv", ["up_axis.py", "--each", "2", "--kinds"])
    up_axis.main()
    output = capsys.readouterr().out
    assert "synthetic objects: 6 clouds, each in 4 poses" in output
    assert all(word in output for word in (*up_axis.RULES, *(f"{axis} up" for axis in up_axis.UP_AXES), *kinds))
    shape = next(line for line in output.splitlines() if "by shape" in line).split()
    assert float(shape[2].rstrip("%")) > 60
