"""Colors, normals, scalars and labels of the points of other libraries' objects, by name, as readers give a file's."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache, partial
from itertools import pairwise
from typing import Any, TypeVar

import numpy as np

from z2p_core.api.object_columns import Column, object_columns
from z2p_core.api.point_cloud_objects import is_scene, scene_nodes
from z2p_core.errors.messages import error_reason
from z2p_core.formats.color_values import srgb_from_numbers, srgb_from_packed, srgb_from_sh
from z2p_core.formats.field_names import find_field_columns, is_color_vector, is_normal_vector, is_packed_color
from z2p_core.formats.las_classes import LAS_CLASS_NAMES
from z2p_core.interfaces import ScanError

MAX_CHANNELS = 16
"""Up to how many channels an array of vectors is split into scalars."""
RESERVED_NAMES = ("rgb", "normal")
LAS_NAMES = frozenset({"numberofreturns", "returnnumber", "pointsourceid", "scananglerank", "scanangle"})
"""Names of fields that clouds of LAS files have in any program, without case and underscores."""
SH_NAMES = ("f_dc_0", "f_dc_1", "f_dc_2")
"""Colors of Gaussian splats."""
Value = TypeVar("Value")


class LazyMapping(Mapping[str, Value]):
    """A mapping whose values are made when they are first asked for, and kept."""

    def __init__(self, makers: Mapping[str, Callable[[], Value]]) -> None:
        self._makers = {name: cache(maker) for name, maker in makers.items()}

    def __getitem__(self, name: str) -> Value:
        """
        Raises:
            KeyError: there is no such name.
            ScanError: another library fails to give the value.
        """
        maker = self._makers[name]
        try:
            return maker()
        except ScanError:
            raise
        except Exception as error:  # other libraries may raise anything
            raise ScanError(f"the points' {name} cannot be read ({error_reason(error)})") from error

    def __contains__(self, name: object) -> bool:
        return name in self._makers

    def __iter__(self) -> Iterator[str]:
        return iter(self._makers)

    def __len__(self) -> int:
        return len(self._makers)


@dataclass(frozen=True)
class ObjectFields:
    """Fields of an object's points; see `z2p_core.interfaces.RawCloud.fields` for their names and meaning."""

    values: Mapping[str, np.ndarray] = field(default_factory=dict)
    """Rows as the points of all the object's clouds, in order."""
    class_names: Mapping[str, Mapping[int, str]] = field(default_factory=dict)
    color_kind: str = ""
    left_out: Mapping[str, str] = field(default_factory=dict)
    """Of each name that is no field of the points, why: ``{"faces": "has shape (12, 3), for 8 points"}``."""
    notes: tuple[str, ...] = ()
    """What to tell the user: colors that were left out, and why."""


def object_fields(source: Any, leading: tuple[int, ...], is_batch: bool = False) -> ObjectFields:
    """The fields of an object whose points have shape (*leading, 3), (B, N, 3) for a batch.

    Colors are converted at once, all else when it is asked for. The clouds of a batch may share a field (N,).
    """
    try:
        if is_scene(source):
            return _scene_fields(source)
        return _fields_of_columns(object_columns(source), leading, is_batch)
    except Exception as error:  # objects of other libraries may raise anything
        note = f"the points' colours and other fields were left out: they cannot be read ({error_reason(error)})"
        return ObjectFields(notes=(note,))


def split_fields(fields: ObjectFields, counts: Sequence[int]) -> list[Mapping[str, np.ndarray]]:
    """The fields of each of several clouds with these numbers of points."""
    if len(counts) == 1:
        return [fields.values]
    ends = np.cumsum([0, *counts]).tolist()
    return [LazyMapping({name: partial(_load_rows, fields.values, name, start, end) for name in fields.values})
            for start, end in pairwise(ends)]  # fmt: skip


def _load_rows(values: Mapping[str, np.ndarray], name: str, start: int, end: int) -> np.ndarray:
    return values[name][start:end]


def _fields_of_columns(columns: Sequence[Column], leading: tuple[int, ...], is_batch: bool = False) -> ObjectFields:
    """Sorts an object's columns into color, normal, and all others."""
    left_out: dict[str, str] = {}
    flat = [_flatten(column, leading, is_batch, left_out) for column in _without_duplicates(columns)]
    fitting = [column for column in flat if column is not None]
    is_las = any(column.name.lower().replace("_", "") in LAS_NAMES for column in fitting)
    srgb, kind, color_names, failures = _find_color(fitting, is_las)
    makers: dict[str, Callable[[], np.ndarray]] = {}
    if srgb is not None:
        makers["rgb"] = lambda: srgb
    normal, normal_names = _find_normal(fitting)
    if normal is not None:
        makers["normal"] = normal
    rest = [column for column in fitting if column.name not in color_names and column.name not in normal_names]
    class_names: dict[str, Callable[[], Mapping[int, str]]] = {}
    for column in rest:
        _add_scalars(column, makers, class_names, left_out)
        if is_las and column.name.lower() == "classification":
            class_names[column.name] = lambda: LAS_CLASS_NAMES
    if srgb is None:
        failures += [f"{name} {reason}" for name, reason in left_out.items() if is_color_vector(name)]
    notes = tuple(f"the points' colours were left out: {failure}" for failure in failures if srgb is None)
    return ObjectFields(LazyMapping(makers), LazyMapping(class_names), kind, left_out, notes)


def _without_duplicates(columns: Sequence[Column]) -> list[Column]:
    """The first column of each name."""
    return list({column.name: column for column in reversed(columns)}.values())[::-1]


def _flatten(
    column: Column, leading: tuple[int, ...], is_batch: bool, left_out: dict[str, str]
) -> Column | None:  # fmt: skip
    """The column with one row for each point of all clouds, without axes of length 1; None if it does not fit."""
    count, shape = int(np.prod(leading)), column.shape
    layouts = [leading, (count,), *([leading[1:]] if is_batch else [])]
    used = next((axes for axes in layouts if shape[: len(axes)] == axes), None)
    if used is None or not column.kind:
        if shape:
            points = " x ".join(map(str, leading))
            left_out[column.name] = f"has shape {shape}, for {points} points" if used is None else "holds no numbers"
        return None
    rest = tuple(side for side in shape[len(used) :] if side != 1)

    def load() -> np.ndarray:
        values = column.load().reshape(-1, *rest)
        return values if len(values) == count else np.tile(values, (leading[0], *(1 for _ in rest)))

    return Column(column.name, (count, *rest), load, column.kind, column.color_scale)


Color = tuple[np.ndarray | None, str, tuple[str, ...], list[str]]
"""sRGB colors or None, their kind, the names of their columns, and why others were none."""


def _find_color(columns: Sequence[Column], is_las: bool) -> Color:
    """The first of the color columns that hold colors."""
    failures = []
    for group in _color_groups(columns):
        names = tuple(column.name for column in group)
        if group[0].shape[1:] == () and len(group) == 1:
            return srgb_from_packed(group[0].load()), "packed in 4 bytes", names, []
        values = group[0].load() if len(group) == 1 else np.column_stack([column.load() for column in group])
        if is_las and not np.any(values):  # LAS files without colors have zeros
            return None, "", names, []
        if names == SH_NAMES:
            return srgb_from_sh(values), "spherical harmonics of degree 0", names, []
        values = values.astype(np.uint8) if values.dtype == bool else values
        if group[0].color_scale is not None:
            return (values[:, :3] / np.float32(group[0].color_scale)).astype(np.float32), "8-bit", names, []
        srgb, kind = srgb_from_numbers(values)
        if kind:
            return srgb, kind, names, []
        failures.append(f"{', '.join(names)}: {_describe_failure(values)}")
    return None, "", (), failures


def _color_groups(columns: Sequence[Column]) -> Iterator[list[Column]]:
    """Columns that may be the points' colors, the most likely first: a vector, three channels, or one packed number."""
    numbers = [column for column in columns if column.kind == "f"]
    vectors = [column for column in numbers if len(column.shape) == 2 and column.shape[1] in (3, 4)]
    yield from ([column] for column in vectors if is_color_vector(column.name))
    scalars = [column for column in numbers if len(column.shape) == 1]
    names = [column.name for column in scalars]
    triple = find_field_columns(names).color
    if triple:
        yield [scalars[index] for index in triple]
    yield from ([column] for column in scalars if is_packed_color(column.name))
    yield from ([column] for column in vectors if column.color_scale is not None and not is_color_vector(column.name))
    if set(names) >= set(SH_NAMES):
        yield [scalars[names.index(name)] for name in SH_NAMES]


def _describe_failure(values: np.ndarray) -> str:
    """Why numbers (N, 3 or more) are no colors."""
    known = values[:, :3][np.isfinite(values[:, :3]).all(axis=1)]
    if not len(known):
        return "no row is finite"
    return f"expected numbers from 0 to 1, 255 or 65535, got {known.min():g} to {known.max():g}"


def _find_normal(columns: Sequence[Column]) -> tuple[Callable[[], np.ndarray] | None, tuple[str, ...]]:
    """What gives the normals (N, 3) float32, and the names of their columns; None if there are none."""
    for column in columns:
        if is_normal_vector(column.name) and column.shape[1:] == (3,) and column.kind == "f":
            return partial(_stack_normals, [column]), (column.name,)
    scalars = [column for column in columns if len(column.shape) == 1 and column.kind == "f"]
    triple = [scalars[index] for index in find_field_columns([column.name for column in scalars]).normal]
    if not triple:
        return None, ()
    names = tuple(column.name for column in triple)
    return partial(_stack_normals, triple), names


def _stack_normals(columns: Sequence[Column]) -> np.ndarray:
    return np.column_stack([column.load() for column in columns]).astype(np.float32)


def _add_scalars(
    column: Column, makers: dict[str, Callable[[], np.ndarray]],
    class_names: dict[str, Callable[[], Mapping[int, str]]], left_out: dict[str, str],
) -> None:  # fmt: skip
    """Adds the scalars of one column: itself, the codes of its words, or each channel as ``NAME_0``, ``NAME_1``, ..."""
    rest = column.shape[1:]
    if column.name in RESERVED_NAMES or len(rest) > 1 or (rest and (rest[0] > MAX_CHANNELS or column.kind == "O")):
        left_out[column.name] = f"has shape {column.shape}"
    elif rest:
        for channel in range(rest[0]):
            makers.setdefault(f"{column.name}_{channel}", partial(_load_channel, column, channel))
    elif column.kind == "O":
        encode = cache(lambda: _encode_words(column.load(), column.name))
        makers[column.name] = lambda: encode()[0]
        class_names[column.name] = lambda: encode()[1]
    else:
        makers[column.name] = lambda: _as_read_only_scalars(column.load())


def _load_channel(column: Column, channel: int) -> np.ndarray:
    return _as_read_only_scalars(column.load()[:, channel])


def _as_read_only_scalars(values: np.ndarray) -> np.ndarray:
    """A view of the caller's numbers that cannot change them; truth values as 0 and 1."""
    types = {"b": np.uint8, "O": np.float64}
    values = values.astype(types[values.dtype.kind]) if values.dtype.kind in types else values.view()
    values.flags.writeable = False
    return values


def _encode_words(words: np.ndarray, name: str) -> tuple[np.ndarray, dict[int, str]]:
    """Labels (N,) int32 of words (N,) in alphabetical order, and what they stand for; numbers as they are.

    Missing words are -1.
    """
    known = np.array([isinstance(word, str) for word in words])
    if not known.any():
        return _as_read_only_scalars(words), {}
    table, codes = np.unique(words[known].astype(str), return_inverse=True)
    labels = np.full(len(words), -1, dtype=np.int32)
    labels[known] = codes
    return labels, dict(enumerate(table.tolist()))


ScenePart = tuple[ObjectFields, np.ndarray, int]
"""Fields, transform (4, 4) to the world, and number of points."""


def _scene_fields(scene: Any) -> ObjectFields:
    """The fields of all placed parts; a part without a field has NaN there. Normals are turned with their part."""
    parts: list[ScenePart] = []
    for geometry, matrix in scene_nodes(scene):
        count = len(geometry.vertices)
        parts.append((_fields_of_columns(object_columns(geometry), (count,)), matrix, count))
    names = dict.fromkeys(name for fields, _, _ in parts for name in fields.values)
    kinds = dict.fromkeys(fields.color_kind for fields, _, _ in parts if fields.color_kind)
    makers = {name: partial(_join_parts, parts, name) for name in names}
    notes = dict.fromkeys(note for fields, _, _ in parts for note in fields.notes)
    return ObjectFields(LazyMapping(makers), {}, ", ".join(kinds), {}, tuple(notes))


def _join_parts(parts: Sequence[ScenePart], name: str) -> np.ndarray:
    """The field of that name of all parts."""
    blocks = []
    for fields, matrix, count in parts:
        if name not in fields.values:
            blocks.append(np.full((count, 3) if name in RESERVED_NAMES else count, np.nan, dtype=np.float32))
        elif name == "normal":
            blocks.append((fields.values[name] @ np.linalg.pinv(matrix[:3, :3])).astype(np.float32))
        else:
            blocks.append(fields.values[name])
    return np.concatenate(blocks)
