"""Rewrites binary glTF into the subset that trimesh reads.

Compressed meshes are refused, normalized integer positions become floats, lines and fans become points, and a file
without a scene, which the format allows, gets one.
"""

from __future__ import annotations

import json
import struct
from typing import Any

import numpy as np

from z2p_core.interfaces import ScanError

_COMPRESSION_NAMES = {
    "KHR_draco_mesh_compression": "Draco",
    "EXT_meshopt_compression": "meshopt",
    "KHR_meshopt_compression": "meshopt",
}
"""Extension that compresses positions -> its usual name."""
_INTEGER_COMPONENTS = {5120: ("i1", 127), 5121: ("u1", 255), 5122: ("<i2", 32767), 5123: ("<u2", 65535)}
"""glTF component type -> its numpy type, and the integer that stands for 1.0 in a normalized accessor."""
_FLOAT_COMPONENT = 5126
"""glTF component type of float32."""
_JSON_CHUNK, _BINARY_CHUNK = b"JSON", b"BIN\0"
_POINTS_MODE, _READABLE_MODES = 0, (0, 4, 5)
"""glTF primitive mode of points, and the modes that trimesh reads: points, triangles and triangle strips."""


def readable_glb(blob: bytes) -> bytes:
    """Rewrites a GLB so that trimesh reads its vertices; returns the same bytes if nothing has to change.

    trimesh ignores normalization (it would read 32767 instead of 1.0), and reads no mesh outside a scene.

    Raises:
        ScanError: the meshes are compressed, use sparse accessors or lie in another file.
        Exception: the file is damaged; parsing raises errors of several types.
    """
    (length,) = struct.unpack_from("<I", blob, 12)
    tree = json.loads(blob[20 : 20 + length])
    for extension in tree.get("extensionsRequired", ()):
        if extension in _COMPRESSION_NAMES:
            raise _compression_error(extension)
    parts = [part for mesh in tree.get("meshes", ()) for part in mesh["primitives"]]
    for extension in (name for part in parts for name in part.get("extensions", ()) if name in _COMPRESSION_NAMES):
        compressed = [part["attributes"]["POSITION"] for part in parts if extension in part.get("extensions", ())]
        if any("bufferView" not in tree["accessors"][index] for index in compressed):
            raise _compression_error(extension)
    used = {part.get("attributes", {}).get("POSITION") for part in parts}
    if any(index is not None and "sparse" in tree["accessors"][index] for index in used):
        raise ScanError("its positions are kept sparse, as differences, which cannot be read here; export the file "
                        "again without sparse accessors")
    normalized = [index for index in used if index is not None and _is_normalized_integer(tree["accessors"][index])]
    lacks_scene = bool(parts) and not tree.get("scenes")
    unreadable = [part for part in parts if part.get("mode", 4) not in _READABLE_MODES]
    if not normalized and not lacks_scene and not unreadable:
        return blob
    for part in unreadable:  # only its vertices count
        part["mode"] = _POINTS_MODE
        part.pop("indices", None)
    if lacks_scene:
        _add_scene(tree)
    binary = bytearray(blob[20 + length + 8 :])
    for index in normalized:
        _make_float(tree, tree["accessors"][index], binary)
    return encode_glb(tree, bytes(binary))


def _compression_error(extension: str) -> ScanError:
    compression = _COMPRESSION_NAMES[extension]
    return ScanError(f"its meshes are packed by {compression} ({extension}), which cannot be read here; open it in "
                     f"Blender, and export it as PLY, or again without {compression} compression")


def _add_scene(tree: dict[str, Any]) -> None:
    """Adds a scene of all root nodes; a file without nodes gets one node per mesh."""
    nodes = tree.get("nodes") or [{"mesh": index} for index in range(len(tree.get("meshes", ())))]
    below = {child for node in nodes for child in node.get("children", ())}
    roots = [index for index in range(len(nodes)) if index not in below]
    tree.update(nodes=nodes, scenes=[{"nodes": roots}], scene=0)


def _is_normalized_integer(accessor: dict[str, Any]) -> bool:
    is_integer = accessor.get("normalized") and accessor["componentType"] in _INTEGER_COMPONENTS
    return bool(is_integer) and "bufferView" in accessor


def _make_float(tree: dict[str, Any], accessor: dict[str, Any], binary: bytearray) -> None:
    """Appends the accessor's positions to the binary chunk as float32, and redirects the accessor to them."""
    view = tree["bufferViews"][accessor["bufferView"]]
    if view["buffer"] != 0:
        raise ScanError("the positions lie in another buffer than the file's own; export it again as one .glb file")
    kind, scale = _INTEGER_COMPONENTS[accessor["componentType"]]
    stride = view.get("byteStride", 3 * np.dtype(kind).itemsize)
    row = np.dtype({"names": ["xyz"], "formats": [(kind, 3)], "itemsize": stride})
    start = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
    padded = bytes(binary[start:]) + bytes(stride)  # the last row may end before its stride does
    values = np.frombuffer(padded, row, accessor["count"])["xyz"] / scale
    binary += bytes(-len(binary) % 4)
    floats = np.maximum(values, -1).astype("<f4").tobytes()
    accessor.update(bufferView=len(tree["bufferViews"]), byteOffset=0, componentType=_FLOAT_COMPONENT, normalized=False)
    tree["bufferViews"].append({"buffer": 0, "byteOffset": len(binary), "byteLength": len(floats)})
    binary += floats


def encode_glb(tree: dict[str, Any], binary: bytes) -> bytes:
    """Encodes a GLB file from the JSON tree and the binary chunk."""
    binary += bytes(-len(binary) % 4)
    tree["buffers"][0]["byteLength"] = len(binary)
    text = json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    parts = ((text, _JSON_CHUNK), (binary, _BINARY_CHUNK))
    chunks = b"".join(struct.pack("<I4s", len(part), kind) + part for part, kind in parts)
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks
