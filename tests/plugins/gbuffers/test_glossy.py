"""The glossy G-buffer: reflections lie where a mirror has them, and diffuse scenes are drawn as by `surfels`."""

from __future__ import annotations

import numpy as np
import pytest

from z2p_core.camera import Camera, light_position
from z2p_core.images import linear_from_srgb
from z2p_core.scene import SceneDescription
from z2p_core.shading.channels import NORMAL_XY, RADIANCE_RGB, GBufferChannel
from z2p_renderer.plugins.gbuffers.glossy import Glossy, lobe_sharpness
from z2p_renderer.plugins.gbuffers.surfels import Surfels

CAMERA = Camera(96, 96)
LIGHT = (3.6, -40.0, 50.0)
COVERAGE, RED = GBufferChannel.COVERAGE, GBufferChannel.RADIANCE_RED
NOT_RGB = [channel for channel in GBufferChannel if channel not in range(*RADIANCE_RGB.indices(len(GBufferChannel)))]


def ball(count: int, seed: int = 0) -> np.ndarray:
    points = np.random.default_rng(seed).normal(size=(count, 3))
    return (0.6 * points / np.linalg.norm(points, axis=1, keepdims=True)).astype(np.float32)


def scene(metallic: float, roughness: float, color: tuple[float, float, float] = (0.5, 0.2, 0.1)) -> SceneDescription:
    material = {"Base Color": (*color, 1.0), "Metallic": metallic, "Roughness": roughness, "Specular IOR Level": 0.5}
    return SceneDescription(light=LIGHT, material=material, floor=-0.6)


def drawn(metallic: float, roughness: float, color: tuple[float, float, float] = (0.5, 0.2, 0.1)) -> np.ndarray:
    """Linear radiance (3, H, W) of a ball in its material; nan off it."""
    picture = Glossy().draw(ball(6000), CAMERA, scene(metallic, roughness, color))
    return np.where(picture[COVERAGE] > 0.99, linear_from_srgb(picture[RADIANCE_RGB]), np.nan)


def test_a_diffuse_scene_is_drawn_as_by_surfels() -> None:
    cloud, plain = ball(2000), SceneDescription(material={"Base Color": (0.5, 0.2, 0.1, 1.0)})
    ours, theirs = (kind().draw(cloud, CAMERA, plain) for kind in (Glossy, Surfels))
    np.testing.assert_allclose(ours[NOT_RGB], theirs[NOT_RGB], atol=1e-5)
    np.testing.assert_allclose(ours[RADIANCE_RGB], theirs[RADIANCE_RGB], atol=4e-3)  # averaged before or after sRGB
    shining = Glossy().draw(cloud, CAMERA, scene(1.0, 0.2))
    diffuse = Surfels().draw(cloud, CAMERA, scene(1.0, 0.2))
    np.testing.assert_allclose(shining[NOT_RGB], diffuse[NOT_RGB], atol=1e-5)


def test_the_highlight_lies_where_a_ball_mirrors_the_light() -> None:
    picture = drawn(1.0, 0.15).sum(0)
    to_light, to_viewer = light_position(LIGHT), CAMERA.position
    halfway = to_light / np.linalg.norm(to_light) + to_viewer / np.linalg.norm(to_viewer)
    place = 0.6 * halfway / np.linalg.norm(halfway)
    (column, row), _ = (values[0] for values in CAMERA.project(place[None]))
    bright = np.argwhere(picture >= 0.9 * np.nanmax(picture)).mean(0) + 0.5
    assert np.hypot(*(bright - (row, column))) < 4, "pixels from where the mirror direction meets the light"


def test_a_highlight_smaller_than_the_spacing_is_as_bright() -> None:
    large, metal = Camera(256, 256), scene(1.0, 0.2, (0.03, 0.03, 0.03))
    brightest = [Glossy().draw(ball(count, seed), large, metal)[RED].max()
                 for count, seed in ((30_000, 0), (700, 1), (700, 2), (700, 3))]  # fmt: skip
    assert brightest[0] < 0.99, "else the test could not fail"
    assert min(brightest[1:]) > 0.95 * brightest[0]


def test_a_ridge_has_no_highlight_of_its_mean_normal() -> None:
    """Neither side of the roof mirrors the light to the viewer, but a surface with their mean normal would."""
    halfway = light_position(LIGHT) / np.linalg.norm(light_position(LIGHT)) + CAMERA.position / np.linalg.norm(
        CAMERA.position)  # fmt: skip
    halfway /= np.linalg.norm(halfway)
    along = np.cross(halfway, (0.0, 0.0, 1.0))
    along /= np.linalg.norm(along)
    across = np.cross(halfway, along)
    u, v = plate(12_000, 0).T
    roof = u[:, None] * along + v[:, None] * across - np.abs(v)[:, None] * halfway
    picture = Glossy().draw(roof.astype(np.float32), Camera(256, 256), scene(1.0, 0.2))
    sides = picture[RED][picture[COVERAGE] > 0.99]
    assert sides.max() < np.quantile(sides, 0.98) + 0.05


def test_roughness_blurs_the_highlight() -> None:
    sharp, blurred = (drawn(0.0, roughness, (0.02, 0.02, 0.02)).sum(0) for roughness in (0.15, 0.5))
    assert np.nanmax(sharp) > 2 * np.nanmax(blurred)
    spread = [np.sum(picture > 0.5 * np.nanmax(picture)) for picture in (sharp, blurred)]
    assert spread[1] > 2 * spread[0]


def test_metal_tints_its_reflections_and_plastic_does_not() -> None:
    red = (0.6, 0.05, 0.05)
    metal, plastic, diffuse = drawn(1.0, 0.25, red), drawn(0.0, 0.25, red), drawn(0.0, 1.0, red)
    specular = plastic - diffuse
    at = np.unravel_index(np.nanargmax(specular.sum(0)), specular.shape[1:])
    assert specular[1][at] > 0.6 * specular[0][at], "the highlight of plastic is white"
    assert np.nanmean(metal[1]) < 0.2 * np.nanmean(metal[0]), "that of metal has its colour"


def test_metal_reflects_floor_from_below_and_sky_from_above() -> None:
    picture = drawn(1.0, 0.1, (1.0, 1.0, 1.0)).mean(0)
    rows = [np.nanmedian(row) for row in picture if np.isfinite(row).any()]
    top, bottom = np.mean(rows[3:10]), np.mean(rows[-14:-4])
    assert top == pytest.approx(0.35, abs=0.1), "the sky's radiance"
    assert bottom > 1.4 * top


def plate(count: int, seed: int, half: float = 0.6) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-half, half, (count, 2)).astype(np.float32)


def test_only_smooth_metal_mirrors_walls_standing_on_it() -> None:
    """A wall of half-grey metal, mirrored in a floor of the same, sends what it mirrors itself: half as much."""
    flat, upright = plate(12_000, 0), plate(12_000, 1)
    ground = np.column_stack([flat, np.full(len(flat), -0.3)]).astype(np.float32)
    wall = np.column_stack([upright[:, 0], np.full(len(upright), 0.5), upright[:, 1] / 2]).astype(np.float32)
    both = np.concatenate([ground, wall])
    shares = []
    for roughness in (0.1, 0.9):
        alone, with_walls = (
            linear_from_srgb(Glossy().draw(cloud, CAMERA, scene(1.0, roughness, (0.5, 0.5, 0.5)))[RED])
            for cloud in (ground, both)
        )
        before = np.column_stack([np.linspace(-0.2, 0.2, 9), np.full(9, 0.25), np.full(9, -0.3)]).astype(np.float32)
        columns, rows = CAMERA.project(before)[0].T.astype(int)
        shares.append(np.median(with_walls[rows, columns]) / np.median(alone[rows, columns]))
    assert shares[0] < 0.65 and shares[1] > 0.8


def test_smooth_metal_mirrors_the_light_with_sharp_edges() -> None:
    """Few pixels have a brightness between the light's image and the sky's; of a blurred highlight most have."""
    shares = []
    for roughness in (0.05, 0.25):
        picture = Glossy().draw(ball(20_000), Camera(256, 256), scene(1.0, roughness, (0.03, 0.03, 0.03)))
        within = (picture[COVERAGE] > 0.99) & ((picture[NORMAL_XY] ** 2).sum(0) < 0.5)  # the rim reflects more
        shown = linear_from_srgb(picture[RED][within])
        brightest = np.quantile(shown, 0.999)
        assert brightest > 10 * 0.03 * 0.35, "the sky's radiance"
        between = (shown > 0.25 * brightest) & (shown < 0.75 * brightest)
        shares.append(between.sum() / (shown > 0.75 * brightest).sum())
    assert shares[0] < 0.5 < 1 < shares[1]


def test_lobe_sharpness_falls_with_roughness() -> None:
    sharpness = [lobe_sharpness(roughness) for roughness in (0.0, 0.2, 0.3, 0.5, 1.0)]
    assert sharpness == sorted(sharpness, reverse=True) and np.isfinite(sharpness).all()
    assert sharpness[-1] == pytest.approx(1)


@pytest.mark.parametrize("count", [0, 1, 2, 5])
def test_clouds_of_few_points_are_drawn(count: int) -> None:
    assert np.isfinite(Glossy().draw(ball(6)[:count], CAMERA, scene(1.0, 0.0))).all()
