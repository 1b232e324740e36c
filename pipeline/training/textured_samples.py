"""Training samples in colors of their own: what inference makes of a textured cloud, and how targets compare with it.

The network draws the cloud in one neutral color, and its picture is multiplied by the relative radiance of the texture
(`z2p_core.shading.demodulation`). Training goes through that product, so that the network learns what makes it better.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import torch
from torch import Tensor

from z2p_core import registry
from z2p_core.images import srgb_from_linear
from z2p_core.interfaces import Control
from z2p_core.settings import apply_controls
from z2p_core.shading.textured_light import neutral_albedo
from z2p_renderer.pipeline.rendering.textures import SeededTexture
from z2p_renderer.storage.shards import Record

COLOR = "color"
"""Name of the control whose place textures take."""
MIN_ALPHA = 1e-3
"""Pixels of less alpha keep their color: there is nothing to divide by it."""
SRGB_KNEE, LINEAR_KNEE = 0.04045, 0.0031308
"""Below these sRGB values and linear ones, the transfer function is linear (IEC 61966-2-1)."""


def texture_albedo(record: Record, cloud: np.ndarray) -> np.ndarray | None:
    """Linear albedo (N, 3) float32 of a cloud in the unit sphere, not yet rotated; None for a record in one color.

    Raises:
        PluginError: the texture is unknown or broken.
    """
    return None if record.texture is None else SeededTexture.from_json(record.texture).albedo(cloud)


def in_neutral_color(record: Record, albedo: np.ndarray, controls: Sequence[dict[str, Any]]) -> Record:
    """The record with the control ``color`` set as inference sets it for a cloud with these albedos (N, 3).

    `controls` are the shard's, in the order of the settings vector.
    """
    control: Control = registry.load("controls", COLOR)()
    value = tuple(round(channel, 5) for channel in srgb_from_linear(neutral_albedo(albedo)).tolist())
    first = sum(int(one["size"]) for one in controls[: [one["name"] for one in controls].index(COLOR)])
    settings = record.settings.copy()
    settings[first : first + control.size] = control.encode(value)
    scene = replace(record.scene, material=dict(record.scene.material))
    apply_controls({COLOR: value}, {COLOR: control}, scene)
    return replace(record, settings=settings, scene=scene)


def multiply_radiance(image: Tensor, factors: Tensor) -> Tensor:
    """Images (B, 4, H, W), premultiplied sRGB and alpha, times factors (B, 3, H, W) in linear light.

    It is `z2p_core.shading.demodulation.apply_relative_radiance`, which gradients pass.
    """
    alpha = image[:, 3:]
    straight = (image[:, :3] / alpha.clamp_min(MIN_ALPHA)).clamp(0, 1)
    product = _srgb_from_linear(_linear_from_srgb(straight) * factors).clamp(max=1)
    return torch.cat([torch.where(alpha > MIN_ALPHA, product * alpha, image[:, :3]), alpha], dim=1)


def _linear_from_srgb(srgb: Tensor) -> Tensor:
    curve = ((srgb.clamp_min(SRGB_KNEE) + 0.055) / 1.055) ** 2.4
    return torch.where(srgb <= SRGB_KNEE, srgb / 12.92, curve)


def _srgb_from_linear(linear: Tensor) -> Tensor:
    curve = 1.055 * linear.clamp_min(LINEAR_KNEE) ** (1 / 2.4) - 0.055
    return torch.where(linear <= LINEAR_KNEE, linear * 12.92, curve)
