"""The settings vector and the scene of several controls, which training and inference both build by one function."""

from __future__ import annotations

import ast
from pathlib import Path

import numpy as np
import pytest

from z2p_core import registry
from z2p_core.scene import SceneDescription
from z2p_core.settings import apply_controls, settings_vector

ROOT = Path(__file__).parents[2]
VALUES = {"elevation": (40.0,), "color": (0.1, 0.2, 0.3), "light": (3.75, 0.0, 75.0)}


def controls(*names: str) -> dict:
    return {name: registry.load("controls", name)() for name in names}


def test_the_vector_follows_the_order_of_the_controls() -> None:
    vector = settings_vector(VALUES, controls("color", "light", "elevation"))
    assert vector.dtype == np.float32
    assert np.allclose(vector, [0.1, 0.2, 0.3, 0.5, 0.5, 1.0, 0.5])
    assert np.allclose(settings_vector(VALUES, controls("elevation", "color")), [0.5, 0.1, 0.2, 0.3])


def test_no_control_gives_an_empty_vector() -> None:
    assert settings_vector({}, {}).shape == (0,)


def test_a_missing_value_is_an_error() -> None:
    for build in (lambda: settings_vector({}, controls("color")),
                  lambda: apply_controls({}, controls("color"), SceneDescription())):  # fmt: skip
        with pytest.raises(KeyError, match="color"):
            build()


def test_every_control_is_applied_in_order() -> None:
    scene, applied = SceneDescription(), controls("light", "elevation", "color")
    apply_controls(VALUES, applied, scene)
    assert (scene.light, scene.elevation) == ((3.75, 0.0, 75.0), 40.0)
    assert scene.material["Base Color"][3] == 1.0


def test_nothing_else_applies_controls() -> None:
    """Training and inference go through `z2p_core.settings`, so that no second order of the controls can come up."""
    sources = [path for room in ("pipeline", "workflows", "storage") for path in (ROOT / room).rglob("*.py")]
    assert len(sources) > 100
    for path in sources:
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Attribute) and node.attr == "apply":
                pytest.fail(f"{path.relative_to(ROOT)}:{node.lineno} applies a control; use z2p_core.settings")
