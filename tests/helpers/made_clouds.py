"""Clouds of simple things, for tests."""

from __future__ import annotations

import numpy as np


def sphere(count: int, seed: int = 0) -> np.ndarray:
    points = np.random.default_rng(seed).normal(size=(count, 3))
    return points / np.linalg.norm(points, axis=1, keepdims=True)


def box(count: int, *half: float) -> np.ndarray:
    """Points on the sides of a box, evenly by area."""
    rng, sides = np.random.default_rng(1), np.array(half)
    area = np.prod(sides) / sides
    axis = rng.choice(3, size=count, p=area / area.sum())
    points = rng.uniform(-1, 1, (count, 3))
    points[np.arange(count), axis] = rng.choice([-1, 1], size=count)
    return points * sides


def moved(points: np.ndarray, *by: float) -> np.ndarray:
    return points + np.array(by)


def lamppost(count: int) -> np.ndarray:
    rng = np.random.default_rng(2)
    pole = np.column_stack([rng.normal(0, 0.02, (count, 2)), rng.uniform(0, 6, count)])
    few = count // 5
    arm = np.column_stack([rng.uniform(-1.4, 0, few), rng.normal(0, 0.02, few), np.full(few, 6.0)])
    return np.vstack([pole, arm])


def chair(count: int) -> np.ndarray:
    seat, back = box(count, 0.5, 0.5, 0.03), moved(box(count, 0.5, 0.03, 0.5), 0, 0.5, 0.5)
    legs = [moved(box(count // 8, 0.02, 0.02, 0.4), x, y, -0.43) for x in (-0.46, 0.46) for y in (-0.46, 0.46)]
    return np.vstack([seat, back, *legs])
