"""Checks of `Condition` plugins."""

from __future__ import annotations

import numpy as np

from z2p_core.camera import Camera
from z2p_core.contracts.assertions import check_array, check_class, expect, same
from z2p_core.interfaces import ColoredCloud, Condition, PointColors
from z2p_core.scene import SceneDescription

NEUTRAL = 0.4
"""Neutral linear color of the clouds that are drawn."""
COVERED_ROWS = slice(16, 48)
"""Rows of the picture, of 64, that the cloud covers."""


def check_condition(condition_class: type[Condition]) -> None:
    """None when the class keeps what `Condition` promises: a picture that tells colors apart, 0 where no cloud is.

    Raises:
        AssertionError: it does not; the message says what was expected and what came.
    """
    check_class("conditions", condition_class, Condition)
    condition, name = condition_class(), condition_class.name
    expect(condition.channels >= 1, f"{name}: expected one channel or more, got {condition.channels}")
    dark, bright = (_draw(condition, _colored_cloud(albedo)) for albedo in (0.2, 0.6))
    expect(bool(dark.any()), f"{name}: draw_into writes an empty picture for a cloud of 400 points")
    expect(not np.array_equal(dark, bright), f"{name}: expected another picture for other colors, got the same one")
    expect(not dark[:, : COVERED_ROWS.start].any(), f"{name}: expected 0 where the cloud is not")
    shuffled = _colored_cloud(0.2, np.random.default_rng(1).permutation(400))
    same(_draw(condition, shuffled), dark, f"{name}: points in another order")
    nothing = ColoredCloud(np.zeros((0, 3), np.float32), PointColors(*np.zeros((2, 0, 3), np.float32)),
                           np.full(3, NEUTRAL, np.float32), np.zeros((4, 64, 64), np.float32))  # fmt: skip
    expect(not _draw(condition, nothing).any(), f"{name}: expected 0 everywhere for a cloud of no point")


def _draw(condition: Condition, colored: ColoredCloud) -> np.ndarray:
    """The picture, drawn twice onto different numbers, once the inputs are known to be left alone."""
    camera, scene = Camera(64, 64), SceneDescription()
    given = [array.copy() for array in _arrays(colored)]
    pictures = np.full((2, condition.channels, 64, 64), np.nan, np.float32)
    pictures[1] = 7
    for picture in pictures:
        condition.draw_into(picture, colored, camera, scene)
    check_array(pictures[0], (condition.channels, 64, 64), np.float32, f"{condition.name}: draw_into")
    same(pictures[1], pictures[0], f"{condition.name}: draw_into, whatever was there before")
    for before, after in zip(given, _arrays(colored), strict=True):
        same(after, before, f"{condition.name}: what is given to draw_into")
    expect(scene == SceneDescription(), f"{condition.name}: draw_into changes the scene given to it")
    return pictures[0]


def _colored_cloud(albedo: float, order: np.ndarray | slice = slice(None)) -> ColoredCloud:
    """Points in a slab across the picture, its left half as bright as the neutral color, the right one as `albedo`."""
    rng = np.random.default_rng(0)
    cloud = rng.uniform((-1, -0.1, -0.3), (1, 0.1, 0.3), (400, 3)).astype(np.float32)[order]
    colors = np.where(cloud[:, :1] < 0, NEUTRAL, albedo).astype(np.float32).repeat(3, axis=1)
    relative = np.zeros((4, 64, 64), np.float32)
    relative[:, COVERED_ROWS] = 1
    relative[:3, COVERED_ROWS, 32:] = albedo / NEUTRAL
    return ColoredCloud(cloud, PointColors(cloud, colors), np.full(3, NEUTRAL, np.float32), relative)


def _arrays(colored: ColoredCloud) -> list[np.ndarray]:
    return [colored.cloud, colored.colors.points, colored.colors.albedo, colored.neutral, colored.relative]
