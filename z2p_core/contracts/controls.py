"""Checks of `Control` plugins."""

from __future__ import annotations

import json

import numpy as np

from z2p_core.contracts.assertions import check_class, expect, plain_json, refuses
from z2p_core.interfaces import Control, SettingError, Value
from z2p_core.scene import SceneDescription

SAMPLED_VALUES = 50
"""How many random values a control is tried with."""


def check_control(control_class: type[Control]) -> None:
    """None when the class keeps what `Control` promises.

    Raises:
        AssertionError: it does not; the message says what was expected and what came.
    """
    check_class("controls", control_class, Control)
    control = control_class()
    slider = control.slider
    for component, low, high in zip(slider.components, slider.low, slider.high, strict=True):
        expect(low < high, f"{control.name}: {component} needs a range, got low {low} and high {high}")
    _accepts(control, slider.default, "its default")
    values = _check_draws(control)
    ends = [slider.low, slider.high, slider.default]
    encodings = {_check_encoding(control, value) for value in [*values, *ends]}
    expect(len(encodings) > 1, f"{control.name}: encode gives {encodings} for every value, so nothing is steered")
    _check_parse(control)
    scenes = [_check_apply(control, value) for value in [*values, *ends]]
    expect(any(scene != scenes[0] for scene in scenes), f"{control.name}: apply changes the scene for no value")


def _check_draws(control: Control) -> list[Value]:
    rng, twin = np.random.default_rng(7), np.random.default_rng(7)
    values = [control.draw(rng) for _ in range(SAMPLED_VALUES)]
    again = [control.draw(twin) for _ in range(SAMPLED_VALUES)]
    expect(values == again, f"{control.name}: draw gives other values for the same rng")
    expect(len(set(values)) > 1, f"{control.name}: draw gives {values[0]} every time")
    for value in values:
        _accepts(control, value, "its own draw")
        plain_json(value, f"{control.name}: draw")
    return values


def _check_encoding(control: Control, value: Value) -> tuple[float, ...]:
    encoding = tuple(control.encode(value))
    size = control.size
    expect(len(encoding) == size, f"{control.name}: size is {size}, but encode gives {encoding} for {value}")
    expect(bool(np.isfinite(encoding).all()), f"{control.name}: encode gives {encoding} for {value}")
    turned = control.mirrored(value)
    _accepts(control, turned, f"what mirrored gives for {value}")
    again = control.mirrored(turned)
    expect(bool(np.allclose(again, value)), f"{control.name}: mirrored twice gives {again} for {value}")
    return encoding


def _check_parse(control: Control) -> None:
    slider = control.slider
    text = ",".join(repr(float(number)) for number in slider.default)
    expect(control.parse(text) == slider.default, f"{control.name}: parse of its default {text!r} gives another value")
    for rubbish in ("", "rubbish!", ",".join(["nan"] * len(slider.components)), text + ",1,2,3,4"):
        refuses(lambda rubbish=rubbish: control.parse(rubbish), SettingError, f"{control.name}: parse of {rubbish!r}")
    for index, (low, high) in enumerate(zip(slider.low, slider.high, strict=True)):
        for outside in (low - 1.5 * (high - low), high + 1.5 * (high - low)):
            value = (*slider.default[:index], outside, *slider.default[index + 1 :])
            text = ",".join(map(repr, value))
            refuses(lambda text=text: control.parse(text), SettingError, f"{control.name}: parse of {text!r}")


def _check_apply(control: Control, value: Value) -> SceneDescription:
    scene, twin = SceneDescription(), SceneDescription()
    control.apply(value, scene)
    control.apply(value, twin)
    expect(scene == twin, f"{control.name}: apply of {value} to two equal scenes makes two different ones")
    written = json.loads(plain_json(scene.to_json(), f"{control.name}: the scene after apply"))
    expect(SceneDescription.from_json(written) == scene, f"{control.name}: the scene after apply is lost in JSON")
    return scene


def _accepts(control: Control, value: Value, which: str) -> None:
    try:
        control.check(value)
    except SettingError as error:
        raise AssertionError(f"{control.name}: {which} {value} is refused: {error}") from error
