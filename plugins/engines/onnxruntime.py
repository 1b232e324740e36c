"""onnxruntime: small, quick to start; comes with every z2p. In float32, and in 8 bits."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from z2p_core.interfaces import Engine, TrainedNetwork
from z2p_core.network.per_size_cache import cached_per_size
from z2p_core.network.telemetry import forbid_telemetry

CPU_INFO = Path("/proc/cpuinfo")
"""Linux's description of the processor, which lists its instruction sets."""
INT8_INSTRUCTIONS = "avx2"
"""The instruction set with fast sums of products of bytes."""
SIZE = ("batch", "height", "width")
"""Names of the dynamic dimensions in an exported network."""


class OnnxRuntime(Engine):
    """The exported network on the processor, float32."""

    name = "onnxruntime"
    version = "1"
    package = "onnxruntime"
    rank = 10

    def __init__(self, network: TrainedNetwork, threads: int | None = None) -> None:
        forbid_telemetry()
        import onnxruntime

        model = network.int8 if self.reads_int8 else network.onnx

        def start(size: tuple[int, ...]) -> Any:
            """A session for one image size, which runs a twelfth faster than one for all sizes, and starts sooner."""
            options = onnxruntime.SessionOptions()
            options.intra_op_num_threads = threads or 0  # 0: as many as there are cores
            options.log_severity_level = 3
            # Its threads would keep spinning after an image, on the cores that draw the buffers of the next one.
            options.add_session_config_entry("session.force_spinning_stop", "1")
            for name, value in zip(SIZE, size, strict=False):
                options.add_free_dimension_override_by_name(name, value)
            return onnxruntime.InferenceSession(model, options, providers=["CPUExecutionProvider"])

        self._session = cached_per_size(start)
        self._fixed = 1 if network.windows else len(SIZE)

    def run(self, buffers: np.ndarray, encoding: np.ndarray, settings: np.ndarray) -> np.ndarray:
        inputs = {"buffers": buffers, "encoding": encoding, "settings": settings}
        session = self._session((len(buffers), *buffers.shape[2:])[: self._fixed])  # a window's height and width vary
        read = {one.name for one in session.get_inputs()}  # no encoding, where the network has none
        picture: np.ndarray
        (picture,) = session.run(None, {name: inputs[name] for name in read})
        return picture


class OnnxRuntimeInt8(OnnxRuntime):
    """The exported network whose inner convolutions are in 8 bits, a quarter quicker; a third with VNNI.

    There, and wherever there is AVX2, it runs unasked: shipped weights only have an 8-bit form where that is as good as
    exact, and without VNNI, where large sums saturate, it is so as well.
    """

    name = "onnxruntime-int8"
    rank = 5
    reads_int8 = True
    exact = False

    @classmethod
    def unasked(cls) -> bool:
        return multiplies_bytes()


@lru_cache(maxsize=1)
def multiplies_bytes() -> bool:
    """Whether the processor computes fast with 8-bit integers; False if the operating system does not say."""
    try:
        description = CPU_INFO.read_text(encoding="ascii", errors="replace")
    except OSError:  # not Linux
        return False
    return INT8_INSTRUCTIONS in description.split()
