"""Quicker forms of an exported network: the same one with less copying, and one that computes in 8 bits."""

from __future__ import annotations

import tempfile
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.halving import add_constant, constant_of, halved_constants, replace_nodes, widened
from z2p_core.telemetry import forbid_telemetry

Inputs = tuple[np.ndarray, np.ndarray, np.ndarray]
"""Buffers, encoding and settings as `z2p_core.interfaces.Engine.run` takes them."""

INPUTS = ("buffers", "encoding", "settings")
WHOLE = ("/stem", "/head", "/sharpen", "/look", "/touch")
"""Convolutions that stay in float32: they read and write the picture, where 8 bits show (SSIM 0.862 for 0.909)."""
STEM_PARTS = ("features", "traced")
"""What the stem's output is split into."""
PICTURE = 4
"""Channels of a picture, which come before the buffers."""
BLOCK = 2
"""Side of the blocks of pixels that a picture's last convolution writes; larger ones read too much around them."""
PERCENTILE = 99.999
"""Of an activation's values, how many the 8 bits reach."""


@dataclass(frozen=True)
class Part:
    """A convolution of several whose sum is wanted.

    What it reads, its kernel (O, I, k, k), bias (O,), stride, and how many zeros surround what it reads.
    """

    source: str
    kernel: np.ndarray
    bias: np.ndarray | None = None
    stride: int = 1
    border: int = 0


def streamlined(onnx: bytes, channels: int, cell: int) -> bytes:
    """The network with less copying: the same sums in another order.

    `channels` is how many the buffers have, `cell` the side of a pixel block. Blocks are read by strided convolutions,
    rather than folded into channels before one, which engines do on one core. Instead of convolutions whose input is
    joined or whose output is split there are two. And what has few channels to write is written in blocks of pixels.
    A network without a stem stays as it is.
    """
    from onnx import checker, load_from_string

    model = load_from_string(onnx)
    graph = model.graph
    stem, look = (_convolution(graph, f"{name}.weight") for name in ("stem", "look"))
    if stem is None:
        return onnx
    folded, padded, encoding = _sources(graph, stem)
    drawn = _strided_stem(graph, stem, padded, encoding, channels, cell)
    if look is not None:
        _split_input(graph, look)
    touch = _convolution(graph, "touch.weight")
    if touch is not None:
        _in_blocks(graph, touch)
    for node in graph.node:
        if node.op_type == "Shape" and node.input[0] == folded:
            node.input[0] = drawn  # as high and as wide
    replace_nodes(graph, list(graph.node))
    checker.check_model(model)
    written: bytes = model.SerializeToString()
    return written


def quantised(onnx: bytes, calibration: Iterable[Inputs]) -> bytes:
    """The network with its inner convolutions in 8 bits, activations scaled by what they are on those inputs.

    Weights stay the very float16 numbers of the weights file, and are rounded when an engine loads the model: so a
    graph file of it is small.
    """
    forbid_telemetry()
    from onnx import load_from_string
    from onnxruntime.quantization import CalibrationMethod, QuantFormat, QuantType, quantize_static

    graph = load_from_string(onnx).graph
    names = [node.name for node in graph.node if node.name.startswith(WHOLE)]
    read = [given.name for given in graph.input]  # no encoding, where the network has none
    with tempfile.TemporaryDirectory(prefix="z2p-quantise-") as folder:
        plain, done = Path(folder) / "plain.onnx", Path(folder) / "quantised.onnx"
        plain.write_bytes(widened(onnx))
        quantize_static(
            plain, done, _Reader(calibration, read), quant_format=QuantFormat.QDQ, op_types_to_quantize=["Conv"],
            per_channel=True, activation_type=QuantType.QUInt8, weight_type=QuantType.QInt8, nodes_to_exclude=names,
            calibrate_method=CalibrationMethod.Percentile,
            extra_options={"AddQDQPairToWeight": True, "CalibPercentile": PERCENTILE},
        )  # fmt: skip
        return halved_constants(done.read_bytes())


class _Reader:
    """Calibration inputs, one after the other, as onnxruntime asks for them."""

    def __init__(self, calibration: Iterable[Inputs], names: list[str]) -> None:
        self._left: Iterator[Inputs] = iter(calibration)
        self._names = names

    def get_next(self) -> dict[str, np.ndarray] | None:
        given = next(self._left, None)
        if given is None:
            return None
        return {name: array for name, array in zip(INPUTS, given, strict=True) if name in self._names}


def _convolution(graph: Any, weight: str) -> Any:
    """The convolution with that weight; None where there is none."""
    return next((node for node in graph.node if node.op_type == "Conv" and node.input[1] == weight), None)


def _strided_stem(graph: Any, stem: Any, padded: str, encoding: str | None, channels: int, cell: int) -> str:
    """Puts strided convolutions in the stem's place, for each part that its output is split into; one's output."""
    kernel, halved = constant_of(graph, "stem.weight")
    bias, _ = constant_of(graph, stem.input[2])
    split = next(node for node in graph.node if node.op_type == "Split" and node.input[0] == stem.output[0])
    graph.node.remove(split)
    graph.node.remove(stem)
    first, drawn = 0, ""
    for name, output, size in zip(STEM_PARTS, split.output, constant_of(graph, split.input[1])[0], strict=True):
        rows = slice(first, first + int(size))
        blocks, rest = np.split(kernel[rows], [channels * cell**2], axis=1)
        parts = {f"stem.{name}": Part(padded, blocks.reshape(-1, channels, cell, cell), bias[rows], cell)}
        if encoding is not None:
            parts[f"stem.{name}.encoding"] = Part(encoding, rest)
        drawn = _add_convolutions(graph, parts, output, halved)
        first = rows.stop
    return drawn


def _split_input(graph: Any, convolution: Any) -> None:
    """Puts a convolution for the picture and one for the buffers in the place of one of both, joined."""
    name = convolution.input[1].removesuffix(".weight")
    joined = next(node for node in graph.node if convolution.input[0] in node.output)
    kernel, halved = constant_of(graph, convolution.input[1])
    bias, _ = constant_of(graph, convolution.input[2])
    picture, buffers = np.split(kernel, [PICTURE], axis=1)
    seen, beside = joined.input
    border = kernel.shape[-1] // 2
    parts = {f"{name}.picture": Part(seen, picture, bias, border=border),
             f"{name}.buffers": Part(beside, buffers, border=border)}  # fmt: skip
    graph.node.remove(convolution)
    _add_convolutions(graph, parts, convolution.output[0], halved)


def _in_blocks(graph: Any, convolution: Any) -> None:
    """Puts a convolution that writes blocks of `BLOCK` pixels a side in the place of one with 3x3 weights.

    Engines compute sixteen channels at a time: four of each of four pixels, where there were but four.
    """
    from onnx import helper

    name = convolution.input[1].removesuffix(".weight")
    kernel, halved = constant_of(graph, convolution.input[1])
    bias, _ = constant_of(graph, convolution.input[2])
    (written, read), reach = kernel.shape[:2], kernel.shape[-1]
    wide = np.zeros((written, BLOCK, BLOCK, read, reach + BLOCK - 1, reach + BLOCK - 1), np.float32)
    for row, column in np.ndindex(BLOCK, BLOCK):
        wide[:, row, column, :, row : row + reach, column : column + reach] = kernel
    blocks = Part(convolution.input[0], wide.reshape(-1, read, *wide.shape[-2:]), np.repeat(bias, BLOCK**2), BLOCK,
                  border=reach // 2)  # fmt: skip
    graph.node.remove(convolution)
    drawn = _add_convolutions(graph, {f"{name}.blocks": blocks}, f"{name}.blocks.drawn", halved)
    graph.node.append(helper.make_node("DepthToSpace", [drawn], [convolution.output[0]], f"/{name}/DepthToSpace",
                                       blocksize=BLOCK, mode="CRD"))  # fmt: skip


def _add_convolutions(graph: Any, parts: dict[str, Part], output: str, halved: bool) -> str:
    """Adds a convolution for each part, by its name, and `output`, their sum; the first one's output."""
    from onnx import helper

    drawn = [f"{name}.drawn" for name in parts] if len(parts) > 1 else [output]
    for (name, part), writes in zip(parts.items(), drawn, strict=True):
        graph.node.extend(add_constant(graph, f"{name}.weight", part.kernel, halved))
        inputs = [part.source, f"{name}.weight"]
        if part.bias is not None:
            graph.node.extend(add_constant(graph, f"{name}.bias", part.bias, halved=False))
            inputs.append(f"{name}.bias")
        shape = {"kernel_shape": part.kernel.shape[2:], "strides": [part.stride] * 2, "pads": [part.border] * 4}
        graph.node.append(helper.make_node("Conv", inputs, [writes], f"/{name}/Conv", **shape))
    if len(parts) > 1:
        graph.node.append(helper.make_node("Sum", drawn, [output], f"/{next(iter(parts))}/Sum"))
    return drawn[0]


def _sources(graph: Any, stem: Any) -> tuple[str, str, str | None]:
    """Names of the picture folded into channels, of the padded one that it was made of, and of the encoding."""
    makers = {output: node for node in graph.node for output in node.output}
    joined = makers[stem.input[0]]
    folded, encoding = joined.input if joined.op_type == "Concat" else (stem.input[0], None)
    node = makers[folded]
    while node.op_type != "Pad":
        node = makers[node.input[0]]
    return folded, node.output[0], encoding
