"""Metallic of the surface, as in Blender's Principled BSDF (paper section 4.7)."""

from __future__ import annotations

from z2p_core.interfaces import Control, Slider, Value
from z2p_core.scene import SceneDescription


class Metallic(Control):
    """0 is a dielectric such as plastic, 1 a metal."""

    name = "metallic"
    version = "1"
    slider = Slider(
        components=("metallic",),
        low=(0.0,),
        high=(1.0,),
        default=(0.0,),
        help="0 plastic to 1 metal",
        metavar="0..1",
    )

    def apply(self, value: Value, scene: SceneDescription) -> None:
        scene.material["Metallic"] = value[0]
        scene.material["Specular IOR Level"] = 0.5  # Blender's default: the plain diffuse surface has none
