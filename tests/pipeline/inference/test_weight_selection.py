"""z2p chooses among the weights it ships: by the controls asked for, and by the noise of each cloud."""

from pathlib import Path

import numpy as np
import pytest

from z2p_core.interfaces import SettingError
from z2p_renderer.pipeline.inference import weight_selection
from z2p_renderer.pipeline.inference.renderer import Renderer
from z2p_renderer.pipeline.inference.weight_selection import (
    DEFAULT_WEIGHTS,
    NOISY_CLOUD_WEIGHTS,
    AutoRenderer,
    load_renderer,
    select_renderer,
)
from z2p_renderer.storage.models.checkpoints import shipped_weights


def sphere_of(count: int, noise: float = 0.0) -> np.ndarray:
    rng = np.random.default_rng(0)
    points = rng.normal(size=(count, 3))
    points *= 0.9 / np.linalg.norm(points, axis=1, keepdims=True)
    return (points + rng.normal(0, noise or 1e-9, points.shape)).astype(np.float32)


def test_noisy_clouds_get_the_denoising_weights() -> None:
    renderer = load_renderer("auto", ())
    chosen, why = select_renderer(renderer, sphere_of(5000))
    assert chosen.weights["name"] == DEFAULT_WEIGHTS and not why
    chosen, why = select_renderer(renderer, sphere_of(5000, 0.012))
    assert chosen.weights["name"] == NOISY_CLOUD_WEIGHTS and "scatter" in why and NOISY_CLOUD_WEIGHTS in why
    assert select_renderer(renderer, sphere_of(5000, 0.02))[0] is chosen, "loaded once"


def test_a_choice_made_stays_made() -> None:
    chosen, _ = select_renderer(load_renderer("auto", ()), sphere_of(5000, 0.012))
    assert select_renderer(chosen, sphere_of(5000))[0] is chosen


def test_weights_that_were_named_are_taken_whatever_comes(tiny_weights: Path) -> None:
    renderer = load_renderer(tiny_weights, ("color",))
    assert not isinstance(renderer, AutoRenderer)
    assert select_renderer(renderer, sphere_of(5000, 0.02)) == (renderer, "")


def test_controls_choose_among_the_shipped_weights() -> None:
    assert isinstance(load_renderer("auto", {"color", "light", "elevation"}), AutoRenderer)
    if "material" in shipped_weights():
        assert load_renderer("auto", {"metallic"}).weights["name"] == "material"
    with pytest.raises(SettingError, match="no weights that come with z2p carry sparkle"):
        load_renderer("auto", {"color", "sparkle"})


def test_an_engine_starts_with_the_first_cloud_that_needs_it(monkeypatch: pytest.MonkeyPatch) -> None:
    started = []
    original = weight_selection.Renderer.__dict__["_engine"].func

    def counted(renderer: Renderer) -> object:
        started.append(renderer.weights["name"])
        return original(renderer)

    monkeypatch.setattr(weight_selection.Renderer.__dict__["_engine"], "func", counted)
    renderer = load_renderer("auto", ())
    assert started == []
    select_renderer(renderer, sphere_of(3000, 0.02))
    assert started == [NOISY_CLOUD_WEIGHTS]
    select_renderer(renderer, sphere_of(3000))
    assert started == [NOISY_CLOUD_WEIGHTS, DEFAULT_WEIGHTS]
