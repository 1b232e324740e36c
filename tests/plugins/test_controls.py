"""What each built-in control does beyond the contract: its parsing, its draw, and what it writes into the scene."""

from __future__ import annotations

import math

import numpy as np
import pytest

from z2p_core import registry
from z2p_core.camera import light_position
from z2p_core.images import srgb_from_linear
from z2p_core.interfaces import Control, SettingError
from z2p_core.scene import SceneDescription


def load(name: str) -> Control:
    control: Control = registry.load("controls", name)()
    return control


def test_the_settings_vector_has_the_sizes_of_the_paper() -> None:
    size = {name: load(name).size for name in ("color", "light", "elevation", "metallic", "roughness")}
    assert size["color"] + size["light"] == 6
    assert size["color"] + size["light"] + size["metallic"] + size["roughness"] == 8
    assert sum(size.values()) == 9


@pytest.mark.parametrize("text", ["teal", "#008080", "0,0.50196078,0.50196078", "#007f80", "TEAL"])
def test_color_reads_names_hex_and_numbers_as_srgb(text: str) -> None:
    assert load("color").parse(text) == pytest.approx((0, 128 / 255, 128 / 255), abs=0.005)


@pytest.mark.parametrize("text", ["tael", "#12", "1,2", "0.5,0.5,1.1", "255,0,0", "red,green,blue"])
def test_color_refuses_with_a_message(text: str) -> None:
    with pytest.raises(SettingError, match="color"):
        load("color").parse(text)


def test_color_reaches_blender_in_linear_light() -> None:
    scene = SceneDescription()
    load("color").apply((0.5, 0.0, 1.0), scene)
    red, green, blue, alpha = np.array(scene.material["Base Color"])
    assert red == pytest.approx(0.21404, abs=1e-5)  # IEC 61966-2-1
    assert (green, blue, alpha) == (0, 1, 1)
    assert srgb_from_linear(red) == pytest.approx(0.5)


def test_random_lights_cover_the_range_before_the_object() -> None:
    light, rng = load("light"), np.random.default_rng(0)
    draws = np.array([light.draw(rng) for _ in range(2000)])
    low, high = np.array(light.slider.low), np.array(light.slider.high)
    spread = (draws - low) / (high - low)
    assert spread.min(0).max() < 0.01 and spread.max(0).min() > 0.99
    np.testing.assert_allclose(spread.mean(0), 0.5, atol=0.03)
    positions = np.array([light_position(tuple(draw)) for draw in draws])
    assert (positions[:, 1] <= 1e-9).all() and (positions[:, 2] > 1).all()


def test_light_and_elevation_are_written_as_given() -> None:
    scene = SceneDescription()
    load("light").apply((4.0, 30.0, 60.0), scene)
    load("elevation").apply((35.0,), scene)
    assert scene.light == (4.0, 30.0, 60.0)
    assert scene.elevation == 35.0
    assert scene.material == {}


def test_elevation_is_mostly_drawn_where_people_look_from() -> None:
    elevation, rng = load("elevation"), np.random.default_rng(0)
    draws = np.array([elevation.draw(rng)[0] for _ in range(2000)])
    # half of them in 10 to 35 on purpose, and of the other half 25/80 by chance
    assert ((draws >= 10) & (draws <= 35)).mean() == pytest.approx(0.5 + 0.5 * 25 / 80, abs=0.05)
    assert draws.max() > 70


@pytest.mark.parametrize(("name", "entry"), [("metallic", "Metallic"), ("roughness", "Roughness")])
def test_material_controls_set_principled_bsdf_inputs(name: str, entry: str) -> None:
    scene = SceneDescription()
    load(name).apply((0.7,), scene)
    assert scene.material == {entry: 0.7, "Specular IOR Level": 0.5}


@pytest.mark.parametrize("name", ["color", "light", "elevation", "metallic", "roughness"])
def test_the_range_is_encoded_between_0_and_1(name: str) -> None:
    control = load(name)
    assert control.encode(control.slider.low) == (0.0,) * control.size
    assert control.encode(control.slider.high) == (1.0,) * control.size


@pytest.mark.parametrize("number", [math.nan, math.inf, -0.001, 1.001])
def test_values_out_of_range_are_refused_with_the_range(number: float) -> None:
    with pytest.raises(SettingError, match=r"--metallic: metallic is .*expected 0 to 1"):
        load("metallic").check((number,))
