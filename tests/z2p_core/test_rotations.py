"""Rotations of quaternions."""

import numpy as np

from z2p_core.rotations import quaternion_rotations


def test_each_turns_about_its_axis_by_its_angle() -> None:
    half = np.radians(90) / 2
    turns = [[1, 0, 0, 0], *([np.cos(half), *(np.sin(half) * axis)] for axis in np.eye(3))]
    still, about_x, about_y, about_z = quaternion_rotations(np.array(turns, dtype=np.float64))
    assert np.allclose(still, np.eye(3))
    assert np.allclose(about_x @ [0, 1, 0], [0, 0, 1])
    assert np.allclose(about_y @ [0, 0, 1], [1, 0, 0])
    assert np.allclose(about_z @ [1, 0, 0], [0, 1, 0])
