"""Colour fidelity: known shifts of hue, lightness and chroma are measured as such."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from z2p_renderer.pipeline.evaluation.paper.methods import Method
from z2p_renderer.pipeline.evaluation.paper.page.color_fidelity import color_error, color_errors, color_table
from z2p_renderer.pipeline.evaluation.paper.page.results import Results


def picture(color: tuple[int, int, int], alpha: int = 255) -> np.ndarray:
    """The object in that colour on the left half, nothing on the right."""
    out = np.zeros((8, 8, 4), np.uint8)
    out[:, :4] = (*color, alpha)
    return out


def test_equal_colours_have_no_error_whatever_the_background() -> None:
    ours = picture((200, 40, 90))
    ours[:, 4:] = (0, 0, 0, 120)  # a shadow
    error = color_error(ours, picture((200, 40, 90)))
    assert error is not None and (error.lightness, error.chroma, error.hue) == pytest.approx((0, 0, 0), abs=1e-9)


def test_hue_error_ignores_lightness() -> None:
    turned = color_error(picture((255, 0, 0)), picture((0, 255, 0)))
    assert turned is not None and turned.hue == pytest.approx(136.0 - 40.0, abs=1)  # CIELAB's hues of sRGB's primaries
    assert turned.lightness == pytest.approx(87.7 - 53.2, abs=0.5)
    darker = color_error(picture((119, 119, 119)), picture((255, 255, 255)))
    assert darker is not None and darker.lightness == pytest.approx(50, abs=0.5) and darker.hue is None
    pale = color_error(picture((200, 150, 150)), picture((255, 0, 0)))
    assert pale is not None and pale.chroma > 50


def test_hue_error_is_the_smaller_angle() -> None:
    error = color_error(picture((250, 20, 120)), picture((250, 20, 60)))
    assert error is not None and error.hue is not None and 0 < error.hue < 60


def test_picture_without_the_object_has_no_colour_error() -> None:
    assert color_error(picture((9, 9, 9), alpha=100), picture((9, 9, 9))) is None


def test_colour_table_pairs_pictures_of_one_case(tmp_path: Path) -> None:
    methods = tuple(Method(name, kind, name) for name, kind in (("regular", "weights"), ("bpa", "baseline")))
    colors = {"red": (200, 30, 30), "blue": (30, 30, 200)}
    shown = {"truth": colors, "regular": colors, "bpa": {"red": (150, 20, 20), "blue": (20, 20, 150)}}
    rows, folders = [], {}
    for method, own in shown.items():
        folder = folders[f"measure/color/cow/{method}"] = tmp_path / method
        folder.mkdir()
        for number, level in enumerate(colors if method != "bpa" else reversed(colors)):
            Image.fromarray(picture(own[level])).save(folder / f"{number}.png")
            rows.append({"sweep": "color", "mesh": "cow", "level": level, "view": 0, "method": method,
                         "picture": f"{number}.png"})  # fmt: skip
    rows.append({"sweep": "color", "mesh": "cow", "level": "red", "view": 1, "method": "bpa", "error": "no ball fits"})
    table = color_table(color_errors(Results(tuple(rows), methods), folders, "color"))
    assert [row[0] for row in table.rows] == ["regular", "bpa"]
    assert all(cell.startswith("0.000") for cell in table.rows[0][1:])
    assert float(table.rows[1][1].split()[0]) < 5 < float(table.rows[1][2].split()[0])
