"""Whatever holds points gives the same points; what holds none is refused with a word why."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
import torch
import trimesh

from z2p_core.interfaces import ScanError
from z2p_core.point_arrays import point_arrays

CLOUD = np.random.default_rng(0).normal(size=(20, 3)).astype(np.float32)
HOLDERS = {
    "array": CLOUD,
    "float64": CLOUD.astype(np.float64),
    "list": CLOUD.tolist(),
    "six columns": np.hstack([CLOUD, CLOUD]),
    "tensor": torch.from_numpy(CLOUD),
    "tensor with a gradient": torch.from_numpy(CLOUD).requires_grad_(),
    "trimesh cloud": trimesh.PointCloud(CLOUD),
    "pyvista-like": SimpleNamespace(points=CLOUD),
    "laspy-like": SimpleNamespace(xyz=CLOUD),
}


@pytest.mark.parametrize("name", HOLDERS)
def test_every_holder_gives_its_points(name: str) -> None:
    given = point_arrays(HOLDERS[name])
    assert not given.batched
    [cloud] = given.clouds
    assert cloud.dtype == np.float64
    np.testing.assert_allclose(cloud, CLOUD)
    assert given.unused_columns == (3 if name == "six columns" else 0)


def test_open3d_clouds_go_in_as_they_are() -> None:
    open3d = pytest.importorskip("open3d")
    legacy = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(CLOUD.astype(np.float64)))
    tensor = open3d.t.geometry.PointCloud(CLOUD)
    for holder in (legacy, tensor):
        np.testing.assert_allclose(point_arrays(holder).clouds[0], CLOUD)


def test_half_precision_is_read() -> None:
    [cloud] = point_arrays(torch.from_numpy(CLOUD).bfloat16()).clouds
    np.testing.assert_allclose(cloud, CLOUD, rtol=0.01)


@pytest.mark.parametrize("batch", [np.stack([CLOUD] * 4), torch.from_numpy(np.stack([CLOUD] * 4)), [CLOUD] * 4,
                                   [CLOUD, CLOUD[:5], torch.from_numpy(CLOUD), trimesh.PointCloud(CLOUD)]])  # fmt: skip
def test_batches(batch: object) -> None:
    given = point_arrays(batch)
    assert given.batched and len(given.clouds) == 4
    np.testing.assert_allclose(given.clouds[3], CLOUD)


def test_the_callers_array_is_left_alone() -> None:
    mine = CLOUD.astype(np.float64)
    point_arrays(mine).clouds[0][:] = 0
    np.testing.assert_array_equal(mine, CLOUD)


@pytest.mark.parametrize(
    ("thing", "told"),
    [
        (np.zeros((3, 100)), "transpose"), (np.zeros(9), "expected points"), (np.zeros((9, 2)), "expected points"),
        (np.zeros((9, 4)), "expected points"), (np.zeros((2, 2, 9, 3)), "expected points"), (None, "expected points"),
        ([[1, 2, 3], [1, 2]], "expected points as an array"), (np.array([["a", "b", "c"]]), "numbers"),
        (np.zeros((4, 3), dtype=complex), "numbers"), (object(), "expected points"), ("cloud", "expected points"),
    ],
)  # fmt: skip
def test_refusals(thing: object, told: str) -> None:
    with pytest.raises(ScanError, match=told):
        point_arrays(thing)
