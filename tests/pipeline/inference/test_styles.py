"""Styles: their radii, what they refuse, and what pictures record of them."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import z2p_core
from z2p_core.camera import DISTANCE, Camera
from z2p_core.interfaces import ScanError, SettingError
from z2p_core.style import Style, parse_style
from z2p_renderer.pipeline.cli import main
from z2p_renderer.pipeline.inference.styles import DRAW, nearest_of
from z2p_renderer.storage.images.image_files import read_record

SMALL = {"size": 48, "view": "front"}


@pytest.fixture
def points() -> np.ndarray:
    return np.random.default_rng(0).normal(size=(60, 3))


def covered(picture: z2p_core.Picture) -> float:
    return float((picture.array[..., 2].astype(int) * (picture.array[..., 3] > 250) > 40).sum())


def test_every_style_has_a_function() -> None:
    from z2p_core.style import STYLE_NAMES

    assert list(DRAW) == list(STYLE_NAMES)


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        (None, Style("balls")),
        (0.5, Style("balls", radius=0.5)),
        ("0.5", Style("balls", radius=0.5)),
        ("2%", Style("balls", radius_share=0.02)),
        ("size", Style("balls", radius_field="size")),
    ],
)
def test_a_radius_is_a_length_a_share_or_a_field(given: object, expected: Style) -> None:
    assert parse_style("balls", given) == expected
    assert parse_style("balls", expected.radius_text) == expected


@pytest.mark.parametrize(
    ("name", "radius"),
    [("blobs", None), (3, None), ("surface", 0.1), ("balls", 0), ("balls", "-1%"), ("balls", "nan"), ("balls", True)],
)
def test_what_is_no_style_is_refused(name: object, radius: object) -> None:
    with pytest.raises(SettingError):
        parse_style(name, radius)


def test_few_points_are_as_many_whole_balls(recwarn: pytest.WarningsRecorder) -> None:
    corners = np.array([[1.0, 0, 0], [-1, 0, 0], [0, 0, 1], [0, 0, -1]])
    picture = z2p_core.render(corners, style="balls", radius="10%", up="+Z", size=128, view=(0, 0))
    pixels_across = 2 * 0.1 * Camera(128, 128).focal / DISTANCE
    assert (picture.array[..., 3] == 255).sum() == pytest.approx(4 * np.pi / 4 * pixels_across**2, rel=0.25)
    chosen = z2p_core.render(corners[:3], style="balls", size=64)
    assert chosen.array[:, [0, -1], 3].max() < 250  # none is cut off
    assert not recwarn.list


def test_a_larger_radius_makes_larger_balls(points: np.ndarray) -> None:
    sizes = [covered(z2p_core.render(points, style="balls", radius=radius, **SMALL)) for radius in (0.05, "10%", 0.4)]
    assert sizes[0] < sizes[1] < sizes[2]


def test_radii_belong_to_their_points_in_any_order(points: np.ndarray) -> None:
    radii = np.linspace(0.05, 0.4, len(points))
    order = np.random.default_rng(1).permutation(len(points))
    one = z2p_core.render(points, style="balls", radius=radii, **SMALL)
    other = z2p_core.render(points[order], style="balls", radius=radii[order], **SMALL)
    assert np.array_equal(one.array, other.array)
    assert not np.array_equal(one.array, z2p_core.render(points, style="balls", radius=radii[::-1], **SMALL).array)


def test_a_radius_beyond_the_object_is_refused(points: np.ndarray) -> None:
    with pytest.raises(SettingError, match="larger than the whole object"):
        z2p_core.render(points, style="balls", radius=100.0, **SMALL)
    with pytest.raises(ScanError, match="is to hold radii"):
        z2p_core.render(points, style="balls", radius=np.zeros(len(points)), **SMALL)


def test_matt_styles_refuse_roughness(points: np.ndarray) -> None:
    with pytest.raises(SettingError, match="the style balls is matt"):
        z2p_core.render(points, style="balls", roughness=0.3, **SMALL)


def test_balls_have_the_colors_of_their_points(points: np.ndarray) -> None:
    red = np.tile([0.9, 0.05, 0.05], (len(points), 1))
    array = z2p_core.render(points, red, style="balls", **SMALL).array
    shown = array[array[..., 3] > 250].astype(int)
    assert (shown[:, 0] >= shown[:, 2]).all()
    assert (shown[:, 0] > 2 * shown[:, 2]).mean() > 0.5


def test_discs_show_the_object(points: np.ndarray) -> None:
    assert covered(z2p_core.render(points, style="discs", color="white", **SMALL)) > 50


def test_the_nearest_point_is_given_in_the_order_of_the_points(points: np.ndarray) -> None:
    order = np.random.default_rng(2).permutation(len(points))
    assert np.array_equal(nearest_of(points.astype(np.float32), points[order].astype(np.float32)), order)


def test_a_record_draws_the_same_balls_again(points: np.ndarray, tmp_path: Path) -> None:
    np.savetxt(tmp_path / "cloud.xyz", points)
    first, again = tmp_path / "first.png", tmp_path / "again.png"
    for words in (
        ["render", f"{tmp_path}/cloud.xyz", "-o", str(first), "--style", "balls", "--radius", "0.2", "--size", "48"],
        ["rerender", str(first), "-o", str(again)],
    ):
        result = CliRunner().invoke(main, words)
        assert result.exit_code == 0, result.output
    assert (read_record(again)["style"], read_record(again)["radius"]) == ("balls", 0.2)
    from PIL import Image

    assert np.array_equal(np.asarray(Image.open(first)), np.asarray(Image.open(again)))


def test_the_pictures_own_camera_draws_the_same_balls(points: np.ndarray) -> None:
    first = z2p_core.render(points, style="balls", size=48, view=(30, 20))
    again = z2p_core.render(points, style="balls", camera=first.pinhole)
    assert np.array_equal(first.array, again.array)


@pytest.mark.parametrize("style", ["balls", "discs"])
def test_no_network_is_missed_where_the_style_needs_none(points: np.ndarray, style: str) -> None:
    with warnings.catch_warnings():
        warnings.filterwarnings("error", message="drawn without the network")
        camera = z2p_core.look_at((0, -9, -9))  # from below the floor
        assert covered(z2p_core.render(points, style=style, color="white", camera=camera, size=48)) > 10
