"""The scans of a viewer: drafts from prepared clouds while a page moves, full pictures as `z2p run-inference` makes."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable
from dataclasses import dataclass, replace
from pathlib import Path
from threading import Lock, RLock
from typing import Any, TypeVar

import numpy as np

from z2p_core.interfaces import ScanError, SettingError, Slider
from z2p_core.placement.viewpoint import Viewpoint
from z2p_core.placement.zoom import Zoom
from z2p_core.surface.subsampling import subsample_hashed
from z2p_renderer.pipeline.cli.options.pictures import look_from_options
from z2p_renderer.pipeline.cli.viewer.view_state import ViewState, draft_state, parse_options
from z2p_renderer.pipeline.coloring.fields import VECTOR_FIELDS, read_scans
from z2p_renderer.pipeline.inference.look import Look
from z2p_renderer.pipeline.inference.prepared_render import PreparedRender
from z2p_renderer.pipeline.inference.render_scan import (
    RenderedScan,
    camera_elevation,
    render_prepared,
    render_scan,
    with_common_scale,
)
from z2p_renderer.pipeline.inference.styles import StyledCloud
from z2p_renderer.pipeline.inference.weight_selection import AUTO, AnyRenderer, AutoRenderer, load_renderer
from z2p_renderer.pipeline.outputs.animation import draw_opening, prepare_scan
from z2p_renderer.storage.models.checkpoints import shipped_weights
from z2p_renderer.storage.scans.clouds import Scan, format_suffix

DRAFT_SIDES = (256, 192, 128)
"""Longer sides in pixels of the pictures that are drawn while the mouse moves; the smaller ones where it is slow."""
MAX_PANES = 12
"""Clouds that one page shows side by side."""
DRAFT_POINTS = 12_000
"""Points of a draft, about: of more, so many are selected."""
KEPT_OPENINGS = 4
"""Pictures that have placed their points that are kept for each pane."""
KEPT_PREPARED = 2
"""Prepared clouds that are kept for each pane."""
Kept = TypeVar("Kept")


@dataclass(frozen=True)
class Pane:
    """One cloud of the page."""

    path: Path
    cloud: int
    """Its index in the file."""
    label: str


@dataclass(frozen=True)
class View:
    """One picture for the page, and from where it was seen."""

    image: np.ndarray
    """(H, W, 4) uint8, straight RGBA; the background is not yet applied."""
    background: tuple[float, float, float] | None
    azimuth: float
    elevation: float
    viewpoint: Viewpoint | None = None
    """None of a draft."""
    note: str = ""


class ViewedScans:
    """The scans of one viewer. One full picture and one draft are drawn at a time, whichever threads ask for them."""

    def __init__(
        self, paths: list[Path], engine: str | None = None, columns: tuple[str, ...] | None = None
    ) -> None:  # fmt: skip
        """Read the files once, so that one that cannot be read is said at the start.

        Raises:
            ScanError: none of the files can be read.
        """
        self.paths, self._engine, self._columns = paths, engine, columns
        self._turns = {True: RLock(), False: RLock()}
        self._renderers_lock, self._kept_lock = RLock(), Lock()
        self._renderers: dict[Hashable, AnyRenderer] = {}
        self._kept: OrderedDict[Hashable, Any] = OrderedDict()
        self.faults: list[str] = []
        """Why files, or clouds of them, are not shown."""
        self.fields: list[str] = []
        """Names of what points can be colored by, of all files."""
        self.panes = self._find_panes()
        if not self.panes:
            raise ScanError(self.faults[0])

    def _find_panes(self) -> list[Pane]:
        panes: list[Pane] = []
        fields: dict[str, None] = {}
        for path in self.paths:
            try:
                clouds = self._read(path, ViewState())
            except (ScanError, OSError, MemoryError) as error:
                self.faults.append(str(error))
                continue
            for index, scan in enumerate(clouds):
                if isinstance(scan, ScanError):
                    self.faults.append(str(scan))
                elif len(panes) < MAX_PANES:
                    panes.append(Pane(path, index, f"{path.name}{scan.label}"))
                    fields |= dict.fromkeys(() if scan.fields is None else scan.fields.names)
                elif len(panes) == MAX_PANES:
                    self.faults.append(f"only the first {MAX_PANES} clouds are shown")
                    break
        self.fields = [name for name in fields if name not in VECTOR_FIELDS]
        return panes

    def turn(self, is_draft: bool) -> RLock:
        """What a thread holds while it draws a draft, or a full picture; see the class."""
        return self._turns[is_draft]

    def sliders(self, weights: str) -> dict[str, Slider]:
        """The sliders of all controls that the weights carry; with ``auto``, of all that shipped weights carry.

        Raises:
            WeightsError: there are no such weights.
        """
        names = list(shipped_weights()) if weights == AUTO else [weights]
        found: dict[str, Slider] = {}
        for renderer in [self._renderer(name, frozenset(), lazy=True) for name in names]:
            found |= {name: control.slider for name, control in renderer.controls.items()}
        return found

    def draft(self, pane: Pane, state: ViewState, side: int = DRAFT_SIDES[0]) -> View:
        """A picture of a pane of at most `side` pixels; the cloud is prepared once for all cameras, lights, materials.

        Raises:
            ScanError, SettingError: as for `full`.
        """
        with self.turn(is_draft=True):
            renderer, look = self._look(draft_state(state, side))
            opening, prepared = self._prepared(pane, state, renderer, look)
            base = opening.placement.azimuth
            turned = 0.0 if state.azimuth is None else state.azimuth - base
            elevation = opening.viewpoint.elevation
            is_chosen = opening.placement.elevation is not None and state.azimuth is None
            values = opening.renderer.settings({**({"elevation": (elevation,)} if is_chosen else {}), **look.values})
            image = render_prepared(prepared, values, look, turned)
            return View(image, look.background, base + turned, values.get("elevation", (elevation,))[0])

    def full(self, pane: Pane, state: ViewState) -> View:
        """The picture of a pane as `z2p run-inference` makes it with the state's options.

        Raises:
            ScanError: the file cannot be read any more, or has no such field.
            SettingError: an option is refused.
        """
        with self.turn(is_draft=False):
            renderer, look = self._look(state)
            scan, suffix = self._scan(pane, state), format_suffix(pane.path)
            given, key = look, self._opening_key(pane, state, scan, renderer, look)
            if state.same_frame:
                renderer, look = self._with_common_frame(state, renderer, look)
            look = self._with_common_scale(state, renderer, look)
            rendered = render_scan(renderer, scan, suffix, look)
            if not state.same_frame:
                self._keep_opening(key, given, rendered)
            placed = rendered.placement.azimuth if not state.same_frame else state.azimuth or 0.0
            coloring = "" if rendered.coloring is None else rendered.coloring.description
            note = "; ".join(filter(None, [rendered.weights_reason, rendered.placement.hint, coloring]))
            return View(rendered.picture, look.background, placed, rendered.viewpoint.elevation, rendered.viewpoint,
                        note)  # fmt: skip

    def common_limits(self, state: ViewState) -> tuple[float, float] | None:
        """The ends of the colormap that several clouds share; None where there is one cloud, or no such field."""
        if len(self.panes) == 1 or not state.has_field:
            return None
        return self._with_common_scale(state, *self._look(state)).color_options.limits

    def _look(self, state: ViewState) -> tuple[AnyRenderer, Look]:
        """The renderer and the look of the state's options."""
        parsed = parse_options(state.options())
        renderer = self._renderer(state.weights, frozenset(parsed.controls))
        return renderer, look_from_options(renderer, parsed.controls, parsed.options, parsed.color_options)

    def _renderer(self, weights: str, controls: frozenset[str], lazy: bool = False) -> AnyRenderer:
        from z2p_renderer.pipeline.inference.renderer import Renderer

        if lazy:
            return self._keep_renderer(("lazy", weights), lambda: Renderer(weights, None, self._engine, lazy=True))
        values = {name: (0.0,) for name in controls}  # only the names count
        return self._keep_renderer((weights, controls if weights == AUTO else frozenset()),
                                   lambda: load_renderer(weights, values, None, self._engine))  # fmt: skip

    def _keep_renderer(self, key: Hashable, load: Callable[[], AnyRenderer]) -> AnyRenderer:
        with self._renderers_lock:
            if key not in self._renderers:
                loaded = load()
                if isinstance(loaded, AutoRenderer):  # one for all sets of controls that it serves
                    loaded = next((one for one in self._renderers.values() if isinstance(one, AutoRenderer)), loaded)
                self._renderers[key] = loaded
            return self._renderers[key]

    def _read(self, path: Path, state: ViewState) -> list[Scan | ScanError]:
        """The clouds of a file with the fields that the state needs; read again when the file has changed."""
        options = parse_options(state.options()).color_options
        status = path.stat()
        key = ("file", path, status.st_mtime_ns, status.st_size, options.wanted_fields)
        return self._keep(key, len(self.paths) + 1, lambda: read_scans(path, self._columns, options))

    def _scan(self, pane: Pane, state: ViewState) -> Scan:
        scans = self._read(pane.path, state)
        scan = scans[pane.cloud] if pane.cloud < len(scans) else ScanError(f"{pane.label}: no longer in its file")
        if isinstance(scan, ScanError):
            raise scan
        return scan

    def _prepared(
        self, pane: Pane, state: ViewState, renderer: AnyRenderer, look: Look
    ) -> tuple[RenderedScan, PreparedRender | StyledCloud]:
        """What has placed the pane's points, from whichever side, and some of them prepared for all sides."""
        scan = self._scan(pane, state)
        opening = self._opening(pane, state, scan, renderer, look)
        size = () if look.style.needs_network else (look.width, look.height)
        return self._keep(("prepared", id(opening), size), KEPT_PREPARED * len(self.panes),
                          lambda: (opening, prepare_scan(opening, scan, look)))  # fmt: skip

    def _opening(
        self, pane: Pane, state: ViewState, scan: Scan, renderer: AnyRenderer, look: Look
    ) -> RenderedScan:  # fmt: skip
        """A picture of the pane in its automatic view, or of any side: the first full one if there is one."""
        start = replace(state, azimuth=None if state.azimuth is None else 0.0)
        placing = replace(look.placement_options, view="auto" if start.azimuth is None else 0.0)

        def draw() -> RenderedScan:
            selected, shared = renderer, replace(look, placement_options=placing)
            if state.same_frame:
                fixed = {name: value for name, value in start.controls.items() if name != "elevation"}
                selected, shared = self._with_common_frame(replace(start, controls=fixed), renderer, shared)
            colored = self._with_common_scale(state, selected, shared)
            plain = replace(colored, color_options=replace(colored.color_options, color_bar=False))
            return thinned(draw_opening(selected, scan, format_suffix(pane.path), replace(plain, zoom=Zoom())))

        key = self._opening_key(pane, state, scan, renderer, look)
        return self._keep(key, KEPT_OPENINGS * len(self.panes), draw)

    def _opening_key(
        self, pane: Pane, state: ViewState, scan: Scan, renderer: AnyRenderer, look: Look
    ) -> tuple[Hashable, ...]:  # fmt: skip
        """What an opening depends on; the side is no part of it, unless it is chosen by the cloud."""
        placing = replace(look.placement_options, view="auto" if state.azimuth is None else 0.0)
        colors = ("color" in look.values, replace(look.color_options, color_bar=False))
        return "opening", pane, id(scan), id(renderer), placing, look.margin, state.same_frame, colors, look.style

    def _keep_opening(self, key: tuple[Hashable, ...], look: Look, rendered: RenderedScan) -> None:
        """Keep a full picture as the opening of drafts, unless there is one; one in the automatic view serves all."""
        any_side = (*key[:4], replace(look.placement_options, view=0.0), *key[5:])
        for one in (key, any_side):
            self._keep(one, KEPT_OPENINGS * len(self.panes), lambda: thinned(rendered))

    def _with_common_frame(self, state: ViewState, renderer: AnyRenderer, look: Look) -> tuple[AnyRenderer, Look]:
        """The renderer and the look of `z2p run-inference --same-frame`."""
        from z2p_renderer.pipeline.batch.common_view import common_viewpoint
        from z2p_renderer.pipeline.inference.weight_selection import select_renderer

        def find() -> tuple[AnyRenderer, Any]:
            common = common_viewpoint(self.paths, look.placement_options, *camera_elevation(renderer, look.values),
                                      self._columns, look.color_options)  # fmt: skip
            return select_renderer(renderer, common.first)[0], common

        key = ("frame", id(renderer), look.placement_options, look.values.get("elevation"), look.color_options.classes)
        selected, common = self._keep(key, 4, find)
        placing = replace(look.placement_options, viewpoint=common.viewpoint, azimuth=0.0, grounded=common.grounded)
        return selected, replace(look, placement_options=placing)

    def _with_common_scale(self, state: ViewState, renderer: AnyRenderer, look: Look) -> Look:
        """The look with one scale of colors for all clouds, as a run of several files has it."""
        if len(self.panes) == 1 or not look.color_options.needs_common_scale:
            return look
        placing = replace(look.placement_options, viewpoint=None)
        key = ("scale", look.color_options, placing, state.same_frame)

        def find() -> Any:
            scans = [(self._scan(pane, state), format_suffix(pane.path)) for pane in self.panes]
            return with_common_scale(renderer, scans, look)[0].color_options

        return replace(look, color_options=self._keep(key, 4, find))

    def _keep(self, key: tuple[Hashable, ...], most: int, make: Callable[[], Kept]) -> Kept:
        """What `make` gives, made once for a key; of each kind (the key's first entry) the `most` newest are kept."""
        with self._kept_lock:
            if key in self._kept:
                self._kept.move_to_end(key)
                kept: Kept = self._kept[key]
                return kept
        made = make()
        with self._kept_lock:
            self._kept[key] = made
            same_kind = [one for one in self._kept if isinstance(one, tuple) and one[0] == key[0]]
            for oldest in same_kind[:-most]:
                del self._kept[oldest]
        return made


def thinned(rendered: RenderedScan) -> RenderedScan:
    """The same without its picture, with about `DRAFT_POINTS` of its points."""
    cloud = subsample_hashed(rendered.cloud, DRAFT_POINTS)
    return replace(rendered, picture=rendered.picture[:0], passes={}, cloud=cloud)


def check_pane(panes: list[Pane], index: Any) -> Pane:
    """The pane of that index.

    Raises:
        SettingError: there is none.
    """
    if type(index) is not int or not 0 <= index < len(panes):
        raise SettingError(f"expected the number of a scan from 0 to {len(panes) - 1}, got {str(index)[:40]}")
    return panes[index]
