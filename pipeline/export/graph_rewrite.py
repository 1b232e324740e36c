"""Faster forms of an exported network: an equivalent graph with less copying, and an int8 one.

Both end before the network's last convolutions, which `z2p_core.network.final_convs` computes faster than engines.
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
    replace_nodes,
    to_fp16_constants,
    to_fp32_constants,
)

EngineInputs = tuple[np.ndarray, np.ndarray, np.ndarray]
"""Buffers, encoding and settings as `z2p_core.interfaces.Engine.run` takes them."""

INPUT_NAMES = ("buffers", "encoding", "settings")
BLOCKS_OUTPUT = "cells"
"""Name of the output of a graph that ends before the last convolutions: blocks of pixels, folded into channels."""
FLOAT32_CONVOLUTIONS = ("/stem", "/head", "/sharpen")
"""Convolutions that stay float32: they read and write the image, where int8 is visible (SSIM 0.862 for 0.909)."""
STEM_OUTPUTS = ("features", "traced")
"""Names of the parts into which the network splits its stem's output."""
CALIBRATION_PERCENTILE = 99.999
"""Percentile of an activation's values that int8 covers."""


@dataclass(frozen=True)
class ConvolutionTerm:
    """One term of a sum of convolutions: its input's name, kernel (O, I, k, k), bias (O,) and stride."""

    source: str
    kernel: np.ndarray
    bias: np.ndarray | None = None
    stride: int = 1


def optimize_graph(onnx: bytes, channels: int, cell: int) -> bytes:
    """An equivalent network with less copying; the same sums in another order.

    `channels` is the number of buffers, `cell` the side of a pixel block. Strided convolutions read the blocks, instead
    of folding them into channels first, which engines do on one core. A convolution of joined inputs, or with a split
    output, becomes two. A network with final convolutions ends before them (`z2p_core.network.final_convs` computes
    them) and takes buffers that need no padding. A network without a stem is returned as it is.
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
            node.input[0] = drawn  # same height and width
    replace_nodes(graph, list(graph.node))
    checker.check_model(model)
    written: bytes = model.SerializeToString()
    return written


def quantize_int8(onnx: bytes, calibration: Iterable[EngineInputs]) -> bytes:
    """The network with its inner convolutions in int8, activations scaled by their range on the calibration inputs.

    Weights stay the float16 numbers of the weights file and are rounded when an engine loads the model, so that the
    difference to the float model is a small file.
    """
    forbid_telemetry()
    from onnx import load_from_string
    from onnxruntime.quantization import CalibrationMethod, QuantFormat, QuantType, quantize_static

    graph = load_from_string(onnx).graph
    excluded = [node.name for node in graph.node if node.name.startswith(FLOAT32_CONVOLUTIONS)]
    names_read = [given.name for given in graph.input]  # without "encoding" if the network has none
    with tempfile.TemporaryDirectory(prefix="z2p-quantise-") as folder:
        plain, quantized = Path(folder) / "plain.onnx", Path(folder) / "quantised.onnx"
        plain.write_bytes(to_fp32_constants(onnx))
        quantize_static(
            plain, quantized, _CalibrationReader(calibration, names_read),
            quant_format=QuantFormat.QDQ, op_types_to_quantize=["Conv"],
            per_channel=True, activation_type=QuantType.QUInt8, weight_type=QuantType.QInt8, nodes_to_exclude=excluded,
            calibrate_method=CalibrationMethod.Percentile,
            extra_options={"AddQDQPairToWeight": True, "CalibPercentile": CALIBRATION_PERCENTILE},
        )  # fmt: skip
        return to_fp16_constants(quantized.read_bytes())


class _CalibrationReader:
    """Hands calibration inputs to onnxruntime one by one."""

    def __init__(self, calibration: Iterable[EngineInputs], names: list[str]) -> None:
        self._remaining: Iterator[EngineInputs] = iter(calibration)
        self._names = names

    def get_next(self) -> dict[str, np.ndarray] | None:
        given = next(self._remaining, None)
        if given is None:
            return None
        return {name: array for name, array in zip(INPUT_NAMES, given, strict=True) if name in self._names}


def _find_convolution(graph: Any, weight: str) -> Any:
    """The convolution with that weight; None if there is none."""
    return next((node for node in graph.node if node.op_type == "Conv" and node.input[1] == weight), None)


def _replace_stem(graph: Any, stem: Any, padded: str, encoding: str | None, channels: int, cell: int) -> str:
    """Replaces the stem by strided convolutions, one set per part of its split output; returns one output's name."""
    kernel, is_fp16 = read_constant(graph, "stem.weight")
    bias, _ = read_constant(graph, stem.input[2])
    split = next(node for node in graph.node if node.op_type == "Split" and node.input[0] == stem.output[0])
    graph.node.remove(split)
    graph.node.remove(stem)
    first, drawn = 0, ""
    for name, output, size in zip(STEM_OUTPUTS, split.output, read_constant(graph, split.input[1])[0], strict=True):
        rows = slice(first, first + int(size))
        blocks, rest = np.split(kernel[rows], [channels * cell**2], axis=1)
        terms = {f"stem.{name}": ConvolutionTerm(padded, blocks.reshape(-1, channels, cell, cell), bias[rows], cell)}
        if encoding is not None:
            terms[f"stem.{name}.encoding"] = ConvolutionTerm(encoding, rest)
        drawn = _add_convolutions(graph, terms, output, is_fp16)
        first = rows.stop
    return drawn


def _end_with_blocks(graph: Any, look: Any, padded: str) -> None:
    """Ends the graph with the blocks that are unfolded into the image which convolution `look` reads.

    Buffers are read as given instead of padded.
    """
    from onnx import TensorProto, helper

    makers = {output: node for node in graph.node for output in node.output}
    image = makers[look.input[0]].input[0]
    for node in graph.node:
        for place, name in enumerate(node.input):
            node.input[place] = INPUT_NAMES[0] if name == padded else name
    del graph.output[:]
    sizes = ["batch", "channels", "rows", "columns"]
    graph.output.append(helper.make_tensor_value_info(BLOCKS_OUTPUT, TensorProto.FLOAT, sizes))
    graph.node.append(helper.make_node("Identity", [makers[image].input[0]], [BLOCKS_OUTPUT], "/cells"))


def _add_convolutions(graph: Any, terms: dict[str, ConvolutionTerm], output: str, is_fp16: bool) -> str:
    """Adds the convolutions `terms` (by name) and their sum `output`; returns the first one's output."""
    from onnx import helper

    drawn = [f"{name}.drawn" for name in terms] if len(terms) > 1 else [output]
    for (name, term), writes in zip(terms.items(), drawn, strict=True):
        graph.node.extend(add_constant(graph, f"{name}.weight", term.kernel, is_fp16))
        inputs = [term.source, f"{name}.weight"]
        if term.bias is not None:
            graph.node.extend(add_constant(graph, f"{name}.bias", term.bias, is_fp16=False))
            inputs.append(f"{name}.bias")
        shape = {"kernel_shape": term.kernel.shape[2:], "strides": [term.stride] * 2}
        graph.node.append(helper.make_node("Conv", inputs, [writes], f"/{name}/Conv", **shape))
    if len(terms) > 1:
        graph.node.append(helper.make_node("Sum", drawn, [output], f"/{next(iter(terms))}/Sum"))
    return drawn[0]


def _stem_sources(graph: Any, stem: Any) -> tuple[str, str, str | None]:
    """Names of the blocks folded into channels, of the padded buffers that they come from, and of the encoding."""
    makers = {output: node for node in graph.node for output in node.output}
    joined = makers[stem.input[0]]
    folded, encoding = joined.input if joined.op_type == "Concat" else (stem.input[0], None)
    node = makers[folded]
    while node.op_type != "Pad":
        node = makers[node.input[0]]
    return folded, node.output[0], encoding
