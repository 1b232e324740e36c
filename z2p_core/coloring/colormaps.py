"""Colormaps by the names of matplotlib, colorcet, Crameri and others: the catalogue of the package ``cmap``."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from z2p_core.errors.did_you_mean import closest_name
from z2p_core.interfaces import SettingError

LUT_LEVELS = 256
"""Colors in a colormap's table."""
COMMON_COLORMAPS = ("viridis", "turbo", "batlow", "cividis", "inferno", "coolwarm", "RdBu", "gray")
"""Names that an error message lists."""


def colormap_lut(name: str) -> np.ndarray:
    """A colormap's colors (256, 3) float32 sRGB in [0, 1] from its low to its high end; read-only.

    Names are those of the package ``cmap``, in upper or lower case, alone (``batlow``) or behind their collection
    (``crameri:batlow``); ``_r`` behind a name turns the map round. Maps of few colors hold bands of one color each.

    Raises:
        SettingError: no colormap has the name.
    """
    if not isinstance(name, str):
        raise SettingError(f"expected the name of a colormap, such as {COMMON_COLORMAPS[0]}, got {name!r}")
    return _cached_lut(name.strip())


@lru_cache(maxsize=64)
def _cached_lut(name: str) -> np.ndarray:
    from cmap import Colormap  # late: its import takes some 60 ms

    try:
        colormap = Colormap(name)
    except ValueError:
        raise SettingError(_unknown_message(name)) from None
    lut = np.clip(colormap.lut(LUT_LEVELS)[:, :3], 0, 1).astype(np.float32)
    lut.setflags(write=False)
    return lut


def _unknown_message(name: str) -> str:
    """What an unknown name's error says: the name that it may stand for, and some common ones."""
    from cmap import Catalog

    stem, is_reversed = (name[:-2], True) if name.lower().endswith("_r") else (name, False)
    near = closest_name(stem.lower(), [known for known in Catalog() if not known.endswith("_r")])
    hint = "" if near is None else f" Did you mean {near}{'_r' if is_reversed else ''}?"
    return (f"no colormap has the name {name!r}.{hint} Common ones are {', '.join(COMMON_COLORMAPS)}; _r behind a "
            "name turns it round, and all names are listed at https://cmap-docs.readthedocs.io")
