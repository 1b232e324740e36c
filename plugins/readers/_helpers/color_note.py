"""What the file's line says of colours, which are not drawn."""

from __future__ import annotations

from collections.abc import Iterable

from z2p_core.api.point_cloud_objects import names_include_color

IGNORED_NOTE = "its colours are ignored"


def colours_note(names: Iterable[str]) -> str:
    """What to say of a file whose points have these fields beside their places; nothing if none is a colour."""
    return IGNORED_NOTE if names_include_color(names) else ""
