"""How a field's values become colors: a colormap between two limits for scalars, an entry for each class of labels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from z2p_core.coloring.colormaps import LUT_LEVELS, colormap_lut
from z2p_core.interfaces import SettingError

Color = tuple[float, float, float]
"""sRGB, each channel in [0, 1]."""


@dataclass(frozen=True)
class ColorScale:
    """A scalar field's colors: a colormap between two limits.

    Raises:
        SettingError: a limit is not finite, or `low` is above `high`.
    """

    field: str
    """The field's name, as it is drawn beside a color bar; any text."""
    colormap: str
    """A name that `colormap_lut` knows."""
    low: float
    """Value of the colormap's first color, in the field's unit."""
    high: float
    """Value of the colormap's last color; may equal `low`: then that value has the middle color."""
    unit: str = ""
    """The field's unit, as it is drawn in brackets behind the name; empty if unknown."""

    def __post_init__(self) -> None:
        if not (np.isfinite(self.low) and np.isfinite(self.high) and self.low <= self.high):
            raise SettingError(f"expected two finite limits of colors, the lower one first, got {self.low:g} and "
                               f"{self.high:g}")

    def colors_of(self, values: np.ndarray) -> np.ndarray:
        """Colors (N, 3) float32 sRGB of values (N,) of any numeric type.

        Values outside the limits have the colors of the ends; rows of values that are NaN or infinite are NaN.

        Raises:
            SettingError: no colormap has the name.
        """
        values = np.asarray(values, dtype=np.float64)
        known = np.isfinite(values)
        colors = colormap_lut(self.colormap)[self._levels(np.where(known, values, self.low))]
        colors[~known] = np.nan
        return colors

    def _levels(self, values: np.ndarray) -> np.ndarray:
        """Indices (N,) of finite values into the colormap's table."""
        half_span = self.high / 2 - self.low / 2  # halves, as the difference of two large numbers may be infinite
        if half_span == 0:
            shares = 0.5 + 0.5 * np.sign(values - self.low)
        else:
            shares = (np.clip(values, self.low, self.high) / 2 - self.low / 2) / half_span
        return np.minimum((shares * LUT_LEVELS).astype(np.intp), LUT_LEVELS - 1)


@dataclass(frozen=True)
class ClassEntry:
    """One class of a field of labels."""

    value: int
    """The label."""
    name: str
    """The class's name, as a legend shows it; the label itself if it has no name."""
    color: Color
    count: int = 0
    """Points with this label; 0 if they were not counted."""


@dataclass(frozen=True)
class ClassColors:
    """Colors of a field of labels."""

    field: str
    """The field's name, as it is drawn above a legend; any text."""
    entries: tuple[ClassEntry, ...]
    """The classes in the order of the legend, each value once."""

    def colors_of(self, values: np.ndarray) -> np.ndarray:
        """Colors (N, 3) float32 sRGB of labels (N,) of any numeric type; NaN for a value that has no entry."""
        labels, is_label = _integer_labels(np.asarray(values))
        if not self.entries:
            return np.full((len(labels), 3), np.nan, dtype=np.float32)
        known_labels = np.array([_to_int64(entry.value) for entry in self.entries], dtype=np.int64)
        palette = np.array([entry.color for entry in self.entries], dtype=np.float32)
        order = np.argsort(known_labels, kind="stable")
        places = order[np.minimum(np.searchsorted(known_labels, labels, sorter=order), len(order) - 1)]
        colors = palette[places]
        colors[~is_label | (known_labels[places] != labels)] = np.nan
        return colors


def _integer_labels(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Labels (N,) as int64, and which of the values are whole numbers and so can be labels."""
    if values.dtype.kind in "iub":
        return values.astype(np.int64), np.ones(len(values), dtype=bool)
    values = values.astype(np.float64)
    is_label = (np.abs(values) < 2.0**63) & (np.floor(values) == values)
    return np.where(is_label, values, 0).astype(np.int64), is_label


def _to_int64(label: int) -> int:
    """A label of 64 bits as a signed number: labels from 2**63 on wrap, as arrays of uint64 do."""
    return (label + 2**63) % 2**64 - 2**63
