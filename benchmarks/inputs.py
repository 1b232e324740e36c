"""Inputs of the benchmarks: clouds of any size, an example mesh, and random weights."""

from __future__ import annotations

from pathlib import Path

import numpy as np

SHIPPED_WEIGHTS = "regular"
"""Name of the weights whose network is timed."""


def make_cloud(count: int) -> np.ndarray:
    """Points (count, 3) float32 on a lobed closed surface in the unit sphere; the same for the same count."""
    rng = np.random.default_rng(count)
    points = rng.standard_normal((count, 3), dtype=np.float32)
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    bumps = 0.8 + 0.2 * np.sin(5 * points[:, 0]) * np.cos(4 * points[:, 2])
    points *= bumps[:, None].astype(np.float32)
    return points


def write_example_mesh(folder: Path) -> Path:
    """Writes a built-in mesh into the folder; returns its path."""
    from z2p_renderer.pipeline.shapes import shape
    from z2p_renderer.storage.meshes import write_mesh

    path = folder / "torus_knot.ply"
    write_mesh(path, *shape("torus_knot"))
    return path


def random_weights(folder: Path) -> Path:
    """Writes random weights of the shipped network's shape, which take the same time as trained ones."""
    import torch

    from z2p_core.network.unet import build_network
    from z2p_renderer.pipeline.export import export_onnx
    from z2p_renderer.pipeline.inference.loading import load_plugins
    from z2p_renderer.storage.models.checkpoints import save_weights

    shipped = load_plugins(SHIPPED_WEIGHTS)
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(0)
        channels, settings = shipped.buffer_channels, shipped.settings
        network = build_network(shipped.config, channels, shipped.encoder.channels, settings)
        with torch.no_grad():
            for parameter in network.parameters():
                parameter += 0.02 * torch.randn_like(parameter)
    path = folder / "random.safetensors"
    save_weights(path, network.state_dict(), {**shipped.card, "training": {}}, half=True)
    export_onnx(path)
    return path
