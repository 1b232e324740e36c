"""Colors, normals and scalars of the vertices of a GLB, read from its accessors.

trimesh keeps 8 of 16 bits of a color, and no scalars of single points.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from z2p_core.images import linear_from_srgb, srgb_from_linear

_COMPONENTS = {5120: "i1", 5121: "u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}
_FULL = {"i1": 127, "u1": 255, "<i2": 32767, "<u2": 65535}
"""The integer that stands for 1."""
_SRGB_WRITERS = ("trimesh", "open3d")
"""Programs that write sRGB colors where the format has linear ones, in the file's ``generator``."""
_KINDS = {"u1": "8-bit", "<u2": "16-bit", "<f4": "shares of 1"}


@dataclass
class PartFields:
    """What a primitive of a mesh has of each of its `count` vertices."""

    count: int
    colors: np.ndarray | None = None
    """Linear RGB (count, 3), the factor of its material included."""
    color_kind: str = ""
    factor: tuple[float, ...] = (1.0, 1.0, 1.0)
    """The linear color of its material."""
    normals: np.ndarray | None = None
    scalars: dict[str, np.ndarray] = field(default_factory=dict)

    def srgb(self, texture: np.ndarray | None = None) -> np.ndarray:
        """sRGB colors (count, 3) float32; `texture` are the sRGB colors of the material's picture at the vertices."""
        linear = np.tile(np.array(self.factor, np.float32), (self.count, 1)) if self.colors is None else self.colors
        if texture is not None:
            linear = linear * linear_from_srgb(texture)
        return np.asarray(srgb_from_linear(np.clip(linear, 0, 1)), dtype=np.float32)


def read_part_fields(blob: bytes) -> list[PartFields]:
    """What the primitives of a GLB have, in the order of its meshes."""
    (length,) = struct.unpack_from("<I", blob, 12)
    tree, binary = json.loads(blob[20 : 20 + length]), blob[20 + length + 8 :]
    generator = str(tree.get("asset", {}).get("generator", "")).lower()
    is_srgb = any(writer in generator for writer in _SRGB_WRITERS)
    return [_read_part(tree, binary, part, is_srgb) for mesh in tree.get("meshes", ()) for part in mesh["primitives"]]


def field_names_of(parts: Sequence[PartFields], textured: bool) -> list[str]:
    """Names of the fields that some of the primitives have."""
    colored = textured or any(part.colors is not None or part.factor != (1.0, 1.0, 1.0) for part in parts)
    names = [name for part in parts for name in part.scalars]
    normal = any(part.normals is not None for part in parts)
    return [*(["rgb"] if colored else []), *(["normal"] if normal else []), *dict.fromkeys(names)]


def _read_part(tree: dict[str, Any], binary: bytes, part: dict[str, Any], is_srgb: bool) -> PartFields:
    attributes = part["attributes"]
    count = int(tree["accessors"][attributes["POSITION"]]["count"])
    values = {name: array for name, index in attributes.items() if name in ("COLOR_0", "NORMAL") or name[:1] == "_"
              if (array := _read_accessor(tree, binary, index)) is not None and len(array) == count}  # fmt: skip
    found = PartFields(count, factor=_material_factor(tree, part))
    if "COLOR_0" in values and values["COLOR_0"].shape[1] >= 3:
        colors = values["COLOR_0"][:, :3].astype(np.float32)
        kind = _COMPONENTS[tree["accessors"][attributes["COLOR_0"]]["componentType"]]
        found.color_kind = _KINDS.get(kind, "") + ("" if is_srgb else ", linear")
        colors = colors / np.float32(_FULL.get(kind, 1))
        found.colors = (linear_from_srgb(colors) if is_srgb else colors) * np.array(found.factor, np.float32)
    if "NORMAL" in values and values["NORMAL"].shape[1] == 3:
        found.normals = values["NORMAL"]
    found.scalars = {name: array[:, 0] for name, array in values.items() if name[:1] == "_" and array.shape[1] == 1}
    return found


def _material_factor(tree: dict[str, Any], part: dict[str, Any]) -> tuple[float, ...]:
    materials, index = tree.get("materials", ()), part.get("material")
    if index is None or index >= len(materials):
        return (1.0, 1.0, 1.0)
    factor = materials[index].get("pbrMetallicRoughness", {}).get("baseColorFactor", (1, 1, 1, 1))
    return tuple(float(share) for share in factor[:3])


def _read_accessor(tree: dict[str, Any], binary: bytes, index: int) -> np.ndarray | None:
    """The numbers (count, width) of an accessor; None if they are sparse, packed, matrices or beyond the file's end."""
    accessor = tree["accessors"][index]
    width, kind = _WIDTHS.get(accessor.get("type")), _COMPONENTS.get(accessor.get("componentType"))
    if width is None or kind is None or "sparse" in accessor or "bufferView" not in accessor:
        return None
    view = tree["bufferViews"][accessor["bufferView"]]
    if view.get("buffer", 0) != 0 or "extensions" in view:
        return None
    size = width * np.dtype(kind).itemsize
    stride = view.get("byteStride") or size
    start = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
    count = int(accessor["count"])
    if start + (count - 1) * stride + size > len(binary):
        return None
    row = np.dtype({"names": ["values"], "formats": [(kind, (width,))], "itemsize": stride})
    content = binary[start : start + count * stride].ljust(count * stride, b"\0")
    return np.frombuffer(content, row, count)["values"]
