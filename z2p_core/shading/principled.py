"""What a surface of Blender's Principled BSDF sends back of light: a matt part under plastic's reflection, and metal's.

C cosines of a table, M places, seen at angles to their normals whose cosines are `facing` (M,).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from z2p_core.shading.microfacet import TABLE_COSINES, directional_albedo_table

F0_PER_SPECULAR_LEVEL = 0.08
"""What a dielectric reflects straight back, for each unit of "Specular IOR Level"."""
IOR = 1.5
"""Of refraction, Blender's own: with it that level is 0.5."""
F90_PER_F0 = 50.0
"""What reflects less than one part of these straight back reflects less than all at a grazing angle, too."""


@dataclass(frozen=True)
class Principled:
    """A material by its inputs in Blender: base colour (3,) linear, metallic, specular level and roughness."""

    color: np.ndarray
    metallic: float
    specular: float
    roughness: float

    @property
    def albedo(self) -> np.ndarray:
        """About all that is sent back (3,), by the matt part and by reflection together."""
        return np.minimum(self.color + self._head_on * (1 - self.metallic), 1)

    def matt(self, facing: np.ndarray) -> np.ndarray:
        """Albedo (M, 3) of the matt part, which gets what plastic's reflection leaves."""
        return self.color * (1 - self.metallic) * (1 - _interpolate_table(self._plastic, facing))

    def reflectance(self, facing: np.ndarray) -> np.ndarray:
        """Share (M, 3) of light from all around that is reflected to a viewer."""
        return _interpolate_table(self.metallic * self._metal + (1 - self.metallic) * self._plastic, facing)

    def gloss(self, shine: np.ndarray, facing: np.ndarray) -> np.ndarray:
        """Radiance (M, 3) of a lamp in it, of what `native.gloss` says of mirrors (M, 3) in its place."""
        mirrored, by_metal, by_plastic = shine[:, 0:1], shine[:, 1:2], shine[:, 2:3]
        metal = self.color * (mirrored - by_metal) + f90_from_f0(self.color) * by_metal
        plastic = self._head_on * (mirrored - by_plastic) + f90_from_f0(self._head_on) * by_plastic
        more_metal, more_plastic = self._more
        radiance: np.ndarray = self.metallic * metal * _interpolate_table(more_metal, facing)
        return radiance + (1 - self.metallic) * plastic * _interpolate_table(more_plastic, facing)

    @cached_property
    def _head_on(self) -> np.ndarray:
        """What plastic reflects straight back (1,)."""
        return np.array([F0_PER_SPECULAR_LEVEL * self.specular])

    @cached_property
    def _shares(self) -> np.ndarray:
        return directional_albedo_table(round(self.roughness, 3), IOR)

    @cached_property
    def _more(self) -> tuple[np.ndarray, np.ndarray]:
        """How much more metal (C, 3) and plastic (C, 1) reflect, as light goes on in them from hill to hill.

        Kulla and Conty, Revisiting Physically Based Shading at Imageworks, 2017, with the lobe of the first bounce for
        all later ones, as Cycles has it.
        """
        sent = self._shares.reshape(-1, 2, 2).sum(2)  # of a mirror's (C, 2), by its hills; the mean over all views
        mean = (2 * sent * TABLE_COSINES[:, None]).mean(0)
        once = (_mean_schlick(self.color), _mean_schlick(self._head_on))
        later = [share * kept / (1 - share * (1 - kept)) for share, kept in zip(once, mean, strict=True)]
        return 1 + later[0] * (1 / sent[:, :1] - 1), 1 + later[1] * (1 / sent[:, 1:] - 1)

    @cached_property
    def _metal(self) -> np.ndarray:
        """What metal reflects of light from all around, (C, 3)."""
        once = self.color * self._shares[:, :1] + f90_from_f0(self.color) * self._shares[:, 1:2]
        return once * self._more[0]

    @cached_property
    def _plastic(self) -> np.ndarray:
        """What plastic does, (C, 1)."""
        once = self._head_on * self._shares[:, 2:3] + f90_from_f0(self._head_on) * self._shares[:, 3:]
        return once * self._more[1]


def f90_from_f0(head_on: np.ndarray) -> np.ndarray:
    """What one that reflects so much straight back reflects at a grazing angle: all, unless it hardly does."""
    share: np.ndarray = np.clip(F90_PER_F0 * head_on, 0, 1)
    return share


def _mean_schlick(head_on: np.ndarray) -> np.ndarray:
    """What one that reflects so much straight back reflects of light from everywhere, by Schlick's fifth power."""
    return head_on + (f90_from_f0(head_on) - head_on) / 21


def _interpolate_table(table: np.ndarray, facing: np.ndarray) -> np.ndarray:
    """What a table (C, K) at `TABLE_COSINES` says at cosines (M,): (M, K) float32."""
    table = table.astype(np.float32)
    steps = np.diff(table, axis=0, append=table[-1:])
    place = np.clip(facing, 0, 1) * np.float32(len(TABLE_COSINES) - 1)
    at = place.astype(np.intp)
    told: np.ndarray = table[at] + (place - at).astype(np.float32)[:, None] * steps[at]
    return told
