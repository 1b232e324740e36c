"""Weights and training checkpoints: safetensors files with a JSON card, checked by a digest. Never pickle."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save

from z2p_core.errors.messages import UserError
from z2p_core.errors.value_limits import LimitError, check_value, describe_value
from z2p_renderer.storage.files.atomic_write import atomic_path
from z2p_renderer.storage.files.bounded_json import JsonError, read_json
from z2p_renderer.storage.files.printable_names import is_file, path_exists
from z2p_renderer.storage.models.card_schema import CARD

FORMAT = 1
SHIPPED_FOLDER = Path(__file__).parents[1] / "weights"
CARD_KEYS = ("network", "zbuffer", "gbuffer", "encoder", "controls", "resolution", "fixed_elevation", "training")
TENSOR_DTYPES = ("F64", "F32", "F16", "I64", "I32", "I16", "I8", "U64", "U32", "U16", "U8", "BOOL")
"""Of tensors in checkpoints; weights have floats alone."""
MAX_CARD_BYTES = 64 << 20
"""Bytes of a card; a checkpoint's holds all rows of a learning curve."""
CHECKPOINT, PREVIOUS_CHECKPOINT = "checkpoint.safetensors", "checkpoint.previous.safetensors"


class WeightsError(UserError):
    """Weights that cannot be used; the message says what was expected, what came, and what to do."""


@dataclass(frozen=True)
class Weights:
    """A network's tensors by name, float32, and the card that says how to rebuild and feed it.

    Card: `format` 1; `network` (NetworkConfig as a dict); `zbuffer`, `gbuffer` {name, version};
    `encoder` {name, version, state};
    `controls` [{name, version, size}] in the settings vector's order; `resolution`, the sides trained at;
    `fixed_elevation` in degrees, or null where elevation is a control; `training`, free notes.
    """

    tensors: dict[str, np.ndarray]
    card: dict[str, Any]
    digest: str = ""
    """sha256 (64 hex digits) of tensors and card as the file has them; what an ONNX file made of them names."""
    file: str = ""
    """Where they came from, for messages."""


def shipped_weights() -> dict[str, Path]:
    """The weights that come with z2p, by name."""
    return {path.stem: path for path in sorted(SHIPPED_FOLDER.glob("*.safetensors"))}


def find_weights(name_or_path: str | Path) -> Path:
    """File of shipped weights, or of a path.

    Raises:
        WeightsError: neither.
    """
    known = shipped_weights()
    if str(name_or_path) in known:
        return known[str(name_or_path)]
    if is_file(name_or_path):
        return Path(name_or_path)
    names = ", ".join(known) or "none"
    raise WeightsError(f"unknown weights {str(name_or_path)!r}; shipped: {names}; or give a .safetensors file")


def save_weights(path: Path, tensors: Mapping[str, Any], card: dict[str, Any], half: bool = False) -> None:
    """Write arrays or tensors and their card to `path`, complete or not at all; as float16 if `half`.

    Raises:
        WeightsError: the card lacks a key, or a value is not finite, or too large for float16.
    """
    missing = [key for key in CARD_KEYS if key not in card]
    if missing:
        raise WeightsError(f"{path}: the card lacks {', '.join(missing)}")
    kind = np.float16 if half else np.float32
    with np.errstate(over="ignore"):  # told below
        arrays: dict[str, np.ndarray] = {name: _to_numpy(tensor).astype(kind) for name, tensor in tensors.items()}
    for name, array in arrays.items():
        if not np.isfinite(array).all():
            raise WeightsError(f"{path}: {name} holds values that are not finite in {np.dtype(kind)}")
    with atomic_path(path) as temporary:
        _write(temporary, arrays, {"format": FORMAT, **card})


def load_weights(path: Path) -> Weights:
    """Tensors (float32) and card of a weights file, which may be a stranger's: all of it is checked, nothing is run.

    Raises:
        WeightsError: missing, not safetensors (a pickle, say), damaged, without a card or with one that cannot be, of
            another format, or with numbers that are not finite.
    """
    tensors, card, digest = _read(path)
    if type(card.get("format")) is not int or card["format"] != FORMAT:
        given = describe_value(card.get("format"))
        raise WeightsError(f"{path}: expected weights of format {FORMAT}, got {given}; update z2p")
    missing = [key for key in CARD_KEYS if key not in card]
    if missing:
        raise WeightsError(f"{path}: the card lacks {', '.join(missing)}; these are not weights of z2p")
    try:
        check_value(card, CARD, "card")
    except LimitError as error:
        raise WeightsError(f"{path}: {error}; get the weights again") from None
    for name, tensor in tensors.items():
        if tensor.dtype not in (np.float16, np.float32) or not np.isfinite(tensor).all():
            raise WeightsError(f"{path}: {name}: expected finite numbers of float16 or float32, got {tensor.dtype}"
                               f"{'' if tensor.dtype.kind != 'f' else ', some not finite'}; get the weights again")
    arrays = {name: tensor.astype(np.float32) for name, tensor in tensors.items()}
    return Weights(arrays, card, digest, str(path))


def check_tensors(weights: Weights, expected: Mapping[str, tuple[int, ...]]) -> None:
    """Nothing, when the tensors' names and shapes are those that the network of the card has.

    Raises:
        WeightsError: a name is missing or unknown, or a shape differs.
    """
    missing, unknown = sorted(set(expected) - set(weights.tensors)), sorted(set(weights.tensors) - set(expected))
    if missing or unknown:
        raise WeightsError(f"{weights.file or 'weights'}: the tensors do not fit the card's network: missing "
                           f"{missing[:3]}, unknown {unknown[:3]}")
    for name, shape in expected.items():
        if weights.tensors[name].shape != tuple(shape):
            raise WeightsError(f"{weights.file or 'weights'}: {name}: expected shape {tuple(shape)}, got "
                               f"{weights.tensors[name].shape}")


def save_checkpoint(folder: Path, tensors: Mapping[str, Any], state: dict[str, Any]) -> None:
    """Write the newest training checkpoint into `folder` and keep the one before it; a kill at any time leaves one."""
    newest = folder / CHECKPOINT
    with atomic_path(newest) as temporary:
        _write(temporary, {name: _to_numpy(tensor) for name, tensor in tensors.items()}, state)
        if newest.exists():
            newest.replace(folder / PREVIOUS_CHECKPOINT)


def load_checkpoint(folder: Path) -> tuple[dict[str, np.ndarray], dict[str, Any], list[str]] | None:
    """Tensors and state of the newest undamaged checkpoint, and warnings about damaged ones.

    None when there is no checkpoint; no tensors and no state when all are damaged.
    """
    warnings: list[str] = []
    for path in (folder / CHECKPOINT, folder / PREVIOUS_CHECKPOINT):
        if path_exists(path):
            try:
                tensors, state, _ = _read(path)
                return tensors, state, warnings
            except WeightsError as error:
                warnings.append(f"ignored a checkpoint: {error}")
    return ({}, {}, warnings) if warnings else None


def _to_numpy(tensor: Any) -> np.ndarray:
    """Contiguous array of an array or of a torch tensor on any device."""
    return np.asarray(tensor.detach().cpu().numpy() if hasattr(tensor, "detach") else tensor, order="C")


def _write(path: Path, arrays: dict[str, np.ndarray], card: dict[str, Any]) -> None:
    """Write a file that lasts, even where the machine goes down right after it got its name."""
    # One metadata key: safetensors orders several as it pleases, and equal weights should be equal bytes.
    header = {"z2p": json.dumps({"card": card, "sha256": _digest(arrays, card)})}
    with path.open("wb") as file:
        file.write(save(arrays, metadata=header))
        file.flush()
        os.fsync(file.fileno())


def _read(path: Path) -> tuple[dict[str, np.ndarray], dict[str, Any], str]:
    path = Path(path)
    if not is_file(path):
        raise WeightsError(f"{path}: no such weights file")
    with path.open("rb") as file:
        start = file.read(4)
    if start[:2] in (b"PK", b"\x80\x02", b"\x80\x03", b"\x80\x04", b"\x80\x05"):
        raise WeightsError(f"{path}: a pickle; expected safetensors, because loading a pickle runs the code in it")
    try:
        with safe_open(path, framework="np") as opened:
            header = opened.metadata() or {}
            if "z2p" not in header:
                raise WeightsError(f"{path}: a safetensors file without z2p's card; expected weights made by z2p")
            metadata = read_json(header["z2p"], MAX_CARD_BYTES)
            arrays = {name: _tensor(opened, name, path) for name in opened.keys()}  # noqa: SIM118 - not a dict
    except JsonError as error:
        raise WeightsError(f"{path}: damaged: its card: {error}; get it again") from error
    except (SafetensorError, OSError) as error:
        raise WeightsError(f"{path}: truncated, damaged or not safetensors ({error}); get it again") from error
    card = metadata.get("card") if isinstance(metadata, dict) else None
    digest = _digest(arrays, card) if isinstance(card, dict) else ""
    if not isinstance(card, dict) or metadata.get("sha256") != digest:
        raise WeightsError(f"{path}: damaged: its content does not match its digest; get it again")
    return arrays, card, digest


def _tensor(opened: Any, name: str, path: Path) -> np.ndarray:
    """A tensor of an opened file, which makes sure that it holds all of it."""
    kind = opened.get_slice(name).get_dtype()
    if kind not in TENSOR_DTYPES:
        expected = ", ".join(TENSOR_DTYPES)
        raise WeightsError(f"{path}: {name}: expected numbers of {expected}, got {kind}; export it as float32")
    array: np.ndarray = opened.get_tensor(name)
    return array


def _digest(arrays: dict[str, np.ndarray], card: dict[str, Any]) -> str:
    digest = hashlib.sha256(json.dumps(card, sort_keys=True).encode())
    for name in sorted(arrays):
        array = arrays[name]
        digest.update(f"{name} {array.dtype} {array.shape}".encode())
        digest.update(np.asarray(array, order="C").reshape(-1).data)
    return digest.hexdigest()
