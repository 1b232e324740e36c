"""The seal of an ONNX file: proper ONNX, of one length, and naming the weights and the model."""

from __future__ import annotations

import hashlib
from pathlib import Path

import onnx
import pytest
from onnx import TensorProto, helper

from z2p_renderer.storage.models.checkpoints import WeightsError
from z2p_renderer.storage.models.onnx_files import load_onnx, onnx_path, save_onnx

DIGEST = hashlib.sha256(b"weights").hexdigest()


@pytest.fixture
def model() -> bytes:
    value = helper.make_tensor_value_info
    node = helper.make_node("Relu", ["x"], ["y"])
    graph = helper.make_graph([node], "one", [value("x", TensorProto.FLOAT, [1])], [value("y", TensorProto.FLOAT, [1])])
    written: bytes = helper.make_model(graph).SerializeToString()
    return written


def test_the_sealed_file_is_onnx_with_a_property_more(tmp_path: Path, model: bytes) -> None:
    path = save_onnx(tmp_path / "w.safetensors", DIGEST, model)
    assert path == tmp_path / "w.onnx" and [file.name for file in tmp_path.iterdir()] == ["w.onnx"]
    read = onnx.load(path)
    onnx.checker.check_model(read)
    [entry] = read.metadata_props
    assert (entry.key, entry.value) == ("z2p", f"1 {DIGEST}{hashlib.sha256(model).hexdigest()}")
    del read.metadata_props[:]
    assert read == onnx.load_from_string(model)


def test_it_comes_back_for_its_weights_only(tmp_path: Path, model: bytes) -> None:
    weights = tmp_path / "w.safetensors"
    assert load_onnx(weights, DIGEST) is None
    save_onnx(weights, DIGEST, model)
    assert load_onnx(weights, DIGEST) == onnx_path(weights).read_bytes()
    with pytest.raises(WeightsError, match=r"made from other weights than w\.safetensors"):
        load_onnx(weights, "0" * 64)


def test_an_onnx_file_of_a_stranger_is_refused(tmp_path: Path, model: bytes) -> None:
    onnx_path(tmp_path / "w.safetensors").write_bytes(model + bytes(300))
    with pytest.raises(WeightsError, match="damaged, or not an ONNX file of this z2p"):
        load_onnx(tmp_path / "w.safetensors", DIGEST)
