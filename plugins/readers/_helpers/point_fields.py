"""Fields of points from the columns of a table: colors, normals, and scalars by their own names."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from z2p_core.formats.color_values import srgb_from_numbers, srgb_from_packed, srgb_from_sh
from z2p_core.formats.field_names import (
    find_field_columns,
    is_color_vector,
    is_normal_vector,
    is_packed_color,
)
from z2p_core.interfaces import RawCloud

Wants = Callable[[str], bool]
"""`Reader.wants`: whether the field of a name is needed."""
BLACK_NOTE = "all its colours are 0, and taken as none"
UNUSABLE_NOTE = "its colours are no numbers from 0 to 65535, and are not taken"
PACKED_KIND, HARMONICS_KIND = "8-bit, packed", "spherical harmonics of degree 0"
_MAX_COMPONENTS = 16
"""Vectors of more components, such as descriptors, are left out."""
_PACKED_INTEGERS = 2.0**32
_RESERVED = ("rgb", "normal")


@dataclass(frozen=True)
class FieldPlan:
    """The fields that the columns of a table make, and which of them are needed."""

    columns_of: Mapping[str, tuple[int, ...]]
    """Of each of the file's fields, in its order, its columns: three of a color or a normal, else one."""
    needed: tuple[str, ...]
    harmonics: bool = False
    """Whether the color is that of Gaussian splats: coefficients of spherical harmonics of degree 0."""

    @property
    def columns(self) -> tuple[int, ...]:
        """Indices of the columns to read, ascending."""
        return tuple(sorted({column for name in self.needed for column in self.columns_of[name]}))

    def without(self, *names: str) -> FieldPlan:
        """The plan for a file whose fields of these names turned out to be none."""
        columns = {name: columns for name, columns in self.columns_of.items() if name not in names}
        return replace(self, columns_of=columns, needed=tuple(name for name in self.needed if name not in names))

    def fill(self, cloud: RawCloud, columns: Mapping[int, np.ndarray]) -> RawCloud:
        """The cloud with the fields that are needed, made of the columns (N,) by their indices."""
        fields: dict[str, np.ndarray] = {}
        kind, notes = cloud.color_kind, [cloud.note]
        for name in self.needed:
            parts = [columns[column] for column in self.columns_of[name]]
            if name == "rgb":
                values = parts[0] if len(parts) == 1 else np.column_stack(parts)
                color, kind, note = (srgb_from_sh(values), HARMONICS_KIND, "") if self.harmonics else make_color(values)
                notes.append(note)
                if color is not None:
                    fields[name] = color
            elif name == "normal":
                if any(part.any() for part in parts):
                    fields[name] = np.column_stack([plain_column(part) for part in parts])
            else:
                fields[name] = plain_column(parts[0])
        missing = {name for name in self.needed if name not in fields}
        return replace(cloud, fields=fields, field_names=tuple(name for name in self.columns_of if name not in missing),
                       color_kind=kind, note="; ".join(filter(None, notes)))  # fmt: skip


def plan_fields(names: Sequence[str], wants: Wants, points: Sequence[int] = ()) -> FieldPlan:
    """Plans the fields of a table by the names of its columns; `points` are those of x, y and z.

    Columns without a name are called by their number from 1; of equal names, the later ones get their number too.
    """
    found = find_field_columns(names, points)
    color = found.color or tuple(column for column in found.scalars if is_packed_color(names[column]))[:1]
    starts = {column: name for name, columns in (("rgb", color), ("normal", found.normal)) for column in columns[:1]}
    taken = {*points, *color, *found.normal}
    columns_of: dict[str, tuple[int, ...]] = {}
    for column, given in enumerate(names):
        if column in starts:
            columns_of[starts[column]] = {"rgb": color, "normal": found.normal}[starts[column]]
        elif column not in taken:
            name = given.strip() or f"column {column + 1}"
            is_taken = name in columns_of or name in _RESERVED
            columns_of[f"{name} (column {column + 1})" if is_taken else name] = (column,)
    return FieldPlan(columns_of, tuple(name for name in columns_of if wants(name)))


def make_color(values: np.ndarray) -> tuple[np.ndarray | None, str, str]:
    """sRGB colors (N, 3) float32 of numbers (N, 3 or 4) or packed ones (N,), what kind these are, and a note.

    The colors are None if the numbers can be none, or are all 0, which writers put where they know no colors.
    """
    if values.ndim == 1:
        colors = unpack_colors(values)
        kind = PACKED_KIND
    else:
        colors, kind = srgb_from_numbers(values)
    if len(colors) == 0 or not np.isfinite(colors).any():
        return None, "", UNUSABLE_NOTE if len(colors) else ""
    if not np.nan_to_num(colors).any():
        return None, "", BLACK_NOTE
    return colors, kind, ""


def unpack_colors(values: np.ndarray) -> np.ndarray:
    """sRGB colors (N, 3) float32 of packed ones (N,); NaN where the numbers can be none.

    Types of 4 bytes hold the bits. Other types come from text, where writers put the integer, or the float of its bits.
    """
    if values.dtype.itemsize == 4 or values.dtype.kind in "iu":
        return srgb_from_packed(values)
    known = values[np.isfinite(values)]
    if len(known) and known.min() >= 0 and known.max() < _PACKED_INTEGERS and not (known % 1).any():
        colors = srgb_from_packed(values)
        colors[~np.isfinite(values)] = np.nan
        return colors
    tiny, huge = np.abs(known) < 1e-30, np.abs(known) > 1e30
    if len(known) and (tiny | huge).all():  # the exponents of floats whose first byte is 0 or 255
        with np.errstate(all="ignore"):
            colors = srgb_from_packed(values.astype(np.float32))
        colors[~np.isfinite(values)] = np.nan
        return colors
    return np.full((len(values), 3), np.nan, dtype=np.float32)


def plain_column(values: np.ndarray) -> np.ndarray:
    """The values (N,), in memory of their own and in the byte order of the machine; truth values become 0 and 1."""
    values = np.asarray(values)
    kind = np.dtype(np.uint8) if values.dtype.kind == "b" else values.dtype.newbyteorder("=")
    if kind.kind == "f" and kind.itemsize not in (4, 8):  # half floats, and long doubles
        kind = np.dtype(np.float32 if kind.itemsize < 4 else np.float64)
    with np.errstate(all="ignore"):
        return np.array(values, dtype=kind)


def whole_if_whole(values: np.ndarray) -> np.ndarray:
    """Numbers of text (N,) float64 as int32 or int64 if all are whole: they may be labels."""
    if not len(values) or not np.isfinite(values).all() or (values % 1).any() or np.abs(values).max() > 2**53:
        return values
    return values.astype(np.int32 if np.abs(values).max() < 2**31 else np.int64)


@dataclass(frozen=True)
class ArrayFields:
    """Fields of arrays beside the points, each of one or several components."""

    plan: FieldPlan
    sources: tuple[tuple[str, int], ...]
    """Of each column of the plan, the name of its array and the component."""

    @property
    def arrays(self) -> tuple[str, ...]:
        """Names of the arrays to read."""
        return tuple(dict.fromkeys(self.sources[column][0] for column in self.plan.columns))

    def fill(self, cloud: RawCloud, arrays: Mapping[str, np.ndarray]) -> RawCloud:
        """The cloud with the fields of arrays (N,) or (N, C), rows as its points, by their names."""
        tables = {name: array.reshape(len(array), -1) for name, array in arrays.items()}
        columns = {column: tables[self.sources[column][0]][:, self.sources[column][1]] for column in self.plan.columns}
        return self.plan.fill(cloud, columns)


def only_bytes(arrays: Mapping[str, tuple[int, np.dtype]]) -> str:
    """The only array of three or four bytes a point, which VTK draws as colors; empty if one is named as such."""
    names = [name for name, (width, kind) in arrays.items() if width in (3, 4) and kind == np.uint8]
    named = any(is_color_vector(name) and width in (3, 4) for name, (width, _) in arrays.items())
    return names[0] if len(names) == 1 and not named else ""


def plan_arrays(widths: Mapping[str, int], wants: Wants, color: str = "") -> ArrayFields:
    """Plans the fields of arrays with so many components each; the one named `color` holds colors by its format.

    A vector that is called color or normal is one; the components of others are numbered from 0.
    """
    names: list[str] = []
    sources: list[tuple[str, int]] = []
    seen: set[str] = set()
    color = color or next((name for name, width in widths.items() if is_color_vector(name) and width in (3, 4)), "")
    for name, width in widths.items():
        if width > _MAX_COMPONENTS:
            continue
        components = [f"{name}_{index}" for index in range(width)] if width > 1 else [name]
        if name == color and width in (3, 4):
            components = ["red", "green", "blue", "alpha"][:width]
        elif width == 3 and is_normal_vector(name) and "normal" not in seen:
            components = ["nx", "ny", "nz"]
            seen.add("normal")
        names += components
        sources += [(name, index) for index in range(width)]
    return ArrayFields(plan_fields(names, wants), tuple(sources))
