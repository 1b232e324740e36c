"""Weights of strangers: odd cards, tensors, headers and graphs; each loads, or is refused as a WeightsError."""

from __future__ import annotations

import hashlib
import json
import struct
import zlib
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from changed_bytes import changed as changed_bytes
from changed_values import changed, json_text, odd
from safetensors.numpy import save

from z2p_core import registry
from z2p_core.config import NetworkConfig, to_dict
from z2p_core.registry import PluginError
from z2p_renderer.pipeline.inference.loading import load_plugins
from z2p_renderer.storage.models.checkpoints import CHECKPOINT, WeightsError, load_checkpoint, load_weights
from z2p_renderer.storage.models.onnx_deltas import graph_path, load_graph, save_graph

CONTROLS = ("color", "light", "elevation")
WEIGHTS = "weights.safetensors"


def make(rng: np.random.Generator, folder: Path) -> None:
    """A file of weights, changed in one way, and a graph beside it for some."""
    tensors, card = dict(_sound()[0]), json.loads(json.dumps(_sound()[1]))
    match int(rng.integers(6)):
        case 0 | 1 | 2:
            blob = _file(tensors, json_text({"card": (other := changed(card, rng)), "sha256": _digest(tensors, other)}))
        case 3:
            tensors = _other_tensors(tensors, rng)
            blob = _file(tensors, json_text({"card": card, "sha256": _digest(tensors, card)}))
        case 4:
            blob = _with_header(_file(tensors, json.dumps({"card": card, "sha256": _digest(tensors, card)})), rng)
        case _:
            blob = changed_bytes(_file(tensors, json.dumps({"card": card, "sha256": _digest(tensors, card)})), rng)
    (folder / WEIGHTS).write_bytes(blob)
    (folder / CHECKPOINT).write_bytes(blob)
    if rng.random() < 0.3:
        _write_graph(folder, rng)


def check(folder: Path) -> str:
    """What came of it."""
    load_checkpoint(folder)
    _try_graph(folder)
    try:
        weights = load_weights(folder / WEIGHTS)
        assert all(np.isfinite(tensor).all() and tensor.dtype == np.float32 for tensor in weights.tensors.values())
        loaded = load_plugins(weights)
        loaded.build()
        assert isinstance(loaded.windows, bool) and loaded.settings >= 0
    except (WeightsError, PluginError) as error:
        text = str(error)
        assert "\n" not in text and len(text) < 1500, f"a message that is no line: {text[:300]!r} ({len(text)})"
        return f"refused {type(error).__name__}"
    return "loaded"


@lru_cache(maxsize=1)
def _sound() -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """Tensors and card of a small network that works."""
    import torch

    from z2p_core.network.unet import build_network

    config = NetworkConfig(widths=(16, 16), mapping=16)
    zbuffer, gbuffer = registry.load("zbuffers", config.zbuffer), registry.load("gbuffers", config.gbuffer)
    controls = [registry.load("controls", name)() for name in CONTROLS]
    torch.manual_seed(0)
    network = build_network(config, zbuffer.channels + gbuffer.channels, 0, sum(one.size for one in controls))
    card = {
        "format": 1, "network": to_dict(config), "zbuffer": {"name": zbuffer.name, "version": zbuffer.version},
        "gbuffer": {"name": gbuffer.name, "version": gbuffer.version},
        "encoder": {"name": "none", "version": registry.load("encoders", "none").version, "state": {}},
        "controls": [{"name": one.name, "version": one.version, "size": one.size} for one in controls],
        "resolution": [64], "fixed_elevation": None, "training": {"cropped": False, "steps": 3},
    }  # fmt: skip
    return {name: tensor.numpy() for name, tensor in network.state_dict().items()}, card


def _digest(tensors: dict[str, np.ndarray], card: Any) -> str:
    """The digest that the file must name, so that what is in it is looked at."""
    try:
        digest = hashlib.sha256(json.dumps(json.loads(json_text(card)), sort_keys=True).encode())
    except (ValueError, RecursionError, TypeError):
        return "0" * 64
    for name in sorted(tensors):
        digest.update(f"{name} {tensors[name].dtype} {tensors[name].shape}".encode() + tensors[name].tobytes())
    return digest.hexdigest()


def _file(tensors: dict[str, np.ndarray], metadata: str) -> bytes:
    blob: bytes = save(tensors, metadata={"z2p": metadata})
    return blob


def _other_tensors(tensors: dict[str, np.ndarray], rng: np.random.Generator) -> dict[str, np.ndarray]:
    """The tensors with one that is missing, too much, of another shape or type, or not finite."""
    name = str(rng.choice(sorted(tensors)))
    tensor = tensors[name].copy()
    match int(rng.integers(7)):
        case 0:
            tensor.flat[rng.integers(tensor.size)] = rng.choice([np.nan, np.inf, -np.inf])
        case 1:
            return {other: tensors[other] for other in tensors if other != name}
        case 2:
            return {**tensors, str(rng.choice(["more", "", name + "x"])): tensor}
        case 3:
            tensor = tensor.astype(rng.choice(["f2", "f8", "i4", "u1", "?", "i8"]))
        case 4:
            tensor = tensor[None] if rng.random() < 0.5 else np.ascontiguousarray(tensor.T[..., :1])
        case 5:
            tensor = np.zeros((0, *tensor.shape), "f4")
        case _:
            tensor = np.full_like(tensor, rng.choice([3e38, -1e30, 1e-40]))
    return {**tensors, name: tensor}


def _with_header(blob: bytes, rng: np.random.Generator) -> bytes:
    """The file with a header that lies: other offsets, shapes, types or lengths."""
    end = 8 + int.from_bytes(blob[:8], "little")
    header = changed(json.loads(blob[8:end]), rng)
    text = json_text(header).encode(errors="surrogatepass")
    length = len(text) if rng.random() < 0.8 else int(rng.choice([0, 2**31, 2**40, 2**63 - 1, len(text) + 1]))
    return struct.pack("<Q", length) + text + blob[end:]


def _write_graph(folder: Path, rng: np.random.Generator) -> None:
    """A graph file beside the weights, changed in its header or as a whole."""
    sound = folder / "sound.safetensors"
    tensors, card = _sound()
    sound.write_bytes(_file(tensors, json.dumps({"card": card, "sha256": _digest(tensors, card)})))
    onnx = b"graph" + b"".join(tensor.tobytes() for tensor in tensors.values()) + b"end"
    magic, header, packed = save_graph(sound, "0" * 64, onnx).read_bytes().split(b"\n", 2)
    if rng.random() < 0.7:
        header = json_text(changed(json.loads(header), rng)).encode(errors="surrogatepass")
    elif rng.random() < 0.5:
        packed = zlib.compress(bytes(int(rng.choice([0, 100, 50_000_000]))), 9) + bytes(int(odd(rng) is None))
    else:
        packed = changed_bytes(packed, rng)
    graph_path(sound).write_bytes(b"\n".join([magic, header, packed]))


def _try_graph(folder: Path) -> None:
    sound = folder / "sound.safetensors"
    if sound.exists():
        try:
            load_graph(sound, "0" * 64)
        except WeightsError as error:
            assert "\n" not in str(error)
