"""From weights to the ONNX file beside them, for engines without torch: python -m pipeline.export WEIGHTS..."""

from __future__ import annotations

import io
import sys
import tempfile
import warnings
from pathlib import Path

import numpy as np

from pipeline.load import LoadedWeights, load_plugins
from storage.checkpoints import WeightsError, resolve
from storage.exports import save_onnx

OPSET = 17
TRACED = (2, 72, 104)
"""Batch, height and width that the network is traced at; batch, height and width of the model are free."""
SMALL = 256
"""Elements below which a constant stays as it is."""


def export_onnx(weights: Path) -> Path:
    """The ONNX file of a weights file, beside it: mapping, padding and statistics included, of any batch and size.

    Constants that float16 holds without loss are stored so, and widened when an engine loads them.

    Raises:
        WeightsError: they cannot be loaded.
        ImportError: torch, onnx or onnxruntime is not installed.
    """
    loaded = load_plugins(weights)
    return save_onnx(weights, loaded.weights.digest, _halved(_folded(_traced(loaded))))


def _traced(loaded: LoadedWeights) -> bytes:
    """The network as torch's tracing exporter writes it: its successor takes twenty times as long."""
    import torch

    network, (batch, height, width) = loaded.build(), TRACED
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
        warnings.simplefilter("ignore")  # on tracing, and on the exporter's age
        torch.onnx.export(
            network, inputs, written, input_names=list(axes), output_names=["picture"], opset_version=OPSET,
            dynamic_axes={**axes, "picture": {0: "batch", **sides}}, dynamo=False,
        )  # fmt: skip
    return written.getvalue()


def _folded(model: bytes) -> bytes:
    """The model with all constants folded, which saves every later start the work."""
    import onnxruntime

    with tempfile.TemporaryDirectory(prefix="z2p-export-") as folder:
        options = onnxruntime.SessionOptions()
        options.optimized_model_filepath = str(Path(folder) / "folded.onnx")
        options.graph_optimization_level = onnxruntime.GraphOptimizationLevel.ORT_ENABLE_BASIC  # standard operators
        options.intra_op_num_threads, options.log_severity_level = 1, 3
        onnxruntime.InferenceSession(model, options, providers=["CPUExecutionProvider"])
        return Path(options.optimized_model_filepath).read_bytes()


def _halved(model: bytes) -> bytes:
    """The model with its large constants as float16 where that loses nothing, each behind a cast to float32."""
    import onnx
    from onnx import numpy_helper

    parsed = onnx.load_from_string(model)
    casts = []
    for constant in parsed.graph.initializer:
        array = numpy_helper.to_array(constant)
        if array.dtype != np.float32 or array.size < SMALL:
            continue
        with np.errstate(over="ignore"):  # what is too large for float16 differs, and stays
            half = array.astype(np.float16)
        if np.array_equal(half.astype(np.float32), array):
            name = constant.name
            constant.CopyFrom(numpy_helper.from_array(half, f"{name}.half"))
            casts.append(onnx.helper.make_node("Cast", [f"{name}.half"], [name], to=onnx.TensorProto.FLOAT))
    nodes = [*casts, *parsed.graph.node]
    del parsed.graph.node[:]
    parsed.graph.node.extend(nodes)
    onnx.checker.check_model(parsed)
    written: bytes = parsed.SerializeToString()
    return written


if __name__ == "__main__":
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    for argument in sys.argv[1:]:
        try:
            print(export_onnx(resolve(argument)))
        except (WeightsError, ImportError) as error:
            sys.exit(f"Error: {error}")
