"""A texture with the seed that makes it one: the same colors for a mesh and for every cloud on it."""

from __future__ import annotations

import zlib
from dataclasses import dataclass
from typing import Any

import numpy as np

from z2p_core import registry
from z2p_core.interfaces import Texture
from z2p_renderer.storage.results.fingerprints import plugin_fields


@dataclass(frozen=True)
class SeededTexture:
    """The name of a texture plugin, and the seed of its random numbers."""

    name: str
    seed: tuple[int, ...]

    def albedo(self, positions: np.ndarray) -> np.ndarray:
        """Linear base colors (N, 3) float32 in [0, 1] at positions (N, 3) in the unit sphere.

        Raises:
            PluginError: the texture is unknown or breaks its contract.
        """
        texture: Texture = registry.load("textures", self.name)()
        albedo = texture.albedo(positions, np.random.default_rng(self.seed))
        if albedo.shape != positions.shape or (len(albedo) and not (albedo.min() >= 0 and albedo.max() <= 1)):
            raise registry.PluginError(f"texture {self.name!r}: expected colors {positions.shape} in [0, 1], "
                                       f"got {albedo.shape}")  # fmt: skip
        return albedo.astype(np.float32)

    def fields(self) -> dict[str, Any]:
        """Fingerprint fields of what has its colors."""
        return {"plugin": plugin_fields(registry.load("textures", self.name)), "seed": list(self.seed)}

    def to_json(self) -> dict[str, Any]:
        """A JSON-able form, which `from_json` reads."""
        return {"name": self.name, "seed": list(self.seed)}

    @classmethod
    def from_json(cls, data: dict[str, Any]) -> SeededTexture:
        """The texture of a `to_json`."""
        return cls(str(data["name"]), tuple(data["seed"]))


def mesh_texture(name: str, identity: str, seed: int) -> SeededTexture:
    """The texture of a kind that the mesh with content digest `identity` (hex) has for a seed, in all of its views."""
    return SeededTexture(name, (seed, int(identity[:16], 16), zlib.crc32(name.encode())))
