"""Extracts points from objects of other libraries by their attributes alone, so that none is imported."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import numpy as np

from z2p_core.interfaces import ScanError

ATTRIBUTES = ("xyz", "points", "vertices", "pos", "positions")
"""Attributes that hold clouds: of laspy (whose `points` are records), open3d and pyvista, trimesh, torch_geometric."""
KEYS = ("points", "xyz", "positions", "pos", "vertices", "coords", "coord")
"""Keys under which a dict holds points; the first one that exists counts."""
NUMERIC_KINDS = "fiu"
"""Kinds of numpy dtypes that hold real numbers."""


def is_cloud_object(source: Any) -> bool:
    """Whether an object other than an array holds one cloud."""
    if hasattr(source, "shape"):
        return False
    return isinstance(source, Mapping) or is_scene(source) or is_las(source) or any(
        hasattr(source, attribute) for attribute in (*ATTRIBUTES, "point", "vertex", "pc_data"))  # fmt: skip


def extract_array(source: Any) -> np.ndarray:
    """The array of an object that holds points, or of anything that numpy converts; its shape is not checked.

    Raises:
        ScanError: the object holds no points, or no numbers.
    """
    if isinstance(source, Mapping):
        return _array_from_mapping(source)
    if is_tensor(source):
        return _array_from_tensor(source)
    for holder in ("point", "vertex"):  # open3d's tensor clouds and meshes
        if hasattr(getattr(source, holder, None), "positions"):
            return np.asarray(getattr(source, holder).positions.cpu().numpy())
    if hasattr(source, "pc_data"):  # pypcd4, whose `points` is a number
        return np.asarray(source.pc_data)
    if is_scene(source):
        return _scene_vertices(source)
    if is_las(source):
        return _stack_axes(np.asarray(getattr(source, axis)) for axis in "xyz")
    if hasattr(source, "columns") and hasattr(source, "to_numpy"):  # pandas and polars
        return _array_from_table(source)
    if isinstance(source, np.ma.MaskedArray) and source.dtype.kind in NUMERIC_KINDS:
        return np.asarray(np.ma.filled(source.astype(np.float64), np.nan))
    if not isinstance(source, np.ndarray):
        attribute = find_point_attribute(source)
        if attribute is not None:
            value = getattr(source, attribute)
            return _array_from_tensor(value) if is_tensor(value) else np.asarray(value)
    return np.asarray(source)


def find_point_attribute(source: Any) -> str | None:
    """The attribute that holds an object's points, if one of the usual ones does."""
    for attribute in ATTRIBUTES:
        value = getattr(source, attribute, None)
        if value is not None and not callable(value):
            return attribute
    return None


def find_point_keys(mapping: Mapping[Any, Any]) -> tuple[Any, ...]:
    """The key under which a mapping holds points, or its keys x, y and z; empty if it has neither."""
    names = {str(name).strip().lower(): name for name in mapping}
    for key in KEYS:
        if key in names:
            return (names[key],)
    return tuple(names[axis] for axis in "xyz") if names.keys() >= set("xyz") else ()


def _array_from_mapping(mapping: Mapping[Any, Any]) -> np.ndarray:
    """Points under a usual key, or from the keys x, y and z.

    Raises:
        ScanError: there are neither, or x, y and z differ in shape.
    """
    keys = find_point_keys(mapping)
    if len(keys) == 1:
        return extract_array(mapping[keys[0]])
    if keys:
        columns = [np.asarray(extract_array(mapping[key])) for key in keys]
        if len({column.shape for column in columns}) > 1:
            shapes = ", ".join(str(column.shape) for column in columns)
            raise ScanError(f"expected x, y and z of one shape, got {shapes}")
        return _stack_axes(column.reshape(-1) for column in columns)
    known = ", ".join(str(name)[:40] for name in list(mapping)[:8]) or "nothing"
    raise ScanError(f"expected a {type(mapping).__name__} with points, xyz, positions ... or x, y and z, got {known}")


def _array_from_tensor(tensor: Any) -> np.ndarray:
    """Through float64, as numpy knows no bfloat16."""
    kind = str(tensor.dtype)
    if "complex" in kind or "bool" in kind:
        raise ScanError(f"expected points as numbers, got dtype {kind}")
    return np.asarray(tensor.detach().cpu().double().numpy())


def _array_from_table(table: Any) -> np.ndarray:
    """Columns x, y and z of a data frame, or all columns if these do not exist."""
    names = {str(name).strip().lower(): name for name in table.columns}
    if names.keys() >= set("xyz"):
        return _stack_axes(np.asarray(table[names[axis]]) for axis in "xyz")
    return np.asarray(table.to_numpy())


def records_to_points(array: np.ndarray) -> np.ndarray:
    """Numbers (..., 3) float64 of records with fields x, y and z; any other array as it is.

    Raises:
        ScanError: these fields hold no numbers.
    """
    fields = {name.lower(): name for name in array.dtype.names or ()}
    if not fields.keys() >= set("xyz"):
        return array
    return _stack_axes(array[fields[axis]] for axis in "xyz")


def _stack_axes(columns: Iterable[np.ndarray]) -> np.ndarray:
    """Points (..., 3) float64 from arrays x, y and z (...) of one shape.

    Raises:
        ScanError: one of them holds no numbers.
    """
    return np.stack([_check_numeric(column).astype(np.float64) for column in columns], axis=-1)


def _check_numeric(column: np.ndarray) -> np.ndarray:
    """Returns the column after a check that it holds numbers.

    Raises:
        ScanError: it does not.
    """
    if column.dtype.kind not in NUMERIC_KINDS:
        raise ScanError(f"expected x, y and z as numbers, got dtype {column.dtype}")
    return column


def is_scene(source: Any) -> bool:
    """Whether an object is a scene of trimesh, whose graph places its geometry."""
    return hasattr(source, "geometry") and hasattr(getattr(source, "graph", None), "nodes_geometry")


def is_tensor(source: Any) -> bool:
    """Whether an object is a tensor of torch; torch_geometric's graphs can be detached, too."""
    return hasattr(source, "detach") and hasattr(source, "dtype")


def is_las(source: Any) -> bool:
    """Whether an object is laspy's cloud, or a record of points, of which it consists."""
    return hasattr(source, "point_format") and all(hasattr(source, axis) for axis in "xyz")


def scene_nodes(scene: Any) -> Iterator[tuple[Any, np.ndarray]]:
    """Each placed geometry of a scene with its transform (4, 4) to the world."""
    for node in scene.graph.nodes_geometry:
        matrix, name = scene.graph[node]
        yield scene.geometry[name], np.asarray(matrix)


def _scene_vertices(scene: Any) -> np.ndarray:
    """All vertices (N, 3) of a scene in world coordinates."""
    parts = [np.asarray(part.vertices) @ matrix[:3, :3].T + matrix[:3, 3] for part, matrix in scene_nodes(scene)]
    if not parts:
        raise ScanError(f"expected points, got a {type(scene).__name__} without geometry")
    return np.vstack(parts)
