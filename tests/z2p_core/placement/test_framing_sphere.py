"""The sphere around very many points is the one that is computed from all of them."""

from __future__ import annotations

import numpy as np
import pytest

from z2p_core.placement import framing_sphere as module
from z2p_core.placement.bounding_sphere import bounding_sphere
from z2p_core.placement.framing_sphere import framing_sphere


@pytest.mark.parametrize("kind", ["ball", "sphere", "box", "far away", "flat"])
def test_it_is_the_smallest_sphere_of_all_points(monkeypatch: pytest.MonkeyPatch, kind: str) -> None:
    monkeypatch.setattr(module, "MIN_POINTS", 100)
    monkeypatch.setattr(module, "SAMPLE_POINTS", 50)
    monkeypatch.setattr(module, "MAX_ADDED_POINTS", 20)
    points = np.random.default_rng(3).normal(size=(4000, 3))
    match kind:
        case "sphere":
            points /= np.linalg.norm(points, axis=1, keepdims=True)
        case "box":
            points = np.clip(points, -1, 1)
        case "far away":
            points += [4e5, 5e6, 100]
        case "flat":
            points[:, 2] = 0
    expected, got = bounding_sphere(points), framing_sphere(points)
    np.testing.assert_allclose(got.centre, expected.centre, atol=1e-7 * expected.radius)
    assert got.radius == pytest.approx(expected.radius, rel=1e-8)
