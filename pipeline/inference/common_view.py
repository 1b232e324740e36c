"""Clouds of one series at one scale and place: the one viewpoint that fits them all, and the one crop."""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from z2p_core.interfaces import ScanError
from z2p_core.linalg import bounding_box, dot_axis
from z2p_core.placement.bounding_sphere import bounding_sphere
from z2p_core.placement.viewpoint import Viewpoint, frame_points
from z2p_core.rotations import random_rotation
from z2p_core.surface.subsampling import subsample_uniform
from z2p_renderer.pipeline.inference.look import Crop, Look
from z2p_renderer.pipeline.inference.render_scan import render_scan
from z2p_renderer.pipeline.inference.trim import MIN_VISIBLE_ALPHA, content_box
from z2p_renderer.pipeline.inference.weight_selection import AnyRenderer
from z2p_renderer.pipeline.placement.options import PlacementOptions
from z2p_renderer.pipeline.placement.place_scan import PlacedCloud, place_scan, select_points
from z2p_renderer.storage.files.printable_names import printable
from z2p_renderer.storage.scans.clouds import Scan, format_suffix, read_each

OUTLINE_DIRECTIONS = 3 * 170
"""A cloud's reach is kept as its farthest points along so many directions, whatever its size."""
DRAFT_SIDE = 256
"""Shorter side of the pictures in which the common crop is looked for, pixels: such as the weights know."""
SPECK_RADIUS_SHARE = 0.02
"""Radius of a cloud, of the common frame's, below which little of it shows."""
MAX_CENTER_SPREAD = 0.02
"""How far apart, in the widest cloud's sides, the middles of clouds may lie that were moved to one place."""
MAX_NAMED_SPECKS = 5
"""Specks that are told by name."""
MAX_OUTLINE_POINTS = 2000
"""Points of each cloud that the choice of the view looks at."""


@dataclass(frozen=True)
class Series:
    """What the clouds share."""

    viewpoint: Viewpoint
    told: str
    """Up and view with their reasons."""
    first: np.ndarray
    """The first cloud (N, 3) float32 in its own frame, by which the weights are chosen."""
    clouds: int
    specks: tuple[tuple[str, float], ...] = ()
    """Clouds so small in the frame that little of them will show: name, and size as a share of the frame's."""
    grounded: bool = False
    """Each cloud is set down onto the common floor, for all of them were moved to be about one place."""

    @property
    def notes(self) -> list[str]:
        """Lines that warn of the specks."""
        lines = [f"note: {name} spans {100 * share:.2g} % of the common frame, too little to be seen; if its units or "
                 "offset are others than the rest's, render it by itself" for name, share in self.specks[:MAX_NAMED_SPECKS]]
        more = len(self.specks) - MAX_NAMED_SPECKS
        return [*lines, f"note: so do {more} more clouds"] if more > 0 else lines


def common_viewpoint(
    scans: Iterable[Path], placement_options: PlacementOptions, elevation: float, free: tuple[float, float] | None,
    columns: tuple[str, ...] | None = None,
) -> Series:
    """The viewpoint that fits the clouds of all files; up, view and weights are those that suit the first cloud.

    Beside the first cloud only one file at a time is in memory. Files that cannot be read are passed over:
    they fail again, and are told, when their turn to be drawn comes. `elevation` and `free` are as for `place_scan`.

    Raises:
        ScanError: no file can be read, or the first cloud has no sensor though its view is asked for.
    """
    reach: list[tuple[str, np.ndarray]] = []
    first: PlacedCloud | None = None
    faults: list[str] = []
    for path in scans:
        try:
            found = _usable_ones(path, columns)
            first = first or place_scan(found[0], format_suffix(path), placement_options, elevation, free)
            settled = replace(placement_options, viewpoint=first.viewpoint)  # as they will be drawn: its up tells what lies below
            shown = [select_points(scan, format_suffix(path), settled) for scan in found]
        except (ScanError, OSError, MemoryError) as error:  # told by name when its turn to be drawn comes
            faults.append(str(error))
            continue
        reach += [(f"{printable(path)}{scan.label}", _outline(one.points, np.array(first.viewpoint.rotation)))
                  for scan, one in zip(found, shown, strict=True)]  # fmt: skip
    if first is None:
        raise ScanError(f"--same-frame: none of the files can be read; the first: {faults[0]}")
    rotation = np.array(first.viewpoint.rotation)
    outlines = [points for _, points in reach]
    grounded = _all_about_one_place(outlines)
    together = np.vstack(_on_one_floor(outlines, rotation[2]) if grounded else outlines)
    shared = frame_points(together, rotation, first.viewpoint.elevation)
    shared = replace(shared, floor=float(shared.place(together)[:, 2].min()))  # what hovers in one cloud hovers
    sizes = [(name, bounding_sphere(points).radius / shared.radius) for name, points in reach]
    specks = tuple((name, size) for name, size in sizes if size < SPECK_RADIUS_SHARE)
    return Series(shared, first.placement.view_description, first.cloud, len(reach), specks, grounded)


def common_crop(
    scans: Iterable[Path], renderer: AnyRenderer, look: Look, columns: tuple[str, ...] | None = None
) -> Crop | None:
    """The part of the frame that shows something of any cloud of the files; None where nothing is to be seen.

    It is found in small pictures, drawn first and thrown away. Clouds that cannot be drawn are passed over: they fail
    again, and are told, when their turn comes.
    """
    share = min(1.0, DRAFT_SIDE / min(look.width, look.height))
    width, height = (max(32, round(side * share)) for side in (look.width, look.height))
    draft = replace(look.untrimmed, width=width, height=height, supersample=1)
    alpha = np.zeros((height, width), dtype=np.uint8)
    for path in scans:
        with suppress(Exception):  # whatever a file brings up, the others count
            for scan in _usable_ones(path, columns):
                with suppress(Exception):
                    np.maximum(alpha, render_scan(renderer, scan, format_suffix(path), draft).picture[..., 3], out=alpha)
    if not (alpha >= MIN_VISIBLE_ALPHA).any():
        return None
    top, bottom, left, right = content_box(alpha, look.margin)
    return left / width, top / height, right / width, bottom / height


def _usable_ones(path: Path, columns: tuple[str, ...] | None) -> list[Scan]:
    """The clouds of a file that show something; those that show nothing are told when their turn comes.

    Raises:
        ScanError: none does, or the file cannot be read.
    """
    found = read_each(path, columns)
    good = [scan for scan in found if isinstance(scan, Scan)]
    if not good:
        raise next(scan for scan in found if isinstance(scan, ScanError))
    return good


def _all_about_one_place(outlines: list[np.ndarray]) -> bool:
    """Whether the middles of all clouds agree, as of collections whose things were moved to the origin, but not lows.

    What such a thing's place says of the floor is nothing: half of it would lie below the ground that it stood on.
    """
    extents = [bounding_box(points) for points in outlines]
    middles = np.array([(low + high) / 2 for low, high in extents])
    widest = max(float((high - low).max()) for low, high in extents)
    alike = float(np.ptp(middles, axis=0).max()) <= MAX_CENTER_SPREAD * widest
    spans = np.array([high - low for low, high in extents])
    return alike and len(outlines) > 1 and bool(np.ptp(spans, axis=0).max() > MAX_CENTER_SPREAD * widest)


def _on_one_floor(outlines: list[np.ndarray], upward: np.ndarray) -> list[np.ndarray]:
    """The clouds, each moved down along `upward` (3,) to where the lowest one stands."""
    lows = [float(dot_axis(points, upward).min()) for points in outlines]
    return [points - (low - min(lows)) * upward for points, low in zip(outlines, lows, strict=True)]


def _outline(points: np.ndarray, rotation: np.ndarray) -> np.ndarray:
    """Farthest points of a cloud along fixed directions and the axes of `rotation` (3, 3), and an even share of all."""
    rng = np.random.default_rng(0)
    directions = np.vstack([rotation, *(random_rotation(rng) for _ in range(OUTLINE_DIRECTIONS // 3))])
    centred = points - points[0]
    farthest = [int(np.argmax(sign * (centred @ direction))) for direction in directions for sign in (1, -1)]
    return np.vstack([points[np.unique(farthest)], subsample_uniform(points, MAX_OUTLINE_POINTS)])
