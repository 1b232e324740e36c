"""Up is found by the shape where this tells it, by what is usual where not; and the other guess is named."""

from __future__ import annotations

import numpy as np
import pytest
from made_clouds import box, chair, moved, sphere

from z2p_core.camera import turn
from z2p_core.up_axis.axis_names import UP_ROTATIONS
from z2p_core.up_axis.choose import guess_up_axis
from z2p_core.up_axis.shape_features import FEATURE_NAMES, axis_features

RNG = np.random.default_rng(0)


def table(count: int = 2000) -> np.ndarray:
    legs = [moved(box(count // 8, 0.03, 0.03, 0.4), x, y, 0.4) for x in (-0.7, 0.7) for y in (-0.4, 0.4)]
    return np.vstack([moved(box(count, 0.8, 0.5, 0.03), 0, 0, 0.83), *legs])


def seated() -> np.ndarray:
    """A chair on a wide piece of floor, as phones scan it."""
    floor = np.column_stack([RNG.uniform(-1.2, 1.2, (2500, 2)), np.full(2500, -0.83)])
    return np.vstack([chair(1500), floor])


def bust() -> np.ndarray:
    head, neck = moved(sphere(1200) * (0.14, 0.17, 0.2), 0, -0.02, 0.65), box(400, 0.08, 0.08, 0.15)
    chest = sphere(3000) * (0.32, 0.2, 0.35)
    return np.vstack([head, moved(neck, 0, 0, 0.42), chest[chest[:, 2] > 0]])


THINGS = {"chair": chair(1500), "table": table(), "chair on a floor": seated()}


@pytest.mark.parametrize("axis", ["+Z", "+Y", "-Y"])
@pytest.mark.parametrize("name", THINGS)
def test_upright_objects_are_found_for_any_axis_and_format(name: str, axis: str) -> None:
    for azimuth in (0.0, 35.0, 250.0):
        points = THINGS[name] @ turn(azimuth).T @ np.array(UP_ROTATIONS[axis], dtype=float)
        for suffix in (".ply", ".pcd", ".npy", ".xyz", ".pts", ".txt"):
            assert guess_up_axis(points + 0.37, suffix).axis == axis


@pytest.mark.parametrize("axis", ["+Z", "+Y", "-Y"])
def test_objects_that_could_be_upside_down_are_upright_or_hinted(axis: str) -> None:
    guess = guess_up_axis(bust() @ np.array(UP_ROTATIONS[axis], dtype=float), ".ply")
    assert axis in (guess.axis, guess.other)


def test_sure_ones_are_called_so_and_name_no_other() -> None:
    guess = guess_up_axis(chair(1500) @ np.array(UP_ROTATIONS["+Y"], dtype=float), ".ply")
    assert (guess.axis, guess.reason, guess.other) == ("+Y", "clearly, by its shape", "")


@pytest.mark.parametrize("points", [sphere(2000), box(4000, 1, 1, 1), sphere(60)], ids=["ball", "cube", "few"])
def test_shapes_without_an_up_axis_get_the_formats_one(points: np.ndarray) -> None:
    for suffix, axis, other in ((".ply", "+Z", "+Y"), (".obj", "+Y", "+Z")):
        guess = guess_up_axis(points, suffix)
        assert (guess.axis, guess.other) == (axis, other)
        assert "its shape tells little" in guess.reason


@pytest.mark.parametrize(("suffix", "axis"), [(".las", "+Z"), (".laz", "+Z"), (".e57", "+Z"), (".glb", "+Y")])
def test_standards_hold_whatever_the_shape(suffix: str, axis: str) -> None:
    for turned in UP_ROTATIONS:
        assert guess_up_axis(chair(1500) @ np.array(UP_ROTATIONS[turned], dtype=float), suffix).axis == axis


def test_a_formats_axis_yields_only_to_a_clear_shape() -> None:
    guess = guess_up_axis(sphere(2000), ".ply", "-Y", "usual for such files")
    assert guess.axis == "-Y" and guess.reason.startswith("usual for such files")
    assert guess_up_axis(chair(1500), ".ply", "-Y", "usual for such files").axis == "+Z"


def test_coordinates_of_a_map_have_their_heights_along_z() -> None:
    tile = np.column_stack([RNG.uniform(0, 300, (5000, 2)), RNG.normal(0, 2, 5000)])
    assert guess_up_axis(np.add(tile, [512_000, 5_403_000, 300]), ".xyz").reason == "a map's coordinates"
    family = guess_up_axis(np.add(tile, [512_000, 5_403_000, 300]), ".ply", "-Y", "usual for such files")
    assert (family.axis, family.reason) == ("+Z", "a map's coordinates")


def test_a_lowest_point_at_height_0_favors_that_axis() -> None:
    brick = box(4000, 1, 1, 1)
    assert guess_up_axis(moved(brick, 0.3, 1.0, 0.4), ".ply").axis == "+Y"
    assert guess_up_axis(moved(brick, 0.3, 0.5, 0.4), ".ply").axis == "+Z"


def test_marks_depend_neither_on_order_nor_on_size_and_place() -> None:
    points = chair(3000)
    plain = axis_features(points)
    assert plain.shape == (6, len(FEATURE_NAMES)) and np.isfinite(plain).all()
    assert np.array_equal(axis_features(points[RNG.permutation(len(points))]), plain)
    np.testing.assert_allclose(axis_features(points[:1400] * 8 + 64), axis_features(points[:1400]), atol=2e-2)


def test_marks_turn_with_the_cloud() -> None:
    points = chair(200)[:1400]  # all are looked at, so that the same ones are
    plain = axis_features(points)
    turned = axis_features(points @ np.array(UP_ROTATIONS["+Y"], dtype=float))
    for mark in ("level faces", "height", "level mirror", "low mass", "feet's hull"):
        column = FEATURE_NAMES.index(mark)
        np.testing.assert_allclose(turned[2:4, column], plain[4:6, column], atol=0.02, err_msg=mark)


@pytest.mark.parametrize(
    "points",
    [np.zeros((200, 3)) + np.arange(200)[:, None] * [1.0, 0, 0], np.repeat(np.eye(3), 50, axis=0),
     np.column_stack([RNG.normal(size=(300, 2)), np.zeros(300)]), sphere(150) * 1e-200, sphere(150) * 1e200],
    ids=["line", "three places", "plane", "tiny", "huge"],
)  # fmt: skip
def test_flat_and_odd_clouds_get_an_axis_without_ado(points: np.ndarray) -> None:
    with np.errstate(all="raise", under="ignore"):
        assert guess_up_axis(points, ".ply").axis in UP_ROTATIONS
