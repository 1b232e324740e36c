"""Lossless float16 storage of an ONNX model's constants, which halves its file, and back to float32."""

from __future__ import annotations

from typing import Any

import numpy as np

MIN_FP16_ELEMENTS = 256
"""Smaller constants stay float32."""


def to_fp16_constants(onnx: bytes) -> bytes:
    """The model with its large constants as float16 where that is lossless, each with a cast to float32."""
    from onnx import checker, load_from_string, numpy_helper

    model = load_from_string(onnx)
    graph, nodes = model.graph, []
    for constant in list(graph.initializer):
        array = numpy_helper.to_array(constant)
        is_large = array.dtype == np.float32 and array.size >= MIN_FP16_ELEMENTS
        if is_large and np.array_equal(_fp16_round_trip(array), array):
            name = constant.name
            graph.initializer.remove(constant)
            nodes += add_constant(graph, name, array, is_fp16=True)
    replace_nodes(graph, [*nodes, *graph.node])
    checker.check_model(model)
    written: bytes = model.SerializeToString()
    return written


def to_fp32_constants(onnx: bytes) -> bytes:
    """The model with float32 constants in place of float16 ones and their casts."""
    from onnx import load_from_string, numpy_helper

    model = load_from_string(onnx)
    graph = model.graph
    stored = {constant.name: constant for constant in graph.initializer}
    casts = [node for node in graph.node if node.op_type == "Cast" and node.input[0] in stored]
    for cast in casts:
        constant = stored[cast.input[0]]
        constant.CopyFrom(numpy_helper.from_array(numpy_helper.to_array(constant).astype(np.float32), cast.output[0]))
    replace_nodes(graph, [node for node in graph.node if node not in casts])
    written: bytes = model.SerializeToString()
    return written


def read_constant(graph: Any, name: str) -> tuple[np.ndarray, bool]:
    """Constant `name` as a float32 array, and whether it is stored as float16."""
    from onnx import numpy_helper

    stored = {constant.name: constant for constant in graph.initializer}
    is_fp16 = f"{name}.half" in stored
    return numpy_helper.to_array(stored[f"{name}.half" if is_fp16 else name]).astype(np.float32), is_fp16


def add_constant(graph: Any, name: str, value: np.ndarray, is_fp16: bool) -> list[Any]:
    """Adds constant `name` to the graph; returns the cast node that a float16 one needs."""
    from onnx import TensorProto, helper, numpy_helper

    value = np.ascontiguousarray(value)
    if not is_fp16:
        graph.initializer.append(numpy_helper.from_array(value, name))
        return []
    graph.initializer.append(numpy_helper.from_array(value.astype(np.float16), f"{name}.half"))
    return [helper.make_node("Cast", [f"{name}.half"], [name], to=TensorProto.FLOAT)]


def replace_nodes(graph: Any, nodes: list[Any]) -> None:
    """Sets the graph's nodes, sorted topologically, without nodes and constants that no output depends on."""
    outputs, remaining = {output.name for output in graph.output}, list(nodes)
    while True:
        read = outputs | {name for node in remaining for name in node.input}
        used = [node for node in remaining if not read.isdisjoint(node.output)]
        if len(used) == len(remaining):
            break
        remaining = used
    known = {constant.name for constant in graph.initializer} | {given.name for given in graph.input} | {""}
    ordered: list[Any] = []
    while remaining:
        ready = [node for node in remaining if known.issuperset(node.input)]
        ordered += ready
        known.update(output for node in ready for output in node.output)
        remaining = [node for node in remaining if not known.issuperset(node.output)]
    constants = [constant for constant in graph.initializer if constant.name in read]
    for field, content in ((graph.node, ordered), (graph.initializer, constants)):
        del field[:]
        field.extend(content)


def _fp16_round_trip(array: np.ndarray) -> np.ndarray:
    """A float32 array rounded to float16 and back; values beyond float16's range become infinite."""
    with np.errstate(over="ignore"):
        return array.astype(np.float16).astype(np.float32)
