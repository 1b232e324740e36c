"""Weights of a tiny network with random numbers, small clouds and `z2p` itself: enough to run inference for real."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result


@pytest.fixture(scope="session")
def tiny_weights(make_weights: Callable[..., Path]) -> Path:
    """Weights that carry color, light and elevation."""
    return make_weights()


@pytest.fixture
def cloud() -> np.ndarray:
    """Points (400, 3) float64 on an ellipsoid, away from the origin."""
    points = np.random.default_rng(1).normal(size=(400, 3))
    return points / np.linalg.norm(points, axis=1, keepdims=True) * (1.0, 0.6, 0.8) + (3.0, 4.0, 5.0)


@pytest.fixture
def z2p() -> Callable[..., Result]:
    """Function that runs `z2p` with the given words."""
    from z2p_renderer.pipeline.cli import main

    return lambda *words: CliRunner().invoke(main, [str(word) for word in words])


@pytest.fixture
def render(z2p: Callable[..., Result], tiny_weights: Path, tmp_path: Path) -> Callable[..., Result]:
    """Function that runs `z2p run-inference` on small pictures with the tiny weights, into `tmp_path`/out."""

    def run(*words: object, output: Path = tmp_path / "out", weights: object = tiny_weights) -> Result:
        return z2p("run-inference", "--output", output, "--weights", weights, "--resolution", 32, *words)

    return run


@pytest.fixture
def scans(tmp_path: Path, cloud: np.ndarray) -> Path:
    """Folder with two good scans."""
    folder = tmp_path / "scans"
    folder.mkdir()
    np.save(folder / "one.npy", cloud)
    np.savetxt(folder / "two.xyz", cloud[:100])
    return folder
