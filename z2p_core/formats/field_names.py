"""Which of a table's columns are color and normal, by their names; the others are scalar fields."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

_COLOR_TRIPLES = (
    ("red", "green", "blue"), ("r", "g", "b"), ("diffuse_red", "diffuse_green", "diffuse_blue"),
    ("colorred", "colorgreen", "colorblue"), ("color_r", "color_g", "color_b"), ("color:0", "color:1", "color:2"),
    ("rgb:0", "rgb:1", "rgb:2"), ("colors:0", "colors:1", "colors:2"), ("rgb_0", "rgb_1", "rgb_2"),
    ("vertex_red", "vertex_green", "vertex_blue"), ("scalar_red", "scalar_green", "scalar_blue"),
    ("scalar_r", "scalar_g", "scalar_b"), ("rf", "gf", "bf"), ("rot", "grün", "blau"), ("rot", "gruen", "blau"),
    ("rouge", "vert", "bleu"), ("col_r", "col_g", "col_b"), ("cr", "cg", "cb"),
)  # fmt: skip
"""Names of three columns of color, lower-case; the plainest first."""
_PACKED_COLOR_NAMES = ("rgb", "rgba")
_COLOR_VECTOR_NAMES = ("rgb", "rgba", "colors", "colours", "color", "colour")
_NORMAL_TRIPLES = (
    ("nx", "ny", "nz"), ("normal_x", "normal_y", "normal_z"), ("normalx", "normaly", "normalz"),
    ("normals:0", "normals:1", "normals:2"), ("normal:0", "normal:1", "normal:2"), ("n_x", "n_y", "n_z"),
    ("nor_x", "nor_y", "nor_z"), ("scalar_nx", "scalar_ny", "scalar_nz"),
)  # fmt: skip
_NORMAL_VECTOR_NAMES = ("normal", "normals")


@dataclass(frozen=True)
class FieldColumns:
    """Indices of the columns of a table by what they hold; those of x, y and z are in none."""

    color: tuple[int, ...] = ()
    """Red, green and blue; empty if there are none."""
    normal: tuple[int, ...] = ()
    scalars: tuple[int, ...] = ()
    """All others."""


def field_key(name: str) -> str:
    """What is compared of a field's name: letters and digits in lower case, without CloudCompare's ``scalar_``."""
    return "".join(letter for letter in name.casefold().removeprefix("scalar_") if letter.isalnum()) or name


def find_field_columns(names: Sequence[str], points: Sequence[int] = ()) -> FieldColumns:
    """Sorts the columns of a table by their names; `points` are the columns of x, y and z."""
    plain = [name.strip().lower() for name in names]
    color, normal = (_find_triple(plain, triples) for triples in (_COLOR_TRIPLES, _NORMAL_TRIPLES))
    taken = {*points, *color, *normal}
    return FieldColumns(color, normal, tuple(index for index in range(len(names)) if index not in taken))


def is_color_vector(name: str) -> bool:
    """Whether an array of that name, of three or four channels, holds the points' colors."""
    return name.strip().lower() in _COLOR_VECTOR_NAMES


def is_normal_vector(name: str) -> bool:
    """Whether an array of that name, of three channels, holds the points' normals."""
    return name.strip().lower() in _NORMAL_VECTOR_NAMES


def is_packed_color(name: str) -> bool:
    """Whether a column of that name holds colors of three bytes in one number, as the Point Cloud Library writes."""
    return name.strip().lower() in _PACKED_COLOR_NAMES


def _find_triple(names: Sequence[str], triples: Sequence[tuple[str, ...]]) -> tuple[int, ...]:
    """Indices of the first triple of names that is complete and unambiguous; empty for none."""
    for triple in triples:
        if all(names.count(name) == 1 for name in triple):
            return tuple(names.index(name) for name in triple)
    return ()
