"""Roughness of the surface, as in Blender's Principled BSDF (paper section 4.7)."""

from __future__ import annotations

from z2p_core.interfaces import Control, Slider, Value
from z2p_core.scene import SceneDescription


class Roughness(Control):
    """0 mirrors, 1 is matt."""

    name = "roughness"
    version = "1"
    slider = Slider(
        components=("roughness",),
        low=(0.0,),
        high=(1.0,),
        default=(0.5,),
        help="0 mirror-like to 1 matt",
        metavar="0..1",
    )

    def apply(self, value: Value, scene: SceneDescription) -> None:
        scene.material["Roughness"] = value[0]
        scene.material["Specular IOR Level"] = 0.5  # Blender's default: the plain diffuse surface has none
