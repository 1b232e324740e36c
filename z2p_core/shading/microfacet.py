"""The GGX microfacet model, as Blender's Principled BSDF uses it: masking, Fresnel terms, VNDF samples, albedo tables.

Directions are unit vectors away from a surface whose normal is +Z: `n_dot_v` is the cosine between the normal and the
direction to the viewer, `n_dot_l` that to the light, `v_dot_h` the one between the viewer and the half vector.
`roughness` is Blender's parameter, and `alpha` = roughness^2 is GGX's (`alpha_from_roughness`). `ior` is a dielectric's
index of refraction. The C kernel of the same model is `z2p_core/native/c/lighting/ggx_specular.c`.

- Walter, Marschner, Li, Torrance: Microfacet Models for Refraction through Rough Surfaces, EGSR 2007.
- Heitz: Understanding the Masking-Shadowing Function in Microfacet-Based BRDFs, JCGT 2014.
- Heitz: Sampling the GGX Distribution of Visible Normals, JCGT 2018.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

CANDIDATE_DIRECTIONS = 1024
"""Samples of the specular lobe from which `specular_directions` chooses."""
TABLE_SAMPLES = 128
"""Samples of the specular lobe for each entry of the albedo tables, which are then right to about 0.01."""
MIN_TABLE_ALPHA = 1e-4
"""Smallest alpha that the albedo tables are computed for: below it the surface is a mirror."""
R2_STEPS = (0.7548776662466927, 0.5698402909980532)
"""Steps of the R2 sequence, which fills a square evenly (Roberts, 2018)."""
MIN_COS_ZENITH = 0.08
"""Directions lower than this above the floor are left out: they would reflect something too far away."""
TABLE_COSINES = np.linspace(0, 1, 64)
"""n_dot_v of the entries of the albedo tables, which are interpolated linearly between these."""


def alpha_from_roughness(roughness: float, smallest: float = 0.0) -> float:
    """GGX's alpha of Blender's roughness in [0, 1], at least `smallest`: the only place where this is computed."""
    return max(roughness**2, smallest)


@lru_cache(maxsize=16)
def specular_directions(n_dot_v: float, roughness: float, ior: float, count: int) -> np.ndarray:
    """Unit vectors (count, 3) from which a rough dielectric reflects light to a viewer; `count` is even.

    The viewer stands on the +X side (y = 0, z > 0). Every direction has the same weight: they are drawn from the
    visible normals in proportion to Fresnel's term and to G2 / G1.
    """
    alpha = alpha_from_roughness(roughness)
    directions, v_dot_h = sample_vndf(np.array([n_dot_v]), alpha, CANDIDATE_DIRECTIONS)
    order = np.argsort(directions[0, :, 2])  # so that the chosen ones are evenly distributed over the heights
    directions, v_dot_h = directions[0, order], v_dot_h[0, order]
    masking = smith_g2_over_g1(np.array(n_dot_v), directions[:, 2], alpha)
    weight = fresnel_dielectric(np.abs(v_dot_h), ior) * masking
    cumulative = np.cumsum(np.where(directions[:, 2] > MIN_COS_ZENITH, weight, 0))
    quantiles = (np.arange(count // 2) + 0.5) / (count // 2) * cumulative[-1]
    chosen = directions[np.searchsorted(cumulative, quantiles)]
    return np.concatenate([chosen, chosen * (1.0, -1.0, 1.0)])


@lru_cache(maxsize=16)
def directional_albedo_table(roughness: float, ior: float) -> np.ndarray:
    """Shares of uniform light that a rough surface reflects in a single bounce, at `TABLE_COSINES`: (64, 4).

    Columns 0 and 1 are for metal: the share is F0 * column 0 + F90 * column 1, with Schlick's Fresnel term. Columns 2
    and 3 are the same for a dielectric, with the exact Fresnel term, normalized (`normalized_fresnel`).
    """
    alpha, n_dot_v = alpha_from_roughness(roughness, MIN_TABLE_ALPHA), np.maximum(TABLE_COSINES, 1e-3)
    directions, v_dot_h = sample_vndf(n_dot_v, alpha, TABLE_SAMPLES)
    masking = smith_g2_over_g1(n_dot_v[:, None], directions[..., 2], alpha)
    weight = np.where(directions[..., 2] > 0, masking, 0)
    metal = (1 - np.clip(v_dot_h, 0, 1)) ** 5
    dielectric = np.clip(normalized_fresnel(np.maximum(v_dot_h, 1e-4), ior), 0, 1)
    return np.stack([(weight * part).mean(1) for part in (1 - metal, metal, 1 - dielectric, dielectric)], axis=1)


def sample_vndf(n_dot_v: np.ndarray, alpha: float, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Directions (C, count, 3) that a rough surface reflects views to, and `v_dot_h` (C, count) of each.

    Views come from the +X side at the cosines `n_dot_v` (C,). Microfacet normals are drawn from the distribution of
    visible normals (Heitz 2018), those on one side of the plane y = 0 only: the other side is its mirror image.
    Directions below the horizon (z < 0) are among the results.
    """
    views = np.stack([np.sqrt(1 - n_dot_v**2), np.zeros_like(n_dot_v), n_dot_v], axis=1)[:, None]
    u, turn = (np.arange(count)[:, None] * R2_STEPS % (1, 0.5)).T
    stretched = views * (alpha, alpha, 1)
    stretched /= np.linalg.norm(stretched, axis=2, keepdims=True)
    tangent_y = np.cross(stretched, (0.0, 1.0, 0.0))  # the other tangent is +Y; both are normal to the stretched view
    y, x = np.sqrt(u) * np.cos(2 * np.pi * turn), np.sqrt(u) * np.sin(2 * np.pi * turn)
    visible = 0.5 * (1 + stretched[..., 2])
    y = (1 - visible) * np.sqrt(1 - x**2) + visible * y
    z = np.sqrt(np.maximum(1 - x**2 - y**2, 0))
    half = x[:, None] * (0.0, 1.0, 0.0) + y[..., None] * tangent_y + z[..., None] * stretched
    half = np.maximum(half, (-np.inf, -np.inf, 1e-6)) * (alpha, alpha, 1)
    half /= np.linalg.norm(half, axis=2, keepdims=True)
    v_dot_h = (half * views).sum(2)
    return 2 * v_dot_h[..., None] * half - views, v_dot_h


def smith_g2_over_g1(n_dot_v: np.ndarray, n_dot_l: np.ndarray, alpha: float) -> np.ndarray:
    """Height-correlated Smith G2 over G1 of the viewer: the weight of a sample of the visible normals (Heitz 2018)."""
    ratio: np.ndarray = 1 / (1 + smith_lambda(n_dot_l, alpha) / (1 + smith_lambda(n_dot_v, alpha)))
    return ratio


def smith_lambda(cosine: np.ndarray, alpha: float) -> np.ndarray:
    """Smith's Lambda of GGX at a cosine to the normal (Heitz 2014, equation 72)."""
    root: np.ndarray = np.sqrt(1 + alpha**2 * (1 / np.maximum(cosine, 1e-3) ** 2 - 1))
    return (root - 1) / 2


def fresnel_dielectric(cosine: np.ndarray, ior: float) -> np.ndarray:
    """Fresnel reflectance of a dielectric for unpolarized light, in [0, 1] (Walter et al. 2007, equation 22)."""
    g = np.sqrt(ior**2 - 1 + cosine**2)
    reflectance: np.ndarray = 0.5 * ((g - cosine) / (g + cosine)) ** 2
    reflectance *= 1 + ((cosine * (g + cosine) - 1) / (cosine * (g - cosine) + 1)) ** 2
    return reflectance


def normalized_fresnel(cosine: np.ndarray, ior: float) -> np.ndarray:
    """(F - F0) / (1 - F0) of a dielectric: 0 at normal incidence, 1 at grazing incidence."""
    f0 = ((ior - 1) / (ior + 1)) ** 2
    return (fresnel_dielectric(cosine, ior) - f0) / (1 - f0)
