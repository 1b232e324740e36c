"""onnxruntime: small, quick to start; comes with every z2p. In float32, and in 8 bits."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from z2p_core.interfaces import Engine, TrainedNetwork
from z2p_core.network.per_size_cache import cached_per_size
from z2p_core.network.telemetry import forbid_telemetry

CPU_FLAGS, AVX2 = Path("/proc/cpuinfo"), "avx2"
"""Where Linux says what a processor knows, and the name of the instructions that add up products of bytes."""
SIZE = ("batch", "height", "width")
"""What an export calls the sizes of its buffers."""


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
            """A session that knows its one size of picture is a twelfth quicker, and sooner there."""
            options = onnxruntime.SessionOptions()
            options.intra_op_num_threads = threads or 0  # 0: as many as there are cores
            options.log_severity_level = 3
            # Its threads would go on spinning after a picture, on the cores that draw the next one's buffers.
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
    """Whether the processor multiplies many bytes at a time; where nothing tells, it does not."""
    try:
        told = CPU_FLAGS.read_text(encoding="ascii", errors="replace")
    except OSError:  # not Linux
        return False
    return AVX2 in told.split()
