"""ONNX files beside weights files: the same network for engines that do not know torch, tied to its weights by digest.

The last bytes of such a file are one metadata property of the ONNX format itself, which names the digest of the weights
and that of the bytes before it. So any ONNX reader takes the file, and z2p refuses a damaged one, or one of others.
"""

from __future__ import annotations

import hashlib
from pathlib import Path

from z2p_renderer.storage.files.atomic_write import atomic_write
from z2p_renderer.storage.models.checkpoints import WeightsError

FORMAT = "1"
"""Raised when what `pipeline.export` writes changes its inputs or outputs."""
_METADATA, _KEY, _VALUE = 14, 1, 2
"""Fields of ONNX's ModelProto (metadata_props) and StringStringEntryProto."""
_NAME = b"z2p"


def onnx_path(weights: Path) -> Path:
    """Where the ONNX file of a weights file belongs: beside it, under the same name."""
    return weights.with_suffix(".onnx")


def save_onnx(weights: Path, digest: str, model: bytes) -> Path:
    """The ONNX file of `weights`, whose content digest (64 hex digits) it names; written complete or not at all."""
    return atomic_write(model + _digest_property(digest, model), onnx_path(weights), durable=True)


def load_onnx(weights: Path, digest: str) -> bytes | None:
    """The ONNX model beside a weights file, or beside the file that it links to; None where there is none.

    Raises:
        WeightsError: it was made from other weights, by another version of z2p, or is damaged.
    """
    path = next((path for path in map(onnx_path, (weights, weights.resolve())) if path.is_file()), None)
    if path is None:
        return None
    content = path.read_bytes()
    size = len(_digest_property(digest, b""))
    model, seal = content[:-size], content[-size:]
    if seal == _digest_property(digest, model):
        return content
    again = f"remove it, or write it again: python -m z2p_renderer.pipeline.export {weights}"
    if seal[:-129] != _digest_property(digest, b"")[:-129]:
        raise WeightsError(f"{path}: damaged, or not an ONNX file of this z2p; {again}")
    if seal[-128:-64] != digest.encode():
        raise WeightsError(
            f"{path}: made from other weights than {weights.name}: expected {digest[:16]}, "
            f"got {seal[-128:-112].decode(errors='replace')}; {again}"
        )
    raise WeightsError(f"{path}: damaged: its content does not match its digest; {again}")


def _digest_property(weights: str, model: bytes) -> bytes:
    """The metadata property; always as long, whatever it names."""
    value = f"{FORMAT} {weights}{hashlib.sha256(model).hexdigest()}".encode()
    return _protobuf_field(_METADATA, _protobuf_field(_KEY, _NAME) + _protobuf_field(_VALUE, value))


def _protobuf_field(number: int, content: bytes) -> bytes:
    """A length-delimited field in protobuf's wire format."""
    length, left = b"", len(content)
    while left > 127:
        length += bytes([left & 127 | 128])
        left >>= 7
    return bytes([number << 3 | 2]) + length + bytes([left]) + content
