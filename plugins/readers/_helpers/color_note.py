"""The note for the user on colors, which are not drawn."""

from __future__ import annotations

from collections.abc import Iterable

from z2p_core.api.point_cloud_objects import names_include_color

IGNORED_NOTE = "its colours are ignored"


def colours_note(names: Iterable[str]) -> str:
    """The note on a file whose points have fields with these names; empty if none of them is a color."""
    return IGNORED_NOTE if names_include_color(names) else ""
