"""The pictures of a figure's table: every cell in one size, and the clouds of one shape before one camera."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from z2p_core.interfaces import ScanError, SettingError, Value
from z2p_renderer.pipeline.batch.common_view import CloudGroup, common_viewpoint_of
from z2p_renderer.pipeline.coloring.color_points import Scale
from z2p_renderer.pipeline.coloring.fields import read_scans
from z2p_renderer.pipeline.inference.look import Look
from z2p_renderer.pipeline.inference.render_scan import camera_elevation, render_scan, with_common_scale
from z2p_renderer.pipeline.inference.weight_selection import AnyRenderer
from z2p_renderer.pipeline.outputs.animation import Motion, draw_opening, render_frames
from z2p_renderer.storage.figure_tables import FigureCell, FigureTable
from z2p_renderer.storage.files.printable_names import printable
from z2p_renderer.storage.images.image_files import FORMATS, PictureError
from z2p_renderer.storage.scans.clouds import Scan, format_suffix

Place = tuple[int, int]
"""Row and column of a cell."""


@dataclass
class CellDrawer:
    """Draws the cells of a table; cells that fail are reported, and stay empty."""

    table: FigureTable
    renderer: AnyRenderer
    look: Look
    palette: Sequence[Value] = ()
    """Colors of the shapes in turn; empty for the look's own."""
    one_camera: bool = False
    """Whether the whole table has one camera, rather than each shape one of its own."""
    on_failure: Callable[[str], None] = field(default=lambda line: None)
    """Called with a line on each cell that fails."""
    scale: Scale | None = None
    """What colors mean, for a color bar; None where points are not colored by a field."""

    def prepare(self) -> None:
        """Reads all clouds, and chooses cameras and the scale of colors."""
        self._scans: dict[Place, tuple[Scan, str]] = {}
        self._pictures: dict[Place, np.ndarray] = {}
        for place, cell in self._cells():
            try:
                if cell.path.suffix.lower() in FORMATS:
                    self._pictures[place] = _fitted(_read_picture(cell.path), self.look.width, self.look.height)
                else:
                    self._scans[place] = (self._read(cell), format_suffix(cell.path))
            except (ScanError, SettingError, OSError, MemoryError, PictureError) as error:
                self._report(cell, error)
        self.look, self.scale = with_common_scale(self.renderer, self._scans.values(), self.look)
        color_options = replace(self.look.color_options, color_bar=False)  # beside the table, not in each cell
        self.look = replace(self.look, color_options=color_options)
        self._looks = self._looks_of_shapes()

    def pictures(self) -> dict[Place, np.ndarray]:
        """The picture (H, W, 4) uint8 of each cell that can be drawn."""
        pictures = dict(self._pictures)
        for place, (scan, suffix) in self._scans.items():
            try:
                pictures[place] = render_scan(self.renderer, scan, suffix, self._looks[self._shape(place)]).picture
            except ScanError as error:
                self._report(self._cell(place), error)
        return pictures

    def turning(self, motion: Motion) -> Iterator[dict[Place, np.ndarray]]:
        """The pictures of each frame of a loop in which all objects turn, or all lights move, together."""
        loops: dict[Place, Iterator[np.ndarray]] = {}
        for place, (scan, suffix) in self._scans.items():
            look = self._looks[self._shape(place)]
            try:
                opening = draw_opening(self.renderer, scan, suffix, look)
            except ScanError as error:
                self._report(self._cell(place), error)
                continue
            loops[place] = render_frames(opening, scan, look, motion)
        for _ in range(motion.frames):
            yield {**self._pictures, **{place: next(loop) for place, loop in loops.items()}}

    def _cells(self) -> Iterator[tuple[Place, FigureCell]]:
        for row, cells in enumerate(self.table.cells):
            for column, cell in enumerate(cells):
                if cell is not None:
                    yield (row, column), cell

    def _cell(self, place: Place) -> FigureCell:
        cell = self.table.cells[place[0]][place[1]]
        assert cell is not None
        return cell

    def _shape(self, place: Place) -> int:
        return self.table.shape_of(*place)

    def _read(self, cell: FigureCell) -> Scan:
        scans = read_scans(cell.path, None, self.look.color_options, self.look.max_rows)
        if cell.cloud >= len(scans):
            raise ScanError(f"holds {len(scans)} clouds, but the table asks for number {cell.cloud + 1}")
        scan = scans[cell.cloud]
        if isinstance(scan, ScanError):
            raise scan
        return scan

    def _looks_of_shapes(self) -> dict[int, Look]:
        """The look of each shape: with its color, and with the camera that its clouds share."""
        shapes = sorted({self._shape(place) for place in self._scans})
        looks = {}
        for shape in shapes:
            members = [self._scans[place] for place in self._scans if self.one_camera or self._shape(place) == shape]
            look = self._with_camera(members)
            if self.palette:
                look = replace(look, values={**look.values, "color": self.palette[shape % len(self.palette)]})
            looks[shape] = look
        return looks

    def _with_camera(self, scans: Sequence[tuple[Scan, str]]) -> Look:
        options = self.look.placement_options
        if options.viewpoint is not None:  # a loaded camera is common to all already
            return self.look
        groups = [CloudGroup("", suffix, lambda scan=scan: [scan]) for scan, suffix in scans]  # type: ignore[misc]
        common = common_viewpoint_of(groups, options, *camera_elevation(self.renderer, self.look.values))
        options = replace(options, viewpoint=common.viewpoint, azimuth=0.0, grounded=common.grounded)
        return replace(self.look, placement_options=options)

    def _report(self, cell: FigureCell, error: Exception) -> None:
        name, text = printable(cell.path), str(error) or type(error).__name__
        self.on_failure(text if text.startswith(name) else f"{name}: {text}")


def _read_picture(path: Path) -> np.ndarray:
    """A picture file as (H, W, 4) uint8.

    Raises:
        PictureError: it is none that can be read.
    """
    from PIL import Image

    try:
        with Image.open(path) as picture:
            return np.asarray(picture.convert("RGBA"))
    except Exception as error:  # pillow raises all kinds of errors on damaged files
        raise PictureError(f"{printable(path)}: cannot be read as a picture ({type(error).__name__})") from None


def _fitted(picture: np.ndarray, width: int, height: int) -> np.ndarray:
    """A picture (H, W, 4) uint8 scaled to fit a size, centered on transparent ground."""
    from PIL import Image

    share = min(width / picture.shape[1], height / picture.shape[0])
    size = max(1, round(picture.shape[1] * share)), max(1, round(picture.shape[0] * share))
    scaled = picture
    if size != (picture.shape[1], picture.shape[0]):
        premultiplied = Image.fromarray(picture).convert("RGBa").resize(size, Image.Resampling.LANCZOS)
        scaled = np.asarray(premultiplied.convert("RGBA"))
    fitted = np.full((height, width, 4), (255, 255, 255, 0), np.uint8)  # no dark line where viewers interpolate
    top, left = (height - size[1]) // 2, (width - size[0]) // 2
    fitted[top : top + size[1], left : left + size[0]] = scaled
    return fitted
