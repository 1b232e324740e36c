"""A figure's table: titles, one size, one color and one camera for each shape, in pixels and in documents."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from click.testing import Result
from PIL import Image

from z2p_core.coloring.scales import ColorScale
from z2p_core.interfaces import SettingError
from z2p_renderer.pipeline.outputs.figure import FigurePage, lay_out
from z2p_renderer.storage.figure_tables import FigureCell, FigureTable

TABLE = FigureTable(("In $x$ & y", "Out"), ("Shape", ""), ((FigureCell(Path("a")), None),) * 2)
PICTURE = np.full((40, 60, 4), (200, 30, 30, 128), np.uint8)


def test_pictures_lie_in_their_cells_as_they_are() -> None:
    layout = lay_out(TABLE, (60, 40), 72)
    page = FigurePage(TABLE, layout).pixels({(1, 1): PICTURE})
    left, top = layout.corner(1, 1)
    assert np.array_equal(page[top : top + 40, left : left + 60], PICTURE)
    assert page.shape[:2] == layout.size(TABLE)[::-1]
    assert page[: layout.top, layout.left :, 3].any() and page[top:, : layout.left, 3].sum() == 0  # titles, or none


@pytest.mark.parametrize("scale", [None, ColorScale("intensity", "viridis", 0.0, 12.0, "dB")])
def test_a_figure_has_the_width_that_is_asked_for(scale: ColorScale | None) -> None:
    layout = lay_out(TABLE, (60, 40), 150, width_mm=80, scale=scale)
    width = FigurePage(TABLE, layout, scale).pixels({}).shape[1]
    assert width == pytest.approx(80 / 25.4 * 150, abs=4)
    assert layout.cell[1] == round(layout.cell[0] * 40 / 60)


def test_a_figure_too_narrow_for_its_cells_is_refused() -> None:
    with pytest.raises(SettingError, match="leave"):
        lay_out(TABLE, (60, 40), 72, width_mm=20)


def test_documents_hold_titles_as_text_and_pictures_as_they_are() -> None:
    layout = lay_out(TABLE, (60, 40), 72)
    page = FigurePage(TABLE, layout)
    svg = page.document({(0, 0): PICTURE}, "svg").decode()
    assert re.findall(r"<text[^>]*>([^<]*)<", svg) == ["In $x$ &amp; y", "Out", "Shape"]
    assert svg.count("<image") == 1
    pdf = page.document({(0, 0): PICTURE}, "pdf")
    assert b"/Width 60" in pdf and b"/Height 40" in pdf and pdf == page.document({(0, 0): PICTURE}, "pdf")


def test_the_command_draws_a_shape_in_one_color_before_one_camera(
    tmp_path: Path, z2p: Callable[..., Result], tiny_weights: Path, cloud: np.ndarray
) -> None:
    np.save(tmp_path / "a.npy", cloud)
    np.save(tmp_path / "b.npy", cloud * (1, 1, 0.5))
    np.save(tmp_path / "both.npy", np.stack([cloud, cloud + 1]))
    Image.fromarray(PICTURE).save(tmp_path / "truth.png")
    (tmp_path / "t.csv").write_text(",A,B,C\n1,a.npy,a.npy,truth.png\n2,b.npy,both.npy#3,\n")
    words = ("figure", tmp_path / "t.csv", "--weights", tiny_weights, "--resolution", 48, "--dpi", 72)
    done = z2p(*words, "--palette", "okabe-ito", "--output", tmp_path / "f.png")
    assert done.exit_code == 1 and "both.npy: holds 2 clouds" in done.output  # its cell stays empty
    figure = Image.open(tmp_path / "f.png")
    assert figure.info["dpi"][0] == pytest.approx(72, abs=0.01)
    pixels, step = np.asarray(figure), 48 + 3
    left, top = pixels.shape[1] - 3 * 48 - 2 * 3, pixels.shape[0] - 2 * 48 - 3
    one, other, truth = (pixels[top : top + 48, left + index * step :][:, :48] for index in range(3))
    assert np.array_equal(one, other) and one[..., 3].any()
    assert np.abs(truth[24, 24].astype(int) - (200, 30, 30, 128)).max() <= 1
    assert not pixels[top + step :, left + step :, 3].any()
    assert z2p(*words, "--output", tmp_path / "f.png").exit_code == 2  # it is there already
    film = z2p(*words, "--frames", 2, "--output", tmp_path / "f.gif", "--quiet")
    assert film.exit_code == 1 and Image.open(tmp_path / "f.gif").n_frames == 2
