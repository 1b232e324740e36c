"""One camera, and one crop, for all clouds of a batch, so that they appear at one scale (``--same-frame``)."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from z2p_core.coloring.options import NONE, ColorOptions
from z2p_core.interfaces import ScanError
from z2p_core.linalg import bounding_box, dot_axis
from z2p_core.placement.bounding_sphere import bounding_sphere
from z2p_core.placement.viewpoint import Viewpoint, frame_points
from z2p_core.rotations import random_rotation
from z2p_core.surface.subsampling import subsample_uniform
from z2p_renderer.pipeline.coloring.fields import read_scans
from z2p_renderer.pipeline.inference.look import Crop, Look
from z2p_renderer.pipeline.inference.render_scan import render_scan
from z2p_renderer.pipeline.inference.trim import MIN_VISIBLE_ALPHA, content_box
from z2p_renderer.pipeline.inference.weight_selection import AnyRenderer
from z2p_renderer.pipeline.placement.options import PlacementOptions
from z2p_renderer.pipeline.placement.place_scan import PlacedCloud, place_scan, select_points
from z2p_renderer.storage.files.printable_names import printable
from z2p_renderer.storage.scans.clouds import Scan, format_suffix

EXTENT_DIRECTIONS = 3 * 170
"""Directions along which a cloud's farthest points are kept: they stand for its extent, whatever its size."""
MAX_SAMPLED_POINTS = 2000
"""Further points of each cloud that are kept, spread over it."""
DRAFT_SIDE = 256
"""Shorter side, in pixels, of the small pictures that the common crop is computed from."""
SPECK_RADIUS_SHARE = 0.02
"""Radius of a cloud over the common frame's below which little of it is visible."""
MAX_NAMED_SPECKS = 5
"""How many such clouds are named in notes."""
MAX_CENTER_SPREAD = 0.02
"""Largest distance between the centers of clouds that count as moved to one place, over the widest cloud's side."""


@dataclass(frozen=True)
class CommonView:
    """What all clouds share."""

    viewpoint: Viewpoint
    description: str
    """The up axis and the view, with the reasons for them."""
    first: np.ndarray
    """The first cloud (N, 3) float32 in its own frame, by which the weights are selected."""
    cloud_count: int
    specks: tuple[tuple[str, float], ...] = ()
    """Clouds that are so small in the frame that little of them is visible: name, and radius over the frame's."""
    grounded: bool = False
    """Whether each cloud is lowered onto the common floor, since all of them were moved to about one place."""

    @property
    def notes(self) -> list[str]:
        """Lines that warn of the specks."""
        lines = [f"note: {name} spans {100 * share:.2g} % of the common frame, too little to be seen; if its units or "
                 "offset are others than the rest's, render it by itself"
                 for name, share in self.specks[:MAX_NAMED_SPECKS]]  # fmt: skip
        more = len(self.specks) - MAX_NAMED_SPECKS
        return [*lines, f"note: so do {more} more clouds"] if more > 0 else lines


def common_viewpoint(
    scans: Iterable[Path], options: PlacementOptions, elevation: float, elevation_range: tuple[float, float] | None,
    columns: tuple[str, ...] | None = None, color_options: ColorOptions | None = None,
) -> CommonView:  # fmt: skip
    """The viewpoint that fits the clouds of all files; up axis, view and weights are those that suit the first cloud.

    Beside the first cloud only one file at a time is in memory. Files that cannot be read are left out here: they fail
    again when they are rendered, and are reported then. `elevation` and `elevation_range` are as for `place_scan`;
    `color_options` say which classes of points are kept.

    Raises:
        ScanError: no file can be read, or the first cloud has no sensor though its view is asked for.
    """
    wanted = color_options or ColorOptions(NONE)
    groups = [CloudGroup(printable(path), format_suffix(path), partial(_readable_clouds, path, columns, wanted))
              for path in scans]  # fmt: skip
    return common_viewpoint_of(groups, options, elevation, elevation_range)


@dataclass(frozen=True)
class CloudGroup:
    """Clouds that are read together, as those of one file."""

    name: str
    """The file's, in messages."""
    suffix: str
    """The file's, in lower case with its dot; empty for none."""
    read: Callable[[], Sequence[Scan]]


def common_viewpoint_of(
    groups: Iterable[CloudGroup], options: PlacementOptions, elevation: float,
    elevation_range: tuple[float, float] | None, reference: PlacedCloud | None = None,
) -> CommonView:  # fmt: skip
    """`common_viewpoint` of groups of clouds; up axis and view are those of `reference`, or of the first cloud.

    Raises:
        ScanError: no cloud can be read, or the first has no sensor though its view is asked for.
    """
    clouds: list[tuple[str, np.ndarray]] = []
    first = reference
    errors: list[str] = []
    for group in groups:
        suffix = group.suffix
        try:
            readable = group.read()
            first = first or place_scan(readable[0], suffix, options, elevation, elevation_range)
            as_rendered = replace(options, viewpoint=first.viewpoint)  # its up axis decides what is a low outlier
            selected = [select_points(scan, suffix, as_rendered) for scan in readable]
        except (ScanError, OSError, MemoryError) as error:  # reported when the file is rendered
            errors.append(str(error))
            continue
        clouds += [(f"{group.name}{scan.label}", _extreme_points(one.points, np.array(first.viewpoint.rotation)))
                   for scan, one in zip(readable, selected, strict=True)]  # fmt: skip
    if first is None or not clouds:
        raise ScanError(f"one frame for all: no cloud can be read; the first: {errors[0]}")
    viewpoint, grounded = _fit_viewpoint([points for _, points in clouds], first.viewpoint)
    sizes = [(name, bounding_sphere(points).radius / viewpoint.radius) for name, points in clouds]
    specks = tuple((name, size) for name, size in sizes if size < SPECK_RADIUS_SHARE)
    return CommonView(viewpoint, first.placement.view_description, first.cloud, len(clouds), specks, grounded)


def common_crop(
    scans: Iterable[Path], renderer: AnyRenderer, look: Look, columns: tuple[str, ...] | None = None
) -> Crop | None:
    """The part of the frame that shows something of any cloud of the files; None if nothing is visible.

    It is computed from small pictures, which are not kept. Clouds that cannot be rendered are left out here: they fail
    again when they are rendered, and are reported then.
    """
    share = min(1.0, DRAFT_SIDE / min(look.width, look.height))
    width, height = (max(32, round(side * share)) for side in (look.width, look.height))
    color_options = replace(look.color_options, by=NONE)
    draft = replace(look.untrimmed, width=width, height=height, supersample=1, color_options=color_options)
    alpha = np.zeros((height, width), dtype=np.uint8)
    for path in scans:
        with suppress(Exception):  # whatever a reader raises, the other files count
            for scan in _readable_clouds(path, columns, look.color_options):
                with suppress(Exception):
                    picture = render_scan(renderer, scan, format_suffix(path), draft).picture
                    np.maximum(alpha, picture[..., 3], out=alpha)
    if not (alpha >= MIN_VISIBLE_ALPHA).any():
        return None
    top, bottom, left, right = content_box(alpha, look.margin)
    return left / width, top / height, right / width, bottom / height


def _readable_clouds(path: Path, columns: tuple[str, ...] | None, options: ColorOptions) -> list[Scan]:
    """The clouds of a file that can be rendered; the others are reported when they are rendered.

    Raises:
        ScanError: there is none, or the file cannot be read.
    """
    clouds = read_scans(path, columns, options)
    readable = [cloud for cloud in clouds if isinstance(cloud, Scan)]
    if not readable:
        raise next(cloud for cloud in clouds if isinstance(cloud, ScanError))
    return readable


def _fit_viewpoint(clouds: list[np.ndarray], first: Viewpoint) -> tuple[Viewpoint, bool]:
    """The viewpoint that fits the clouds, turned as that of the first one; and whether all are lowered to one floor."""
    rotation = np.array(first.rotation)
    grounded = _have_one_center(clouds)
    together = np.vstack(_on_one_floor(clouds, rotation[2]) if grounded else clouds)
    viewpoint = frame_points(together, rotation, first.elevation)
    floor = float(viewpoint.place(together)[:, 2].min())  # a cloud that hovers above the others' floor hovers
    return replace(viewpoint, floor=floor), grounded


def _have_one_center(clouds: list[np.ndarray]) -> bool:
    """Whether all clouds have the same center but different sizes, as collections of objects moved to the origin have.

    The height of such a cloud does not say where its floor was: half of it would lie below the common one.
    """
    boxes = [bounding_box(points) for points in clouds]
    centers = np.array([(low + high) / 2 for low, high in boxes])
    sides = np.array([high - low for low, high in boxes])
    tolerance = MAX_CENTER_SPREAD * float(sides.max())
    same_center = float(np.ptp(centers, axis=0).max()) <= tolerance
    return same_center and len(clouds) > 1 and bool(np.ptp(sides, axis=0).max() > tolerance)


def _on_one_floor(clouds: list[np.ndarray], up: np.ndarray) -> list[np.ndarray]:
    """The clouds, each moved down along `up` (3,) until its lowest point is as low as that of the lowest cloud."""
    lows = [float(dot_axis(points, up).min()) for points in clouds]
    return [points - (low - min(lows)) * up for points, low in zip(clouds, lows, strict=True)]


def _extreme_points(points: np.ndarray, rotation: np.ndarray) -> np.ndarray:
    """Farthest points of a cloud along fixed directions and the axes of `rotation` (3, 3), and a uniform sample."""
    rng = np.random.default_rng(0)
    directions = np.vstack([rotation, *(random_rotation(rng) for _ in range(EXTENT_DIRECTIONS // 3))])
    offsets = points - points[0]
    farthest = [int(np.argmax(sign * (offsets @ direction))) for direction in directions for sign in (1, -1)]
    return np.vstack([points[np.unique(farthest)], subsample_uniform(points, MAX_SAMPLED_POINTS)])
