"""Adds synthetic noise to clouds, in units of the mesh's bounding sphere (paper section 4)."""

from __future__ import annotations

import numpy as np

NOISE_KINDS = ("none", "uniform", "gaussian")


def add_noise(cloud: np.ndarray, kind: str, scale: float, rng: np.random.Generator) -> np.ndarray:
    """Cloud (N, 3), of the same dtype, plus independent noise per coordinate; always a copy.

    `scale` is in the cloud's units, in which the mesh's radius is 1: the half-width of ``uniform`` noise, or the
    standard deviation of ``gaussian`` noise. ``none`` draws nothing from `rng`.

    Raises:
        ValueError: an unknown kind, or a scale that is negative or not finite.
    """
    if kind not in NOISE_KINDS:
        raise ValueError(f"noise: expected one of {', '.join(NOISE_KINDS)}, got {kind!r}")
    if not 0 <= scale < np.inf:
        raise ValueError(f"noise scale: expected a number from 0, in units of the mesh's radius, got {scale:g}")
    if kind == "none" or scale == 0:
        return cloud.copy()
    noise = rng.uniform(-scale, scale, cloud.shape) if kind == "uniform" else rng.normal(0.0, scale, cloud.shape)
    return (cloud + noise).astype(cloud.dtype)
