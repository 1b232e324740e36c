"""Clear coat on the surface: the varnish of Blender's Principled BSDF, as a z2p control."""

from __future__ import annotations

from z2p_core.interfaces import Control, Slider, Value
from z2p_core.scene import SceneDescription


class Coat(Control):
    """0 is bare, 1 is fully varnished."""

    name = "coat"
    version = "1"
    slider = Slider(
        components=("coat",),
        low=(0.0,),
        high=(1.0,),
        default=(0.0,),
        help="clear coat, 0 bare to 1 varnished",
        metavar="0..1",
    )

    def apply(self, value: Value, scene: SceneDescription) -> None:
        scene.material["Coat Weight"] = value[0]
        scene.material["Coat Roughness"] = 0.1  # low enough for a clear highlight, wide enough to be learnt
