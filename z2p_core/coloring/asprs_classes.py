"""Customary colors of the standard point classes of LAS files, which `z2p_core.formats.las_classes` names."""

from __future__ import annotations

ASPRS_COLORS: dict[int, tuple[float, float, float]] = {
    0: (0.74, 0.74, 0.74), 1: (0.62, 0.62, 0.62), 2: (0.63, 0.44, 0.26), 3: (0.71, 0.80, 0.33),
    4: (0.42, 0.70, 0.27), 5: (0.11, 0.48, 0.20), 6: (0.89, 0.36, 0.20), 7: (0.80, 0.10, 0.52),
    8: (0.83, 0.64, 0.25), 9: (0.15, 0.48, 0.82), 10: (0.47, 0.29, 0.58), 11: (0.40, 0.41, 0.45),
    12: (0.80, 0.71, 0.58), 13: (0.93, 0.78, 0.16), 14: (0.97, 0.62, 0.10), 15: (0.22, 0.31, 0.60),
    16: (0.68, 0.54, 0.06), 17: (0.52, 0.61, 0.80), 18: (0.96, 0.30, 0.74), 19: (0.36, 0.62, 0.66),
    20: (0.48, 0.36, 0.27), 21: (0.66, 0.85, 0.92), 22: (0.55, 0.47, 0.52),
}  # fmt: skip
"""Class -> sRGB in [0, 1]: ground brown, vegetation green, buildings red, water blue, unclassified points grey."""
