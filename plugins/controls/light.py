"""Where the area light stands, in spherical coordinates relative to the camera (paper section 3.2)."""

from __future__ import annotations

from z2p_core.interfaces import Control, Slider, Value
from z2p_core.scene import SceneDescription


class Light(Control):
    """Light position: radius in world units, azimuth and elevation in degrees."""

    name = "light"
    version = "1"
    slider = Slider(
        components=("radius", "azimuth", "elevation"),
        low=(3.0, -90.0, 25.0),
        high=(4.5, 90.0, 75.0),
        default=(3.6, -40.0, 50.0),
        help="light position: radius 3 to 4.5, azimuth -90 to 90 (0 behind the camera, positive right), "
        "elevation 25 to 75 degrees",
        metavar="R,AZ,EL",
    )

    def mirrored(self, value: Value) -> Value:
        radius, azimuth, elevation = value
        return radius, -azimuth, elevation

    def apply(self, value: Value, scene: SceneDescription) -> None:
        radius, azimuth, elevation = value
        scene.light = (radius, azimuth, elevation)
