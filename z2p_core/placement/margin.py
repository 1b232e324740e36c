"""How much of a picture is left free around the object: the camera stays, and the object is made larger or smaller."""

from __future__ import annotations

import math
from dataclasses import replace
from numbers import Real
from typing import Any

from z2p_core.camera import DISTANCE, FIELD_OF_VIEW
from z2p_core.interfaces import SettingError
from z2p_core.placement.viewpoint import Viewpoint

MAX_MARGIN = 0.45
"""Largest margin on each side of the object, as a share of the picture's shorter side."""
HALF_WIDTH = math.tan(math.radians(FIELD_OF_VIEW / 2))
"""Half the width of the camera's view at distance 1."""
DEFAULT_MARGIN = (1 - math.tan(math.asin(1 / DISTANCE)) / HALF_WIDTH) / 2
"""Margin around the unit sphere, into which every object is scaled: 0.103."""


def parse_margin(wish: Any) -> float | None:
    """The margin as a share of the shorter side, from a share (0.1) or percent (10, ``10%``); None stays None.

    Raises:
        SettingError: it is neither, or leaves no room for the object.
    """
    if wish is None:
        return None
    text = wish.strip() if isinstance(wish, str) else ""
    try:
        margin = math.nan if isinstance(wish, bool) else float(text.removesuffix("%") if text else wish)
    except (TypeError, ValueError, OverflowError):
        margin = math.nan
    if text.endswith("%") or margin >= 1:
        margin /= 100
    if not 0 <= margin <= MAX_MARGIN or not (text or isinstance(wish, Real)):
        raise SettingError(f"margin: expected a share of the shorter side from 0 to {MAX_MARGIN:g}, or percent "
                           f"as in 10%, got {wish!r}")  # fmt: skip
    return margin


def radius_with_margin(margin: float | None) -> float:
    """Radius in world units of the sphere that leaves this margin around it; 1 for None."""
    if margin is None:
        return 1.0
    return DISTANCE * math.sin(math.atan((1 - 2 * margin) * HALF_WIDTH))


def with_margin(viewpoint: Viewpoint, margin: float | None) -> Viewpoint:
    """The viewpoint that leaves this margin around an object that fits the frame of the given viewpoint."""
    return _resized(viewpoint, radius_with_margin(margin))


def without_margin(viewpoint: Viewpoint, margin: float | None) -> Viewpoint:
    """The viewpoint to which `with_margin` adds this margin: its inverse."""
    return _resized(viewpoint, 1 / radius_with_margin(margin))


def _resized(viewpoint: Viewpoint, factor: float) -> Viewpoint:
    floor = None if viewpoint.floor is None else viewpoint.floor * factor
    return viewpoint if factor == 1 else replace(viewpoint, radius=viewpoint.radius / factor, floor=floor)
