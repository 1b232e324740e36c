"""The Principled BSDF conserves energy and matches known limits."""

from __future__ import annotations

import numpy as np
import pytest

from z2p_core.shading.microfacet import TABLE_COSINES, directional_albedo_table, fresnel_dielectric, normalized_fresnel
from z2p_core.shading.principled import Principled

FACING = np.linspace(0.05, 1, 20, dtype=np.float32)
ROUGHNESSES = (0.0, 0.05, 0.3, 0.6, 1.0)


def surface(color: float, metallic: float, roughness: float, specular: float = 0.5) -> Principled:
    return Principled(np.full(3, color, np.float32), metallic, specular, roughness)


@pytest.mark.parametrize("roughness", ROUGHNESSES)
def test_white_metal_reflects_all_light(roughness: float) -> None:
    np.testing.assert_allclose(surface(1.0, 1.0, roughness).specular_albedo(FACING), 1, atol=0.01)


@pytest.mark.parametrize("roughness", ROUGHNESSES)
def test_white_plastic_reflects_all_light(roughness: float) -> None:
    white = surface(1.0, 0.0, roughness)
    np.testing.assert_allclose(white.diffuse_albedo(FACING) + white.specular_albedo(FACING), 1, atol=1e-6)


@pytest.mark.parametrize("metallic", [0.0, 0.4, 1.0])
@pytest.mark.parametrize("roughness", ROUGHNESSES)
def test_no_surface_reflects_more_light_than_it_receives(metallic: float, roughness: float) -> None:
    for color in (0.0, 0.3, 0.9):
        one = surface(color, metallic, roughness)
        sent = one.diffuse_albedo(FACING) + one.specular_albedo(FACING)
        assert (sent >= 0).all() and (sent <= 1.01).all()
        assert (one.albedo >= color - 1e-6).all() and (one.albedo <= 1).all()


def test_smooth_plastic_follows_fresnel_and_metal_schlick() -> None:
    plastic = surface(0.0, 0.0, 0.0).specular_albedo(FACING)[:, 0]
    np.testing.assert_allclose(plastic[2:], fresnel_dielectric(FACING[2:], 1.5), rtol=0.05)
    metal = surface(0.4, 1.0, 0.0).specular_albedo(FACING)[:, 0]
    np.testing.assert_allclose(metal[2:], (0.4 + 0.6 * (1 - FACING) ** 5)[2:], rtol=0.03)


def test_without_specular_level_the_surface_is_diffuse() -> None:
    dull = surface(0.3, 0.0, 1.0, specular=0.0)
    assert dull.specular_albedo(FACING).max() == 0
    np.testing.assert_allclose(dull.diffuse_albedo(FACING), 0.3, atol=1e-6)
    np.testing.assert_allclose(dull.albedo, 0.3)


def test_specular_radiance_at_normal_incidence_is_f0() -> None:
    """For a mirrored radiance of 1, seen along the normal."""
    ahead, shine = np.ones(1, np.float32), np.array([[1.0, 0.0, 0.0]], np.float32)
    np.testing.assert_allclose(surface(0.3, 1.0, 0.0).specular_radiance(shine, ahead), 0.3, rtol=1e-3)
    np.testing.assert_allclose(surface(0.3, 0.0, 0.0).specular_radiance(shine, ahead), 0.04, rtol=1e-3)
    np.testing.assert_allclose(surface(0.3, 0.5, 0.0).specular_radiance(shine, ahead), 0.17, rtol=1e-3)
    grazing = np.array([[1.0, 1.0, 1.0]], np.float32)
    np.testing.assert_allclose(surface(0.3, 0.5, 0.0).specular_radiance(grazing, ahead), 1, rtol=1e-3)


def test_albedo_tables_match_known_limits() -> None:
    smooth, rough = directional_albedo_table(0.0, 1.5), directional_albedo_table(1.0, 1.5)
    np.testing.assert_allclose(smooth[5:, :2].sum(1), 1, atol=0.01)
    assert rough[-1, :2].sum() == pytest.approx(1 - np.log(2), abs=0.015), "the integral, by hand"
    assert (np.diff(rough[:, :2].sum(1)) < 0).all(), "rough surfaces mask less at grazing angles"
    np.testing.assert_allclose(smooth[8:, 3], normalized_fresnel(TABLE_COSINES[8:], 1.5), atol=0.01)
    assert normalized_fresnel(np.array([1.0, 0.0]), 1.5) == pytest.approx([0, 1], abs=1e-6)
