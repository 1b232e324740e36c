"""Views drawn for training and evaluation."""

from __future__ import annotations

import numpy as np
import pytest

from z2p_core.scene import SceneDescription
from z2p_renderer.pipeline.render import RenderSettings
from z2p_renderer.pipeline.rendering.views import load_controls, sample_view, view_rng

CONTROLS = load_controls(("color", "light", "elevation"))
IDENTITY = "ab" * 32


def test_view_depends_on_seed_mesh_and_index_alone() -> None:
    def view(seed: int, identity: str, index: int) -> str:
        return repr(sample_view(CONTROLS, view_rng(seed, identity, index), 0.5))

    first = view(0, IDENTITY, 7)
    assert first == view(0, IDENTITY, 7)
    assert len({first, view(1, IDENTITY, 7), view(0, "cd" * 32, 7), view(0, IDENTITY, 8)}) == 4


def test_upright_views_rotate_about_z_alone() -> None:
    for index in range(20):
        rotation = np.array(sample_view(CONTROLS, view_rng(0, IDENTITY, index), upright=1.0).scene.rotation)
        np.testing.assert_allclose(rotation[2], [0, 0, 1], atol=1e-12)
        np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
    tilts = [sample_view(CONTROLS, view_rng(0, IDENTITY, i), upright=0.0).scene.rotation[2][2] for i in range(200)]
    assert abs(float(np.mean(tilts))) < 0.15  # uniform over all rotations


def test_controls_reach_the_scene() -> None:
    view = sample_view(CONTROLS, view_rng(0, IDENTITY, 0), 0.5)
    assert view.scene.light == view.values["light"]
    assert view.scene.elevation == view.values["elevation"][0]
    assert set(view.scene.material) == {"Base Color"}  # the regular set stays plainly diffuse


def test_material_controls_bring_the_specular_lobe() -> None:
    controls = load_controls(("color", "light", "elevation", "metallic", "roughness"))
    material = sample_view(controls, view_rng(0, IDENTITY, 0), 0.5).scene.material
    assert material["Specular IOR Level"] == 0.5 and {"Metallic", "Roughness"} <= set(material)
    assert SceneDescription().material == {}


@pytest.mark.parametrize(("key", "value"), [("denoise", "best"), ("passes", ("albedo",))])
def test_unknown_render_settings_name_the_known_ones(key: str, value: object) -> None:
    with pytest.raises(ValueError, match=r"expected .*got"):
        RenderSettings(**{key: value})  # type: ignore[arg-type]
