"""What points are colored by, as a user chooses it; checked."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from numbers import Integral, Real
from typing import Any

from z2p_core.interfaces import SettingError

AUTO, RGB, NONE = "auto", "rgb", "none"
DEFAULT_COLORMAP = "viridis"
LIMIT_PERCENTILES = (2.0, 98.0)
"""Percentiles of a field's values that a colormap spans, unless the user names limits."""
GIVEN_FIELD = "given values"
"""Name of the field that scalars or labels become that a caller in Python gives as an array; no legend shows it."""
CLASS_FIELDS = ("classification", "class", "label", "labels", "semantic", "segmentation", "category")
"""Usual names of the field by which classes are kept where points are not colored by another field of labels."""
MAX_KEPT_CLASSES = 1000
"""How many classes a user can name."""


@dataclass(frozen=True)
class ColorOptions:
    """What the points of a cloud are colored by."""

    by: str = AUTO
    """``auto``: their own colors where there are some, and no one color is chosen; ``rgb``: these; ``none``: one color
    for all; else the name of a field."""
    colormap: str | None = None
    """Name of a colormap; None: `DEFAULT_COLORMAP` for scalars, and a palette of different colors for labels."""
    limits: tuple[float, float] | None = None
    """The values at both ends of the colormap; None: percentiles of each cloud's values."""
    classes: tuple[int, ...] = ()
    """Labels of the points that are kept; empty: all."""
    relight: float | None = None
    """How much of the studio's light falls on the colors, 0 to 1; None: a default for their kind."""
    color_bar: bool = False
    """Whether the picture shows the color bar, or the legend of the classes."""
    is_categorical: bool | None = None
    """Whether a field's values are labels, as a series decided it for all of its clouds; None: by each cloud."""

    other_fields: tuple[str, ...] = ()
    """Names of fields that must be read for other things than colors."""

    @property
    def wanted_fields(self) -> tuple[str, ...]:
        """Names of the fields that must be read."""
        kept_by = CLASS_FIELDS if self.classes else ()
        own = (RGB,) if self.by in (AUTO, RGB) else () if self.by == NONE else (self.by,)
        return (*own, *kept_by, *self.other_fields)

    @property
    def needs_common_scale(self) -> bool:
        """Whether several clouds would have a scale each: by a field's values, without common limits or labels."""
        return self.field is not None and self.limits is None and self.is_categorical is None

    @property
    def field(self) -> str | None:
        """The name of the field of scalars or labels; None if colors are the points' own, or one for all."""
        return None if self.by in (AUTO, RGB, NONE) else self.by


def parse_limits(limits: Any) -> tuple[float, float] | None:
    """The limits of a colormap: None, or two finite numbers in ascending order.

    Raises:
        SettingError: they are something else.
    """
    if limits is None:
        return None
    try:
        low, high = (float(limit) for limit in limits)
    except (TypeError, ValueError, OverflowError):
        low = high = math.nan
    if not (math.isfinite(low) and math.isfinite(high) and low < high):
        raise SettingError(f"expected limits LOW,HIGH as two finite numbers, the lower one first, got {limits!r}")
    return low, high


def parse_classes(classes: Any) -> tuple[int, ...]:
    """Labels to keep, of one or several whole numbers; None for all.

    Raises:
        SettingError: they are something else, or none.
    """
    if classes is None:
        return ()
    given: Sequence[Any] = [classes] if isinstance(classes, Integral) else list(classes)
    if not 1 <= len(given) <= MAX_KEPT_CLASSES or not all(isinstance(one, Integral) for one in given):
        raise SettingError(f"expected classes as whole numbers, such as 2,5,6, got {classes!r}")
    return tuple(sorted({int(one) for one in given}))


def parse_relight(relight: Any) -> float | None:
    """How much of the studio's light falls on colors, 0 to 1; None for the default.

    Raises:
        SettingError: it is something else.
    """
    if relight is None:
        return None
    if isinstance(relight, bool) or not isinstance(relight, Real) or not 0 <= float(relight) <= 1:
        raise SettingError(f"expected relight from 0 to 1, got {relight!r}")
    return float(relight)
