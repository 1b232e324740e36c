"""Clouds from Python objects: arrays, tensors and cloud objects of other libraries, single or in batches."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from z2p_core.api.object_columns import batch_members, has_named_columns
from z2p_core.api.object_fields import object_fields, split_fields
from z2p_core.api.point_cloud_objects import NUMERIC_KINDS, extract_array, is_cloud_object
from z2p_core.api.point_cloud_objects import records_to_points as records_to_points
from z2p_core.errors.messages import error_reason
from z2p_core.formats.arrays.non_point_arrays import refuse_other_arrays
from z2p_core.interfaces import ScanError

MAX_COLUMNS = 128
MIN_MAP_SIDE = 16
"""Least number of rows and of columns of a point map."""
MAX_TESTED_LINES = 512
"""Rows and columns of an array that are examined to recognize a point map."""
MAX_SPREAD_SHARE = 0.05
"""Standard deviation of x/z within the columns of a point map, and of y/z within its rows, as a share of that between
them."""
MIN_POINTS_PER_LINE = 8
"""Average number of points in the nonempty columns or rows that are needed for this test."""
MAX_LINE_BULGE_SHARE = 0.1
"""RMS distance of a row or column of a point map from its plane, as a share of that of the whole map."""


@dataclass(frozen=True)
class PointArrays:
    """Clouds (N, 3) float64, one or a batch."""

    clouds: list[np.ndarray]
    batched: bool
    unused_columns: int
    """Number of nameless columns behind x, y, z that were left out."""
    fields: tuple[Mapping[str, np.ndarray], ...] = ()
    """What else is known of each cloud's points, as in `z2p_core.interfaces.RawCloud.fields`: ``rgb`` (N, 3) float32,
    ``normal`` (N, 3) float32, scalars and labels (N,) by their own names. Values but colors are made when they are
    first asked for, which raises ScanError if the other library fails."""
    class_names: tuple[Mapping[str, Mapping[int, str]], ...] = ()
    """Of each cloud's fields of labels, what some of their values stand for."""
    color_kinds: tuple[str, ...] = ()
    """Of each cloud, what numbers its colors were made of, in a few words; empty without colors."""
    left_out: Mapping[str, str] = field(default_factory=dict)
    """Of each name that an object has and that is no field of its points, why."""
    notes: tuple[str, ...] = ()
    """What to tell the user: which colors were left out, and why."""


def point_arrays(points: Any) -> PointArrays:
    """The clouds in an array or tensor (N, 3 or more) or (B, N, 3 or more), a cloud object, or a list of these.

    A depth camera's point map (H, W, 3 or more) is one cloud.

    Raises:
        ScanError: no numbers, or another shape.
    """
    members = batch_members(points)
    points = points if members is None else members
    if isinstance(points, Sequence) and not isinstance(points, str) and points and _axis_count(points[0]) == 2:
        return _join_members([_parse_member(part, index) for index, part in enumerate(points)])
    array = records_to_points(_extract_array(points))
    shape = array.shape
    if array.dtype.names:
        raise ScanError(f"expected records with fields x, y and z, got {', '.join(array.dtype.names)}")
    flat = array.ndim in (2, 3) and shape[-2] == 3 != shape[-1]
    if array.ndim not in (2, 3) or flat or not 3 <= shape[-1] <= MAX_COLUMNS:
        hint = "; transpose it, e.g. points.swapaxes(-1, -2)" if flat else ""
        raise ScanError(f"expected points (N, 3 or more) or a batch (B, N, 3 or more), got {shape}{hint}")
    if array.dtype.kind not in NUMERIC_KINDS:
        raise ScanError(f"expected points as numbers, got dtype {array.dtype}")
    refuse_other_arrays(array)
    batch = as_batch(array)
    clouds = [np.array(cloud[:, :3], dtype=np.float64) for cloud in batch]
    is_batch = array.ndim == 3 and batch is array
    found = object_fields(points, shape[:-1], is_batch)
    unused = 0 if has_named_columns(points) else shape[-1] - 3
    return PointArrays(clouds, is_batch, unused,
                       tuple(split_fields(found, [len(cloud) for cloud in clouds])), (found.class_names,) * len(clouds),
                       (found.color_kind,) * len(clouds), found.left_out, found.notes)  # fmt: skip


def _join_members(parts: Sequence[PointArrays]) -> PointArrays:
    """The batch of a list's clouds; a note that not all have says which has it."""
    notes: dict[str, list[int]] = {}
    for index, part in enumerate(parts):
        for note in part.notes:
            notes.setdefault(note, []).append(index)
    told = [note if len(indices) == len(parts) else f"cloud [{', '.join(map(str, indices))}]: {note}"
            for note, indices in notes.items()]  # fmt: skip
    left_out = {name: reason for part in reversed(parts) for name, reason in part.left_out.items()}
    return PointArrays(
        [part.clouds[0] for part in parts], True, max(part.unused_columns for part in parts),
        tuple(part.fields[0] for part in parts), tuple(part.class_names[0] for part in parts),
        tuple(part.color_kinds[0] for part in parts), left_out, tuple(told),
    )  # fmt: skip


def as_batch(array: np.ndarray) -> np.ndarray:
    """Clouds (B, N, C) of a cloud (N, C), a batch (returned as it is), or a point map (H, W, C), which is one cloud."""
    if array.ndim == 3 and not _is_point_map(array):
        return array
    return array.reshape(1, -1, array.shape[-1])


@np.errstate(all="ignore")  # the numbers may be no coordinates
def _is_point_map(array: np.ndarray) -> bool:
    """Whether numbers (H, W, 3 or more) are the point map of a pinhole camera rather than H clouds.

    In camera axes x/z depends on the column alone and y/z on the row alone, unlike in a batch. In other axes each row
    and each column lies in a plane, while the whole map does not.
    """
    if min(array.shape[:2]) < MIN_MAP_SIDE:
        return False
    rows, columns = (np.linspace(0, side - 1, min(side, MAX_TESTED_LINES)).astype(int) for side in array.shape[:2])
    points = array[rows[:, None], columns, :3].astype(np.float64)
    x, y, z = np.moveaxis(points, -1, 0)
    with np.errstate(all="ignore"):  # missing points are 0 0 0 or no numbers
        across, down = x / z, y / z
    valid = np.isfinite(across) & np.isfinite(down)
    if _varies_across_columns(across, valid) and _varies_across_columns(down.T, valid.T):
        return True
    whole = _plane_residuals(points.reshape(1, -1, 3), valid.reshape(1, -1))
    return all(np.median(_plane_residuals(*lines)) < MAX_LINE_BULGE_SHARE * whole.max(initial=0)
               for lines in ((points, valid), (points.swapaxes(0, 1), valid.T)))  # fmt: skip


def _plane_residuals(points: np.ndarray, valid: np.ndarray) -> np.ndarray:
    """RMS distances (K,) of the `valid` points of each line (L, M, 3) from its best plane; short lines are skipped."""
    counts = valid.sum(1)
    used = counts >= MIN_POINTS_PER_LINE
    if not used.any():
        return np.array([np.inf])
    counts, weights = counts[used, None], valid[used, :, None]
    points = np.where(weights, points[used], 0.0)
    points -= points.sum(1, keepdims=True) / counts[:, None] * weights
    spread = np.einsum("lma,lmb->lab", points, points) / counts[:, None]
    if not np.isfinite(spread).all():  # the numbers are too large
        return np.array([np.inf])
    return np.sqrt(np.maximum(np.linalg.eigvalsh(spread)[:, 0], 0))


def _varies_across_columns(values: np.ndarray, valid: np.ndarray) -> bool:
    """Whether the valid values (`valid`) of (H, W) vary far less within columns than between them."""
    counts = valid.sum(0)
    used = counts > 0
    if used.sum() < 2 or counts[used].mean() < MIN_POINTS_PER_LINE:
        return False
    values = np.where(valid, values, 0.0)[:, used]
    means = values.sum(0) / counts[used]
    within = np.where(valid[:, used], (values - means) ** 2, 0.0).sum()
    between = (counts[used] * (means - (counts[used] * means).sum() / counts.sum()) ** 2).sum()
    return bool(within < MAX_SPREAD_SHARE**2 * between)


def _parse_member(part: Any, index: int) -> PointArrays:
    """The cloud at `index` of a list; errors name the index."""
    try:
        return point_arrays(part)
    except ScanError as error:
        raise ScanError(f"cloud [{index}]: {error}") from error


def _extract_array(points: Any) -> np.ndarray:
    """Array of a tensor on any device, of a cloud object, or of anything that numpy converts.

    Raises:
        ScanError: it is something else.
    """
    expected = f"expected points as an array (N, 3), a cloud object or one path, got {_type_name(points)}"
    try:
        array = extract_array(points)
    except ScanError:
        raise
    except Exception as error:  # ragged lists; objects of other libraries may raise anything
        raise ScanError(f"{expected} ({error_reason(error)})") from error
    if not isinstance(points, np.ndarray) and (array.ndim == 0 or array.dtype.kind in "OUS"):
        raise ScanError(expected)
    return array


def _type_name(points: Any) -> str:
    """The name of an object's type; for a list also that of its first member."""
    name = type(points).__name__
    return f"{name} of {type(points[0]).__name__}" if isinstance(points, list | tuple) and points else name


def _axis_count(part: Any) -> int:
    """Number of axes of a list member: 2 for a cloud, so that the list is a batch."""
    if hasattr(part, "shape"):
        return len(part.shape)
    return 2 if is_cloud_object(part) else 0
