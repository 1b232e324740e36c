"""The last two convolutions of the fast network without an engine, for exports that end before them.

They have few channels of many pixels, which engines are slow with: a third of a picture's time, for a tenth of its
sums. `z2p_core.native.touched` does both in one go.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from z2p_core import native
from z2p_core.config import FINE_BLOCK, NetworkConfig


@dataclass(frozen=True)
class FinalConvs:
    """What `UnshuffleUNet.refine` of `z2p_core.network.unet` does to a picture that is still in cells of `cell` pixels a side.

    Its convolutions, packed for the kernel; and the stride of the network, which the sides of its input are multiples
    of.
    """

    look: native.Convolution
    touch: native.Convolution
    cell: int
    stride: int

    @classmethod
    def of(cls, tensors: Mapping[str, np.ndarray], config: NetworkConfig) -> FinalConvs | None:
        """That of a network's tensors, of float16 or float32; None where it has no such convolutions."""
        if config.kind != "unshuffle_unet" or not config.refine:
            return None
        spare = (0, -config.refine % native.GROUP)  # units that say nothing
        look = np.pad(tensors["look.weight"], (spare, (0, 0), (0, 0), (0, 0))), np.pad(tensors["look.bias"], spare)
        touch = np.pad(tensors["touch.weight"], ((0, 0), spare, (0, 0), (0, 0))), tensors["touch.bias"]
        cell = FINE_BLOCK if config.fine else config.unshuffle
        return cls(native.packed(*look), native.packed(*touch), cell, config.stride)

    def padded(self, buffers: np.ndarray) -> np.ndarray:
        """Buffers (B, C, H, W) with as many zeros to the right and below as the network wants."""
        height, width = buffers.shape[2:]
        below, right = -height % self.stride, -width % self.stride
        if not (below or right):
            return buffers
        return np.pad(buffers, ((0, 0), (0, 0), (0, below), (0, right)))

    def finish(self, cells: np.ndarray, buffers: np.ndarray) -> np.ndarray:
        """Pictures (B, 4, H, W) in [0, 1] from what the network drew (B, 4 cell^2, H / cell, W / cell) of buffers."""
        picture = np.empty((len(cells), 4, *buffers.shape[2:]), np.float32)
        for drawn, seen, out in zip(cells, buffers, picture, strict=True):
            native.touched(drawn, seen, self.cell, self.look, self.touch, out)
        return picture
