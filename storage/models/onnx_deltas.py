"""Graph files: an ONNX file without the numbers that the weights file beside it holds anyway, a hundredth of its size.

An ONNX file repeats its weights byte by byte. A graph file keeps the rest of it, and where each tensor lies in the
weights file, so that joining the two gives the very bytes of the ONNX file. z2p ships graphs, trainings write ONNX.
"""

from __future__ import annotations

import hashlib
import json
import zlib
from pathlib import Path
from typing import Any

from safetensors import safe_open

from z2p_core.errors.value_limits import Count, JsonObject, LimitError, ListOf, Text, check_value
from z2p_renderer.storage.files.atomic_write import atomic_write
from z2p_renderer.storage.files.bounded_json import JsonError, read_json
from z2p_renderer.storage.models.checkpoints import WeightsError

FORMAT = 2
"""Raised when the models change in what they read or give: those of format 1 had the last convolutions as well."""
INT8 = "int8"
"""Form of the network that computes in 8 bits; its graph file is another."""
_MAGIC = b"z2p graph\n"
_DIGEST = Text("64 hex digits", "[0-9a-f]{64}")
_PIECE = ListOf(Count(0, 1 << 40), 3, 3)
_HEADER = JsonObject({"format": Count(FORMAT, FORMAT), "weights": _DIGEST, "sha256": _DIGEST,
                "pieces": ListOf(_PIECE, 0, 100_000)})  # fmt: skip
MAX_REST_BYTES = 1 << 28
"""Bytes of an ONNX file that are no tensors; ours have some hundred thousand."""
MIN_TENSOR_BYTES = 512
"""Bytes below which a tensor is kept in the graph rather than looked for."""


def graph_path(weights: Path, form: str = "") -> Path:
    """Where the graph file of a weights file belongs: beside it, under the same name, and that of another form."""
    return weights.with_suffix(f".{form}.graph" if form else ".graph")


def save_graph(weights: Path, digest: str, onnx: bytes, form: str = "") -> Path:
    """The graph file of `weights`, whose content digest (64 hex digits) it names; written complete or not at all.

    `onnx` is an ONNX file made of these weights. Large are only constants that it stores otherwise than they do.
    """
    source = weights.read_bytes()
    pieces, rest = _split(onnx, source, _tensor_spans(weights, source))
    packed = zlib.compress(rest, 9)
    header = {"format": FORMAT, "weights": digest, "sha256": hashlib.sha256(onnx).hexdigest(), "pieces": pieces}
    content = _MAGIC + json.dumps(header).encode() + b"\n" + packed
    return atomic_write(content, graph_path(weights, form), durable=True)


def load_graph(weights: Path, digest: str, form: str = "") -> bytes | None:
    """The ONNX file of `weights` in that form, joined from it and the graph file beside it; None where there is none.

    Raises:
        WeightsError: it was made from other weights, by another version of z2p, or is damaged.
    """
    places = (graph_path(file, form) for file in (weights, weights.resolve()))
    path = next((path for path in places if path.is_file()), None)
    if path is None:
        return None
    again = f"remove it, or write the whole export: python -m z2p_renderer.pipeline.export {weights}"
    header, rest = _read(path, again)
    if header["weights"] != digest:
        raise WeightsError(
            f"{path}: made from other weights than {weights.name}: expected {digest[:16]}, "
            f"got {str(header['weights'])[:16]}; {again}"
        )
    source = weights.read_bytes()
    if not _pieces_fit(header["pieces"], len(source), len(rest)):
        raise WeightsError(f"{path}: damaged: its pieces are not those of {weights.name}; {again}")
    onnx = _join(header["pieces"], source, rest)
    if hashlib.sha256(onnx).hexdigest() != header["sha256"]:
        raise WeightsError(f"{path}: damaged, or {weights.name} was written anew since; {again}")
    return onnx


def _tensor_spans(weights: Path, source: bytes) -> list[tuple[int, int]]:
    """First byte and number of bytes of each tensor that is worth looking for, in the order of the file."""
    with safe_open(weights, framework="np") as opened:  # refuses a header that does not fit the file
        names = set(opened.keys())
    start = 8 + int.from_bytes(source[:8], "little")  # safetensors: length of the header, the header, the tensors
    header = json.loads(source[8:start])
    spans = sorted(header[name]["data_offsets"] for name in names)
    return [(start + first, last - first) for first, last in spans if last - first >= MIN_TENSOR_BYTES]


def _split(onnx: bytes, source: bytes, places: list[tuple[int, int]]) -> tuple[list[tuple[int, int, int]], bytes]:
    """Pieces of `onnx`, each (bytes of the rest, then first byte and number of bytes of `source`), and the rest."""
    found = []
    for first, size in places:
        at = onnx.find(source[first : first + size])
        if at >= 0:
            found.append((at, first, size))
    pieces, rest, end = [], b"", 0
    for at, first, size in sorted(found):
        if at < end:  # equal tensors are stored once
            continue
        pieces.append((at - end, first, size))
        rest += onnx[end:at]
        end = at + size
    return pieces, rest + onnx[end:]


def _join(pieces: list[tuple[int, int, int]], source: bytes, rest: bytes) -> bytes:
    parts, used = [], 0
    for own, first, size in pieces:
        parts += [rest[used : used + own], source[first : first + size]]
        used += own
    return b"".join([*parts, rest[used:]])


def _read(path: Path, again: str) -> tuple[dict[str, Any], bytes]:
    magic, _, content = path.read_bytes().partition(b"\n")
    if magic + b"\n" != _MAGIC:
        raise WeightsError(f"{path}: damaged, or not a graph file of z2p; {again}")
    text, _, packed = content.partition(b"\n")
    try:
        header = read_json(text)
        check_value(header, _HEADER, "header")
        unpacking = zlib.decompressobj()
        rest = unpacking.decompress(packed, MAX_REST_BYTES)
    except (JsonError, LimitError, zlib.error) as error:
        raise WeightsError(f"{path}: damaged, or of another format than {FORMAT} ({error}); {again}") from error
    if not unpacking.eof or unpacking.unused_data:
        raise WeightsError(f"{path}: damaged: expected what {MAX_REST_BYTES:,} bytes hold at most; {again}")
    return header, rest


def _pieces_fit(pieces: list[tuple[int, int, int]], source: int, rest: int) -> bool:
    """Whether all pieces lie in files of so many bytes, and are together no more than these."""
    inside = all(first + size <= source for _, first, size in pieces)
    return inside and sum(own for own, _, _ in pieces) <= rest and sum(size for *_, size in pieces) <= source
