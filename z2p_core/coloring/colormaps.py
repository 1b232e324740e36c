"""Colormaps by the names of matplotlib, colorcet, Crameri and others: the catalogue of the package ``cmap``."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from z2p_core.errors.did_you_mean import closest_name
from z2p_core.interfaces import SettingError

if TYPE_CHECKING:
    from cmap._catalog import Catalog

LUT_LEVELS = 256
"""Colors in a colormap's table."""
COMMON_COLORMAPS = ("viridis", "turbo", "batlow", "cividis", "inferno", "coolwarm", "RdBu", "gray")
"""Names that an error message lists."""
_COLLECTIONS_OF_PREFIX = {"cet_": "colorcet", "cmo.": "cmocean", "cmr.": "cmasher", "cmc.": "crameri"}
"""What packages put before their colormaps' names in matplotlib -> their collection's name in ``cmap``."""


def colormap_lut(name: str) -> np.ndarray:
    """A colormap's colors (256, 3) float32 sRGB in [0, 1] from its low to its high end; read-only.

    Names are those of the package ``cmap``, in upper or lower case, alone (``batlow``) or behind their collection
    (``crameri:batlow``), and those of other packages in matplotlib (``cmc.batlow``); ``_r`` behind a name reverses
    the map. Maps of a few colors hold bands of one color each.

    Raises:
        SettingError: no colormap has the name.
    """
    if not isinstance(name, str):
        raise SettingError(f"expected the name of a colormap, such as {COMMON_COLORMAPS[0]}, got {name!r}")
    return _cached_lut(name.strip())


@lru_cache(maxsize=64)
def _cached_lut(name: str) -> np.ndarray:
    from cmap import Colormap  # late: its import and its catalogue take some 90 ms

    stem, is_reversed = (name[:-2], True) if name.lower().endswith("_r") else (name, False)
    full_name = _full_name(stem, Colormap.catalog())
    if full_name is None:
        raise SettingError(_unknown_message(name, stem, is_reversed, Colormap.catalog()))
    colors = np.clip(Colormap(full_name).lut(LUT_LEVELS)[:, :3], 0, 1).astype(np.float32)
    lut = colors[np.arange(LUT_LEVELS) * len(colors) // LUT_LEVELS]  # maps of a few colors give just these
    lut = np.ascontiguousarray(lut[::-1] if is_reversed else lut)
    lut.setflags(write=False)
    return lut


def _full_name(name: str, catalogue: Catalog) -> str | None:
    """The name with its collection, by which ``cmap`` takes it without a warning; None if there is no such map.

    Of collections that have a map of the same name, matplotlib's is taken, and then the first.
    """
    prefix = next((prefix for prefix in _COLLECTIONS_OF_PREFIX if name.lower().startswith(prefix)), None)
    if prefix is not None:
        in_collection = _full_name(f"{_COLLECTIONS_OF_PREFIX[prefix]}:{name[len(prefix):]}", catalogue)
        if in_collection is not None:
            return in_collection
    try:
        return catalogue.resolve(name)
    except KeyError:
        behind_collection = f":{name.lower()}"
        return next((known for known in catalogue if name and known.lower().endswith(behind_collection)), None)


def _unknown_message(name: str, stem: str, is_reversed: bool, catalogue: Catalog) -> str:
    """What an unknown name's error says: the name that it may stand for, and some common ones."""
    near = closest_name(stem.lower(), {known.lower() for known in catalogue if ":" not in known or ":" in stem})
    hint = "" if near is None else f" Did you mean {near}{'_r' if is_reversed else ''}?"
    return (f"no colormap has the name {name!r}.{hint} Common ones are {', '.join(COMMON_COLORMAPS)}; _r behind a "
            "name reverses it, and all names are listed at https://cmap-docs.readthedocs.io")
