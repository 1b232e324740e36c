"""Removes the bias that Monte Carlo noise leaves in faint shadows on a render's floor.

Alpha of a shadow cannot fall below 0, so the denoised mean of a few noisy samples overestimates faint shadows ("haze").
Weights that learn from such renders would darken all of the floor around an object.
"""

from __future__ import annotations

import numpy as np
import torch

SHADOW_ALPHAS = (0.0, 0.001, 0.004, 0.01, 0.04, 0.1, 1.0)
RELATIVE_BIASES = (0.0, 0.15, 0.7, 1.0, 0.6, 0.32, 0.3)
"""Bias at shadows of these alphas, relative to its maximum; measured by `scripts/measure_shadow_bias.py`."""


def remove_shadow_bias(image: torch.Tensor, coverage: torch.Tensor, bias: float) -> torch.Tensor:
    """Premultiplied RGBA images (B, 4, H, W) in [0, 1] without the bias of their floor's shadow.

    `coverage` (B, 1, H, W) in [0, 1] is the object's share of each pixel, which does not change. `bias` is the alpha
    by which a shadow of alpha 0.01, where the bias is largest, is too dark.
    """
    if bias == 0:
        return image
    alpha, floor = image[:, 3:], 1 - coverage
    shadow = ((alpha - coverage) / floor.clamp_min(1e-3)).clamp(0, 1)
    relative = torch.from_numpy(np.interp(shadow.numpy(), SHADOW_ALPHAS, RELATIVE_BIASES).astype(np.float32))
    return torch.cat([image[:, :3], alpha - floor * shadow.minimum(bias * relative)], dim=1)
