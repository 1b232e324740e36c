"""A scale bar and axes tell the data's own lengths, in pictures and in documents."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from z2p_core.camera import turn
from z2p_core.placement.viewpoint import Viewpoint
from z2p_renderer.pipeline.inference.look import Look
from z2p_renderer.pipeline.inference.render_scan import RenderedScan, render_scan
from z2p_renderer.pipeline.inference.renderer import Renderer
from z2p_renderer.pipeline.legends.annotate import Annotations, annotate, encode_document
from z2p_renderer.pipeline.legends.marks import FrameGeometry, Marks
from z2p_renderer.pipeline.legends.scale_bar import round_length
from z2p_renderer.storage.scans.clouds import usable

VIEWPOINT = Viewpoint((500000.0, 10.0, 3.0), 40.0, tuple(map(tuple, turn(30.0).tolist())), 20.0)
GEOMETRY = FrameGeometry(VIEWPOINT, 400, 300, 0, 0, ((499990.0, -5.0, 0.0), (500010.0, 25.0, 6.0)))
PICTURE = np.zeros((300, 400, 4), np.uint8)


@pytest.mark.parametrize(("most", "length"), [(1.0, 1), (0.99, 0.5), (4.9, 2), (5, 5), (700, 500), (2.1e-7, 2e-7)])
def test_lengths_are_round(most: float, length: float) -> None:
    assert round_length(most) == pytest.approx(length)


def test_a_length_across_the_line_of_sight_has_its_pixels() -> None:
    across = turn(30.0).T @ np.array([1.0, 0, 0])  # the camera's right, in the data's axes
    ends = np.array(VIEWPOINT.centre) + np.outer([-0.5, 0.5], across)
    pixels, _ = GEOMETRY.project(ends)
    assert np.linalg.norm(pixels[1] - pixels[0]) == pytest.approx(GEOMETRY.pixels_per_unit, rel=1e-3)
    assert GEOMETRY.project(np.array(VIEWPOINT.centre)[None])[0][0] == pytest.approx([200, 150])


def test_the_bar_is_as_long_as_it_says() -> None:
    svg = encode_document(PICTURE, Annotations(GEOMETRY, Marks(scale_bar=True, unit="m")), "svg", 72).decode()
    (text,) = re.findall(r"<text[^>]*>([^<]*)<", svg)
    lines = re.findall(r'd="M ([\d.]+) ([\d.]+) \nL ([\d.]+) ([\d.]+) \n"', svg)
    (length,) = {float(end) - float(start) for start, top, end, bottom in lines if top == bottom}
    assert text == "20 m"
    assert length == pytest.approx(20 * GEOMETRY.pixels_per_unit, rel=1e-3)


def test_axes_have_ticks_of_the_data() -> None:
    svg = encode_document(PICTURE, Annotations(GEOMETRY, Marks(axes=True)), "svg", 72).decode()
    texts = re.findall(r"<text[^>]*>([^<]*)<", svg)
    assert {"x", "y", "z"} <= set(texts)
    numbers = [float(text.replace("−", "-")) for text in texts if text not in "xyz"]
    assert {0.0, 20.0, 500000.0} <= set(numbers) and max(numbers) <= 500010


@pytest.mark.parametrize("marks", [Marks(scale_bar=True), Marks(axes=True)])
def test_marks_leave_the_size_and_what_they_do_not_cover(marks: Marks) -> None:
    picture = np.random.default_rng(0).integers(0, 256, PICTURE.shape).astype(np.uint8)
    drawn = annotate(picture, Annotations(GEOMETRY, marks))
    assert drawn.shape == picture.shape
    assert 0.001 < (drawn != picture).any(-1).mean() < 0.1


def test_a_trimmed_picture_gets_a_strip_for_its_bar(tiny_weights: Path, cloud: np.ndarray) -> None:
    def draw(**marks: bool) -> RenderedScan:
        look = Look(width=96, height=96, tight=True, marks=Marks(**marks))
        return render_scan(Renderer(tiny_weights), usable(cloud), "", look)

    plain, barred = draw(), draw(scale_bar=True)
    height = len(plain.picture)
    assert len(barred.picture) > height and np.array_equal(barred.picture[:height], plain.picture)
    assert barred.picture[height:, :, 3].any()
