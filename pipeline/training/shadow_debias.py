"""The haze that noise leaves on a render's floor, and pictures without it.

Shade cannot be less than none, so of a few noisy samples a pixel, denoised, faint shade comes out darker than it is.
Weights that learn from such renders would darken all of the floor around their objects.
"""

from __future__ import annotations

import numpy as np
import torch

SHADOW_ALPHAS = (0.0, 0.001, 0.004, 0.01, 0.04, 0.1, 1.0)
RELATIVE_BIASES = (0.0, 0.15, 0.7, 1.0, 0.6, 0.32, 0.3)
"""How much of the haze lies in shade of these alphas, as `scripts/measure_haze.py` finds it."""


def remove_shadow_bias(picture: torch.Tensor, coverage: torch.Tensor, haze: float) -> torch.Tensor:
    """Pictures (B, 4, H, W), premultiplied, with the haze taken from the shade on their floor.

    `coverage` (B, 1, H, W) is the object's share of each pixel, which stays as it is; `haze` is in alpha, that in a
    shade of 0.01, where it is thickest. All in [0, 1].
    """
    if haze == 0:
        return picture
    alpha, floor = picture[:, 3:], 1 - coverage
    shade = ((alpha - coverage) / floor.clamp_min(1e-3)).clamp(0, 1)
    shares = torch.from_numpy(np.interp(shade.numpy(), SHADOW_ALPHAS, RELATIVE_BIASES).astype(np.float32))
    return torch.cat([picture[:, :3], alpha - floor * shade.minimum(haze * shares)], dim=1)
