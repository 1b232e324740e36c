"""What rough surfaces mirror: directions of the lobe that a Principled BSDF reflects (GGX), and how much goes there."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

CANDIDATE_DIRECTIONS = 1024
"""Directions of which those that are asked for are chosen."""
TABLE_SAMPLES = 128
"""Directions of each view that a share is the mean of: it is right to a hundredth then."""
R2_STEPS = (0.7548776662466927, 0.5698402909980532)
"""Steps of the R2 sequence, which fills a square evenly (Roberts, 2018)."""
MIN_COS_ZENITH = 0.08
"""Lowest sine of a direction's elevation: what lies lower mirrors something too far off."""
TABLE_COSINES = np.linspace(0, 1, 64)
"""Of the angles to the normal at which shares are kept; between these they run straight."""


@lru_cache(maxsize=16)
def specular_directions(cosine: float, roughness: float, index: float, count: int) -> np.ndarray:
    """Unit vectors (count, 3) from which light comes to a viewer by a surface whose normal is +Z; even in number.

    The viewer sees it at that cosine, from the +X side (y 0, z > 0). Each direction brings as much: they are thinned by
    Fresnel's term, for an index of refraction, and by what the surface hides of itself.
    """
    alpha = roughness**2
    ways, facing = sample_vndf(np.array([cosine]), alpha, CANDIDATE_DIRECTIONS)
    order = np.argsort(ways[0, :, 2])  # so that those chosen are spread evenly over the heights
    ways, facing = ways[0, order], facing[0, order]
    weight = fresnel_dielectric(np.abs(facing), index) * smith_g2_over_g1(np.array(cosine), ways[:, 2], alpha)
    total = np.cumsum(np.where(ways[:, 2] > MIN_COS_ZENITH, weight, 0))
    chosen = ways[np.searchsorted(total, (np.arange(count // 2) + 0.5) / (count // 2) * total[-1])]
    return np.concatenate([chosen, chosen * (1.0, -1.0, 1.0)])


@lru_cache(maxsize=16)
def directional_albedo_table(roughness: float, index: float) -> np.ndarray:
    """What a rough surface sends, at `TABLE_COSINES`, under a sky that is the same all over, to the first bounce: (64, 4).

    Parts that are as large as what it reflects head on, and at a grazing angle: of metal, by Schlick's fifth power of
    what is missing to the cosine, and of a dielectric with that index of refraction, by Fresnel's term.
    """
    alpha, viewers = max(roughness**2, 1e-4), np.maximum(TABLE_COSINES, 1e-3)
    ways, facing = sample_vndf(viewers, alpha, TABLE_SAMPLES)
    weight = np.where(ways[..., 2] > 0, smith_g2_over_g1(viewers[:, None], ways[..., 2], alpha), 0)
    metal = (1 - np.clip(facing, 0, 1)) ** 5
    dielectric = np.clip(normalized_fresnel(np.maximum(facing, 1e-4), index), 0, 1)
    return np.stack([(weight * part).mean(1) for part in (1 - metal, metal, 1 - dielectric, dielectric)], axis=1)


def sample_vndf(cosines: np.ndarray, alpha: float, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Ways (C, count, 3) that rough surfaces with normal +Z reflect views to, and cosines (C, count) half-way to them.

    Views are from the +X side, at these cosines (C,). The surfaces' own normals are those that a viewer sees (Heitz,
    Sampling the GGX Distribution of Visible Normals, 2018), of one side of two that are alike.
    """
    viewers = np.stack([np.sqrt(1 - cosines**2), np.zeros_like(cosines), cosines], axis=1)[:, None]
    u, turn = (np.arange(count)[:, None] * R2_STEPS % (1, 0.5)).T
    stretched = viewers * (alpha, alpha, 1)
    stretched /= np.linalg.norm(stretched, axis=2, keepdims=True)
    up = np.cross(stretched, (0.0, 1.0, 0.0))  # both lie across the stretched viewer
    y, x = np.sqrt(u) * np.cos(2 * np.pi * turn), np.sqrt(u) * np.sin(2 * np.pi * turn)
    seen = 0.5 * (1 + stretched[..., 2])
    y = (1 - seen) * np.sqrt(1 - x**2) + seen * y
    ahead = np.sqrt(np.maximum(1 - x**2 - y**2, 0))
    normals = x[:, None] * (0.0, 1.0, 0.0) + y[..., None] * up + ahead[..., None] * stretched
    normals = np.maximum(normals, (-np.inf, -np.inf, 1e-6)) * (alpha, alpha, 1)
    normals /= np.linalg.norm(normals, axis=2, keepdims=True)
    facing = (normals * viewers).sum(2)
    return 2 * facing[..., None] * normals - viewers, facing


def smith_g2_over_g1(viewer: np.ndarray, way: np.ndarray, alpha: float) -> np.ndarray:
    """Share of what a viewer sees that is not hidden from a way, both given by their cosines to the normal."""
    share: np.ndarray = 1 / (1 + smith_lambda(way, alpha) / (1 + smith_lambda(viewer, alpha)))
    return share


def fresnel_dielectric(cosine: np.ndarray, index: float) -> np.ndarray:
    """Share of light that a dielectric reflects, unpolarised (Walter et al., 2007, equation 22)."""
    g = np.sqrt(index**2 - 1 + cosine**2)
    share: np.ndarray = 0.5 * ((g - cosine) / (g + cosine)) ** 2
    share *= 1 + ((cosine * (g + cosine) - 1) / (cosine * (g - cosine) + 1)) ** 2
    return share


def normalized_fresnel(cosine: np.ndarray, index: float) -> np.ndarray:
    """How far that share has risen at a cosine, from 0 straight ahead to 1 at a grazing angle."""
    ahead = ((index - 1) / (index + 1)) ** 2
    return (fresnel_dielectric(cosine, index) - ahead) / (1 - ahead)


def smith_lambda(cosine: np.ndarray, alpha: float) -> np.ndarray:
    """Smith's lambda of GGX: how much of itself a rough surface hides, against what it shows."""
    slant: np.ndarray = np.sqrt(1 + alpha**2 * (1 / np.maximum(cosine, 1e-3) ** 2 - 1))
    return (slant - 1) / 2
