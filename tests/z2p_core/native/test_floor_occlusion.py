"""Occlusion of the floor: size, place and depth of shadows against plain geometry."""

import numpy as np
import pytest
from point_shapes import square_of

from z2p_core import native


def test_the_shadow_of_a_sheet_has_its_size_and_place():
    side, half = 200, 2.0
    sheet = square_of(20_000, 0.25, 0.0) + np.float32([0.5, 0, 0])
    samples = np.float32([[0.5, 0, 2.0], [0.5, 0, 50.0]])
    occlusion = native.floor_occlusion(sheet, samples, -1.0, half, side)
    cell = 2 * half / side
    rows, columns = np.nonzero(occlusion)
    middle = (columns.mean() + 0.5) * cell - half, (rows.mean() + 0.5) * cell - half
    assert middle == pytest.approx((0.5, 0), abs=cell)
    # the near sample stretches half a unit by 3 / 2, the far one hardly
    assert len(rows) * cell**2 == pytest.approx(0.75**2, rel=0.08)
    assert (occlusion == 1.0).sum() * cell**2 == pytest.approx((0.5 * 51 / 50) ** 2, rel=0.08)
    assert set(np.unique(occlusion)) == {0.0, 0.5, 1.0}


def test_a_mirrored_camera_sees_a_sheet_smaller_on_the_floor():
    """As in a mirror: the floor lies between the two, at two thirds of the way to the sheet."""
    side, half = 200, 2.0
    camera = np.float32([[0.5, 0, -3.0]])
    occlusion = native.floor_occlusion(square_of(20_000, 0.45, 0.0) + np.float32([0.5, 0, 0]), camera, -1.0, half, side)
    rows, columns = np.nonzero(occlusion)
    assert len(rows) * (2 * half / side) ** 2 == pytest.approx(0.6**2, rel=0.08)
    assert (columns.mean() + 0.5) * 2 * half / side - half == pytest.approx(0.5, abs=0.02)


def mean_around(grid: np.ndarray, cells: int) -> np.ndarray:
    """The mean over this many cells to every side; cells beyond the border count as 0."""
    padded, window, side = np.pad(grid, cells), 2 * cells + 1, len(grid)
    return sum(padded[i : i + side, j : j + side] for i in range(window) for j in range(window)) / window**2


def square_light(middle: tuple[float, float, float]) -> tuple[np.ndarray, np.ndarray]:
    """A tilted square light above the floor, and its 64 samples."""
    square = np.float32([middle, [1.4, 0.8, 0.0], [-0.5, 0.9, 1.3]])
    steps = (np.arange(8) + 0.5) / 8 - 0.5
    return square, np.float32([square[0] + x * square[1] + y * square[2] for y in steps for x in steps])


def test_light_samples_count_by_the_light_that_they_give():
    """Compared with each sample alone, weighted by the irradiance that it gives the cell."""
    side, half, floor = 160, 2.0, -0.7
    square, samples = square_light((0.9, -1.6, 1.9))
    axis = np.cross(square[2], square[1]) / np.linalg.norm(np.cross(square[2], square[1]))
    sheet = square_of(40_000, 0.5, 0.3)
    occlusion = native.floor_occlusion(sheet, samples, floor, half, side, blur_cells=2, area_light=square)
    x, y = np.meshgrid(*[(np.arange(side) + 0.5) / side * 2 * half - half] * 2)
    full, hidden = np.zeros((side, side)), np.zeros((side, side))
    for number, sample in enumerate(samples):
        to_sample = sample - np.stack([x, y, np.full_like(x, floor)], -1)
        irradiance = np.abs(to_sample @ axis) * to_sample[..., 2] / (to_sample**2).sum(-1) ** 2
        one_sample = np.where(np.arange(64)[:, None] == number, samples, np.float32([0, 0, -0.6]))  # others are below
        full += irradiance
        hidden += irradiance * 64 * native.floor_occlusion(sheet, one_sample, floor, half, side)
    expected, unweighted = hidden / full, native.floor_occlusion(sheet, samples, floor, half, side)
    # compared after a blur, as the kernel smooths the steps from sample to sample
    errors = [np.abs(mean_around(result - expected, 4)).mean() for result in (occlusion, unweighted)]
    assert errors[0] < 0.25 * errors[1]


def test_a_penumbra_has_no_steps():
    """A half plane's edge hides the samples row by row; the floor must darken evenly nevertheless."""
    side, half = 400, 2.0
    rows = (np.arange(8) + 0.5) / 8 - 0.5
    square = np.float32([[0, 0, 2.0], [1.6, 0, 0], [0, 1.6, 0]])
    samples = np.float32([[1.6 * x, 1.6 * y, 2.0] for y in rows for x in rows])
    sheet = square_of(60_000, 0.7, 0.0) + np.float32([0.7, 0, 0])
    steps = []
    for blur, light in ((0, None), (2, square)):
        occlusion = native.floor_occlusion(sheet, samples, -1.0, half, side, blur_cells=blur, area_light=light)
        steps.append(np.diff(occlusion[side // 2, 150:250]))
    assert np.median(steps[1]) > 0  # with steps, most cells are as dark as the next
    assert steps[1].std() < 0.4 * steps[0].std()


@pytest.mark.parametrize(("eroded_share", "number", "wider"), [(0.0, 0, 1), (0.25, 0, 0), (0.25, 1, 1), (1.0, 1, 0)])
def test_eroded_samples_have_shadows_a_cell_narrower(eroded_share: float, number: int, wider: int):
    """Averaged over positions relative to the cells: eroded shadows have the sheet's width, others a cell more."""
    side, half = 120, 2.0
    samples = np.where(np.arange(64)[:, None] == number, np.float32([0, 0, 4000.0]), np.float32([0, 0, -0.3]))
    widths, middles = [], []
    for shift in np.linspace(0, 2 * half / side, 10, endpoint=False, dtype=np.float32):
        sheet = square_of(40_000, 0.5, 0.0) + np.float32([shift, 0, 0])
        row = native.floor_occlusion(sheet, samples, -0.5, half, side, eroded_share)[side // 2] * 64
        widths.append(row.sum())
        middles.append((np.flatnonzero(row).mean() + 0.5) * 2 * half / side - half - shift)
    assert np.mean(widths) == pytest.approx(side / (2 * half) + wider, abs=0.2)
    assert np.mean(middles) == pytest.approx(0, abs=0.2 * 2 * half / side)


def test_blur_is_the_mean_over_the_cells_around():
    side, blur, sheet = 90, 3, square_of(4_000, 0.4, 0.0) + np.float32([0.3, -0.5, 0])
    samples = np.float32([[0.5, 0, 2.0], [0.5, 0.4, 3.0]])
    sharp = native.floor_occlusion(sheet, samples, -1.0, 2.0, side)
    blurred = native.floor_occlusion(sheet, samples, -1.0, 2.0, side, blur_cells=blur)
    np.testing.assert_allclose(blurred, mean_around(sharp, blur), atol=1e-6)


def test_points_above_the_light_or_far_off_cast_no_shadow():
    points = np.float32([[0, 0, 2.5], [0, 0, 2.0], [1.9, 0, 1.9]])
    assert not native.floor_occlusion(points, np.float32([[0, 0, 2.0]]), -1.0, 2.0, 64).any()


@pytest.mark.parametrize("share", [0.0, 0.25, 0.5, 0.8, 1.0])
def test_eroded_samples_are_spread_evenly_over_the_light(share: float):
    """The width of each sample's own shadow shows whether it is eroded; each quarter of the light has as many."""
    side, sheet = 60, square_of(4_000, 0.5, 0.0)
    below, widths = np.float32([0, 0, -0.3]), []
    for number in range(64):
        samples = np.where(np.arange(64)[:, None] == number, np.float32([0, 0, 4000.0]), below)
        widths.append(native.floor_occlusion(sheet, samples, -0.5, 2.0, side, share).sum())
    is_eroded = np.full((8, 8), share == 1)
    if 0 < share < 1:
        is_eroded = (np.float32(widths) < max(widths) - 1e-3).reshape(8, 8)
    assert is_eroded.sum() == round(64 * share)
    for quarter in (is_eroded[:4, :4], is_eroded[:4, 4:], is_eroded[4:, :4], is_eroded[4:, 4:]):
        assert abs(quarter.mean() - share) <= 1 / 16


@pytest.mark.parametrize(("side", "wide"), [(40, 100), (90, 40), (50, 50)])
def test_a_resampled_linear_grid_stays_linear(side: int, wide: int):
    def slope(cells: int) -> np.ndarray:
        x, y = np.meshgrid(*[(np.arange(cells, dtype=np.float32) + 0.5) / cells] * 2)
        return 0.2 + 0.5 * x + 0.1 * y

    edge = -(-wide // side)  # cells beyond the outermost centers, where values are constant
    result = native.resample_grid(slope(side), wide)[edge:-edge, edge:-edge]
    np.testing.assert_allclose(result, slope(wide)[edge:-edge, edge:-edge], atol=1e-5)
    assert (native.resample_grid(np.full((side, side), 0.3, np.float32), wide) == np.float32(0.3)).all()
