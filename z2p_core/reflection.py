"""Where a rough surface mirrors: directions of the reflected lobe of a Principled BSDF (GGX), each as bright."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

TRIED = 1024
"""Directions of which those that are asked for are chosen."""
PLASTIC = (0.7548776662466927, 0.5698402909980532)
"""Steps of the R2 sequence, which fills a square evenly (Roberts, 2018)."""
LEVEL = 0.08
"""Lowest sine of a direction's elevation: what lies lower mirrors something too far off."""


@lru_cache(maxsize=16)
def mirror_directions(cosine: float, roughness: float, index: float, count: int) -> np.ndarray:
    """Unit vectors (count, 3) from which light comes to a viewer by a surface whose normal is +Z; even in number.

    The viewer sees it at that cosine, from the +X side (y 0, z > 0). Each direction brings as much. They are normals
    that the viewer sees (Heitz, Sampling the GGX Distribution of Visible Normals, 2018), turned into reflections and
    thinned by Fresnel's term, for an index of refraction, and by what the surface hides of itself.
    """
    alpha, viewer = roughness**2, np.array([np.sqrt(1 - cosine**2), 0.0, cosine])
    u, turn = (np.arange(TRIED)[:, None] * PLASTIC % (1, 0.5)).T  # one side of two that are alike
    stretched = viewer * (alpha, alpha, 1)
    stretched /= np.linalg.norm(stretched)
    up = np.cross(stretched, (0.0, 1.0, 0.0))  # both lie across the stretched viewer
    y, x = np.sqrt(u) * np.cos(2 * np.pi * turn), np.sqrt(u) * np.sin(2 * np.pi * turn)
    seen = 0.5 * (1 + stretched[2])
    y = (1 - seen) * np.sqrt(1 - x**2) + seen * y
    ahead = np.sqrt(np.maximum(1 - x**2 - y**2, 0))
    normals = x[:, None] * (0.0, 1.0, 0.0) + y[:, None] * up + ahead[:, None] * stretched
    normals = np.maximum(normals, (-np.inf, -np.inf, 1e-6)) * (alpha, alpha, 1)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    facing = normals @ viewer
    ways = 2 * facing[:, None] * normals - viewer
    order = np.argsort(ways[:, 2])  # so that those chosen are spread evenly over the heights
    ways, facing = ways[order], facing[order]
    weight = fresnel(np.abs(facing), index) / (1 + hidden(ways[:, 2], alpha) / (1 + hidden(viewer[2:], alpha)))
    total = np.cumsum(np.where(ways[:, 2] > LEVEL, weight, 0))
    chosen = ways[np.searchsorted(total, (np.arange(count // 2) + 0.5) / (count // 2) * total[-1])]
    return np.concatenate([chosen, chosen * (1.0, -1.0, 1.0)])


def fresnel(cosine: np.ndarray, index: float) -> np.ndarray:
    """Share of light that a dielectric reflects, unpolarised (Walter et al., 2007, equation 22)."""
    g = np.sqrt(index**2 - 1 + cosine**2)
    share: np.ndarray = 0.5 * ((g - cosine) / (g + cosine)) ** 2
    share *= 1 + ((cosine * (g + cosine) - 1) / (cosine * (g - cosine) + 1)) ** 2
    return share


def hidden(cosine: np.ndarray, alpha: float) -> np.ndarray:
    """Smith's lambda of GGX: how much of itself a rough surface hides, against what it shows."""
    slant: np.ndarray = np.sqrt(1 + alpha**2 * (1 / np.maximum(cosine, 1e-3) ** 2 - 1))
    return (slant - 1) / 2
