"""Weights of a tiny network with random numbers, small clouds and `z2p` itself: enough to run inference for real."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result


@pytest.fixture(scope="session")
def make_weights(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Path]:
    """Function that writes weights for the given controls and returns their file."""
    import torch

    from storage.checkpoints import save_weights
    from z2p_core import registry
    from z2p_core.config import NetworkConfig, to_dict
    from z2p_core.model import build_network

    def make(controls: tuple[str, ...] = ("color", "light", "elevation"), fixed_elevation: float | None = None) -> Path:
        zbuffer, gbuffer = registry.load("zbuffers", "splats"), registry.load("gbuffers", "surfels")
        encoder = registry.load("encoders", "fourier").create(np.random.default_rng(0))
        carried = [registry.load("controls", name)() for name in controls]
        config = NetworkConfig(widths=(16, 16), mapping=16)
        torch.manual_seed(0)
        settings = sum(control.size for control in carried)
        network = build_network(config, zbuffer.channels + gbuffer.channels, encoder.channels, settings)
        with torch.no_grad():
            for parameter in network.parameters():
                parameter.copy_(torch.randn_like(parameter) * 0.15)
        path = tmp_path_factory.mktemp("weights") / "tiny.safetensors"
        card = {
            "network": to_dict(config),
            "zbuffer": {"name": zbuffer.name, "version": zbuffer.version},
            "gbuffer": {"name": gbuffer.name, "version": gbuffer.version},
            "encoder": {"name": "fourier", "version": type(encoder).version, "state": encoder.state},
            "controls": [{"name": one.name, "version": one.version, "size": one.size} for one in carried],
            "resolution": [64],
            "fixed_elevation": fixed_elevation,
            "training": {},
        }
        save_weights(path, network.state_dict(), card)
        return path

    return make


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
    from pipeline.cli import main

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
