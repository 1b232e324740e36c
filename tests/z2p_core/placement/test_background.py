"""The subject without its wall, the table under things, rooms: found where they are, and nowhere else."""

from __future__ import annotations

import numpy as np
import pytest

from z2p_core.camera import turn
from z2p_core.interfaces import Sensor
from z2p_core.placement.background import foreground_mask
from z2p_core.placement.room_detection import is_room
from z2p_core.placement.support_plane import support_plane_normal
from z2p_core.rotations import align_to_vertical, random_rotation
from z2p_core.up_axis.axis_names import UP_ROTATIONS
from z2p_core.up_axis.choose import choose_up

RNG = np.random.default_rng(0)
ORIGIN = Sensor(np.zeros(3), np.eye(3))


def ball(count: int, radius: float, *centre: float) -> np.ndarray:
    """The half of a ball that faces the origin."""
    points = RNG.normal(size=(4 * count, 3))
    points *= radius / np.linalg.norm(points, axis=1, keepdims=True)
    return (points[points @ centre < 0] + centre)[:count]


def wall(count: int, depth: float) -> np.ndarray:
    return np.column_stack([RNG.uniform(-0.5, 0.5, (count, 2)) * depth, np.full(count, depth)])


def table(tilt: float, things: int = 1500) -> np.ndarray:
    """A table with balls on it, 1 to 2 before a camera that looks down by `tilt` degrees, OpenCV axes."""
    top = np.column_stack([RNG.uniform(-0.6, 0.6, 4000), np.full(4000, 0.7), RNG.uniform(-0.5, 0.5, 4000)])
    on_it = [ball(things // 2, 0.12, x, 0.58, 0.1) for x in (-0.3, 0.3)]
    angle = np.radians(-tilt)
    pitch = np.array([[1, 0, 0], [0, np.cos(angle), -np.sin(angle)], [0, np.sin(angle), np.cos(angle)]])
    level: np.ndarray = np.vstack([top, *on_it])
    return (level + np.array([0.0, 0.0, 1.4])) @ pitch.T


def test_a_wall_behind_the_subject_is_removed_alone() -> None:
    points = np.vstack([ball(2000, 0.3, 0.0, 0.0, 1.0), wall(5000, 2.5), ball(5, 0.01, 0.1, 0.0, 1.8)])
    kept = foreground_mask(points, ORIGIN)
    assert kept[:2000].all() and not kept[2000:].any()
    rotation = random_rotation(np.random.default_rng(3))
    moved = foreground_mask(points @ rotation.T + 7.0, Sensor(np.full(3, 7.0), rotation))
    assert np.array_equal(moved, kept)


@pytest.mark.parametrize(
    "points",
    [ball(2000, 0.3, 0.0, 0.0, 1.0), np.vstack([ball(2000, 0.3, 0.0, 0.0, 1.0), wall(5000, 1.12)]),
     np.vstack([ball(300, 0.1, 0.0, 0.0, 1.0), wall(9000, 3.0)]), wall(3000, 2.0),
     np.column_stack([RNG.uniform(-0.3, 0.3, (5000, 2)), RNG.uniform(0.5, 3.0, 5000)])],
    ids=["no wall", "wall close behind", "a scrap before a wall", "wall alone", "evenly deep"],
)  # fmt: skip
def test_without_a_clear_gap_all_stays(points: np.ndarray) -> None:
    assert foreground_mask(points, ORIGIN).all()


@pytest.mark.parametrize("tilt", [0.0, 20.0, 45.0, 60.0])
def test_the_table_tells_up_whatever_the_cameras_tilt(tilt: float) -> None:
    angle = np.radians(-tilt)
    true_up = np.array([0.0, -np.cos(angle), -np.sin(angle)])
    points = table(tilt)
    up = choose_up(points, ORIGIN, ".pcd")
    normal = support_plane_normal(points, up.rotation[2], ORIGIN)
    assert normal is not None
    assert normal @ true_up > np.cos(np.radians(2))
    rotation = align_to_vertical(up.rotation, normal)
    np.testing.assert_allclose(rotation @ normal, [0, 0, 1], atol=1e-12)
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)


def box_corner() -> np.ndarray:
    """Two upright sides and the top of a box, seen by a camera that looks down on it."""
    u, v = RNG.uniform(-0.5, 0.5, (2, 3000))
    sides = [np.column_stack([u, v, np.full(3000, -0.5)]), np.column_stack([np.full(3000, -0.5), v, u])]
    return np.vstack(sides) @ turn_about_y(0.8).T + np.array([0.0, 0.4, 2.0])


def turn_about_y(angle: float) -> np.ndarray:
    return np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])


@pytest.mark.parametrize("points", [ball(3000, 0.3, 0.0, 0.2, 1.0), wall(3000, 2.0), box_corner()],
                         ids=["ball", "wall", "box"])  # fmt: skip
def test_no_table_is_seen_where_none_is(points: np.ndarray) -> None:
    assert support_plane_normal(points, np.array([0.0, -1.0, 0.0]), ORIGIN) is None


def test_setting_upright_what_is_upright_changes_nothing() -> None:
    rotation = turn(30.0) @ np.array(UP_ROTATIONS["+Y"], dtype=float)
    assert np.array_equal(align_to_vertical(rotation, rotation.T @ [0.0, 0.0, 1.0]), rotation)


def room(height: float, *sides: float) -> np.ndarray:
    x, y = (RNG.uniform(-side / 2, side / 2, 9000) for side in sides)
    flat = [np.column_stack([x, y, np.full(9000, level)]) for level in (0.0, height)]
    walls = np.column_stack([np.full(9000, sides[0] / 2), y, RNG.uniform(0, height, 9000)])
    return np.vstack([*flat, walls])


def test_rooms_are_told_from_things() -> None:
    assert is_room(room(2.6, 5.0, 4.0))
    assert not is_room(room(2.6, 5.0, 4.0)[9000:])  # no floor
    assert not is_room(room(0.3, 0.5, 0.4))  # a box
    assert not is_room(room(9.0, 3.0, 3.0))  # a tower
    assert not is_room(room(2.6, 5.0, 4.0) * 1000)  # millimetres: not known to be a room
    assert not is_room(ball(3000, 2.0, 0.0, 0.0, 2.0))
    assert not is_room(RNG.uniform(0, 3, (20_000, 3)))  # solid
    around, across = RNG.uniform(0, 2 * np.pi, (2, 20_000))
    ring = np.column_stack([(3 + 1.3 * np.cos(across)) * np.cos(around), (3 + 1.3 * np.cos(across)) * np.sin(around),
                            1.3 * np.sin(across)])  # fmt: skip
    assert not is_room(ring)
    furnished = np.vstack([room(2.6, 5.0, 4.0), RNG.uniform((-2, -1.8, 0), (0, 0, 1.8), (9000, 3))])
    corner = (furnished[:, 0] > 0) & (furnished[:, 1] > 0)
    assert is_room(furnished) and is_room(furnished[~corner])  # of the shape of an L
