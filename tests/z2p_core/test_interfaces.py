"""What plugin authors inherit: sliders that check themselves, and controls that parse, check, draw and encode."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from z2p_core.interfaces import Control, SettingError, Slider, Value
from z2p_core.scene import SceneDescription


class Wind(Control):
    name, version = "wind", "1"
    slider = Slider(("speed", "azimuth"), (0.0, -180.0), (40.0, 180.0), (5.0, 0.0), help="wind", unit="m/s, degrees")

    def apply(self, value: Value, scene: SceneDescription) -> None:
        scene.lift = value[0]


inside = st.tuples(st.floats(0, 40), st.floats(-180, 180))


@given(inside)
def test_every_value_inside_survives_its_text(value: Value) -> None:
    assert Wind().parse(",".join(map(repr, value))) == value
    assert Wind().check(value) == value


@given(inside, inside)
def test_encode_is_in_the_unit_range_and_keeps_order(value: Value, other: Value) -> None:
    encoded, other_encoded = Wind().encode(value), Wind().encode(other)
    assert len(encoded) == Wind().size == 2
    assert all(0 <= number <= 1 for number in encoded)
    for component in range(2):
        if value[component] < other[component]:
            assert encoded[component] <= other_encoded[component]


@given(st.integers(0, 2**32))
def test_draw_is_inside_and_comes_from_the_rng_alone(seed: int) -> None:
    value = Wind().draw(np.random.default_rng(seed))
    assert Wind().check(value) == value
    assert Wind().draw(np.random.default_rng(seed)) == value


@pytest.mark.parametrize("text", ["", "5", "5,0,0", "fast,0", "5;0", "5,", "0x5,0"])
def test_text_of_another_form_is_told_what_was_expected(text: str) -> None:
    with pytest.raises(SettingError, match="--wind: expected speed,azimuth as numbers, got"):
        Wind().parse(text)


@pytest.mark.parametrize("text", ["41,0", "-0.1,0", "nan,0", "inf,0"])
def test_a_number_outside_is_told_its_range(text: str) -> None:
    with pytest.raises(SettingError, match=r"--wind: speed is .*, expected 0 to 40 m/s"):
        Wind().parse(text)


def test_check_counts_components() -> None:
    with pytest.raises(SettingError, match="expected 2 numbers"):
        Wind().check((1.0,))


@pytest.mark.parametrize(
    ("low", "high", "default"),
    [((0.0,), (1.0,), (1.5,)), ((1.0,), (0.0,), (0.5,)), ((0.0,), (1.0,), (math.nan,)), ((0.0, 0.0), (1.0,), (0.5,))],
)
def test_an_impossible_slider_is_refused(low: Value, high: Value, default: Value) -> None:
    with pytest.raises(ValueError, match="slider"):
        Slider(("gloss",), low, high, default, help="")


def test_a_slider_without_components_is_refused() -> None:
    with pytest.raises(ValueError, match="slider"):
        Slider((), (), (), (), help="")


def test_a_control_without_apply_cannot_be_made() -> None:
    class Idle(Control):
        name, version, slider = "idle", "1", Wind.slider

    with pytest.raises(TypeError, match="apply"):
        Idle()  # type: ignore[abstract]


def test_a_scene_survives_json() -> None:
    scene = SceneDescription(elevation=33.0, light=(4.0, 1.0, 60.0), lift=0.2)
    scene.material = {"Base Color": (0.1, 0.2, 0.3, 1.0), "Metallic": 0.5}
    assert SceneDescription.from_json(json.loads(json.dumps(scene.to_json()))) == scene
    assert scene != SceneDescription()
