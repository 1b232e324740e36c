"""Colour of the surface, as the user writes it in sRGB; Cycles gets it in linear light."""

from __future__ import annotations

from z2p_core.images import linear_from_srgb
from z2p_core.interfaces import Control, SettingError, Slider, Value
from z2p_core.scene import SceneDescription


class Color(Control):
    """Base colour, sRGB in [0, 1]."""

    name = "color"
    version = "1"
    slider = Slider(
        components=("red", "green", "blue"),
        low=(0.0, 0.0, 0.0),
        high=(1.0, 1.0, 1.0),
        default=(0.29, 0.53, 0.73),
        help="surface colour: a CSS name, #hex, or r,g,b with each 0 to 1",
        metavar="COLOR",
    )

    def parse(self, text: str) -> Value:
        """sRGB triple from an opaque CSS colour name, ``#rgb``, ``#rrggbb`` or ``r,g,b`` in [0, 1].

        Raises:
            SettingError: the text is none of these.
        """
        if "," in text:
            return super().parse(text)
        from PIL import ImageColor  # late: a plugin listing needs no pillow

        try:
            red, green, blue, *alpha = ImageColor.getrgb(text)
        except ValueError:
            raise SettingError(
                f"--color: expected a CSS colour name, #hex, or r,g,b with each 0 to 1, got {text!r}"
            ) from None
        if alpha not in ([], [255]):
            raise SettingError(f"--color: expected an opaque colour, as surfaces are, got {text!r}")
        return (red / 255, green / 255, blue / 255)

    def apply(self, value: Value, scene: SceneDescription) -> None:
        red, green, blue = (float(linear_from_srgb(channel)) for channel in value)
        scene.material["Base Color"] = (red, green, blue, 1.0)
