"""One scale of colors for a series of clouds, so that a color means the same value in all of their pictures."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from z2p_core.coloring.options import ColorOptions
from z2p_core.coloring.scales import ClassColors
from z2p_core.formats.field_names import field_key
from z2p_core.interfaces import ScanError
from z2p_core.placement.viewpoint import Viewpoint
from z2p_renderer.pipeline.coloring.color_points import Scale, scalars_of, scale_of
from z2p_renderer.pipeline.coloring.fields import HEIGHT, ScalarField, read_scans
from z2p_renderer.storage.scans.clouds import Scan, format_suffix

MAX_SAMPLED_VALUES = 200_000
"""Values of each cloud from which common limits are computed, at most; labels are all looked at."""

PlaceScan = Callable[[Scan, str], Viewpoint]
"""Gives the viewpoint of a scan from a file with some suffix; only the field ``height`` needs it."""


@dataclass
class _Values:
    """What is known of a field from the clouds so far."""

    first: ScalarField | None = None
    samples: list[np.ndarray] = field(default_factory=list)
    labels: set[int | float] = field(default_factory=set)
    is_categorical: bool = True

    def add(self, scalars: ScalarField) -> None:
        """Take the values of one more cloud into account."""
        self.first = self.first or scalars
        self.samples.append(scalars.values[:: -(-len(scalars.values) // MAX_SAMPLED_VALUES) or 1])
        self.is_categorical = self.is_categorical and scalars.is_categorical
        if self.is_categorical:
            self.labels.update(np.unique(scalars.values[np.isfinite(scalars.values)]).tolist())


def scans_of(
    files: Iterable[Path], columns: tuple[str, ...] | None, options: ColorOptions
) -> Iterator[tuple[Scan, str]]:
    """The clouds of all files that can be read, with their files' suffixes; others are reported when rendered."""
    for file in files:
        with suppress(ScanError, OSError, MemoryError):
            clouds = read_scans(file, columns, options)
            yield from ((cloud, format_suffix(file)) for cloud in clouds if isinstance(cloud, Scan))


def share_scale(
    scans: Iterable[tuple[Scan, str]], options: ColorOptions, place: PlaceScan
) -> tuple[ColorOptions, Scale | None]:  # fmt: skip
    """The options with one scale for all scans, and that scale; None where points are not colored by a field.

    Only one scan at a time is in memory. Scans without the field are left out: they fail when they are rendered.
    """
    name = options.field
    if name is None:
        return options, None
    values = _Values()
    for scan, suffix in scans:
        with suppress(ScanError):
            values.add(scalars_of(scan, name, place(scan, suffix) if field_key(name) == HEIGHT else None))
    if values.first is None:
        return options, None
    is_categorical = options.limits is None and options.colormap is None and values.is_categorical
    together = np.array(sorted(values.labels)) if is_categorical else np.concatenate(values.samples)
    options = replace(options, is_categorical=is_categorical)
    scale, _ = scale_of(replace(values.first, values=together), options)
    if isinstance(scale, ClassColors):
        return options, replace(scale, entries=tuple(replace(entry, count=0) for entry in scale.entries))
    return replace(options, limits=(scale.low, scale.high) if scale.low < scale.high else options.limits), scale
