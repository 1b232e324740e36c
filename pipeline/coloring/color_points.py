"""The colors of a placed scan's points: their own, or those of a scalar field or of labels."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from z2p_core.coloring.class_palettes import class_colors
from z2p_core.coloring.options import AUTO, DEFAULT_COLORMAP, GIVEN_FIELD, LIMIT_PERCENTILES, NONE, RGB, ColorOptions
from z2p_core.coloring.scales import ClassColors, ColorScale
from z2p_core.formats.field_names import field_key
from z2p_core.formats.row_subsampling import MAX_ROWS_LIMIT
from z2p_core.images import linear_from_srgb
from z2p_core.interfaces import PointColors, ScanError
from z2p_core.linalg import CHUNK_POINTS
from z2p_core.placement.viewpoint import Viewpoint
from z2p_renderer.pipeline.coloring.fields import HEIGHT, ScalarField, find_scalars
from z2p_renderer.storage.scans.clouds import Scan

Scale = ColorScale | ClassColors

MAX_COLOR_SAMPLES = MAX_ROWS_LIMIT
"""Colors of a cloud that are used: those of all points that are drawn."""
MISSING_VALUE_COLOR = (0.62, 0.62, 0.62)
"""sRGB of points whose field is nan."""
RGB_RELIGHT = 1.0
"""How much of the studio's light falls on the points' own colors, unless the user says."""


@dataclass(frozen=True)
class Coloring:
    """Colors of points, and where they come from."""

    points: np.ndarray
    """(K, 3) float64, in the scan's units and axes."""
    srgb: np.ndarray
    """(K, 3) float32 in [0, 1]."""
    relight: float
    """How much of the studio's light falls on them, 0 to 1."""
    scale: Scale | None = None
    """The colormap with its limits, or the classes; None for the points' own colors."""
    field: str = RGB
    """The name of their field."""
    description: str = ""
    """Where they come from, in words for the scan's line."""

    def place(self, viewpoint: Viewpoint) -> PointColors:
        """The colors before the camera; of very many every k-th one."""
        step = -(-len(self.points) // MAX_COLOR_SAMPLES) or 1
        srgb = self.srgb[::step]
        albedo = np.empty(srgb.shape, np.float32)
        for start in range(0, len(srgb), CHUNK_POINTS):  # what comes in between would take much memory
            albedo[start : start + CHUNK_POINTS] = linear_from_srgb(srgb[start : start + CHUNK_POINTS])
        return PointColors(viewpoint.place(self.points[::step]), albedo, self.relight)

    def to_json(self) -> dict[str, Any]:
        """What a picture's record says of the colors."""
        scale: dict[str, Any] = {}
        if isinstance(self.scale, ColorScale):
            scale = {"colormap": self.scale.colormap, "clim": [self.scale.low, self.scale.high]}
        return {"color_by": self.field, **scale, "relight": self.relight}


def color_points(scan: Scan, viewpoint: Viewpoint, options: ColorOptions) -> Coloring | None:
    """The colors of a scan's points; None if all have one color.

    Raises:
        ScanError: the scan has no such field, or no value in it.
    """
    if options.by in (AUTO, RGB):
        return _own_colors(scan, options)
    if options.by == NONE:
        return None
    scalars = scalars_of(scan, options.by, viewpoint)
    relight = 1.0 if options.relight is None else options.relight
    scale, how = scale_of(scalars, options)
    srgb = scale.colors_of(scalars.values)
    missing = np.isnan(srgb).any(axis=1)
    srgb[missing] = MISSING_VALUE_COLOR
    without = f", {int(missing.sum())} points without a value in grey" if missing.any() else ""
    return Coloring(scalars.points, srgb, relight, scale, scalars.name, f"coloured by {how}{without}")


def scalars_of(scan: Scan, name: str, viewpoint: Viewpoint | None) -> ScalarField:
    """The values of the field of that name; ``height`` is that of the placed cloud if the scan has no such field.

    The viewpoint places the cloud; only the height needs it.

    Raises:
        ScanError: there is no such field, or it has no value.
    """
    try:
        scalars = find_scalars(scan, name)
    except ScanError:
        if field_key(name) != HEIGHT or viewpoint is None:
            raise
        heights = viewpoint.place(scan.points)[:, 2] * np.float32(viewpoint.radius)
        scalars = ScalarField(HEIGHT, scan.points, heights - heights.min())
    if scalars.values.dtype.kind == "f" and not np.isfinite(scalars.values).any():
        raise ScanError(f"the field {scalars.name!r} has no value at any point (all are nan or infinite); color by "
                        "another field")
    return scalars


def scale_of(scalars: ScalarField, options: ColorOptions) -> tuple[Scale, str]:
    """The colors of a field's values, and what they show in words."""
    label = "" if scalars.name == GIVEN_FIELD else scalars.name
    is_categorical = options.is_categorical
    if is_categorical is None:
        is_categorical = options.limits is None and options.colormap is None and scalars.is_categorical
    if is_categorical:
        classes = class_colors(label, scalars.values, scalars.class_names)
        return classes, f"{label or 'labels'}, {_count(len(classes.entries), 'class', 'classes')}"
    limits = options.limits or percentile_limits(scalars.values)
    scale = ColorScale(label, options.colormap or DEFAULT_COLORMAP, *limits, scalars.unit)
    span = f"{limits[0]:.6g} to {limits[1]:.6g}" if limits[0] < limits[1] else f"{limits[0]:.6g} at every point"
    given = "" if options.limits or limits[0] == limits[1] else " (2nd to 98th percentile)"
    return scale, f"{label or 'values'}, {span}{f' {scalars.unit}' if scalars.unit else ''}{given}"


def percentile_limits(values: np.ndarray) -> tuple[float, float]:
    """Percentiles of the finite values; the whole range where these are equal."""
    known = values[np.isfinite(values)].astype(np.float64)
    low, high = np.percentile(known, LIMIT_PERCENTILES).tolist()
    return (low, high) if low < high else (float(known.min()), float(known.max()))


def _own_colors(scan: Scan, options: ColorOptions) -> Coloring | None:
    """The points' own colors; None if there are none and none are insisted on.

    Raises:
        ScanError: there are none, and the user asks for them.
    """
    srgb = None if scan.fields is None else scan.fields.values.get(RGB)
    known = None if srgb is None else np.isfinite(srgb).all(axis=1)
    if scan.fields is None or srgb is None or known is None or not known.any():
        if options.by == AUTO:
            return None
        listed = ", ".join(scan.fields.names) if scan.fields is not None and scan.fields.names else "no other fields"
        raise ScanError(f"expected points with colours of their own, got none (it has {listed}); leave --color-by out, "
                        "or name a field")
    kind = scan.fields.color_kind
    relight = RGB_RELIGHT if options.relight is None else options.relight
    own = Coloring(scan.fields.points, srgb, relight, description=f"own colours{f' ({kind})' if kind else ''}")
    return own if known.all() else replace(own, points=own.points[known], srgb=srgb[known])


def _count(number: int, one: str, many: str) -> str:
    return f"{number} {one if number == 1 else many}"
