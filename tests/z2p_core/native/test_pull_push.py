"""An image extended beyond the pixels that have values, against numpy."""

import numpy as np
import pytest

from z2p_core import native


def sum_of_four(image: np.ndarray) -> np.ndarray:
    """Sums of the 2 x 2 blocks of an image (..., H, W)."""
    height, width = image.shape[-2:]
    image = np.pad(image, [(0, 0)] * (image.ndim - 2) + [(0, height % 2), (0, width % 2)])
    rows = image[..., ::2, :] + image[..., 1::2, :]
    return rows[..., ::2] + rows[..., 1::2]


def extended_half(values: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Pull-push interpolation: values (3, H, W) at half the resolution."""
    total = sum_of_four(weights)
    mean, weights = sum_of_four(values * weights) / np.maximum(total, 1e-9), np.minimum(total, 1)
    if weights.size == 1:
        return mean
    coarser = extended_half(mean, weights).repeat(2, axis=1).repeat(2, axis=2)
    return mean * weights + coarser[:, : weights.shape[0], : weights.shape[1]] * (1 - weights)


@pytest.mark.parametrize("size", [(1, 1), (2, 3), (33, 47), (64, 64)])
def test_values_are_extended_as_by_numpy(size: tuple[int, int]) -> None:
    rng = np.random.default_rng(0)
    values = rng.random((3, *size), np.float32)
    weights = rng.random(size, np.float32) * (rng.random(size) < 0.3)
    weights[0, 0] = 1
    found = native.extend_halved(values, weights, 2.0)
    np.testing.assert_allclose(found, extended_half(values, np.minimum(2 * weights, 1)), atol=1e-5)


def test_an_image_without_values_is_0() -> None:
    assert not native.extend_halved(np.ones((3, 9, 7)), np.zeros((9, 7))).any()
