"""Quicker forms of an export: less copying is the same network, and 8 bits are nearly that."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import onnxruntime
import pytest

from z2p_core.contracts.engines import INEXACT_TOLERANCE
from z2p_core.network.final_convs import FinalConvs
from z2p_renderer.pipeline.export import export_onnx
from z2p_renderer.pipeline.export.calibration import calibration_inputs
from z2p_renderer.pipeline.export.graph_rewrite import INPUT_NAMES, EngineInputs, optimize_graph, quantize_int8
from z2p_renderer.pipeline.inference.renderer import Renderer
from z2p_renderer.storage.models.checkpoints import load_weights, save_weights
from z2p_renderer.storage.models.onnx_deltas import INT8, graph_path, load_graph, save_graph

FORMS: dict[str, dict[str, Any]] = {
    "unshuffle": {"widths": (16, 16, 24), "mapping": 24},
    "cells of three": {"widths": (16, 24), "mapping": 16, "unshuffle": 3, "fine": 0},
    "no single pixels": {"widths": (16, 24), "mapping": 16, "fine": 8, "refine": 0},
    "cells of two": {"widths": (16, 24), "mapping": 16, "unshuffle": 2},
    "single pixels": {"widths": (16, 24), "mapping": 16, "fine": 0, "refine": 8, "zbuffer": "splats"},
    "blocks, then pixels": {"widths": (16, 24), "mapping": 16, "fine": 8, "refine": 6},
    "encoding": {"widths": (16, 24), "mapping": 16, "encoder": "fourier"},
    "one setting": {"widths": (16, 16), "controls": ("light",), "fixed_elevation": 20.0},
}


def halved(file: Path) -> Path:
    """The weights again, as they are shipped."""
    weights = load_weights(file)
    half = file.with_name("half.safetensors")
    save_weights(half, weights.tensors, weights.card, half=True)
    return half


def drawn(model: bytes, inputs: EngineInputs) -> np.ndarray:
    session = onnxruntime.InferenceSession(model, providers=["CPUExecutionProvider"])
    read = {one.name for one in session.get_inputs()}
    given = {name: array for name, array in zip(INPUT_NAMES, inputs, strict=True) if name in read}
    picture: np.ndarray = session.run(None, given)[0]
    return picture


def run_with_final_convs(model: bytes, inputs: EngineInputs, touch: FinalConvs | None) -> np.ndarray:
    """The picture of a network whose last convolutions are left out of the model."""
    if touch is None:
        return drawn(model, inputs)
    buffers, (height, width) = touch.padded(inputs[0]), inputs[0].shape[2:]
    return touch.finish(drawn(model, (buffers, *inputs[1:])), buffers)[:, :, :height, :width]


def operators(model: bytes) -> list[str]:
    return [node.op_type for node in onnx.load_from_string(model).graph.node]


def constants(model: bytes) -> set[str]:
    return {constant.name.removesuffix(".half") for constant in onnx.load_from_string(model).graph.initializer}


def random_inputs(renderer: Renderer, batch: int, width: int, height: int) -> EngineInputs:
    rng, cell = np.random.default_rng(0), renderer._loaded.config.unshuffle
    given = renderer.inputs(rng.normal(size=(300, 3)).astype(np.float32) / 3, None, width, height)
    shapes = (batch, *given[0].shape[1:]), given[1].shape, (batch, *given[2].shape[1:])
    assert given[1].shape[1:] == (-(-height // cell), -(-width // cell))
    buffers, encoding, settings = (rng.random(shape, dtype=np.float32) for shape in shapes)
    return buffers, encoding, settings


@pytest.mark.slow
@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("half", [True, False])
def test_optimized_graph_gives_the_same_output(make_weights: Callable[..., Path], form: str, half: bool) -> None:
    file = make_weights(**FORMS[form])
    file = halved(file) if half else file
    model, renderer = export_onnx(file).read_bytes(), Renderer(file)
    loaded = renderer._loaded
    lean = optimize_graph(model, loaded.buffer_channels, loaded.config.unshuffle)
    touch = FinalConvs.from_tensors(loaded.weights.tensors, loaded.config)
    for batch, width, height in ((1, 64, 64), (2, 97, 61), (3, 33, 130)):
        inputs = random_inputs(renderer, batch, width, height)
        assert (
            np.abs(run_with_final_convs(lean, inputs, touch) - drawn(model, inputs)).max() < 1e-3
        )  # random weights: steep
    assert operators(lean).count("Transpose") < operators(model).count("Transpose")
    assert "Split" not in operators(lean) and not {"look.weight", "touch.weight"} & constants(lean)
    assert (touch is None) == (FORMS[form].get("refine") == 0) and len(lean) < len(model) + 4_000


def test_a_network_without_a_stem_stays_as_it_is(make_weights: Callable[..., Path]) -> None:
    file = make_weights(kind="adain_unet", unshuffle=1, widths=(8, 12), encoder="none")
    model = export_onnx(file).read_bytes()
    assert optimize_graph(model, 13, 1) == model


def test_calibration_is_seeded_and_varies_every_control(make_weights: Callable[..., Path]) -> None:
    renderer = Renderer(make_weights())
    first, second = (list(calibration_inputs(renderer, 3, np.random.default_rng(1))) for _ in range(2))
    for one, other in zip(first, second, strict=True):
        assert all(np.array_equal(a, b) for a, b in zip(one, other, strict=True))
    assert not np.array_equal(first[0][2], first[1][2]) and all(buffers.any() for buffers, _, _ in first)


@pytest.mark.slow
def test_int8_output_is_close_and_its_graph_is_small(make_weights: Callable[..., Path]) -> None:
    file = halved(make_weights(widths=(32, 48, 64), mapping=64))
    model, renderer = export_onnx(file).read_bytes(), Renderer(file)
    given = list(calibration_inputs(renderer, 4, np.random.default_rng(0)))
    small = quantize_int8(model, given[:3])
    kinds = operators(small)
    assert kinds.count("QuantizeLinear") > 10 and kinds.count("Conv") == operators(model).count("Conv")
    off = np.abs(drawn(small, given[3]) - drawn(model, given[3]))
    assert 0 < off.mean() < INEXACT_TOLERANCE
    save_graph(file, load_weights(file).digest, small, INT8)
    assert graph_path(file, INT8).stat().st_size < 0.25 * file.stat().st_size
    assert load_graph(file, load_weights(file).digest, INT8) == small
    assert Renderer(file, engine="onnxruntime-int8").engine == "onnxruntime-int8"
