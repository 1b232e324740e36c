"""Textures: as many colors as they say, at the scale of their period, the same on a mesh and on its points."""

from __future__ import annotations

import numpy as np
import pytest

from z2p_core import registry
from z2p_renderer.pipeline.rendering.textures import SeededTexture, mesh_texture


def along_a_line(name: str, period: float, seed: int = 0) -> np.ndarray:
    """Colors (4000, 3) at even distances on a straight line of length 2 through the sphere."""
    texture = registry.load("textures", name)()
    texture.period = (period, period)
    direction = np.random.default_rng(seed).normal(size=3)
    line = np.linspace(-1, 1, 4000)[:, None] * direction / np.linalg.norm(direction)
    colors: np.ndarray = texture.albedo(line, np.random.default_rng(seed))
    return colors


@pytest.mark.slow
@pytest.mark.parametrize(("name", "most"), [("uniform", 1), ("stripes", 2), ("checks", 2), ("spots", 2), ("lines", 2),
                                            ("patches", 5)])  # fmt: skip
def test_patterns_have_as_many_colors_as_they_say(name: str, most: int) -> None:
    found = {len(np.unique(along_a_line(name, 0.15, seed), axis=0)) for seed in range(10)}
    assert max(found) <= most and (most == 1 or max(found) >= 2)


@pytest.mark.parametrize("name", ["stripes", "checks", "spots", "lines", "noise", "smooth"])
def test_a_shorter_period_has_more_changes(name: str) -> None:
    def changes(period: float) -> float:
        colors = np.array([along_a_line(name, period, seed) for seed in range(12)])
        return float(np.abs(np.diff(colors, axis=1)).sum())

    assert changes(0.1) > 2 * changes(0.4)


def test_two_colors_of_a_pattern_can_be_told_apart() -> None:
    for seed in range(20):
        colors = np.unique(along_a_line("stripes", 0.1, seed), axis=0)
        assert len(colors) == 2 and np.linalg.norm(colors[0] - colors[1]) > 0.1


def test_a_mesh_and_its_cloud_share_their_texture() -> None:
    texture = mesh_texture("stripes", "0123456789abcdef" * 4, 3)
    places = np.random.default_rng(0).uniform(-0.5, 0.5, (50, 3))
    read_back = SeededTexture.from_json(texture.to_json())
    np.testing.assert_array_equal(texture.albedo(places[::2]), read_back.albedo(places)[::2])


def test_textures_differ_by_mesh_seed_and_kind() -> None:
    kinds = [mesh_texture("stripes", "0" * 64, 0), mesh_texture("stripes", "1" * 64, 0),
             mesh_texture("stripes", "0" * 64, 1), mesh_texture("checks", "0" * 64, 0)]  # fmt: skip
    assert len({one.seed for one in kinds}) == 4


def test_a_texture_out_of_range_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    glaring = registry.load("textures", "smooth")
    monkeypatch.setattr(glaring, "albedo", lambda self, places, rng: np.full(places.shape, 2, np.float32))
    with pytest.raises(registry.PluginError, match="texture 'smooth': expected colors"):
        SeededTexture("smooth", (1,)).albedo(np.zeros((4, 3)))
