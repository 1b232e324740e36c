"""Whether weights know how a camera sees a cloud: they were trained on one distance, upright and from above.

The picture may show any part of the usual frame, at any size: these are the same to a convolutional network.
"""

from __future__ import annotations

import math

import numpy as np

from z2p_core.placement.placed_camera import FRAME_PER_FOCAL, PlacedCamera

MIN_DISTANCE_RADII = 1.3
"""Distance from the camera to the middle of the cloud, in the cloud's radius, below which perspective is too strong.
From there to parallel rays the network is 4 dB better than the rough rendering, as for the usual view."""
MAX_ELEVATION_DEGREES = 82.0
MIN_ELEVATION_DEGREES = -2.0
MAX_ROLL_DEGREES = 12.0
MAX_PIXEL_ASPECT = 1.03
"""Largest ratio of the two focal lengths at which pixels count as square."""
MIN_FRAME_PIXELS = 64
"""Side of the frame that the cloud would fill, in pixels, below which its details are too small."""
FIXED_ELEVATION_TOLERANCE_DEGREES = 3.0


def unfamiliar_view(camera: PlacedCamera, floor: float) -> str:
    """Why weights do not know how a camera sees a cloud on a floor of that height, in words; empty if they do."""
    if not camera.orthographic:
        if camera.position[2] < floor:
            return "it stands below the floor"
        if camera.origin_distance < 1:
            return "it stands inside the cloud"
        if camera.origin_distance < MIN_DISTANCE_RADII:
            return "it stands so near that its perspective is strong"
    if camera.elevation > MAX_ELEVATION_DEGREES:
        return "it looks down too steeply"
    if camera.elevation < MIN_ELEVATION_DEGREES:
        return "it looks up"
    if abs(roll_degrees(camera)) > MAX_ROLL_DEGREES:
        return f"it is rolled by {round(roll_degrees(camera))} degrees"
    fx, fy = camera.focal_lengths
    if max(fx, fy) > MAX_PIXEL_ASPECT * min(fx, fy):
        return "its pixels are oblong"
    if FRAME_PER_FOCAL * camera.pixels_per_unit < MIN_FRAME_PIXELS:
        return "the cloud is tiny in its picture"
    return ""


def roll_degrees(camera: PlacedCamera) -> float:
    """Degrees by which the vertical leans in the picture, at the middle of the cloud; 0 if it stands upright."""
    in_camera = camera.rotation @ np.array([0.0, 0.0, 1.0])
    if not camera.orthographic:
        middle = -camera.rotation @ camera.position
        in_camera = in_camera - middle * in_camera[2] / middle[2] if middle[2] else in_camera
    right, down = in_camera[:2]
    return math.degrees(math.atan2(right, -down)) if math.hypot(right, down) > 1e-6 else 0.0
