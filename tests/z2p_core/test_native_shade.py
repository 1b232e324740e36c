"""The kernel that hides lamps from the floor: shade lies where it should, as dark as it should be."""

import numpy as np
import pytest
from point_shapes import square_of

from z2p_core import native


def test_the_shade_of_a_sheet_on_the_floor_has_its_size_and_place():
    side, half = 200, 2.0
    sheet = square_of(20_000, 0.25, 0.0) + np.float32([0.5, 0, 0])
    lamps = np.float32([[0.5, 0, 2.0], [0.5, 0, 50.0]])
    shade = native.floor_shade(sheet, lamps, -1.0, half, side)
    cell = 2 * half / side
    rows, columns = np.nonzero(shade)
    middle = (columns.mean() + 0.5) * cell - half, (rows.mean() + 0.5) * cell - half
    assert middle == pytest.approx((0.5, 0), abs=cell)
    # the near lamp stretches half a unit by 3 / 2, the far one hardly
    assert len(rows) * cell**2 == pytest.approx(0.75**2, rel=0.08)
    assert (shade == 1.0).sum() * cell**2 == pytest.approx((0.5 * 51 / 50) ** 2, rel=0.08)
    assert set(np.unique(shade)) == {0.0, 0.5, 1.0}


def test_an_eye_below_the_floor_sees_a_sheet_smaller_on_it():
    """As in a mirror: the floor lies between the two, at two thirds of the way to the sheet."""
    side, half = 200, 2.0
    eye = np.float32([[0.5, 0, -3.0]])
    shade = native.floor_shade(square_of(20_000, 0.45, 0.0) + np.float32([0.5, 0, 0]), eye, -1.0, half, side)
    rows, columns = np.nonzero(shade)
    assert len(rows) * (2 * half / side) ** 2 == pytest.approx(0.6**2, rel=0.08)
    assert (columns.mean() + 0.5) * 2 * half / side - half == pytest.approx(0.5, abs=0.02)


def test_parts_of_a_square_light_count_as_much_as_they_shine():
    """Against each part alone, weighed by what it gives the cell."""
    side, half, floor = 60, 2.0, -0.7
    middle, across, up = square = np.float32([[0.9, -1.6, 1.9], [1.4, 0.8, 0.0], [-0.5, 0.9, 1.3]])
    axis = np.cross(up, across) / np.linalg.norm(np.cross(up, across))
    steps = (np.arange(8) + 0.5) / 8 - 0.5
    lamps = np.float32([middle + x * across + y * up for y in steps for x in steps])
    sheet = square_of(6_000, 0.5, 0.3)
    shade = native.floor_shade(sheet, lamps, floor, half, side, square=square)
    x, y = np.meshgrid(*[(np.arange(side) + 0.5) / side * 2 * half - half] * 2)
    full, lost = np.zeros((side, side)), np.zeros((side, side))
    for lamp in lamps:
        away = lamp - np.stack([x, y, np.full_like(x, floor)], -1)
        given = np.abs(away @ axis) * away[..., 2] / (away**2).sum(-1) ** 2
        full += given
        lost += given * native.floor_shade(sheet, lamp[None], floor, half, side)
    expected, even = lost / full, native.floor_shade(sheet, lamps, floor, half, side)
    assert np.abs(shade - expected).mean() < 0.2 * np.abs(even - expected).mean()


def test_a_soft_shade_is_the_mean_over_the_cells_around():
    side, soft, sheet = 90, 3, square_of(4_000, 0.4, 0.0) + np.float32([0.3, -0.5, 0])
    lamps = np.float32([[0.5, 0, 2.0], [0.5, 0.4, 3.0]])
    sharp = native.floor_shade(sheet, lamps, -1.0, 2.0, side)
    padded = np.pad(sharp, soft)
    mean = sum(padded[i : i + side, j : j + side] for i in range(7) for j in range(7)) / 49
    np.testing.assert_allclose(native.floor_shade(sheet, lamps, -1.0, 2.0, side, soft=soft), mean, atol=1e-6)


def test_points_above_a_lamp_and_far_off_cast_no_shade():
    points = np.float32([[0, 0, 2.5], [0, 0, 2.0], [1.9, 0, 1.9]])
    assert not native.floor_shade(points, np.float32([[0, 0, 2.0]]), -1.0, 2.0, 64).any()
