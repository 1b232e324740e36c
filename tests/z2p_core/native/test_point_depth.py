"""The depth encoding of the Z2P paper against plain numpy."""

import numpy as np
import pytest

from z2p_core import native


@pytest.mark.parametrize("stride", [40, 52])
def test_intensity_is_the_exponential_of_depth(stride):
    depth = np.random.default_rng(0).uniform(-10, 80, (30, stride)).astype(np.float32)[:, 3:40]
    depth[::3] = np.inf
    out = np.empty(depth.shape, np.float32)
    native.depth_to_intensity(depth, 2.6, 0.6, out)
    np.testing.assert_allclose(out, np.exp((2.6 - depth.astype(np.float64)) / 0.6), rtol=3e-5, atol=1e-37)
    near = np.linspace(2.6, 4.6, 1000, dtype=np.float32).reshape(10, 100)
    drawn = np.empty(near.shape, np.float32)
    native.depth_to_intensity(near, 2.6, 0.6, drawn)
    np.testing.assert_allclose(drawn, np.exp((2.6 - near) / np.float32(0.6)), rtol=1e-6)
