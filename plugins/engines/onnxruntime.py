"""onnxruntime: small, quick to start; comes with every z2p."""

from __future__ import annotations

import numpy as np

from z2p_core.interfaces import Engine, TrainedNetwork


class OnnxRuntime(Engine):
    """The exported network on the processor, float32."""

    name = "onnxruntime"
    version = "1"
    package = "onnxruntime"
    rank = 10

    def __init__(self, network: TrainedNetwork, threads: int | None = None) -> None:
        import onnxruntime

        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = threads or 0  # 0: as many as there are cores
        options.log_severity_level = 3
        self._session = onnxruntime.InferenceSession(network.onnx, options, providers=["CPUExecutionProvider"])

    def run(self, buffers: np.ndarray, encoding: np.ndarray, settings: np.ndarray) -> np.ndarray:
        picture: np.ndarray
        (picture,) = self._session.run(None, {"buffers": buffers, "encoding": encoding, "settings": settings})
        return picture
