"""How high the camera stands: it moves the projection as well as the settings vector."""

from __future__ import annotations

import numpy as np

from z2p_core.interfaces import Control, Slider, Value
from z2p_core.scene import SceneDescription


class Elevation(Control):
    """Camera elevation above the horizon, degrees; below 0 the camera would sink under the floor."""

    name = "elevation"
    version = "1"
    slider = Slider(
        components=("elevation",),
        low=(0.0,),
        high=(80.0,),
        default=(20.0,),
        help="camera elevation above the horizon, 0 to 80 degrees",
        metavar="DEG",
    )

    def draw(self, rng: np.random.Generator) -> Value:
        """Half the renders between 10 and 35 degrees, where people look from; half anywhere."""
        low, high = (10.0, 35.0) if rng.uniform() < 0.5 else (0.0, 80.0)
        return (float(rng.uniform(low, high)),)

    def apply(self, value: Value, scene: SceneDescription) -> None:
        scene.elevation = value[0]
