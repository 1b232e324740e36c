"""Joins a .gltf file and its buffers, which lie beside it or in its text, into one GLB."""

from __future__ import annotations

import base64
import json
from pathlib import Path
from typing import Any
from urllib.parse import unquote

from z2p_core.interfaces import ScanError
from z2p_renderer.plugins.readers._helpers.gltf import encode_glb

_UNUSED_PARTS = ("images", "textures", "samplers", "animations", "skins", "cameras")
"""Parts of a glTF file that do not affect the vertices, or lie in files of their own."""


def as_glb(path: Path) -> bytes:
    """The GLB of a .gltf file and its buffers, without images; of materials the color is kept.

    Raises:
        ScanError: it is no glTF file, or a buffer is missing, too short or outside its folder.
        Exception: the file is damaged; parsing raises errors of several types.
    """
    blob = path.read_bytes()
    if not blob.lstrip().startswith(b"{"):
        raise ScanError("expected a glTF file, which is JSON; this is another format under that name")
    tree = json.loads(blob)
    if not isinstance(tree, dict) or "asset" not in tree:
        raise ScanError("expected a glTF file, which tells its version under 'asset'; this is another kind of JSON")
    binary, starts = b"", []
    for number, buffer in enumerate(tree.get("buffers", ())):
        starts.append(len(binary))
        content = _read_buffer(buffer, path.parent, number)
        if len(content) < buffer["byteLength"]:
            raise ScanError(f"the glTF file promises {buffer['byteLength']} bytes in buffer {number}, {len(content)} "
                            "came; export it again")
        binary += content + bytes(-len(content) % 4)
    for view in tree.get("bufferViews", ()):
        view["byteOffset"] = view.get("byteOffset", 0) + starts[view["buffer"]]
        view["buffer"] = 0
    for name in _UNUSED_PARTS:
        tree.pop(name, None)
    tree["materials"] = [_plain_material(material) for material in tree.get("materials", ())]
    for node in tree.get("nodes", ()):
        node.pop("skin", None)
        node.pop("camera", None)
    tree["buffers"] = [{"byteLength": len(binary)}]
    return encode_glb(tree, binary)


def _plain_material(material: dict[str, Any]) -> dict[str, Any]:
    """A material of one color."""
    factor = material.get("pbrMetallicRoughness", {}).get("baseColorFactor")
    return {} if factor is None else {"pbrMetallicRoughness": {"baseColorFactor": factor}}


def bytes_beside(path: Path) -> int:
    """Total size of the buffer files of a .gltf; 0 if it cannot be determined (`as_glb` reports the reason)."""
    try:
        uris = [buffer.get("uri", "") for buffer in json.loads(path.read_bytes()).get("buffers", ())]
        return sum((path.parent / unquote(uri)).stat().st_size for uri in uris if not uri.startswith("data:"))
    except (OSError, ValueError, AttributeError, TypeError, RecursionError):
        return 0


def _read_buffer(buffer: dict[str, Any], folder: Path, number: int) -> bytes:
    """The bytes of a buffer, from a data URI or from a file in the folder or below it.

    Raises:
        ScanError: the buffer is elsewhere, or its file is missing.
    """
    uri = buffer.get("uri", "")
    if uri.startswith("data:"):
        kind, _, text = uri.partition(",")
        if not kind.endswith(";base64"):
            raise ScanError(f"the glTF file keeps buffer {number} in another way than base64; export it again as GLB")
        return base64.b64decode(text)
    name = unquote(uri)
    if not name or "://" in name or Path(name).is_absolute() or ".." in Path(name).parts:
        raise ScanError(f"the glTF file keeps buffer {number} elsewhere than beside itself ({name[:60]!r}); export it "
                        "again as GLB")
    beside = folder / name
    if not beside.is_file():
        raise ScanError(f"the glTF file's points are in {name[:80]!r}, which is not beside it; copy that too, or "
                        "export it again as GLB")
    return beside.read_bytes()
