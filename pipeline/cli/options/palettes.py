"""Color palettes for series of figures, which color-blind readers can tell apart as well."""

from __future__ import annotations

from z2p_core.interfaces import Value

PALETTES = {
    "okabe-ito": ("#0072b2", "#e69f00", "#009e73", "#cc79a7", "#56b4e9", "#d55e00", "#f0e442"),
    "tol-bright": ("#4477aa", "#ee6677", "#228833", "#ccbb44", "#66ccee", "#aa3377", "#bbbbbb"),
    "tol-muted": ("#88ccee", "#44aa99", "#117733", "#332288", "#ddcc77", "#999933", "#cc6677", "#882255", "#aa4499"),
    "greys": ("#f2f2f2", "#cccccc", "#a6a6a6", "#808080", "#595959"),
}
"""Name -> colors in the order of use: Okabe and Ito (2008, without black), Paul Tol's schemes (2021), and greys."""


def palette_colors(name: str) -> tuple[Value, ...]:
    """The colors of a palette, as sRGB in [0, 1].

    Raises:
        KeyError: there is no palette of that name.
    """
    return tuple((int(c[1:3], 16) / 255, int(c[3:5], 16) / 255, int(c[5:7], 16) / 255) for c in PALETTES[name])
