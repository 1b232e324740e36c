"""torch: what the network was trained with, the reference of the other engines, and the one that uses CUDA."""

from __future__ import annotations

import numpy as np

from z2p_core.interfaces import Engine, TrainedNetwork


class TorchEngine(Engine):
    """The network as it was trained, on the graphics card where there is one."""

    name = "torch"
    version = "1"
    package = "torch"
    rank = 30  # its import alone takes longer than all the rest of a picture
    reads_onnx = False

    def __init__(self, network: TrainedNetwork, threads: int | None = None) -> None:
        import torch

        if threads is not None:
            torch.set_num_threads(threads)
        self._device = torch.device("cuda" if torch.cuda.is_available() else "cpu")
        self._module = network.module().to(self._device)

    def run(self, buffers: np.ndarray, encoding: np.ndarray, settings: np.ndarray) -> np.ndarray:
        import torch

        with torch.inference_mode():
            inputs = (torch.from_numpy(array).to(self._device) for array in (buffers, encoding, settings))
            picture: np.ndarray = self._module(*inputs).cpu().numpy()
        return picture
