"""Fields of clouds in arrays: of the columns behind x, y and z, and of arrays beside the points."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from z2p_core.formats.tables.extra_columns import colors_hold, guess_columns
from z2p_core.interfaces import RawCloud
from z2p_renderer.plugins.readers._helpers.point_fields import Wants, plan_arrays

_IMAGE_NAMES = ("image", "images", "img", "imgs")
"""Names of the colors of point maps."""
_MAX_OWN_COLUMNS = 32
_SAMPLE_ROWS = 1000


@dataclass(frozen=True)
class SideArrays:
    """The arrays of a file that may belong to its points, none of them read yet."""

    shapes: Mapping[str, tuple[int, ...]] = field(default_factory=dict)
    load: Callable[[str], np.ndarray] = lambda name: np.empty(0)


def side_arrays(array: np.ndarray, points_field: str | None = None) -> SideArrays:
    """The fields of records beside x, y and z, or beside the vector field `points_field`."""
    if array.dtype.names is None:
        return SideArrays()
    own = {points_field} if points_field else {name for name in array.dtype.names if name.lower() in ("x", "y", "z")}
    shapes = {name: (*array.shape, *array.dtype[name].shape) for name in array.dtype.names
              if name not in own and array.dtype[name].base.kind in "fiub"}  # fmt: skip
    return SideArrays(shapes, lambda name: array[name])


def joined(*sides: SideArrays) -> SideArrays:
    """All arrays of several sources; of one name, the first counts."""
    owner = {name: side for side in reversed(sides) for name in side.shapes}
    shapes = {name: side.shapes[name] for side in sides for name in side.shapes if owner[name] is side}
    return SideArrays(shapes, lambda name: owner[name].load(name))


@np.errstate(all="ignore")  # the numbers may be no coordinates
def with_array_fields(
    clouds: list[RawCloud], array: np.ndarray, side: SideArrays, wants: Wants, is_map: bool = False
) -> list[RawCloud]:
    """The clouds of an array (..., C), which are its rows one after the other, with their fields.

    Arrays of the shape (...) or (..., K) belong to the points; of point maps (..., H, W) also such as (..., K, H, W).
    """
    if not clouds:
        return clouds
    lead = array.shape[:-1]
    rows = array.reshape(-1, array.shape[-1])
    own = rows[:, 3 : 3 + _MAX_OWN_COLUMNS]
    sample = rows[: min(_SAMPLE_ROWS, len(clouds[0].points))].astype(np.float64)
    guess = guess_columns(sample[:, 3 : 3 + _MAX_OWN_COLUMNS], sample[:, :3])
    own_names = [name or f"column {column}" for column, name in enumerate(guess.names, start=4)]
    widths = {name: 1 for name in own_names}
    widths |= {name: width for name, shape in side.shapes.items() if name not in widths
               and (width := _width(shape, lead, is_map))}  # fmt: skip
    image = next((name for name in _IMAGE_NAMES if is_map and widths.get(name) in (3, 4)), "")
    fields = plan_arrays(widths, wants, image)
    arrays = {name: own[:, own_names.index(name)] if name in own_names else _rows(side.load(name), lead, is_map)
              for name in fields.arrays}  # fmt: skip
    note = guess.note(4) if wants("rgb") else ""
    if "r" in arrays and "r" in guess.names:
        three = np.column_stack([arrays[name] for name in "rgb"]).astype(np.float64)
        if not colors_hold(three, rows[:, :3].astype(np.float64)):
            fields, note = replace(fields, plan=fields.plan.without("rgb")), ""
    whole = RawCloud(np.empty((0, 3)), note=note)
    return _split(fields.fill(whole, arrays), clouds)


def _split(whole: RawCloud, clouds: list[RawCloud]) -> list[RawCloud]:
    """The clouds with their shares of the rows of the fields of all."""
    ends = np.cumsum([len(cloud.points) for cloud in clouds])
    parts = []
    for cloud, end in zip(clouds, ends.tolist(), strict=True):
        fields = {name: values[end - len(cloud.points) : end] for name, values in whole.fields.items()}
        parts.append(replace(cloud, fields=fields, field_names=whole.field_names, color_kind=whole.color_kind,
                             note="; ".join(filter(None, [cloud.note, whole.note]))))  # fmt: skip
    return parts


def _width(shape: tuple[int, ...], lead: tuple[int, ...], is_map: bool) -> int:
    """How many numbers of each point an array of that shape has; 0 if it is not one of the points'."""
    if shape == lead:
        return 1
    if shape[:-1] == lead:
        return shape[-1]
    return shape[-3] if _is_channels_first(shape, lead, is_map) else 0


def _is_channels_first(shape: tuple[int, ...], lead: tuple[int, ...], is_map: bool) -> bool:
    """Whether an array (..., K, H, W) belongs to maps (..., H, W)."""
    return is_map and len(shape) == len(lead) + 1 >= 3 and (*shape[:-3], *shape[-2:]) == lead


def _rows(values: np.ndarray, lead: tuple[int, ...], is_map: bool) -> np.ndarray:
    """Values (N,) or (N, K) of an array that belongs to points of the shape `lead`."""
    if values.shape[:-1] != lead and _is_channels_first(values.shape, lead, is_map):
        values = np.moveaxis(values, -3, -1)
    count = int(np.prod(lead))
    return values.reshape(count) if values.shape == lead else values.reshape(count, -1)
