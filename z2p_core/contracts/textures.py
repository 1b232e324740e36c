"""Checks of `Texture` plugins."""

from __future__ import annotations

import numpy as np

from z2p_core.contracts.assertions import check_array, check_class, expect, same
from z2p_core.interfaces import Texture


def check_texture(texture_class: type[Texture]) -> None:
    """None when the class keeps what `Texture` promises: colors in [0, 1], by the place and the rng alone.

    Raises:
        AssertionError: it does not; the message says what was expected and what came.
    """
    check_class("textures", texture_class, Texture)
    texture, name = texture_class(), texture_class.name
    shortest, longest = texture.period
    expect(0 < shortest <= longest, f"{name}: expected 0 < shortest <= longest period, got {texture.period}")
    positions = _places_in_the_sphere(500)
    given = positions.copy()
    albedo = texture.albedo(positions, np.random.default_rng(1))
    check_array(albedo, (500, 3), np.float32, f"{name}: albedo")
    expect(bool(albedo.min() >= 0 and albedo.max() <= 1), f"{name}: expected colors in [0, 1]")
    same(texture_class().albedo(positions, np.random.default_rng(1)), albedo, f"{name}: the same rng, albedo")
    part = texture.albedo(positions[100:150], np.random.default_rng(1))
    same(part, albedo[100:150], f"{name}: some of the places alone, albedo")
    same(positions, given, f"{name}: the positions given to albedo")
    nowhere = texture.albedo(positions[:0], np.random.default_rng(1))
    check_array(nowhere, (0, 3), np.float32, f"{name}: no place, albedo")
    other = texture.albedo(positions, np.random.default_rng(2))
    expect(not np.array_equal(other, albedo), f"{name}: expected another texture from another rng, got the same one")


def _places_in_the_sphere(count: int) -> np.ndarray:
    """Positions (count, 3) float64 in the unit sphere."""
    rng = np.random.default_rng(0)
    directions = rng.normal(size=(count, 3))
    radii = rng.uniform(size=(count, 1)) ** (1 / 3)
    return radii * directions / np.linalg.norm(directions, axis=1, keepdims=True)
