"""Description of one Blender render, free of bpy: what controls write and the render stage reads."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from typing import Any

SIDE_LIMITS = (32, 4096)
"""Smallest and largest width or height of a drawn image, in pixels. They are here since this file needs no numpy, which
the command line does not load before it has work to do."""
LIGHT_SIDE = 1.6
"""Side of the square area light, which faces the origin, in world units."""
LIGHT_RADIANCE = 18.0
"""Radiance of the area light, the same in all directions of its front side and in all three colors."""
AMBIENT = 0.35
"""Radiance of the sky, the same from everywhere."""
DEFAULT_BASE_COLOR = (0.8, 0.8, 0.8, 1.0)
"""Base color of Blender's Principled BSDF where no control sets one, linear RGBA."""

MaterialInput = float | tuple[float, ...]
"""Value of an input of Blender's Principled BSDF: a number, or a linear RGBA color."""

IDENTITY = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
"""Rotation matrix that turns nothing."""


@dataclass
class SceneDescription:
    """One image of one mesh. Units: world units (the mesh's bounding sphere has radius 1), degrees, linear color.

    `material` holds inputs of Blender's Principled BSDF by their names in Blender's interface. With none set the
    surface is diffuse without a specular lobe, as in the paper.
    """

    elevation: float = 20.0
    """Camera elevation above the horizon, degrees."""
    light: tuple[float, float, float] = (3.75, -40.0, 50.0)
    """Light's radius, azimuth relative to the camera (0 behind it, positive to image right), elevation; degrees."""
    material: dict[str, MaterialInput] = field(default_factory=dict)
    rotation: tuple[tuple[float, float, float], ...] = IDENTITY
    """Rotation matrix (rows) that turns the normalised mesh into the world."""
    lift: float = 0.0
    """How far the mesh hovers above the floor."""
    floor: float | None = None
    """Height of the floor in world units; None: it touches the lowest point of the turned mesh, before `lift`.

    A reconstructed mesh gets the true mesh's floor here, not one of its own.
    """

    def to_json(self) -> dict[str, Any]:
        """Lists and numbers for JSON, which `from_json` reads."""
        data = dataclasses.asdict(self)
        if self.floor is None:
            del data["floor"]  # scenes without one keep the fingerprint that they had before the field existed
        return data

    @classmethod
    def from_json(cls, data: dict[str, Any]) -> SceneDescription:
        """The description that `to_json` returned."""
        material = {name: tuple(x) if isinstance(x, list) else x for name, x in data["material"].items()}
        rotation = tuple(tuple(row) for row in data["rotation"])
        return cls(data["elevation"], tuple(data["light"]), material, rotation, data["lift"], data.get("floor"))
