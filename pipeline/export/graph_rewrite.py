"""Quicker forms of an exported network: the same one with less copying, and one that computes in 8 bits.

Both end before the network's last convolutions, which `z2p_core.network.final_convs` does quicker than engines.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from z2p_core.network.telemetry import forbid_telemetry
from z2p_renderer.pipeline.export.fp16_constants import (
    add_constant,
    read_constant,
    to_fp16_constants,
    replace_nodes,
    to_fp32_constants,
)

EngineInputs = tuple[np.ndarray, np.ndarray, np.ndarray]
"""Buffers, encoding and settings as `z2p_core.interfaces.Engine.run` takes them."""

INPUT_NAMES = ("buffers", "encoding", "settings")
BLOCKS_OUTPUT = "cells"
"""What the output is called of a network that ends before its last convolutions."""
FLOAT32_CONVOLUTIONS = ("/stem", "/head", "/sharpen")
"""Convolutions that stay in float32: they read and write the picture, where 8 bits show (SSIM 0.862 for 0.909)."""
STEM_OUTPUTS = ("features", "traced")
"""What the stem's output is split into."""
CALIBRATION_PERCENTILE = 99.999
"""Of an activation's values, how many the 8 bits reach."""


@dataclass(frozen=True)
class ConvolutionTerm:
    """A convolution of several whose sum is wanted.

    What it reads, its kernel (O, I, k, k), bias (O,) and stride.
    """

    source: str
    kernel: np.ndarray
    bias: np.ndarray | None = None
    stride: int = 1


def optimize_graph(onnx: bytes, channels: int, cell: int) -> bytes:
    """The network with less copying: the same sums in another order.

    `channels` is how many the buffers have, `cell` the side of a pixel block. Blocks are read by strided convolutions,
    rather than folded into channels before one, which engines do on one core. Instead of a convolution whose input is
    joined or whose output is split there are two. A network that goes over single pixels at the end gives its picture
    in cells, for that to be done by `z2p_core.network.final_convs`, and is given buffers that need no padding. One without a stem
    stays as it is.
    """
    from onnx import checker, load_from_string

    model = load_from_string(onnx)
    graph = model.graph
    stem, look = (_find_convolution(graph, f"{name}.weight") for name in ("stem", "look"))
    if stem is None:
        return onnx
    folded, padded, encoding = _stem_sources(graph, stem)
    drawn = _replace_stem(graph, stem, padded, encoding, channels, cell)
    if look is not None:
        _end_with_blocks(graph, look, padded)
    for node in graph.node:
        if node.op_type == "Shape" and node.input[0] == folded:
            node.input[0] = drawn  # as high and as wide
    replace_nodes(graph, list(graph.node))
    checker.check_model(model)
    written: bytes = model.SerializeToString()
    return written


def quantize_int8(onnx: bytes, calibration: Iterable[EngineInputs]) -> bytes:
    """The network with its inner convolutions in 8 bits, activations scaled by what they are on those inputs.

    Weights stay the very float16 numbers of the weights file, and are rounded when an engine loads the model: so a
    graph file of it is small.
    """
    forbid_telemetry()
    from onnx import load_from_string
    from onnxruntime.quantization import CalibrationMethod, QuantFormat, QuantType, quantize_static

    graph = load_from_string(onnx).graph
    names = [node.name for node in graph.node if node.name.startswith(FLOAT32_CONVOLUTIONS)]
    read = [given.name for given in graph.input]  # no encoding, where the network has none
    with tempfile.TemporaryDirectory(prefix="z2p-quantise-") as folder:
        plain, done = Path(folder) / "plain.onnx", Path(folder) / "quantised.onnx"
        plain.write_bytes(to_fp32_constants(onnx))
        quantize_static(
            plain, done, _CalibrationReader(calibration, read), quant_format=QuantFormat.QDQ, op_types_to_quantize=["Conv"],
            per_channel=True, activation_type=QuantType.QUInt8, weight_type=QuantType.QInt8, nodes_to_exclude=names,
            calibrate_method=CalibrationMethod.Percentile,
            extra_options={"AddQDQPairToWeight": True, "CalibPercentile": CALIBRATION_PERCENTILE},
        )  # fmt: skip
        return to_fp16_constants(done.read_bytes())


class _CalibrationReader:
    """Calibration inputs, one after the other, as onnxruntime asks for them."""

    def __init__(self, calibration: Iterable[EngineInputs], names: list[str]) -> None:
        self._left: Iterator[EngineInputs] = iter(calibration)
        self._names = names

    def get_next(self) -> dict[str, np.ndarray] | None:
        given = next(self._left, None)
        if given is None:
            return None
        return {name: array for name, array in zip(INPUT_NAMES, given, strict=True) if name in self._names}


def _find_convolution(graph: Any, weight: str) -> Any:
    """The convolution with that weight; None where there is none."""
    return next((node for node in graph.node if node.op_type == "Conv" and node.input[1] == weight), None)


def _replace_stem(graph: Any, stem: Any, padded: str, encoding: str | None, channels: int, cell: int) -> str:
    """Puts strided convolutions in the stem's place, for each part that its output is split into; one's output."""
    kernel, halved = read_constant(graph, "stem.weight")
    bias, _ = read_constant(graph, stem.input[2])
    split = next(node for node in graph.node if node.op_type == "Split" and node.input[0] == stem.output[0])
    graph.node.remove(split)
    graph.node.remove(stem)
    first, drawn = 0, ""
    for name, output, size in zip(STEM_OUTPUTS, split.output, read_constant(graph, split.input[1])[0], strict=True):
        rows = slice(first, first + int(size))
        blocks, rest = np.split(kernel[rows], [channels * cell**2], axis=1)
        parts = {f"stem.{name}": ConvolutionTerm(padded, blocks.reshape(-1, channels, cell, cell), bias[rows], cell)}
        if encoding is not None:
            parts[f"stem.{name}.encoding"] = ConvolutionTerm(encoding, rest)
        drawn = _add_convolutions(graph, parts, output, halved)
        first = rows.stop
    return drawn


def _end_with_blocks(graph: Any, look: Any, padded: str) -> None:
    """Ends the graph with the cells of pixels that make the picture at which that convolution looks.

    Buffers are read as they are given, where they were padded before.
    """
    from onnx import TensorProto, helper

    makers = {output: node for node in graph.node for output in node.output}
    picture = makers[look.input[0]].input[0]
    for node in graph.node:
        for place, name in enumerate(node.input):
            node.input[place] = INPUT_NAMES[0] if name == padded else name
    del graph.output[:]
    sizes = ["batch", "channels", "rows", "columns"]
    graph.output.append(helper.make_tensor_value_info(BLOCKS_OUTPUT, TensorProto.FLOAT, sizes))
    graph.node.append(helper.make_node("Identity", [makers[picture].input[0]], [BLOCKS_OUTPUT], "/cells"))


def _add_convolutions(graph: Any, parts: dict[str, ConvolutionTerm], output: str, halved: bool) -> str:
    """Adds a convolution for each part, by its name, and `output`, their sum; the first one's output."""
    from onnx import helper

    drawn = [f"{name}.drawn" for name in parts] if len(parts) > 1 else [output]
    for (name, part), writes in zip(parts.items(), drawn, strict=True):
        graph.node.extend(add_constant(graph, f"{name}.weight", part.kernel, halved))
        inputs = [part.source, f"{name}.weight"]
        if part.bias is not None:
            graph.node.extend(add_constant(graph, f"{name}.bias", part.bias, halved=False))
            inputs.append(f"{name}.bias")
        shape = {"kernel_shape": part.kernel.shape[2:], "strides": [part.stride] * 2}
        graph.node.append(helper.make_node("Conv", inputs, [writes], f"/{name}/Conv", **shape))
    if len(parts) > 1:
        graph.node.append(helper.make_node("Sum", drawn, [output], f"/{next(iter(parts))}/Sum"))
    return drawn[0]


def _stem_sources(graph: Any, stem: Any) -> tuple[str, str, str | None]:
    """Names of the picture folded into channels, of the padded one that it was made of, and of the encoding."""
    makers = {output: node for node in graph.node for output in node.output}
    joined = makers[stem.input[0]]
    folded, encoding = joined.input if joined.op_type == "Concat" else (stem.input[0], None)
    node = makers[folded]
    while node.op_type != "Pad":
        node = makers[node.input[0]]
    return folded, node.output[0], encoding
