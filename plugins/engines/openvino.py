"""OpenVINO: Intel's engine, quickest per picture, slower to start than onnxruntime. In float32, bfloat16 and 8 bits."""

from __future__ import annotations

import hashlib
import io
import threading
from typing import Any, ClassVar

import numpy as np

from z2p_core.interfaces import Engine, TrainedNetwork
from z2p_core.network.per_size_cache import cached_per_size
from z2p_core.parallel import core_count

STARTING = threading.Lock()
"""Held over OpenVINO's first question for a type, which fills a table: two threads that ask at once wait for ever."""


class OpenVino(Engine):
    """The exported network on the processor, float32."""

    name = "openvino"
    version = "1"
    package = "openvino"
    rank = 20
    precision: ClassVar[str] = "f32"

    def __init__(self, network: TrainedNetwork, threads: int | None = None) -> None:
        import openvino

        self._options: dict[str, object] = {
            "INFERENCE_PRECISION_HINT": self.precision, "PERFORMANCE_HINT": "LATENCY",
        }  # fmt: skip
        if threads is not None:  # one stream draws one picture after the other, so as many as the cores have room for
            streams = max(1, core_count() // threads)
            self._options |= {"NUM_STREAMS": streams, "INFERENCE_NUM_THREADS": streams * threads}
        with STARTING:
            openvino.Type.f32.to_dtype()
        self._core = openvino.Core()
        model = (network.int8 if self.reads_int8 else network.onnx) or b""
        self._read = lambda: self._core.read_model(model, b"")
        self._shelf = network.shelf
        able = sorted(self._core.get_property("CPU", "OPTIMIZATION_CAPABILITIES"))
        self._origin = [openvino.get_version(), *able, hashlib.sha256(model).hexdigest(), sorted(self._options.items())]
        self._reads = [one.get_any_name() for one in self._read().inputs]  # no encoding, where the network has none
        self._open = network.windows
        self._compiled = cached_per_size(self._compile)
        self._own = threading.local()  # a request serves one thread at a time

    def run(self, buffers: np.ndarray, encoding: np.ndarray, settings: np.ndarray) -> np.ndarray:
        available = {"buffers": buffers, "encoding": encoding, "settings": settings}
        inputs = {name: available[name] for name in self._reads}
        # sharing saves copies of 18 MB
        outputs = self._request(inputs).infer(inputs, share_inputs=True, share_outputs=True)
        picture: np.ndarray = outputs[0].copy()  # its memory belongs to the request
        return picture

    def _request(self, inputs: dict[str, np.ndarray]) -> Any:
        """This thread's own request to the network of that size, or of every size, where windows ask for ever new ones.

        A network of one size is a fifth quicker, but takes a third of a second to make.
        """
        shapes = {name: array.shape for name, array in inputs.items()}
        if self._open:
            shapes = {name: opened(shape) for name, shape in shapes.items()}
        compiled = self._compiled(tuple(shapes.items()))
        if getattr(self._own, "compiled", None) is not compiled:
            self._own.compiled, self._own.request = compiled, compiled.create_infer_request()
        return self._own.request

    def _compile(self, shapes: tuple[tuple[str, tuple[int, ...]], ...]) -> Any:
        """The network for inputs of those shapes, -1 for any length."""
        if self._shelf is None:
            return self._compiled_anew(shapes)
        key = repr((self._origin, shapes))
        kept = self._shelf.get(key)
        if kept is not None:
            try:
                return self._core.import_model(kept, "CPU", self._options)
            except RuntimeError:  # of another machine after all: made again
                pass
        compiled = self._compiled_anew(shapes)
        stream = io.BytesIO()
        compiled.export_model(stream)
        self._shelf.put(key, stream.getvalue())
        return compiled

    def _compiled_anew(self, shapes: tuple[tuple[str, tuple[int, ...]], ...]) -> Any:
        model = self._read()
        model.reshape(dict(shapes))
        return self._core.compile_model(model, "CPU", self._options)


def opened(shape: tuple[int, ...]) -> tuple[int, ...]:
    """The shape of a picture's input, (B, C, H, W) or (E, h, w), height and width left open; others as they are."""
    return (*shape[:-2], -1, -1) if len(shape) > 2 else shape


class OpenVinoBfloat16(OpenVino):
    """The exported network in bfloat16, where the processor has it (AVX512-BF16, AMX); float32 elsewhere."""

    name = "openvino-bf16"
    rank = 120
    exact = False
    precision = "bf16"


class OpenVinoInt8(OpenVinoBfloat16):
    """The exported network whose inner convolutions are in 8 bits, the rest in bfloat16 where there is that."""

    name = "openvino-int8"
    rank = 130
    reads_int8 = True
