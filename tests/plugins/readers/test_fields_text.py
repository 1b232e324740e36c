"""Text: colors and scalars by the names of columns, by the format, or by numbers that leave no doubt."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from reader_files import read_fields

from z2p_core.interfaces import RawCloud

COUNT = 120
RNG = np.random.default_rng(1)
POINTS = RNG.normal(size=(COUNT, 3)).round(5)
COLORS = RNG.integers(0, 256, (COUNT, 3))
SHARES = RNG.random((COUNT, 3)).round(6)
NORMALS = POINTS / np.linalg.norm(POINTS, axis=1, keepdims=True)
LABELS = RNG.integers(0, 9, COUNT)
INTENSITY = RNG.integers(-2048, 2048, COUNT)
HEIGHT = RNG.random(COUNT).round(6) * 40


def write(path: Path, *columns: np.ndarray, head: str = "", separator: str = " ") -> Path:
    parts = [np.asarray(column).reshape(COUNT, -1) for column in columns]
    rows = [separator.join(repr(number) for part in parts for number in part[row].tolist()) for row in range(COUNT)]
    path.write_text(head + "\n".join(rows) + "\n")
    return path


def read(path: Path, *wanted: str, columns: tuple[str, ...] | None = None) -> RawCloud:
    [cloud] = read_fields(path, wanted or None, columns)
    return cloud


def has_colors(cloud: RawCloud, colors: np.ndarray = COLORS / 255) -> bool:
    return bool(np.allclose(cloud.fields["rgb"], colors, atol=1e-6))


def test_cloudcompares_header_names_all_columns(tmp_path: Path) -> None:
    head = f"//X Y Z R G B Scalar_field Classification Nx Ny Nz\n{COUNT}\n"
    cloud = read(write(tmp_path / "a.txt", POINTS, COLORS, HEIGHT, LABELS, NORMALS, head=head))
    assert cloud.field_names == ("rgb", "Scalar_field", "Classification", "normal") and not cloud.note
    assert has_colors(cloud) and cloud.color_kind == "8-bit"
    assert np.array_equal(cloud.fields["Classification"], LABELS) and cloud.fields["Classification"].dtype == np.int32
    np.testing.assert_allclose(cloud.fields["Scalar_field"], HEIGHT)
    np.testing.assert_allclose(cloud.fields["normal"], NORMALS)
    assert np.array_equal(cloud.points, POINTS)


@pytest.mark.parametrize("separator", [",", ";", "\t"])
def test_tables_of_named_columns(tmp_path: Path, separator: str) -> None:
    names = ["Label", "x", "y", "height [m]", "z", "red", "green", "blue"]
    path = write(tmp_path / "a.csv", LABELS, POINTS[:, :2], HEIGHT, POINTS[:, 2], COLORS,
                 head=separator.join(names) + "\n", separator=separator)  # fmt: skip
    cloud = read(path)
    assert cloud.field_names == ("Label", "height", "rgb") and cloud.units == {"height": "m"}
    assert has_colors(cloud) and np.array_equal(cloud.fields["Label"], LABELS)
    some = read(path, "HEIGHT")
    assert list(some.fields) == ["height"] and np.array_equal(some.points, POINTS)


def test_named_columns_of_words_are_no_fields(tmp_path: Path) -> None:
    rows = "".join(f"oak {x} {y} {z} {r} {g} {b} {i if i % 7 else ''}\n" for i, ((x, y, z), (r, g, b))
                   in enumerate(zip(POINTS.tolist(), COLORS.tolist(), strict=True))).replace(" ", ",")  # fmt: skip
    (tmp_path / "a.csv").write_text("kind,x,y,z,r,g,b,count\n" + rows)
    cloud = read(tmp_path / "a.csv")
    assert cloud.field_names == ("rgb", "count") and has_colors(cloud)
    assert np.isnan(cloud.fields["count"][::7]).all() and cloud.fields["count"][1] == 1


def test_the_users_names_of_columns(tmp_path: Path) -> None:
    path = write(tmp_path / "a.txt", POINTS, INTENSITY, COLORS)
    cloud = read(path, columns=("x", "y", "z", "intensity", "r", "g", "b"))
    assert has_colors(cloud) and np.array_equal(cloud.fields["intensity"], INTENSITY) and not cloud.note


def test_packed_colors_in_text(tmp_path: Path) -> None:
    bits = (COLORS[:, 0] << 16 | COLORS[:, 1] << 8 | COLORS[:, 2]).astype(np.uint32)
    for values in (bits, bits.view("f4").astype("f8")):
        assert has_colors(read(write(tmp_path / "a.txt", POINTS, values, head="x y z rgb\n")))
    cloud = read(write(tmp_path / "a.txt", POINTS, HEIGHT, head="x y z rgb\n"))
    assert not cloud.fields and "no numbers from 0 to 65535" in cloud.note


@pytest.mark.parametrize(("columns", "has_intensity"), [((INTENSITY, COLORS), True), ((COLORS,), False)])
def test_pts_has_intensities_and_colors(tmp_path: Path, columns, has_intensity: bool) -> None:
    cloud = read(write(tmp_path / "a.pts", POINTS, *columns, head=f"{COUNT}\n"))
    assert has_colors(cloud) and not cloud.note and ("intensity" in cloud.fields) == has_intensity
    if has_intensity:
        assert np.array_equal(cloud.fields["intensity"], INTENSITY)
    assert read(write(tmp_path / "b.pts", POINTS, INTENSITY, head=f"{COUNT}\n")).field_names == ("intensity",)


def test_pts_of_several_scans_keeps_its_rows(tmp_path: Path) -> None:
    rows = [" ".join(map(repr, [*point, 7, *color])) for point, color in zip(POINTS.tolist(), COLORS.tolist(),
                                                                             strict=True)]  # fmt: skip
    (tmp_path / "a.pts").write_text("\n".join(["50", *rows[:50], str(COUNT - 50), *rows[50:]]) + "\n")
    assert has_colors(read(tmp_path / "a.pts"))


@pytest.mark.parametrize("suffix", [".txt", ".xyz", ".asc", ".csv"])
@pytest.mark.parametrize(("columns", "names", "colors"), [
    ((COLORS,), ("rgb",), COLORS / 255), ((SHARES,), ("rgb",), SHARES), ((NORMALS,), ("normal",), None),
    ((COLORS, NORMALS), ("rgb", "normal"), COLORS / 255), ((NORMALS, COLORS), ("normal", "rgb"), COLORS / 255),
    ((INTENSITY, COLORS), ("column 4", "rgb"), COLORS / 255), ((COLORS, LABELS), ("rgb", "column 7"), COLORS / 255),
    ((HEIGHT,), ("column 4",), None),
])  # fmt: skip
def test_unnamed_columns_that_leave_no_doubt(tmp_path, suffix, columns, names, colors) -> None:
    cloud = read(write(tmp_path / f"a{suffix}", POINTS, *columns, separator="," if suffix == ".csv" else " "))
    assert cloud.field_names == names and set(cloud.fields) == set(names)
    assert colors is None or has_colors(cloud, colors)
    assert ("taken as colours" in cloud.note) == (colors is not None)


COUNTS = np.column_stack([1 + LABELS % 3, 1 + LABELS % 4, LABELS])
PARTS = SHARES / SHARES.sum(1, keepdims=True)


@pytest.mark.parametrize("columns", [
    (COUNTS,), (RNG.integers(0, 256, COUNT), COUNTS[:, :2]), (PARTS,), ((POINTS - POINTS.min(0)) / 9,),
    (RNG.integers(0, 256, (COUNT, 4)),), (np.arange(COUNT), COLORS[:, :2]), (np.full((COUNT, 3), 90),),
    (RNG.integers(0, 2000, (COUNT, 3)),), (COLORS - 5,), (COLORS * 1000.0,), (np.sign(POINTS) > 0,),
], ids=["counts", "intensity", "parts", "unit cube", "four", "numbers", "constants", "pixels", "negative", "large",
        "bits"])  # fmt: skip
def test_columns_that_may_be_no_colors_are_none(tmp_path: Path, columns: tuple[np.ndarray, ...]) -> None:
    cloud = read(write(tmp_path / "a.txt", POINTS, *(np.asarray(column) + 0 for column in columns)))
    assert "rgb" not in cloud.fields and "rgb" not in cloud.field_names


def test_a_guess_is_tried_on_the_whole_file(tmp_path: Path) -> None:
    rows = np.tile(np.column_stack([POINTS, COLORS]), (20, 1))
    rows[2000:, 3:] = -7
    (tmp_path / "a.txt").write_text("\n".join(" ".join(map(repr, row)) for row in rows.tolist()))
    cloud = read(tmp_path / "a.txt")
    assert "rgb" not in cloud.fields and not cloud.note


def test_colmaps_colors_errors_and_tracks(tmp_path: Path) -> None:
    head = "# 3D point list\n#   POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[] as (IMAGE_ID, POINT2D_IDX)\n"
    table = np.column_stack([POINTS, COLORS, SHARES[:, 0]]).astype(object)
    table[:, 3:6] = COLORS
    rows = [" ".join(map(str, [row + 9, *table[row], *[4, 17] * length])) for row, length in enumerate(LABELS)]
    (tmp_path / "points3D.txt").write_text(head + "\n".join(rows) + "\n")
    cloud = read(tmp_path / "points3D.txt")
    assert has_colors(cloud) and cloud.units == {"ERROR": "px"}
    assert np.array_equal(cloud.fields["track_length"], LABELS)
    np.testing.assert_allclose(cloud.fields["ERROR"], SHARES[:, 0])
    assert np.array_equal(cloud.fields["POINT3D_ID"], np.arange(COUNT) + 9) and np.array_equal(cloud.points, POINTS)
    assert list(read(tmp_path / "points3D.txt", "rgb").fields) == ["rgb"]


def test_a_missing_color_is_nan(tmp_path: Path) -> None:
    rows = [f"{x},{y},{z},{'' if row % 4 == 0 else r},{g},{b}" for row, ((x, y, z), (r, g, b)) in
            enumerate(zip(POINTS.tolist(), COLORS.tolist(), strict=True))]  # fmt: skip
    (tmp_path / "a.csv").write_text("x,y,z,r,g,b\n" + "\n".join(rows))
    cloud = read(tmp_path / "a.csv")
    expected = np.where((np.arange(COUNT) % 4 == 0)[:, None], np.nan, COLORS / 255)
    np.testing.assert_allclose(cloud.fields["rgb"], expected, atol=1e-6)
