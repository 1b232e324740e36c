"""What the file's line says of colours, which are not drawn."""

from __future__ import annotations

from collections.abc import Iterable

NOTE = "its colours are ignored"
_NAMES = frozenset({"red", "r", "rgb", "rgba", "diffuse_red", "colorred", "color", "colors", "color_0", "packed_color"})


def colours_note(names: Iterable[str]) -> str:
    """What to say of a file whose points have these fields beside their places; nothing if none is a colour."""
    return NOTE if any(name.lower() in _NAMES for name in names) else ""
