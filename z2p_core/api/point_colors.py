"""Colors of points, as callers of `render` give them: sRGB, scalars or labels for each point of each cloud, checked."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from z2p_core.errors.messages import error_reason
from z2p_core.interfaces import SettingError

MAX_NAMED_COLORS = 4
"""How many colors a message lists."""

def are_scalars(colors: Any, clouds: Sequence[np.ndarray]) -> bool:
    """Whether what a caller gives as colors is one number for each point of the clouds (N, 3), not three."""
    if isinstance(colors, Sequence) and len(colors) and not isinstance(colors[0], int | float | np.number):
        shapes = [np.shape(_to_array(part)) for part in colors]
        if any(len(shape) == 1 and (shape[0] not in (3, 4) or shape[0] == len(clouds[0])) for shape in shapes):
            return True
    shape = np.shape(_to_array(colors)) if not isinstance(colors, Sequence) or _is_regular(colors) else ()
    if len(shape) == 1 or (len(shape) > 1 and shape[-1] == 1):
        return True
    return len(shape) == 2 and shape == (len(clouds), len(clouds[0]))


def split_scalars(colors: Any, clouds: Sequence[np.ndarray]) -> tuple[np.ndarray, ...]:
    """Scalars or labels (N,) of each cloud (N, 3), of an array or tensor (N,), (B, N) or a list of (N,).

    Raises:
        SettingError: they are no real numbers, or not one for each point of all clouds or of every cloud.
    """
    try:
        is_list = isinstance(colors, Sequence) and not _is_regular(colors)
        flat = np.concatenate([_to_array(part).reshape(-1) for part in colors]) if is_list else _to_array(colors)
    except Exception as error:  # whatever another library's object raises on its way to an array
        message = f"expected colors as numbers, got {type(colors).__name__} ({error_reason(error)})"
        raise SettingError(message) from error
    flat = flat.reshape(-1)
    if flat.dtype.kind not in "fiub" or not len(flat):
        raise SettingError(f"expected colors as numbers, one or three for each point, got {flat.shape} {flat.dtype}")
    return split_by_cloud(flat, clouds)


def _is_regular(colors: Sequence[Any]) -> bool:
    """Whether the members of a list have one shape, so that they are one array."""
    return len({np.shape(_to_array(part)) for part in colors}) == 1


def parse_colors(colors: Any) -> np.ndarray:
    """sRGB colors (M, 3) float64 of an array, tensor or list (..., 3 or 4) of them; alpha is left out.

    Floats are in [0, 1]; integers count to 255, or to 1 if none is larger. NaN is a color that is not known.

    Raises:
        SettingError: they are no such numbers, or lie outside that range, or none is known.
    """
    try:
        parts = [_to_array(part) for part in colors] if isinstance(colors, Sequence) else []
        are_clouds = bool(parts) and all(part.ndim == 2 for part in parts)
        table = np.concatenate(parts) if are_clouds else _to_array(colors)
    except Exception as error:  # ragged lists, and whatever another library's object raises on its way to an array
        message = f"expected colors (N, 3) as numbers, got {type(colors).__name__} ({error_reason(error)})"
        raise SettingError(message) from error
    if table.size == 0 or table.ndim < 2 or table.shape[-1] not in (3, 4) or table.dtype.kind not in "fiu":
        raise SettingError(f"expected colors (N, 3) as numbers, got {table.shape} {table.dtype}")
    is_bytes = table.dtype.kind in "iu" and table.max() > 1
    srgb = table[..., :3].reshape(-1, 3) / (255.0 if is_bytes else 1.0)
    known = srgb[~np.isnan(srgb).any(axis=1)]
    if not len(known):
        raise SettingError("expected colors of the points, got only nan; leave colors out, or give one color=")
    if known.min() < 0 or known.max() > 1:
        raise SettingError(f"expected colors as floats from 0 to 1 or integers to 255, got {known.min():g} to "
                           f"{known.max():g}; divide them by their largest value")  # fmt: skip
    return srgb


def split_by_cloud(table: np.ndarray, clouds: Sequence[np.ndarray]) -> tuple[np.ndarray, ...]:
    """The colors (N, 3) or values (N,) of each cloud (N, 3), from those of all points, or of one that all share.

    Raises:
        SettingError: there is a color neither for each point of all clouds nor for each one of every cloud.
    """
    points = sum(map(len, clouds))
    if len(table) == points:
        return tuple(np.split(table, np.cumsum([len(cloud) for cloud in clouds])[:-1]))
    if any(len(cloud) != len(table) for cloud in clouds):
        raise SettingError(f"expected a color or value for each of the {points} points, got {len(table)}; leave colors "
                           "out, or give one color=")
    return (table,) * len(clouds)


def mean_color(srgb: np.ndarray) -> tuple[float, ...]:
    """Mean sRGB (3,) of colors (N, 3), of which some may be NaN."""
    known = srgb[~np.isnan(srgb).any(axis=1)]
    mean = known.mean(axis=0, dtype=np.float64) if len(known) else np.zeros(3)
    return tuple(mean.tolist())


def name_colors(colors: Sequence[Sequence[float]]) -> str:
    """The first few different colors as ``#rrggbb``, of sRGB triples in [0, 1]."""
    names = list(dict.fromkeys("#" + "".join(f"{round(255 * channel):02x}" for channel in color) for color in colors))
    return ", ".join(names[:MAX_NAMED_COLORS]) + (", ..." if len(names) > MAX_NAMED_COLORS else "")


def _to_array(colors: Any) -> np.ndarray:
    return np.asarray(colors.detach().cpu().numpy() if hasattr(colors, "detach") else colors)
