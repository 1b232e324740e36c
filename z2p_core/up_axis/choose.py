"""Which of a cloud's six axes points up: its depth camera's up, or the likeliest axis by file format and shape."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from z2p_core.interfaces import Sensor
from z2p_core.linalg import bounding_box
from z2p_core.placement.depth_camera import METRES, implied_sensor, is_depth_camera
from z2p_core.up_axis.axis_names import UP_ROTATIONS
from z2p_core.up_axis.feature_weights import up_axis_scores
from z2p_core.up_axis.shape_features import axis_features

AXES = ("+X", "-X", "+Y", "-Y", "+Z", "-Z")

_PLY_PRIOR = {"+Z": 0.45, "+Y": 0.33, "-Y": 0.165, "-Z": 0.015, "+X": 0.02, "-X": 0.02}
_GRAPHICS_PRIOR = {"+Z": 0.19, "+Y": 0.71, "-Y": 0.06, "-Z": 0.01, "+X": 0.015, "-X": 0.015}
_SCAN_PRIOR = {"+Z": 0.545, "+Y": 0.27, "-Y": 0.13, "-Z": 0.015, "+X": 0.02, "-X": 0.02}
PRIORS: Mapping[str, Mapping[str, float]] = {
    ".ply": _PLY_PRIOR, ".off": _SCAN_PRIOR, ".stl": _SCAN_PRIOR, ".obj": _GRAPHICS_PRIOR, ".pcd": _SCAN_PRIOR,
}  # fmt: skip
"""Suffix -> estimated share of such files in which each axis is up; all other suffixes use `_SCAN_PRIOR`."""
STANDARD_AXES = {".glb": "+Y", ".gltf": "+Y", ".las": "+Z", ".laz": "+Z", ".e57": "+Z", ".ptx": "+Z"}
"""Suffix -> the axis that is up by the format's standard, or by the practice of surveys."""
FILE_HINT_PRIOR = 0.8
"""Prior probability of the axis that the file's own hints (its program or its family of files) name."""
SHAPE_UNCERTAINTY = 0.05
"""Share of clouds whose shape features are taken as uninformative: their kind may be missing in the training data."""
MIN_SHAPE_SUPPORT = 0.3
"""Smallest probability by shape alone for an axis that is not the usual one to be chosen."""
MIN_POINTS = 100
"""Smallest cloud whose shape is considered."""
ORIGIN_TOLERANCE = 0.005
"""Largest distance from coordinate 0, in the cloud's size, at which an end of the cloud counts as lying there."""
GROUNDED_ODDS = 3.0
"""Factor by which an object with one end at coordinate 0 is likelier to stand on that end."""
MIN_MAP_COORDINATE = 1000.0
"""Smallest horizontal coordinate that may belong to a map, whose heights are along z."""
MIN_MAP_DISTANCE = 10.0
"""The smallest distance of a map's tile from the origin, in the cloud's size."""
CLEAR_PROBABILITY = 0.9
"""Probability from which on the reason says "clearly"."""
ALTERNATIVE_PROBABILITY = 0.15
"""Probability from which on the second likeliest axis is named."""
MIN_SHAPE_ODDS_RATIO = 1.5
"""Factor by which the shape must raise the odds of the usual axis for the reason to name the shape."""


@dataclass(frozen=True)
class UpChoice:
    """How a cloud is set upright."""

    rotation: np.ndarray
    """Matrix (3, 3) from the file's axes to axes with +Z up and the front at -Y."""
    axis: str
    """What points up: ``+Y``, or ``the sensor's -Y`` when that is none of the file's axes."""
    reason: str
    sensor: Sensor | None = None
    """The depth camera that took the cloud, given by the file or implied by the points."""
    other: str = ""
    """Another of the file's axes that may be up, if the choice is in doubt."""


@dataclass(frozen=True)
class AxisGuess:
    """The axis that is most likely up, the reason, and the second likeliest one if it is close."""

    axis: str
    reason: str
    other: str = ""


def choose_up(
    points: np.ndarray, sensor: Sensor | None, suffix: str, units: Sequence[float] = (METRES,),
    usual: tuple[str, str] = ("", ""),
) -> UpChoice:  # fmt: skip
    """The up axis of finite points (N, 3) of a file with that suffix (lower-case, with its dot), and the reason.

    A depth camera's own up, else `guess_up_axis`. A `sensor` that sees all around (a laser scanner) says nothing about
    up. Without a sensor, the points may still look like a depth camera's in one of the `units` per metre. `usual` is
    the axis that hints in the file name, and the reason; both are empty without hints.
    """
    reason = "as its depth camera stood"
    if sensor is not None and not is_depth_camera(points, sensor):
        sensor = None
    elif sensor is None:
        sensor, reason = implied_sensor(points, units), "it looks like a depth camera's view from the origin"
    if sensor is not None:
        rotation = np.array(UP_ROTATIONS["-Y"], dtype=np.float64) @ sensor.rotation.T
        return UpChoice(rotation, _axis_name(rotation[2]), reason, sensor)
    guess = guess_up_axis(points, suffix, *usual)
    rotation = np.array(UP_ROTATIONS[guess.axis], dtype=np.float64)
    return UpChoice(rotation, guess.axis, guess.reason, other=guess.other)


def guess_up_axis(points: np.ndarray, suffix: str, usual: str = "", usual_reason: str = "") -> AxisGuess:
    """The axis of finite points (N, 3) that is probably up in a file with that suffix (lower-case, with its dot).

    Naive Bayes: the format's prior, times the likelihood of the shape's `axis_features`, times the odds of an end at
    coordinate 0. `usual` is the axis that hints in the file name, if any, and `usual_reason` says which. The order of
    the points does not matter.
    """
    if not usual and suffix in STANDARD_AXES:
        return AxisGuess(STANDARD_AXES[suffix], f"the convention of {suffix}")
    low, high = bounding_box(points)
    size = float((high - low).max())
    if float(np.abs(low + high)[:2].max()) / 2 > max(MIN_MAP_COORDINATE, MIN_MAP_DISTANCE * size):
        return AxisGuess("+Z", "a map's coordinates")
    prior = _prior(suffix, usual)
    shape = np.full(6, 1 / 6)
    if len(points) >= MIN_POINTS and size > 0:
        scores = up_axis_scores(axis_features(points))
        likelihood = np.exp(scores - scores.max())
        shape = (1 - SHAPE_UNCERTAINTY) * likelihood / likelihood.sum() + SHAPE_UNCERTAINTY / 6
    grounded = np.where(np.abs(np.stack([low, -high], axis=1).ravel()) < ORIGIN_TOLERANCE * size, GROUNDED_ODDS, 1.0)
    posterior = prior * shape * grounded
    unsupported = (shape * grounded < MIN_SHAPE_SUPPORT) & (prior < prior.max())
    posterior[unsupported] = np.minimum(posterior[unsupported], 0.9 * posterior[prior.argmax()])
    return _explain_choice(posterior / posterior.sum(), prior, usual_reason if usual else "the usual axis")


def _prior(suffix: str, usual: str) -> np.ndarray:
    """Prior probabilities (6,) of `AXES`."""
    share = np.array([PRIORS.get(suffix, _SCAN_PRIOR)[axis] for axis in AXES])
    if not usual:
        return share
    share[AXES.index(usual)] = 0.0
    share *= (1 - FILE_HINT_PRIOR) / share.sum()
    share[AXES.index(usual)] = FILE_HINT_PRIOR
    return share


def _explain_choice(posterior: np.ndarray, prior: np.ndarray, usual_reason: str) -> AxisGuess:
    """The likeliest axis with its reason in words, from its posterior and prior probabilities (6,)."""
    first, second = (int(place) for place in np.argsort(-posterior, kind="stable")[:2])
    expected = int(prior.argmax())
    other = AXES[second] if posterior[second] >= ALTERNATIVE_PROBABILITY else ""
    if first == expected and _odds(posterior[first]) < MIN_SHAPE_ODDS_RATIO * _odds(prior[first]):
        doubt = "" if prior[first] >= FILE_HINT_PRIOR else ", of which its shape tells little"
        return AxisGuess(AXES[first], usual_reason + doubt, other)
    certainty = "clearly" if posterior[first] >= CLEAR_PROBABILITY else "probably"
    reason = f"{certainty}, by its shape"
    if first == expected and usual_reason != "the usual axis":
        reason = f"{usual_reason}, and its shape says so"
    return AxisGuess(AXES[first], reason, other)


def _odds(probability: float) -> float:
    return float(probability / max(1 - probability, 1e-9))


def _axis_name(up: np.ndarray) -> str:
    """Name of the file's axis along a unit vector (3,)."""
    longest = int(np.abs(up).argmax())
    if abs(up[longest]) < 1 - 1e-6:
        return "the sensor's -Y"
    return ("+" if up[longest] > 0 else "-") + "XYZ"[longest]
