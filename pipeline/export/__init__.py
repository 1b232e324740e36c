"""Exports weights to an ONNX file beside them, for engines without torch.

``python -m z2p_renderer.pipeline.export WEIGHTS...``
"""

from __future__ import annotations

import importlib.util
import io
import tempfile
import warnings
from pathlib import Path

from z2p_core.errors.install_advice import install_advice
from z2p_core.network.telemetry import forbid_telemetry
from z2p_renderer.pipeline.export.fp16_constants import to_fp16_constants
from z2p_renderer.pipeline.inference.loading import LoadedWeights, load_plugins
from z2p_renderer.storage.models.onnx_files import save_onnx

OPSET = 17
TRACE_SHAPE = (2, 72, 104)
"""Batch, height and width at which the network is traced; the model takes any."""


def export_onnx(weights: Path) -> Path:
    """Writes the ONNX file of a weights file beside it: the whole network, for any batch and image size.

    Constants that float16 holds without loss are stored so; engines get them as float32.

    Raises:
        WeightsError: they cannot be loaded.
        ImportError: torch, onnx or onnxruntime is not installed.
    """
    loaded = load_plugins(weights)
    return save_onnx(weights, loaded.weights.digest, to_fp16_constants(_fold_constants(_trace_network(loaded))))


def check_exporter() -> None:
    """Raises if a library that `export_onnx` needs is missing; to be called before a long training.

    Raises:
        ImportError: onnx or onnxruntime is missing; the message says how to get it.
    """
    missing = [name for name in ("onnx", "onnxruntime") if importlib.util.find_spec(name) is None]
    if missing:
        raise ImportError(f"to export weights, {' and '.join(missing)} must be installed; {install_advice('pipeline')}")


def _trace_network(loaded: LoadedWeights) -> bytes:
    """ONNX model of the network by torch's tracing exporter, which is twenty times as fast as its successor."""
    import torch

    network, (batch, height, width) = loaded.build(), TRACE_SHAPE
    cell = loaded.config.unshuffle
    inputs = (
        torch.zeros(batch, loaded.buffer_channels, height, width),
        torch.zeros(loaded.encoder.channels, height // cell, width // cell),
        torch.zeros(batch, loaded.settings),
    )
    sides = {2: "height", 3: "width"}
    axes = {"buffers": {0: "batch", **sides}, "encoding": {1: "rows", 2: "columns"}, "settings": {0: "batch"}}
    written = io.BytesIO()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # about tracing, and that the exporter is deprecated
        torch.onnx.export(
            network, inputs, written, input_names=list(axes), output_names=["picture"], opset_version=OPSET,
            dynamic_axes={**axes, "picture": {0: "batch", **sides}}, dynamo=False,
        )  # fmt: skip
    return written.getvalue()


def _fold_constants(model: bytes) -> bytes:
    """The model with its constants folded, which makes every later start faster."""
    forbid_telemetry()
    import onnxruntime

    with tempfile.TemporaryDirectory(prefix="z2p-export-") as folder:
        options = onnxruntime.SessionOptions()
        options.optimized_model_filepath = str(Path(folder) / "folded.onnx")
        options.graph_optimization_level = onnxruntime.GraphOptimizationLevel.ORT_ENABLE_BASIC  # standard operators
        options.intra_op_num_threads, options.log_severity_level = 1, 3
        onnxruntime.InferenceSession(model, options, providers=["CPUExecutionProvider"])
        return Path(options.optimized_model_filepath).read_bytes()
