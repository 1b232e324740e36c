"""Graph files: joined with their weights they give the ONNX file byte for byte, and nothing else passes for it."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from z2p_renderer.pipeline.export import export_onnx
from z2p_renderer.pipeline.inference.renderer import Renderer
from z2p_renderer.storage.models.checkpoints import WeightsError, load_weights, save_weights
from z2p_renderer.storage.models.onnx_deltas import graph_path, load_graph, save_graph
from z2p_renderer.storage.models.onnx_files import onnx_path


@pytest.fixture(scope="module")
def halved(make_weights: Callable[..., Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Weights as float16, as they are shipped, with both forms of export beside them."""
    whole = load_weights(make_weights(widths=(32, 48), mapping=64))
    file = tmp_path_factory.mktemp("graphs") / "half.safetensors"
    save_weights(file, whole.tensors, whole.card, half=True)
    save_graph(file, load_weights(file).digest, export_onnx(file).read_bytes())
    return file


@pytest.fixture
def weights(halved: Path, tmp_path: Path) -> Path:
    """Weights and graph that a test may spoil; no ONNX file."""
    shutil.copy(graph_path(halved), tmp_path)
    return Path(shutil.copy(halved, tmp_path))


def test_graph_and_weights_give_the_onnx_file_byte_for_byte(halved: Path) -> None:
    assert load_graph(halved, load_weights(halved).digest) == onnx_path(halved).read_bytes()


def test_a_graph_holds_no_numbers_of_the_weights(halved: Path) -> None:
    assert graph_path(halved).stat().st_size < 40_000 < 0.3 * onnx_path(halved).stat().st_size


def test_weights_in_float32_have_graphs_too(make_weights: Callable[..., Path], tmp_path: Path) -> None:
    file = Path(shutil.copy(make_weights(), tmp_path / "whole.safetensors"))
    onnx = export_onnx(file).read_bytes()
    save_graph(file, load_weights(file).digest, onnx)
    assert load_graph(file, load_weights(file).digest) == onnx


def test_engines_run_from_a_graph_file_without_torch(weights: Path) -> None:
    assert not onnx_path(weights).exists()
    assert Renderer(weights, threads=1).engine == "onnxruntime"


def test_a_link_to_weights_finds_the_graph_of_its_target(weights: Path, tmp_path: Path) -> None:
    link = tmp_path / "elsewhere" / "linked.safetensors"
    link.parent.mkdir()
    link.symlink_to(weights)
    assert load_graph(link, load_weights(link).digest) is not None


def test_no_graph_is_none(weights: Path) -> None:
    graph_path(weights).unlink()
    assert load_graph(weights, load_weights(weights).digest) is None


def test_the_graph_of_other_weights_is_refused(weights: Path) -> None:
    held = load_weights(weights)
    name, tensor = next(iter(held.tensors.items()))
    save_weights(weights, {**held.tensors, name: tensor + 1}, held.card, half=True)
    with pytest.raises(WeightsError, match=r"half\.graph: made from other weights than half\.safetensors"):
        Renderer(weights)


@pytest.mark.parametrize("place", [3, 40, 200, -1, -5000])
def test_a_flipped_bit_is_noticed(weights: Path, place: int) -> None:
    content = bytearray(graph_path(weights).read_bytes())
    content[place] ^= 1
    graph_path(weights).write_bytes(content)
    with pytest.raises(WeightsError, match=r"damaged|made from other weights|expected a graph file"):
        Renderer(weights)


@pytest.mark.parametrize("left", [0, 5, 60, -1])
def test_a_truncated_graph_is_refused(weights: Path, left: int) -> None:
    graph_path(weights).write_bytes(graph_path(weights).read_bytes()[:left])
    with pytest.raises(WeightsError, match="damaged"):
        Renderer(weights)
