"""Pictures of balls: silhouettes, light and shadow of one, two and several."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from z2p_core.camera import DISTANCE, Camera, light_position
from z2p_core.camera_placement.placed_camera import ORTHOGRAPHIC_DISTANCE, PlacedCamera
from z2p_core.scene import AMBIENT, LIGHT_RADIANCE, LIGHT_SIDE, SceneDescription
from z2p_core.shading.balls import Balls, draw_balls, pixel_filter

WHITE = (0.8, 0.8, 0.8)
SIDE = 64


def balls(*centers: tuple[float, float, float], radius: float = 0.3, albedo: tuple[float, ...] = WHITE) -> Balls:
    count = len(centers)
    return Balls(np.array(centers, np.float32), np.full(count, radius, np.float32),
                 np.tile(np.float32(albedo), (count, 1)))  # fmt: skip


def draw(shown: Balls, floor: float | None = -1.0, elevation: float = 20.0, side: int = SIDE) -> np.ndarray:
    scene = SceneDescription(elevation=elevation, floor=floor)
    return draw_balls(shown, Camera(side, side, elevation), scene)


def pixel(place: tuple[float, float, float], elevation: float = 20.0, side: int = SIDE) -> tuple[int, int]:
    """Row and column of the pixel that shows a place."""
    [[x, y]], _ = Camera(side, side, elevation).project(np.array([place]))
    return int(y), int(x)


def test_a_ball_covers_the_disc_that_it_is_seen_as() -> None:
    image, camera = draw(balls((0, 0, 0)), floor=-50.0, elevation=0.0), Camera(SIDE, SIDE, 0.0)
    radius = camera.focal * 0.3 / math.sqrt(DISTANCE**2 - 0.3**2)
    assert image[3].sum() == pytest.approx(math.pi * radius**2, rel=0.01)


def test_a_ball_is_lit_as_the_light_falls_on_it() -> None:
    toward = light_position(SceneDescription().light)
    toward /= np.linalg.norm(toward)
    row, column = pixel(tuple(0.3 * toward))
    distance = np.linalg.norm(light_position(SceneDescription().light)) - 0.3
    direct = LIGHT_RADIANCE * LIGHT_SIDE**2 / distance**2 / math.pi
    shown = draw(balls((0, 0, 0)), floor=-50.0)[1, row, column]
    assert shown == pytest.approx(0.8 * (direct + AMBIENT), rel=0.06)  # an area light, and a floor far below


def test_the_side_towards_the_light_is_brighter() -> None:
    image = draw(balls((0, 0, 0)))
    lit, unlit = pixel((-0.2, -0.15, 0.12)), pixel((0.24, -0.15, -0.05))
    assert image[1][lit] > 1.5 * image[1][unlit]


def test_the_shadow_is_darkest_where_a_ball_touches_the_floor() -> None:
    alpha = draw(balls((0, 0, -0.7)))[3]
    contact, beside = pixel((0.33, -0.12, -1.0)), pixel((0.75, -0.1, -1.0))
    assert alpha[contact] > alpha[beside] + 0.1


def test_two_balls_lend_each_other_their_color() -> None:
    pair = balls((-0.3, 0, 0), (0.3, 0, 0))
    red_beside = replace(pair, albedo=np.array([WHITE, (0.9, 0.05, 0.05)], np.float32))
    row, column = pixel((-0.06, -0.18, 0.0))
    neutral, tinted = draw(pair)[:3, row, column], draw(red_beside)[:3, row, column]
    assert tinted[0] / tinted[2] > 1.05 * neutral[0] / neutral[2]


def test_a_ball_in_front_hides_one_behind() -> None:
    pair = balls((0, -0.5, 0), (0, 0.5, 0), radius=0.2)
    shown = replace(pair, albedo=np.array([(0, 0, 0.8), (0.8, 0, 0)], np.float32))
    red, _, blue = draw(shown, elevation=0.0)[:3, SIDE // 2, SIDE // 2]
    assert red == 0 and blue > 0


def test_the_order_of_balls_does_not_matter() -> None:
    rng = np.random.default_rng(0)
    centers = rng.uniform(-0.5, 0.5, (200, 3))
    shown = Balls(centers.astype(np.float32), rng.uniform(0.02, 0.1, 200).astype(np.float32),
                  rng.uniform(0, 1, (200, 3)).astype(np.float32))  # fmt: skip
    order = rng.permutation(200)
    other = Balls(shown.centers[order], shown.radii[order], shown.albedo[order])
    assert np.array_equal(draw(shown), draw(other))


def test_each_ball_has_its_own_radius() -> None:
    shown = replace(balls((-0.4, 0, 0), (0.4, 0, 0)), radii=np.array([0.1, 0.3], np.float32))
    alpha = draw(shown, floor=-50.0, elevation=0.0)[3]
    assert alpha[:, SIDE // 2 :].sum() == pytest.approx(9 * alpha[:, : SIDE // 2].sum(), rel=0.12)


def test_unlit_colors_stay_as_they_are() -> None:
    image = draw(replace(balls((0, 0, 0), albedo=(0.2, 0.4, 0.6)), relight=0.0))
    assert image[:3, SIDE // 2, SIDE // 2] == pytest.approx([0.2, 0.4, 0.6], rel=1e-4)


def test_the_floor_touches_the_lowest_ball_where_none_is_given() -> None:
    shown = balls((0, 0, -0.2))
    assert np.array_equal(draw(shown, floor=None), draw(shown, floor=-0.5))


def test_balls_around_the_camera_are_left_out() -> None:
    behind = balls((0, 0, 0), (0, -2 * DISTANCE, 0), tuple(Camera(SIDE, SIDE).position))
    assert np.isfinite(draw(behind)).all()


@pytest.mark.parametrize("samples", [3, 4])
def test_a_pixel_counts_its_samples_once(samples: int) -> None:
    weights = pixel_filter(samples)
    assert weights.sum() == pytest.approx(1)
    assert weights == pytest.approx(weights[::-1])


def test_parallel_rays_show_a_ball_at_its_scale_wherever_it_is() -> None:
    pixels_per_unit, shown = 40.0, balls((0.5, 0, 0), (0.5, 1.5, 0), radius=0.25)
    camera = PlacedCamera(SIDE, SIDE, 0.0, (pixels_per_unit,) * 2, (SIDE / 2, SIDE / 2),
                          station=(0.0, -ORTHOGRAPHIC_DISTANCE, 0.0), parallel=True)  # fmt: skip
    alpha = draw_balls(shown, camera, SceneDescription(floor=-50.0))[3]
    assert alpha.sum() == pytest.approx(math.pi * (0.25 * pixels_per_unit) ** 2, rel=0.02)
    assert (alpha * np.arange(SIDE)).sum() / alpha.sum() == pytest.approx(SIDE / 2 + 20 - 0.5, abs=0.3)


def test_oblong_pixels_and_a_shifted_center_change_where_balls_are_seen() -> None:
    usual = Camera(SIDE, SIDE, 0.0)
    camera = PlacedCamera(SIDE, SIDE, 0.0, (usual.focal, 2 * usual.focal), (20.0, SIDE / 2))
    shown = balls((0, 0, 0), radius=0.2)
    alpha = draw_balls(shown, camera, SceneDescription(floor=-50.0))[3]
    before = draw_balls(shown, usual, SceneDescription(floor=-50.0))[3]
    assert alpha.sum() == pytest.approx(2 * before.sum(), rel=0.02)
    assert (alpha * np.arange(SIDE)).sum() / alpha.sum() == pytest.approx(19.5, abs=0.2)
