"""What is timed: clouds of any size, weights, and the folder that they lie in."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from z2p_core import registry
from z2p_core.config import NetworkConfig, to_dict

CONTROLS = ("color", "light", "elevation")


def cloud_of(count: int) -> np.ndarray:
    """Points (count, 3) float32 on a lobed closed surface in the unit sphere; the same ones every time."""
    rng = np.random.default_rng(count)
    points = rng.standard_normal((count, 3), dtype=np.float32)
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    bumps = 0.8 + 0.2 * np.sin(5 * points[:, 0]) * np.cos(4 * points[:, 2])
    points *= bumps[:, None].astype(np.float32)
    return points


def random_weights(folder: Path) -> Path:
    """Weights of the shipped network's shape with random numbers: they take the same time as trained ones."""
    import torch

    from pipeline.export import export_onnx
    from storage.checkpoints import save_weights
    from z2p_core.model import build_network

    zbuffer, gbuffer = registry.load("zbuffers", "splats"), registry.load("gbuffers", "surfels")
    encoder = registry.load("encoders", "fourier").create(np.random.default_rng(0))
    controls = [registry.load("controls", name)() for name in CONTROLS]
    config, settings = NetworkConfig(), sum(control.size for control in controls)
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(0)
        network = build_network(config, zbuffer.channels + gbuffer.channels, encoder.channels, settings)
        with torch.no_grad():
            for parameter in network.parameters():
                parameter += 0.02 * torch.randn_like(parameter)
    card = {
        "network": to_dict(config),
        "zbuffer": {"name": zbuffer.name, "version": zbuffer.version},
        "gbuffer": {"name": gbuffer.name, "version": gbuffer.version},
        "encoder": {"name": encoder.name, "version": encoder.version, "state": encoder.state},
        "controls": [{"name": one.name, "version": one.version, "size": one.size} for one in controls],
        "resolution": [512], "fixed_elevation": None, "training": {},
    }  # fmt: skip
    path = folder / "random.safetensors"
    save_weights(path, network.state_dict(), card, half=True)
    export_onnx(path)
    return path
