"""What objects of other libraries hold of each point beside its place, as columns by name; none is imported."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from z2p_core.api.point_cloud_objects import find_point_attribute, find_point_keys, is_las, is_tensor
from z2p_core.images import srgb_from_linear

MAX_UINT8 = 255.0
DEFAULT_MATERIAL_COLOR, DEFAULT_TEXTURE_COLOR = (102, 102, 102), (100, 100, 100)
"""What trimesh paints that has no color, and that has coordinates of a texture but no texture, in bytes."""
USUAL_ATTRIBUTES = ("colors", "rgb", "normals", "normal", "intensity", "labels")
"""Attributes that are asked for where an object does not list its own."""


@dataclass(frozen=True)
class Column:
    """Numbers or words for each point, which may be another library's until they are loaded."""

    name: str
    shape: tuple[int, ...]
    load: Callable[[], np.ndarray]
    """Gives them as a numpy array of that shape: masked and missing numbers are NaN."""
    kind: str
    """``f`` for numbers and truth values, ``O`` for words or unknown objects, empty for what is neither."""
    color_scale: float | None = None
    """Full intensity, where the library defines it for such a color."""


def object_columns(source: Any) -> list[Column]:
    """The columns of a cloud object; none for an array of plain numbers, or a tensor."""
    if isinstance(source, Mapping):
        return _mapping_columns(source)
    if is_tensor(source):
        return []
    for holder, points in (("point", "positions"), ("vertex", "positions")):  # open3d's tensor clouds and meshes
        if hasattr(getattr(source, holder, None), points):
            return _tensor_map_columns(getattr(source, holder))
    if hasattr(source, "pc_data"):  # pypcd4
        return _record_columns(source.pc_data)
    if hasattr(source, "columns") and hasattr(source, "to_numpy"):  # pandas and polars
        return _table_columns(source)
    if isinstance(source, np.ndarray):
        return _record_columns(source)
    if is_las(source):
        return _las_columns(source)
    if hasattr(source, "visual"):  # trimesh
        return _trimesh_columns(source)
    if hasattr(source, "point_data"):  # pyvista
        return _vtk_columns(source)
    if callable(getattr(source, "has_colors", None)) or callable(getattr(source, "has_vertex_colors", None)):
        return _open3d_columns(source)
    return _attribute_columns(source)


def has_named_columns(source: Any) -> bool:
    """Whether an object is a data frame whose columns have names rather than numbers."""
    is_table = hasattr(source, "columns") and hasattr(source, "to_numpy")
    return is_table and all(isinstance(name, str) for name in source.columns)


def batch_members(source: Any) -> list[Any] | None:
    """The clouds of a batch object of torch_geometric, or as dicts of pytorch3d; None for any other object."""
    if callable(getattr(source, "to_data_list", None)):
        return list(source.to_data_list())
    if not callable(getattr(source, "points_list", None)):
        return None
    clouds = source.points_list()
    members: list[dict[str, Any]] = [{"points": points} for points in clouds]
    for name in ("features", "normals"):
        parts = getattr(source, f"{name}_list", lambda: None)()
        for member, part in zip(members, parts or (), strict=False):
            is_color = name == "features" and part.shape[-1] in (3, 4)
            member["rgb" if is_color else name] = part
    return members


def make_column(name: object, value: Any, color_scale: float | None = None) -> Column | None:
    """The column of an array, tensor, series or list; None if it is no such thing."""
    if not hasattr(value, "shape") or not hasattr(value, "dtype"):
        if not isinstance(value, list | tuple):
            return None
        try:
            value = np.asarray(value)
        except ValueError:  # ragged
            return None
    shape = tuple(int(side) for side in value.shape)
    return Column(str(name), shape, lambda: to_numpy(value), _kind(value.dtype), color_scale)


def to_numpy(value: Any) -> np.ndarray:
    """The array of a tensor on any device, a series of a data frame, a masked array, or what numpy converts."""
    if is_tensor(value):  # numpy knows no bfloat16
        value = value.detach().cpu()
        return np.asarray((value.float() if "bfloat16" in str(value.dtype) else value).numpy())
    if isinstance(value, np.ma.MaskedArray) and value.dtype.kind in "fiub":
        return np.asarray(np.ma.filled(value.astype(np.float64), np.nan) if np.ma.is_masked(value) else value.data)
    if not isinstance(value, np.ndarray) and hasattr(value, "cpu"):  # open3d
        value = value.cpu().numpy()
    return np.asarray(value)


def _kind(dtype: Any) -> str:
    """`Column.kind` of a numpy dtype, or of another library's by its name."""
    if isinstance(dtype, np.dtype):
        return "f" if dtype.kind in "fiub" else "O" if dtype.kind in "OU" else ""
    name = str(dtype).lower()
    if any(word in name for word in ("complex", "date", "time", "duration", "list", "array", "struct")):
        return ""
    return "f" if any(word in name for word in ("int", "float", "double", "bool", "decimal")) else "O"


def _columns(items: Iterable[tuple[object, Any]]) -> list[Column]:
    made = (make_column(name, value) for name, value in items)
    return [column for column in made if column is not None]


def _mapping_columns(mapping: Mapping[Any, Any]) -> list[Column]:
    """All but the points, and what the object has itself that holds these."""
    used = find_point_keys(mapping)
    inner = object_columns(mapping[used[0]]) if len(used) == 1 else []
    return [*_columns((name, mapping[name]) for name in mapping if name not in used), *inner]


def _record_columns(records: np.ndarray) -> list[Column]:
    """The fields of records but x, y and z."""
    names = [name for name in records.dtype.names or () if name.lower() not in ("x", "y", "z")]
    return _columns((name, records[name]) for name in names)


def _table_columns(table: Any) -> list[Column]:
    """Named columns but x, y and z, or but the first three if there are no such."""
    names = list(table.columns)
    plain = [str(name).strip().lower() for name in names]
    if set(plain) >= set("xyz"):
        names = [name for name, word in zip(names, plain, strict=True) if word not in ("x", "y", "z")]
    else:
        names = [name for name in names[3:] if isinstance(name, str)]
    return _columns((name, table[name]) for name in names)


def _tensor_map_columns(tensors: Any) -> list[Column]:
    """Those of open3d's attributes of points, whose order is random."""
    columns = _columns((name, tensors[name]) for name in sorted(tensors) if name != "positions")
    return [_with_byte_scale(column, tensors[column.name].dtype) for column in columns]


def _with_byte_scale(column: Column, dtype: Any) -> Column:
    """The column whose bytes, if it has such, are colors to 255 even where none is larger than 1."""
    if str(dtype).lower() != "uint8":
        return column
    return Column(column.name, column.shape, column.load, column.kind, MAX_UINT8)


def _las_columns(las: Any) -> list[Column]:
    """laspy's dimensions, extra ones scaled, but the integers of which x, y and z are made."""
    names = [name for name in las.point_format.dimension_names if name not in ("X", "Y", "Z")]
    return _columns((name, las[name]) for name in names)


def _vtk_columns(mesh: Any) -> list[Column]:
    """Arrays of pyvista's points, the active scalars first; bytes of three or four channels are colors."""
    arrays = dict(mesh.point_data.items())
    active = getattr(mesh.point_data, "active_scalars_name", None)
    names = sorted(arrays, key=lambda name: name != active)
    columns = [make_column(name, arrays[name]) for name in names]
    return [_with_byte_scale(column, arrays[column.name].dtype) for column in columns if column is not None]


def _open3d_columns(cloud: Any) -> list[Column]:
    """Colors and normals of open3d's legacy clouds and meshes; those of line sets are of lines."""
    if hasattr(cloud, "lines"):
        return []
    prefix = "vertex_" if hasattr(cloud, "vertices") else ""
    arrays = {name: np.asarray(getattr(cloud, prefix + name, ())) for name in ("colors", "normals")}
    return _columns((name, values) for name, values in arrays.items() if values.size)


def _attribute_columns(source: Any) -> list[Column]:
    """Public attributes of any other object, as of torch_geometric's graphs; colors of trimesh's paths are of lines."""
    if hasattr(source, "entities"):
        return []
    points = find_point_attribute(source)
    attributes = dict(getattr(source, "__dict__", {}))
    if points not in attributes and callable(getattr(source, "to_dict", None)):  # torch_geometric
        attributes = dict(source.to_dict())
    for name in USUAL_ATTRIBUTES:
        if name not in attributes and not callable(getattr(source, name, None)):
            attributes[name] = getattr(source, name, None)
    return _columns((name, value) for name, value in attributes.items()
                    if name != points and not str(name).startswith("_"))  # fmt: skip


def _trimesh_columns(mesh: Any) -> list[Column]:
    """Colors, normals, attributes of the vertices, metadata with a row for each of them, and a loaded PLY file's rest.

    trimesh drops the scalars of PLY files, and all but the low byte of their 16-bit colors (seen in 5.2).
    """
    count = len(mesh.vertices)
    file = _ply_properties(mesh)
    channels = [file.pop(name, None) for name in ("red", "green", "blue")]
    colors = _trimesh_colors(mesh, count)
    if colors is not None and all(channel is not None and channel.dtype.kind in "iu" for channel in channels):
        stored = np.column_stack(channels)  # type: ignore[arg-type]
        colors = stored if stored.max() > MAX_UINT8 and np.array_equal(stored & 255, colors[:, :3]) else colors
    columns = [] if colors is None else [_color_column(colors)]
    attributes = {**getattr(mesh.visual, "vertex_attributes", {}), **getattr(mesh, "vertex_attributes", {})}
    attributes.pop("uv", None)
    metadata = [column for column in _columns(mesh.metadata.items()) if column.shape[:1] == (count,)]
    columns += [*_columns({**attributes, **file}.items()), *metadata]
    if len(getattr(mesh, "faces", ())) and not {"nx", "normal", "normals"} & {column.name for column in columns}:
        columns.append(Column("normal", (count, 3), lambda: _mesh_normals(mesh), "f"))
    return columns


def _mesh_normals(mesh: Any) -> np.ndarray:
    """Normals (N, 3) of trimesh's vertices: the mesh's own, or the area-weighted sums of its faces' (not of length 1).

    trimesh complains aloud where it computes them without scipy.
    """
    if "vertex_normals" in getattr(mesh, "_cache", ()):
        return np.asarray(mesh.vertex_normals)
    faces = np.asarray(mesh.faces)
    corners = np.asarray(mesh.vertices)[faces]
    areas = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return np.column_stack([np.bincount(faces.reshape(-1), np.repeat(axis, 3), len(mesh.vertices)) for axis in areas.T])


def _color_column(colors: np.ndarray) -> Column:
    """Colors of trimesh's in bytes, of any type, or 16-bit ones."""
    scale = 65535.0 if colors.dtype.itemsize > 1 and colors.dtype.kind in "iu" else MAX_UINT8
    return Column("rgb", colors.shape, lambda: colors, "f", scale)


def _ply_properties(mesh: Any) -> dict[str, np.ndarray]:
    """The properties (N,) of the vertices in the PLY file that trimesh loaded, if these are still the mesh's."""
    data = mesh.metadata.get("_ply_raw", {}).get("vertex", {}).get("data", {})
    names = getattr(getattr(data, "dtype", None), "names", None) or (data if isinstance(data, Mapping) else ())
    found = {str(name): np.asarray(data[name]) for name in names}
    found = {name: values.reshape(-1) for name, values in found.items() if values.size == len(mesh.vertices)}
    if not found.keys() >= set("xyz"):
        return {}
    places = np.column_stack([found.pop(axis) for axis in "xyz"])
    return found if np.array_equal(places, mesh.vertices) else {}


def _trimesh_colors(mesh: Any, count: int) -> np.ndarray | None:
    """Colors (count, 3 or 4) of trimesh's vertices in bytes; None if they are only the library's default."""
    visual = mesh.visual
    kind = getattr(visual, "kind", None)
    if not hasattr(mesh, "faces"):
        colors = np.asarray(getattr(mesh, "colors", ()))
        return colors if colors.size else None
    if kind == "vertex":
        return np.asarray(visual.vertex_colors)
    if kind == "face":
        return _mean_face_colors(np.asarray(mesh.faces), np.asarray(visual.face_colors), count)
    return _texture_colors(visual, count) if kind == "texture" else None


def _mean_face_colors(faces: np.ndarray, colors: np.ndarray, count: int) -> np.ndarray:
    """Colors (count, 3) of vertices in bytes, as floats: the mean of their faces' (F, 3 or 4); NaN without a face.

    trimesh's own mean needs scipy.
    """
    corners = faces.reshape(-1)
    degree = np.bincount(corners, minlength=count)
    sums = [np.bincount(corners, np.repeat(channel, faces.shape[1]), count) for channel in colors[:, :3].T]
    with np.errstate(invalid="ignore"):  # no face
        return np.column_stack(sums) / degree[:, None]


def _texture_colors(visual: Any, count: int) -> np.ndarray | None:
    """Colors (count, 3 or 4) of a texture at the vertices, or of a material; None for trimesh's default ones."""
    material = visual.material
    factor = getattr(material, "baseColorFactor", None)  # linear, as in glTF
    image = getattr(material, "image", None) or getattr(material, "baseColorTexture", None)
    if image is not None and visual.uv is not None and len(visual.uv) == count:
        colors = np.asarray(visual.to_color().vertex_colors)
        is_default = max(image.size) <= 2 and (colors[:, :3] == DEFAULT_TEXTURE_COLOR).all()
        return None if is_default else colors
    if factor is not None:
        return np.tile(MAX_UINT8 * srgb_from_linear(np.asarray(factor)[:3] / MAX_UINT8), (count, 1))
    main = np.asarray(getattr(material, "main_color", DEFAULT_MATERIAL_COLOR))[:3]
    return None if (main == DEFAULT_MATERIAL_COLOR).all() else np.tile(main, (count, 1))
