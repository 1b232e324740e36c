"""OpenVINO: Intel's engine, quickest per picture on its processors, slower to start than onnxruntime."""

from __future__ import annotations

import threading

import numpy as np

from z2p_core.interfaces import Engine, TrainedNetwork


class OpenVino(Engine):
    """The exported network on the processor, float32."""

    name = "openvino"
    version = "1"
    package = "openvino"
    rank = 20

    def __init__(self, network: TrainedNetwork, threads: int | None = None) -> None:
        import openvino

        options: dict[str, object] = {"INFERENCE_PRECISION_HINT": "f32", "PERFORMANCE_HINT": "LATENCY"}
        if threads is not None:
            options["INFERENCE_NUM_THREADS"] = threads
        core = openvino.Core()
        self._compiled = core.compile_model(core.read_model(network.onnx, b""), "CPU", options)
        self._own = threading.local()  # a request serves one thread at a time

    def run(self, buffers: np.ndarray, encoding: np.ndarray, settings: np.ndarray) -> np.ndarray:
        if not hasattr(self._own, "request"):
            self._own.request = self._compiled.create_infer_request()
        inputs = {"buffers": buffers, "encoding": encoding, "settings": settings}
        picture: np.ndarray = self._own.request.infer(inputs)["picture"].copy()  # its memory is the request's
        return picture
