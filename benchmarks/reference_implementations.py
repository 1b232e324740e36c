"""Reference implementations to time z2p against: Eq. 1 as a double loop and as torch scatter; the paper's network."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import torch
import torch.nn.functional as F

from z2p_core.camera import Camera
from z2p_core.config import NetworkConfig
from z2p_core.network.unet import build_network
from z2p_core.splatting import INTENSITY_ALPHA, INTENSITY_BETA, SPLAT_WINDOW
from z2p_renderer.pipeline.inference.loading import load_plugins

PAPER_WIDTHS = (64, 128, 256, 512, 1024)
"""As in configs/paper.toml."""
PAPER_SETTINGS = 7


def double_loop(cloud: np.ndarray, camera: Camera) -> np.ndarray:
    """The paper's z-buffer (H, W), one point and one pixel of its window at a time."""
    image = np.zeros((camera.height, camera.width), np.float32)
    pixels, depths = camera.project(cloud)
    reach = SPLAT_WINDOW // 2
    for (x, y), depth in zip(pixels, depths, strict=True):
        value = math.exp(-(float(depth) - INTENSITY_ALPHA) / INTENSITY_BETA)
        for row in range(int(y) - reach, int(y) + reach + 1):
            for column in range(int(x) - reach, int(x) + reach + 1):
                if 0 <= row < camera.height and 0 <= column < camera.width and value > image[row, column]:
                    image[row, column] = value
    return image


def torch_scatter(cloud: np.ndarray, camera: Camera) -> torch.Tensor:
    """The same z-buffer (1, 1, H, W) by scattering the largest intensity, and a max-pool."""
    points = torch.from_numpy(cloud)
    rotation = torch.from_numpy(camera.rotation.astype(np.float32))
    in_camera = (points - torch.from_numpy(camera.position.astype(np.float32))) @ rotation.T
    depth = in_camera[:, 2]
    column = torch.floor(in_camera[:, 0] / depth * camera.focal + camera.width / 2).long()
    row = torch.floor(in_camera[:, 1] / depth * camera.focal + camera.height / 2).long()
    visible = (column >= 0) & (row >= 0) & (column < camera.width) & (row < camera.height) & (depth > 0)
    image = torch.zeros(camera.height * camera.width)
    value = torch.exp((INTENSITY_ALPHA - depth[visible]) / INTENSITY_BETA)
    image.scatter_reduce_(0, row[visible] * camera.width + column[visible], value, "amax")
    return F.max_pool2d(image.view(1, 1, camera.height, camera.width), SPLAT_WINDOW, 1, SPLAT_WINDOW // 2)


def paper_network(side: int) -> Callable[[], object]:
    """A call of the paper's U-Net, AdaIN everywhere at full resolution, on a square picture in torch float32."""
    config = NetworkConfig(kind="adain_unet", widths=PAPER_WIDTHS, unshuffle=1)
    network = build_network(config, 1, 40, PAPER_SETTINGS).eval()
    inputs = torch.rand(1, 1, side, side), torch.rand(40, side, side), torch.rand(1, PAPER_SETTINGS)

    def run() -> object:
        with torch.inference_mode():
            return network(*inputs)

    return run


def cuda_network(weights: Path, side: int, batch: int) -> tuple[Callable[[], object], float]:
    """A synchronous call of the network on the graphics card in float32, and its lower bound in milliseconds.

    The bound is the time to read all inputs and weights and to write all images once, at the card's copy bandwidth.
    """
    loaded = load_plugins(weights)
    network = loaded.build().cuda()
    cell = loaded.config.unshuffle
    shapes = (
        (batch, loaded.buffer_channels, side, side), (loaded.encoder.channels, side // cell, side // cell),
        (batch, loaded.settings),
    )  # fmt: skip
    inputs = [torch.rand(shape, device="cuda") for shape in shapes]

    def run() -> object:
        with torch.inference_mode():
            picture = network(*inputs)
        torch.cuda.synchronize()
        return picture

    bytes_moved = sum(tensor.nbytes for tensor in (*inputs, *network.parameters())) + 16 * batch * side * side
    return run, 1e3 * bytes_moved / _bandwidth()


def _bandwidth() -> float:
    """Bytes a second that the graphics card reads and writes while it copies."""
    source = torch.empty(1 << 28, dtype=torch.uint8, device="cuda")
    target, began, ended = torch.empty_like(source), *(torch.cuda.Event(enable_timing=True) for _ in range(2))
    target.copy_(source)
    began.record()
    for _ in range(10):
        target.copy_(source)
    ended.record()
    torch.cuda.synchronize()
    return 10 * 2 * source.nbytes / (began.elapsed_time(ended) / 1e3)
