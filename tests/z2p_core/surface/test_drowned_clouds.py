"""Clouds whose surface drowns in noise: how many of their points are left to tell it."""

import math

import pytest
from point_shapes import sphere_of

from z2p_core.surface.normals import estimate_surface
from z2p_core.surface.subsampling import subsample_hashed


@pytest.mark.parametrize("count", [6_001, 16_400, 31_999, 60_000])
def test_of_a_cloud_that_drowns_a_third_is_kept_each_time_and_never_too_few(monkeypatch, count):
    monkeypatch.setattr("z2p_core.surface.normals.noise_exceeds_patch", lambda own: True)
    kept = len(estimate_surface(subsample_hashed(sphere_of(count), 40_000)).points)
    assert 1_850 < kept < 6_000
    times = math.log(min(count, 40_000) / kept, 3)
    assert abs(times - round(times)) < 0.07
