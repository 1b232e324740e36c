"""Colors of labels: the customary ones of LAS classes, and for other labels a palette of colors that are told apart."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache

import numpy as np

from z2p_core.coloring.asprs_classes import ASPRS_COLORS
from z2p_core.coloring.scales import ClassColors, ClassEntry, Color
from z2p_core.formats.las_classes import LAS_CLASS_NAMES
from z2p_core.images import linear_from_srgb

UNLABELLED_COLOR: Color = (0.62, 0.62, 0.62)
"""Color of all negative labels."""
_MAX_TABLE_SPAN = 1 << 20
"""Labels that span no more values are counted in a table, others by sorting."""
_MIN_LIGHTNESS, _MAX_LIGHTNESS = 32, 82
"""CIELAB lightness of the palette's colors: none as dark as a shadow, none as light as a white background."""
_MIN_CHROMA = 18
"""CIELAB chroma of the palette's colors: greys are left to points without a label."""
_MIN_DISTANCES = (28, 14)
"""CIELAB distance of any two of the palette's colors: of its first ones, as far as they go, and then of all."""
_PALETTE_LENGTH = 139
"""Colors in the palette; a prime number, so that labels at equal steps have different colors."""


def class_colors(
    field: str,
    values: np.ndarray,
    class_names: Mapping[int, str] | None = None,
    colors_given: Mapping[int, Color] | None = None,
) -> ClassColors:
    """The classes that occur among labels (N,) of any numeric type, by value, with names, colors and counts.

    The classes of LAS files (a field named ``classification``, in upper or lower case, or CloudCompare's
    ``scalar_Classification``) have their customary colors, negative labels are grey, and all others have the color of
    their number in `label_palette`. So a label has the same color in every cloud, whatever other labels it holds.
    Values that are no whole numbers belong to no class.

    Args:
        field: the field's name.
        values: labels (N,).
        class_names: names of some labels; others have the standard's name, or their number.
        colors_given: colors of some labels, in the place of their own.
    """
    names, given = class_names or {}, colors_given or {}
    is_las = field.casefold().removeprefix("scalar_") == "classification"
    entries = []
    for label, count in _count_labels(np.asarray(values)):
        name = names.get(label) or (LAS_CLASS_NAMES.get(label) if is_las else None) or _number_name(label)
        color = given.get(label) or (ASPRS_COLORS.get(label) if is_las else None) or label_color(label)
        entries.append(ClassEntry(label, name, color, count))
    return ClassColors(field, tuple(entries))


def label_color(label: int) -> Color:
    """The color of a label without a customary one; grey if it is negative.

    Labels beyond the palette's length begin it again, at first darker and then lighter.
    """
    if label < 0:
        return UNLABELLED_COLOR
    palette = label_palette()
    color = palette[label % len(palette)]
    round_number = label // len(palette) % 3
    if round_number == 0:
        return color
    towards, share = (0.0, 0.3) if round_number == 1 else (1.0, 0.3)
    red, green, blue = (channel + (towards - channel) * share for channel in color)
    return red, green, blue


@lru_cache(maxsize=1)
def label_palette() -> tuple[Color, ...]:
    """Colors of the labels 0, 1, 2 and so on: Tableau's ten but for the grey, then Glasbey's that fit with them."""
    from cmap import Colormap  # late: its import and its catalogue take some 90 ms

    candidates = np.concatenate([Colormap(name).lut()[:, :3] for name in ("tab10", "glasbey")])
    lab = _cielab(candidates)
    chroma = np.hypot(lab[:, 1], lab[:, 2])
    fits = (lab[:, 0] > _MIN_LIGHTNESS) & (lab[:, 0] < _MAX_LIGHTNESS) & (chroma > _MIN_CHROMA)
    chosen: list[int] = []
    for distance in _MIN_DISTANCES:
        for index in np.nonzero(fits)[0]:
            if not chosen or np.linalg.norm(lab[chosen] - lab[index], axis=1).min() > distance:
                chosen.append(int(index))
    return tuple((float(red), float(green), float(blue)) for red, green, blue in candidates[chosen[:_PALETTE_LENGTH]])


def _cielab(srgb: np.ndarray) -> np.ndarray:
    """CIELAB (N, 3) float64, white point D65, of sRGB (N, 3) in [0, 1]."""
    to_xyz = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])
    xyz = linear_from_srgb(np.asarray(srgb, dtype=np.float64)) @ to_xyz.T / to_xyz.sum(axis=1)
    x, y, z = np.where(xyz > 0.008856, np.cbrt(xyz), 7.787 * xyz + 16 / 116).T
    return np.stack([116 * y - 16, 500 * (x - y), 200 * (y - z)], axis=1)


def _number_name(label: int) -> str:
    """The name of a label without one."""
    return "unlabelled" if label == -1 else str(label)


def _count_labels(values: np.ndarray) -> list[tuple[int, int]]:
    """Each whole number among values (N,), in rising order, and how often it occurs."""
    if values.dtype.kind not in "iub":
        values = values[(np.abs(values) < 2.0**63) & (np.floor(values) == values)]
    if values.size == 0:
        return []
    low, high = int(values.min()), int(values.max())
    if high - low < _MAX_TABLE_SPAN and abs(low) < 2**62:
        counts = np.bincount(values.astype(np.int64) - low)
        return [(low + int(offset), int(counts[offset])) for offset in np.nonzero(counts)[0]]
    labels, counts = np.unique(values, return_counts=True)
    return [(int(label), int(count)) for label, count in zip(labels, counts, strict=True)]
