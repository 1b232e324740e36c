"""Colors and normals of a table are recognized by the names of their columns."""

from __future__ import annotations

import pytest

from z2p_core.formats.field_names import find_field_columns


@pytest.mark.parametrize(("names", "color", "normal", "scalars"), [
    ("x y z red green blue alpha intensity", (3, 4, 5), (), (6, 7)),
    ("X Y Z R G B Nx Ny Nz", (3, 4, 5), (6, 7, 8), ()),
    ("x y z b g r", (5, 4, 3), (), ()),
    ("x y z r g label", (), (), (3, 4, 5)),
    ("x y z red red green blue", (), (), (3, 4, 5, 6)),
    ("Points:0 Points:1 Points:2 RGB:0 RGB:1 RGB:2 Normals:0 Normals:1 Normals:2", (3, 4, 5), (6, 7, 8), ()),
])  # fmt: skip
def test_columns_are_sorted_by_name(
    names: str, color: tuple[int, ...], normal: tuple[int, ...], scalars: tuple[int, ...]
) -> None:
    columns = find_field_columns(names.split(), points=(0, 1, 2))
    assert (columns.color, columns.normal, columns.scalars) == (color, normal, scalars)
