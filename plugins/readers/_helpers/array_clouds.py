"""Clouds from arrays, by their shape and name: single clouds, batches, point maps; other arrays are refused."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from z2p_core.api.point_arrays import as_batch, records_to_points
from z2p_core.formats.arrays.image_grids import GRID_ADVICE
from z2p_core.formats.arrays.non_point_arrays import refuse_other_arrays
from z2p_core.formats.arrays.point_maps import estimate_map_sensor
from z2p_core.interfaces import RawCloud, ScanError, Sensor
from z2p_renderer.plugins.readers._helpers.array_fields import SideArrays, side_arrays, with_array_fields
from z2p_renderer.plugins.readers._helpers.point_fields import Wants
from z2p_renderer.plugins.readers._text.column_doubts import find_leading_columns

MAX_COLUMNS = 128
_MIN_SUSPICIOUS_BYTES, _MAX_COMPRESSION_RATIO = 100 << 20, 200
"""An array of more bytes than the first that was compressed by more than the second, a ratio, is no cloud."""
MAP_KEYS = ("pts3d", "world_points", "point_map", "pointmap", "point_maps", "points3d", "points_3d", "xyz_map",
            "world_points_from_depth", "pts3d_in_other_view", "xyz_image")  # fmt: skip
"""Names of point maps, as networks that predict depth write them."""
OBJECT_KEYS = ("data", "complete_pcds", "incomplete_pcds", "gt", "complete", "partial", "pcds")
"""Names under which data sets made of ShapeNet or ModelNet keep their objects."""
POINT_KEYS = ("points", "xyz", "positions", "pos", "vertices", "coords", "coord", "point_cloud", "pointcloud",
              "pointclouds", "point_clouds", "pcd", "pc", "pts", "cloud", *MAP_KEYS,
              *OBJECT_KEYS)  # fmt: skip
"""Names under which programs keep points; the first that holds some counts."""
NO_FIELD_KEYS = {*POINT_KEYS, "faces", "triangles", "edges", "cells"}
"""Names of arrays that are no fields of the points beside them, even if they have as many rows."""
_CAMERA_AXES_KEYS = {"pts3d", "point_map", "pointmap", "point_maps", "xyz_map", "xyz_image"}
"""Names of point maps in the axes of their own camera."""
_OBJECT_UP = {"up": "+Y", "up_reason": "the usual axes of ModelNet and ShapeNet", "up_certain": False}
_MAX_SAMPLED_ROWS = 1000
"""Rows at the beginning of a cloud that are examined for what its columns hold."""
_MIN_MAP_SIDE, _MAX_MAP_CHANNELS = 8, 8
"""Least number of rows and of columns of a point map, and largest number of values per pixel."""


@np.errstate(all="ignore")  # the numbers may be no coordinates
def clouds_from_array(
    array: np.ndarray, key: str = "", wants: Wants = lambda name: False, side: SideArrays | None = None
) -> list[RawCloud]:
    """Splits an array (N, C), (B, N, C), (H, W, C) or (B, H, W, C) into clouds (N, 3) float64.

    Its shape, and its name `key` in the file, decide what its axes mean. The clouds get those fields that are wanted of
    further columns, and of the arrays beside it.

    Raises:
        ScanError: the shape or the numbers are not those of points.
    """
    array = move_coordinates_last(array)
    as_maps = array.ndim == 4 or (array.ndim == 3 and key in MAP_KEYS)
    if as_maps and min(array.shape[-3:-1]) >= _MIN_MAP_SIDE and 3 <= array.shape[-1] <= _MAX_MAP_CHANNELS:
        maps = array if array.ndim == 4 else array[None]
        clouds = [_cloud_from_map(points, certain=key in _CAMERA_AXES_KEYS or not key) for points in maps]
        return with_array_fields(clouds, array, side or SideArrays(), wants, is_map=True)
    if not _is_transposed(array.shape) or array.shape[-1] == 4:
        refuse_other_arrays(array)
    check_shape(array.shape)
    batch = as_batch(array)
    if array.ndim == 3 and batch is not array:
        return with_array_fields([_cloud_from_map(array)], array, side or SideArrays(), wants, is_map=True)
    if array.ndim == 2:
        _check_first_columns(array)
    up = _OBJECT_UP if key in OBJECT_KEYS else {}
    clouds = [RawCloud(_first_three_columns(cloud), **up) for cloud in batch]  # type: ignore[arg-type]
    return with_array_fields(clouds, array, side or SideArrays(), wants)


def _check_first_columns(array: np.ndarray) -> None:
    """Raises ScanError where something else than x, y and z comes first in the rows of a cloud (N, 3 or more)."""
    sample = array[:_MAX_SAMPLED_ROWS].astype(np.float64)
    before, description = find_leading_columns(_first_three_columns(array), sample)
    if before:
        columns = f"columns 1 to {before}" if before > 1 else "column 1"
        raise ScanError(f"{columns} may be {description} "
                        f"rather than coordinates: save x, y and z alone, as array[:, {before}:{before + 3}] if they "
                        "come next, or array[:, :3]")


def exceeds_size_limit(unpacked: int, packed: int, max_bytes: int) -> bool:
    """Whether an array of `unpacked` bytes, stored in `packed`, is larger than `max_bytes` or too compressible."""
    too_compressed = unpacked > _MIN_SUSPICIOUS_BYTES and unpacked > _MAX_COMPRESSION_RATIO * max(packed, 1)
    return unpacked > max_bytes or too_compressed


def move_coordinates_last(array: np.ndarray) -> np.ndarray:
    """The array with x, y, z along its last axis: a point map (3, H, W) or (B, 3, H, W) is transposed."""
    if array.ndim not in (3, 4) or array.shape[-3] != 3 or array.shape[-1] == 3 or array.shape[-2] < _MIN_MAP_SIDE:
        return array
    moved = np.moveaxis(array, -3, -1)
    return moved if array.ndim == 4 or as_batch(moved) is not moved else array


def check_shape(shape: tuple[int, ...]) -> None:
    """Raises ScanError for a shape that points never have."""
    if len(shape) in (2, 3) and 3 <= shape[-1] <= MAX_COLUMNS and not _is_transposed(shape):
        return
    hint = "; transpose it, e.g. array.swapaxes(-1, -2)" if _is_transposed(shape) else ""
    if len(shape) in (2, 3) and (shape[-1] > MAX_COLUMNS or (len(shape) == 3 and shape[-1] < 3)) and not hint:
        hint = f"; is it a depth map or a grid of heights? {GRID_ADVICE}"
    raise ScanError(f"expected (N, 3 or more) or a batch (B, N, 3 or more), got {shape}{hint}")


def check_fields(dtype: np.dtype) -> None:
    """Raises ScanError for a type that holds no numbers, or records without such that are called x, y and z."""
    if dtype.hasobject:
        raise ScanError("the array holds pickled objects, which are never opened; save one plain float array a file, "
                        "or a batch (B, N, 3)")
    if dtype.names is None:
        if dtype.kind not in "fiu":
            raise ScanError(f"expected an array of numbers, got dtype {dtype}; save the points as float32 or float64")
        return
    name = _points_field(dtype)
    axes = [dtype[field] for field in dtype.names if field.lower() in ("x", "y", "z")]
    if name is None and (len(axes) != 3 or any(axis.kind not in "fiu" or axis.shape for axis in axes)):
        raise ScanError(f"expected records with numbers x, y and z, got dtype {str(dtype)[:160]}; name them so, or "
                        "save the points as float32 or float64")


def plain_numbers(array: np.ndarray) -> np.ndarray:
    """The numbers (..., 3 or more) of an array; of records, the fields that hold x, y and z."""
    name = _points_field(array.dtype)
    return records_to_points(array) if name is None else array[name]


def record_fields(array: np.ndarray) -> SideArrays:
    """The fields of records beside their points."""
    return side_arrays(array, _points_field(array.dtype))


def stack_axes(columns: dict[str, np.ndarray]) -> np.ndarray:
    """Points (N, 3) from arrays x, y and z of one shape.

    Raises:
        ScanError: their shapes differ.
    """
    shapes = [columns[axis].shape for axis in "xyz"]
    if len(set(shapes)) > 1:
        raise ScanError(f"expected arrays x, y and z of one shape, got {', '.join(map(str, shapes))}; save the points "
                        "as points=...")
    return np.stack([columns[axis] for axis in "xyz"], axis=-1).reshape(-1, 3)


def is_points(shape: tuple[int, ...], dtype: np.dtype, key: str = "") -> bool:
    """Whether an array of that shape and type could hold points."""
    try:
        check_fields(dtype)
        if dtype.names is not None:
            return len(shape) in (1, 2)
        if len(shape) == 4 or (len(shape) == 3 and shape[0] == 3 and key in MAP_KEYS):
            return 3 in (shape[-1], shape[-3])
        check_shape(shape)
    except ScanError:
        return False
    return True


def _points_field(dtype: np.dtype) -> str | None:
    """The name of the field of records that holds x, y and z as one vector; None if there is none."""
    fields = {name.lower(): name for name in dtype.names or ()}
    names: Iterable[str] = (fields[key] for key in POINT_KEYS if key in fields)
    return next((name for name in names if dtype[name].shape == (3,) and dtype[name].base.kind in "fiu"), None)


def _cloud_from_map(points: np.ndarray, certain: bool = False) -> RawCloud:
    """The cloud of a point map (H, W, 3 or more), with the pose of its camera as the sensor."""
    rows, columns = points.shape[:2]
    sensor: Sensor | None = estimate_map_sensor(points[..., :3], certain)
    note = f"a point map of {rows} x {columns} pixels"
    return RawCloud(_first_three_columns(points.reshape(rows * columns, -1)), sensor, note=note)


def _first_three_columns(rows: np.ndarray) -> np.ndarray:
    with np.errstate(all="ignore"):  # long doubles beyond float64 become infinite, and are dropped as such
        return np.ascontiguousarray(rows[:, :3], dtype=np.float64)


def _is_transposed(shape: tuple[int, ...]) -> bool:
    """Whether the coordinates seem to run along the axis before the last: (3, N) rather than (N, 3)."""
    return len(shape) in (2, 3) and shape[-2] == 3 != shape[-1]
