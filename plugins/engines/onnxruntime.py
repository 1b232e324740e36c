"""onnxruntime: small, quick to start; comes with every z2p. In float32, and in 8 bits."""

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
        # Its threads would go on spinning after a picture, on the cores that draw the next one's buffers.
        options.add_session_config_entry("session.force_spinning_stop", "1")
        model = network.int8 if self.reads_int8 else network.onnx
        self._session = onnxruntime.InferenceSession(model, options, providers=["CPUExecutionProvider"])
        self._reads = {one.name for one in self._session.get_inputs()}  # no encoding, where the network has none

    def run(self, buffers: np.ndarray, encoding: np.ndarray, settings: np.ndarray) -> np.ndarray:
        inputs = {"buffers": buffers, "encoding": encoding, "settings": settings}
        picture: np.ndarray
        (picture,) = self._session.run(None, {name: inputs[name] for name in self._reads})
        return picture


class OnnxRuntimeInt8(OnnxRuntime):
    """The exported network whose inner convolutions are in 8 bits, twice as quick; on processors with VNNI."""

    name = "onnxruntime-int8"
    rank = 110
    reads_int8 = True
    exact = False
