"""Which of a cloud's six axes points up: what is usual for its kind of file, weighed against what its shape says."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from z2p_core.linalg import bounding_box
from z2p_core.up_axis.feature_weights import up_axis_scores
from z2p_core.up_axis.shape_features import axis_features

AXES = ("+X", "-X", "+Y", "-Y", "+Z", "-Z")

_PLY_PRIOR = {"+Z": 0.45, "+Y": 0.33, "-Y": 0.165, "-Z": 0.015, "+X": 0.02, "-X": 0.02}
_GRAPHICS_PRIOR = {"+Z": 0.19, "+Y": 0.71, "-Y": 0.06, "-Z": 0.01, "+X": 0.015, "-X": 0.015}
_SCAN_PRIOR = {"+Z": 0.545, "+Y": 0.27, "-Y": 0.13, "-Z": 0.015, "+X": 0.02, "-X": 0.02}
PRIORS: Mapping[str, Mapping[str, float]] = {
    ".ply": _PLY_PRIOR, ".off": _SCAN_PRIOR, ".stl": _SCAN_PRIOR, ".obj": _GRAPHICS_PRIOR, ".pcd": _SCAN_PRIOR,
}  # fmt: skip
"""Suffix -> how often each axis is up in such files, as far as we know; all others are taken as `_SCAN_PRIOR`."""
STANDARD_AXES = {".glb": "+Y", ".gltf": "+Y", ".las": "+Z", ".laz": "+Z", ".e57": "+Z", ".ptx": "+Z"}
"""Suffix -> the axis that its standard, or the practice of surveys, holds for up."""
USUAL_BY_FILE = 0.8
"""Share of the files with a family's marks that have the family's axis up."""
SHAPE_UNCERTAINTY = 0.05
"""Share of clouds of which the shape tells nothing, however clear it seems: they may be of a kind not learnt from."""
LEAST_SHAPE_SUPPORT = 0.3
"""How likely the shape alone must make an axis at least, to be taken for up before the usual one."""
FEWEST_POINTS = 100
"""Fewer tell no shape."""
ORIGIN_TOLERANCE, GROUNDED_FACTOR = 0.005, 3.0
"""A thing whose end lies at 0, but for that share of its size, is so many times as likely to stand on that end."""
MAP_COORDINATE, MAP_DISTANCE = 1000.0, 10.0
"""Coordinates so large, and so many times the cloud's size, are a map's, which has its heights along z."""
CLEAR_CHANCE, POSSIBLE_CHANCE = 0.9, 0.15
"""How likely an axis is that is called clear, and another one that is named at least."""
TELLING_ODDS = 1.5
"""How many times as likely as before the shape must make the usual axis, to be said to tell it."""


@dataclass(frozen=True)
class AxisGuess:
    """The axis that is most likely up, why, and the other one that may be, if any."""

    axis: str
    reason: str
    other: str = ""


def guess_up_axis(points: np.ndarray, suffix: str, usual: str = "", usual_reason: str = "") -> AxisGuess:
    """Which axis of finite points (N, 3) is up in a file with that suffix (lower-case, with its dot).

    `usual` is the axis that is usual for files with such marks as this one has, if any, and `usual_reason` says which.
    The order of the points does not count.
    """
    if not usual and suffix in STANDARD_AXES:
        return AxisGuess(STANDARD_AXES[suffix], f"the convention of {suffix}")
    low, high = bounding_box(points)
    size = float((high - low).max())
    if float(np.abs(low + high)[:2].max()) / 2 > max(MAP_COORDINATE, MAP_DISTANCE * size):
        return AxisGuess("+Z", "a map's coordinates")
    prior = _prior(suffix, usual)
    shape = np.full(6, 1 / 6)
    if len(points) >= FEWEST_POINTS and size > 0:
        told = up_axis_scores(axis_features(points))
        likely = np.exp(told - told.max())
        shape = (1 - SHAPE_UNCERTAINTY) * likely / likely.sum() + SHAPE_UNCERTAINTY / 6
    grounded = np.where(np.abs(np.stack([low, -high], axis=1).ravel()) < ORIGIN_TOLERANCE * size, GROUNDED_FACTOR, 1.0)
    chance = prior * shape * grounded
    unsupported = (shape * grounded < LEAST_SHAPE_SUPPORT) & (prior < prior.max())
    chance[unsupported] = np.minimum(chance[unsupported], 0.9 * chance[prior.argmax()])
    return _told(chance / chance.sum(), prior, usual_reason if usual else "the usual axis")


def _prior(suffix: str, usual: str) -> np.ndarray:
    """How likely each of `AXES` is, before the cloud is looked at (6,)."""
    share = np.array([PRIORS.get(suffix, _SCAN_PRIOR)[axis] for axis in AXES])
    if not usual:
        return share
    share[AXES.index(usual)] = 0.0
    share *= (1 - USUAL_BY_FILE) / share.sum()
    share[AXES.index(usual)] = USUAL_BY_FILE
    return share


def _told(chance: np.ndarray, prior: np.ndarray, usual_reason: str) -> AxisGuess:
    """The guess in words, of how likely each axis is, with its shape (6,) and before (6,)."""
    first, second = (int(place) for place in np.argsort(-chance, kind="stable")[:2])
    expected = int(prior.argmax())
    other = AXES[second] if chance[second] >= POSSIBLE_CHANCE else ""
    if first == expected and _odds(chance[first]) < TELLING_ODDS * _odds(prior[first]):
        doubt = "" if prior[first] >= USUAL_BY_FILE else ", of which its shape tells little"
        return AxisGuess(AXES[first], usual_reason + doubt, other)
    sure = "clearly" if chance[first] >= CLEAR_CHANCE else "probably"
    reason = f"{sure}, by its shape"
    if first == expected and usual_reason != "the usual axis":
        reason = f"{usual_reason}, and its shape says so"
    return AxisGuess(AXES[first], reason, other)


def _odds(chance: float) -> float:
    """How many times as likely something is as all else."""
    return float(chance / max(1 - chance, 1e-9))
