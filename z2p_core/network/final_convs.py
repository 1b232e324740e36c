"""The network's last two convolutions without an engine, for exported models that end before them.

They have few channels at full resolution, which engines are slow at: a third of an image's time for a tenth of its
arithmetic. One kernel of z2p's own does both (`z2p_core/native/c/image/final_convs.c`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from z2p_core import native
from z2p_core.config import FINE_BLOCK, NetworkConfig


@dataclass(frozen=True)
class FinalConvs:
    """What `UnshuffleUNet.refine` of `z2p_core.network.unet` does, for images that are still folded into cells."""

    conv_in: native.Convolution
    """Reads the image and the buffers; the layer `look` in the state dict, packed for the kernel."""
    conv_out: native.Convolution
    """Reads the positive part of that; its result is added to the image; the layer `touch`."""
    cell: int
    """Side of a cell in pixels."""
    stride: int
    """The network's stride, which the sides of its input are multiples of."""

    @classmethod
    def from_tensors(cls, tensors: Mapping[str, np.ndarray], config: NetworkConfig) -> FinalConvs | None:
        """The convolutions in a network's state dict, float16 or float32; None where the network has none."""
        if config.kind != "unshuffle_unet" or not config.refine:
            return None
        padding = (0, -config.refine % native.CHANNEL_GROUP)  # zero channels, to whole groups of the kernel
        conv_in = np.pad(tensors["look.weight"], (padding, *3 * [(0, 0)])), np.pad(tensors["look.bias"], padding)
        conv_out = np.pad(tensors["touch.weight"], ((0, 0), padding, (0, 0), (0, 0))), tensors["touch.bias"]
        cell = FINE_BLOCK if config.fine else config.unshuffle
        return cls(native.pack_convolution(*conv_in), native.pack_convolution(*conv_out), cell, config.stride)

    def padded(self, buffers: np.ndarray) -> np.ndarray:
        """Buffers (B, C, H, W), padded with zeros to the right and below to multiples of the network's stride."""
        height, width = buffers.shape[2:]
        below, right = -height % self.stride, -width % self.stride
        if not (below or right):
            return buffers
        return np.pad(buffers, ((0, 0), (0, 0), (0, below), (0, right)))

    def finish(self, cells: np.ndarray, buffers: np.ndarray) -> np.ndarray:
        """Images (B, 4, H, W) float32 in [0, 1], premultiplied sRGB and alpha.

        `cells` (B, 4 cell^2, H / cell, W / cell) is the output of the exported model for `buffers` (B, C, H, W).
        """
        images = np.empty((len(cells), 4, *buffers.shape[2:]), np.float32)
        for image_cells, image_buffers, image in zip(cells, buffers, images, strict=True):
            native.final_convs(image_cells, image_buffers, self.cell, self.conv_in, self.conv_out, image)
        return images
