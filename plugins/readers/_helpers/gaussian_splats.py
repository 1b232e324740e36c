"""Points from Gaussian splats in PLY files, as 3DGS writes them and as SuperSplat packs them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from z2p_core.formats.ply_header import PlyElement, PlyHeader
from z2p_core.formats.row_subsampling import MAX_ROWS
from z2p_core.interfaces import RawCloud, ScanError
from z2p_renderer.plugins.readers._helpers.point_fields import PACKED_KIND, FieldPlan, Wants, plan_fields

USUAL_UP, UP_REASON = "-Y", "usual for Gaussian splats"
MIN_VISIBLE_OPACITY = 0.05
"""Gaussians of lower opacity are left out: training leaves many of them in empty space."""
MIN_HUGE_DIAGONALS = 0.25
"""Gaussians whose longest axis exceeds this many diagonals of the bounding box of the others are left out: they are
haze or sky, and their center lies on no surface."""
_BOX_QUANTILES = (0.02, 0.98)
"""Quantiles of the coordinates that bound this box."""
_SPLATS_PER_CHUNK = 256
"""How many packed Gaussians share the bounds in one row of the element ``chunk``."""
_PACKED_PROPERTIES = ("packed_position", "packed_scale", "packed_color")
_SH_COLUMNS = ("f_dc_0", "f_dc_1", "f_dc_2")
_BOUNDS = ("min_x", "min_y", "min_z", "max_x", "max_y", "max_z")
_COLOR_BOUNDS = ("min_r", "min_g", "min_b", "max_r", "max_g", "max_b")
_SCALE_BOUNDS = ("min_scale_x", "min_scale_y", "min_scale_z", "max_scale_x", "max_scale_y", "max_scale_z")


def is_splats(vertex: PlyElement) -> bool:
    """Whether the vertices are Gaussians: they have an opacity, a scale and a rotation."""
    return {"opacity", "scale_0", "rot_0"} <= {entry.name for entry in vertex.properties}


def splat_columns(vertex: PlyElement) -> tuple[str, ...]:
    """Names of the opacity and the scales; surfels have two scales, Gaussians three."""
    scales = sorted(entry.name for entry in vertex.properties if entry.name in ("scale_0", "scale_1", "scale_2"))
    return ("opacity", *scales)


def plan_splats(names: Sequence[str], wants: Wants, points: Sequence[int]) -> FieldPlan:
    """The fields of Gaussians with properties of these names: their color is the constant part of its harmonics."""
    plan = plan_fields(names, wants, points)
    plan = plan.without(*(name for name in names if name.startswith("f_rest_")))
    if "rgb" in plan.columns_of or not set(_SH_COLUMNS) <= set(names):
        return plan
    columns_of = {"rgb": tuple(names.index(name) for name in _SH_COLUMNS), **plan.without(*_SH_COLUMNS).columns_of}
    return FieldPlan(columns_of, tuple(name for name in columns_of if wants(name)), harmonics=True)


def cloud_from_splats(
    cloud: RawCloud, opacity: np.ndarray, scales: Sequence[np.ndarray], total: int
) -> RawCloud:
    """The cloud of those Gaussians that show a surface, with its fields.

    `opacity` (N,) is that before the sigmoid, `scales` are logarithmic; `total` is the number of Gaussians in the file,
    of which the cloud may be a subsample. The field ``opacity`` becomes that in [0, 1].
    """
    seen = opacity[np.isfinite(opacity)]
    alpha = opacity if len(seen) and seen.min() >= 0 and seen.max() <= 1 else _sigmoid(opacity)
    if "opacity" in cloud.fields:
        cloud = replace(cloud, fields={**cloud.fields, "opacity": alpha.astype(np.float32)})
    return _visible_cloud(cloud, alpha, np.column_stack([np.empty((len(opacity), 0)), *scales]), total)


def is_packed(header: PlyHeader) -> bool:
    """Whether a PLY file holds Gaussians as SuperSplat packs them."""
    vertex = header.element("vertex")
    names = {entry.name for entry in vertex.properties} if vertex else set()
    return {"packed_position", "packed_color"} <= names and header.element("chunk") is not None


def cloud_from_packed_splats(body: bytes, header: PlyHeader, wants: Wants, note: str = "") -> RawCloud:
    """The cloud of packed Gaussians, from all bytes behind the header.

    Raises:
        ScanError: the bounds are missing, or are not one row for every 256 Gaussians.
    """
    tables, at = {}, 0
    for element in header.elements:
        given = [entry.name for entry in element.properties]
        packed = [entry.type for entry in element.properties if entry.name in _PACKED_PROPERTIES]
        if header.ascii or not element.scalar or len(set(given)) < len(given) or any(
            kind.kind not in "iu" or kind.itemsize != 4 for kind in packed
        ):
            raise ScanError("packed Gaussian splats are binary, whole numbers of 4 bytes (uint); export the file again")
        tables[element.name] = np.frombuffer(body, element.dtype, element.count, at) if element.count else None
        at += element.least_bytes(ascii=False)
    chunk, vertex = tables["chunk"], tables["vertex"]
    if vertex is None:
        return RawCloud(np.empty((0, 3)))
    names = set(chunk.dtype.names or ()) if chunk is not None else set()
    if chunk is None or not set(_BOUNDS) <= names or len(chunk) != -(-len(vertex) // _SPLATS_PER_CHUNK):
        raise ScanError(f"{len(vertex)} packed Gaussian splats need a row of bounds (chunk) for each "
                        f"{_SPLATS_PER_CHUNK} of them, got {0 if chunk is None else len(chunk)}; export the file again")
    rows = np.arange(0, len(vertex), -(-len(vertex) // MAX_ROWS))
    group, vertex = rows // _SPLATS_PER_CHUNK, vertex[rows]
    points = _dequantize(vertex["packed_position"], chunk[group], _BOUNDS)
    has_scales = "packed_scale" in (vertex.dtype.names or ()) and set(_SCALE_BOUNDS) <= names
    scales = np.empty((len(rows), 0))
    if has_scales:
        scales = _dequantize(vertex["packed_scale"], chunk[group], _SCALE_BOUNDS)
    alpha = (vertex["packed_color"] & 255) / 255.0
    cloud = _with_packed_color(RawCloud(points, note=note), vertex["packed_color"], chunk[group], wants)
    if wants("opacity"):
        cloud = replace(cloud, fields={**cloud.fields, "opacity": alpha.astype(np.float32)})
    return _visible_cloud(cloud, alpha, scales, int(header.element("vertex").count))  # type: ignore[union-attr]


def _with_packed_color(cloud: RawCloud, packed: np.ndarray, chunk: np.ndarray, wants: Wants) -> RawCloud:
    """The cloud with the colors of ``0xRRGGBBAA`` (N,), between the bounds in the rows of `chunk` if it has some."""
    cloud = replace(cloud, field_names=("rgb", "opacity"))
    if not wants("rgb"):
        return cloud
    shares = np.column_stack([(packed.astype(np.uint32) >> shift & 255) for shift in (24, 16, 8)]) / 255.0
    if set(_COLOR_BOUNDS) <= set(chunk.dtype.names or ()):
        low, high = (np.column_stack([chunk[name] for name in _COLOR_BOUNDS[at : at + 3]]) for at in (0, 3))
        shares = low + shares * (high - low)
    return replace(cloud, fields={"rgb": np.clip(shares, 0, 1).astype(np.float32)}, color_kind=PACKED_KIND)


def _dequantize(packed: np.ndarray, chunk: np.ndarray, bounds: tuple[str, ...]) -> np.ndarray:
    """Unpacks integers (N,) of 11, 10 and 11 bits to (N, 3) float64 between the bounds in the rows of `chunk`."""
    packed = packed.astype(np.uint32)
    shares = np.column_stack([(packed >> 21) / 2047.0, (packed >> 11 & 1023) / 1023.0, (packed & 2047) / 2047.0])
    low, high = (np.column_stack([chunk[name] for name in bounds[at : at + 3]]).astype(np.float64) for at in (0, 3))
    return np.asarray(low + shares * (high - low))


def _sigmoid(numbers: np.ndarray) -> np.ndarray:
    with np.errstate(over="ignore"):
        return np.asarray(1 / (1 + np.exp(-numbers.astype(np.float64))))


def _visible_cloud(cloud: RawCloud, alpha: np.ndarray, scales: np.ndarray, total: int) -> RawCloud:
    """The cloud of the Gaussians that are neither faint nor huge; of all, if fewer than three remain."""
    points, notes = cloud.points, [cloud.note]
    solid = alpha >= MIN_VISIBLE_OPACITY
    large = np.zeros(len(points), dtype=bool)
    placed = points[solid & np.isfinite(points).all(1)]
    if scales.shape[1] and len(placed) > 2:
        low, high = np.quantile(placed, _BOX_QUANTILES, axis=0)
        with np.errstate(over="ignore"):
            length = np.exp(scales.astype(np.float64)).max(1)
            large = solid & (length > MIN_HUGE_DIAGONALS * float(np.linalg.norm(high - low)))
    kept = solid & ~large
    if kept.sum() < 3:
        kept[:] = True
        notes.append("all its Gaussians are nearly transparent or huge, and none was left out")
    elif not kept.all():
        huge = f" and {int(large.sum())} huge ones" if large.any() else ""
        faint = f"{int((~solid).sum())} nearly transparent Gaussians (opacity below {MIN_VISIBLE_OPACITY:.0%})"
        notes.append(f"{faint}{huge} left out")
    joined_note = "; ".join(filter(None, notes))
    fields = {name: values[kept] for name, values in cloud.fields.items()}
    cloud = replace(cloud, points=points[kept].astype(np.float64), fields=fields, note=joined_note)
    total_or_none = total if total > len(points) else None
    return replace(cloud, total=total_or_none, up=USUAL_UP, up_reason=UP_REASON, up_certain=False)
