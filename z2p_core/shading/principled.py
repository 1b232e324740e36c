"""Blender's Principled BSDF, reduced to base color, metallic, roughness and specular level.

A surface is a mix of metal (GGX with Schlick's Fresnel term) and of a diffuse base below a dielectric GGX layer. The
specular parts are compensated for multiple scattering (Kulla and Conty, Revisiting Physically Based Shading at
Imageworks, 2017), as Cycles does.

C entries of a table, M places, seen at the cosines `n_dot_v` (M,) to their normals.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from z2p_core.shading.microfacet import TABLE_COSINES, directional_albedo_table

F0_PER_SPECULAR_LEVEL = 0.08
"""F0 of the dielectric layer (its reflectance at normal incidence) for each unit of "Specular IOR Level"."""
IOR = 1.5
"""Index of refraction of the dielectric layer, Blender's default, which belongs to a specular level of 0.5."""
F90_PER_F0 = 50.0
"""F90 (the reflectance at grazing incidence) is 1 unless F0 is below 1 / 50; then it is this many times F0."""


@dataclass(frozen=True)
class Principled:
    """A material by its inputs in Blender: base color (3,) linear, metallic, specular level and roughness in [0, 1]."""

    color: np.ndarray
    metallic: float
    specular: float
    roughness: float

    @property
    def albedo(self) -> np.ndarray:
        """About the total albedo (3,) of the diffuse and the specular part together."""
        return np.minimum(self.color + self._f0 * (1 - self.metallic), 1)

    def diffuse_albedo(self, n_dot_v: np.ndarray) -> np.ndarray:
        """Albedo (M, 3) of the diffuse part, which receives what the dielectric layer does not reflect."""
        return self.color * (1 - self.metallic) * (1 - _interpolate_table(self._dielectric_albedo, n_dot_v))

    def specular_albedo(self, n_dot_v: np.ndarray) -> np.ndarray:
        """Directional albedo (M, 3) of the specular part: the share of uniform light that it reflects to the viewer."""
        table = self.metallic * self._metal_albedo + (1 - self.metallic) * self._dielectric_albedo
        return _interpolate_table(table, n_dot_v)

    def metal_share(self, n_dot_v: np.ndarray) -> np.ndarray:
        """Share (M, 3) in [0, 1] of metal, which the base color tints, in the specular albedo."""
        metal = self.metallic * _interpolate_table(self._metal_albedo, n_dot_v)
        share: np.ndarray = metal / np.maximum(self.specular_albedo(n_dot_v), 1e-6)
        return share

    def specular_radiance(self, ggx_terms: np.ndarray, n_dot_v: np.ndarray) -> np.ndarray:
        """Specular radiance (M, 3) of the area light.

        `ggx_terms` (M, 3) are those of `z2p_core.native.specular_radiance`: the radiance with F = 1, and the same
        weighted by the normalized Fresnel term of metal (Schlick's) and of the dielectric.
        """
        unweighted, by_metal, by_dielectric = ggx_terms[:, 0:1], ggx_terms[:, 1:2], ggx_terms[:, 2:3]
        metal = self.color * (unweighted - by_metal) + f90_from_f0(self.color) * by_metal
        dielectric = self._f0 * (unweighted - by_dielectric) + f90_from_f0(self._f0) * by_dielectric
        metal_gain, dielectric_gain = self._multiple_scattering_gain
        radiance: np.ndarray = self.metallic * metal * _interpolate_table(metal_gain, n_dot_v)
        return radiance + (1 - self.metallic) * dielectric * _interpolate_table(dielectric_gain, n_dot_v)

    @cached_property
    def _f0(self) -> np.ndarray:
        """Reflectance (1,) of the dielectric layer at normal incidence."""
        return np.array([F0_PER_SPECULAR_LEVEL * self.specular])

    @cached_property
    def _single_scattering(self) -> np.ndarray:
        """`directional_albedo_table` (C, 4) of this roughness."""
        return directional_albedo_table(round(self.roughness, 3), IOR)

    @cached_property
    def _multiple_scattering_gain(self) -> tuple[np.ndarray, np.ndarray]:
        """Factors of metal (C, 3) and the dielectric (C, 1) by which multiple scattering raises the single one.

        Kulla and Conty 2017; later bounces have the lobe of the first one, as in Cycles.
        """
        albedo = self._single_scattering.reshape(-1, 2, 2).sum(2)  # (C, 2) with F = 1
        mean_albedo = (2 * albedo * TABLE_COSINES[:, None]).mean(0)
        mean_fresnel = (_mean_schlick(self.color), _mean_schlick(self._f0))
        later = [f * kept / (1 - f * (1 - kept)) for f, kept in zip(mean_fresnel, mean_albedo, strict=True)]
        return 1 + later[0] * (1 / albedo[:, :1] - 1), 1 + later[1] * (1 / albedo[:, 1:] - 1)

    @cached_property
    def _metal_albedo(self) -> np.ndarray:
        """Directional albedo (C, 3) of metal."""
        once = self.color * self._single_scattering[:, :1] + f90_from_f0(self.color) * self._single_scattering[:, 1:2]
        return once * self._multiple_scattering_gain[0]

    @cached_property
    def _dielectric_albedo(self) -> np.ndarray:
        """Directional albedo (C, 1) of the dielectric layer."""
        once = self._f0 * self._single_scattering[:, 2:3] + f90_from_f0(self._f0) * self._single_scattering[:, 3:]
        return once * self._multiple_scattering_gain[1]


def f90_from_f0(f0: np.ndarray) -> np.ndarray:
    """Reflectance at grazing incidence of a surface with reflectance `f0` at normal incidence, same shape."""
    f90: np.ndarray = np.clip(F90_PER_F0 * f0, 0, 1)
    return f90


def _mean_schlick(f0: np.ndarray) -> np.ndarray:
    """Cosine-weighted mean of Schlick's Fresnel term over the hemisphere, same shape as `f0`."""
    return f0 + (f90_from_f0(f0) - f0) / 21


def _interpolate_table(table: np.ndarray, n_dot_v: np.ndarray) -> np.ndarray:
    """Entries (M, K) float32 of a table (C, K) at `TABLE_COSINES`, linearly interpolated at the cosines (M,)."""
    table = table.astype(np.float32)
    steps = np.diff(table, axis=0, append=table[-1:])
    position = np.clip(n_dot_v, 0, 1) * np.float32(len(TABLE_COSINES) - 1)
    entry = position.astype(np.intp)
    values: np.ndarray = table[entry] + (position - entry).astype(np.float32)[:, None] * steps[entry]
    return values
