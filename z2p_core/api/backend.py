"""The interface between `z2p_core.render` and the code that renders, which is found by entry point, never imported."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from importlib.metadata import entry_points
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from z2p_core.coloring.options import ColorOptions
from z2p_core.errors.install_advice import install_advice
from z2p_core.style import Style

if TYPE_CHECKING:
    from z2p_core.pinhole import AnyCamera, PinholeCamera
    from z2p_core.placement.viewpoint import Viewpoint

GROUP = "z2p.studio"
"""Entry-point group of the backend."""


@dataclass(frozen=True)
class RenderRequest:
    """What the user asks of the pictures, in the words and numbers of `z2p_core.render`; the backend checks them."""

    up: str = "+Z"
    view: str | float | tuple[float, float] = "auto"
    azimuth: float = 0.0
    camera: Viewpoint | AnyCamera | Mapping[str, Any] | str | Path | None = None
    controls: Mapping[str, Any] = field(default_factory=dict)
    """Control name -> text, number or numbers; None counts as not given."""
    size: tuple[int, int] = (512, 512)
    """Width and height in pixels."""
    background: Any = None
    supersample: int = 1
    tight: bool = False
    keep_outliers: bool = False
    cut_top: float = 0.0
    smooth: Any = "auto"
    margin: Any = None
    weights: str | Path = "auto"
    colors: Sequence[Sequence[float]] = ()
    """sRGB in [0, 1] of each cloud, or one for all of them, instead of the color control; empty for none."""
    fields: Sequence[Mapping[str, np.ndarray]] = ()
    """What else is known of the points of each cloud, as in `RawCloud.fields`; empty for nothing."""
    class_names: Sequence[Mapping[str, Mapping[int, str]]] = ()
    """Of each cloud, what values of a field of labels stand for, as in `RawCloud.class_names`; empty for nothing."""
    color_kinds: Sequence[str] = ()
    """Of each cloud, what numbers its own colors were; empty where it is not known."""
    color_options: ColorOptions = field(default_factory=ColorOptions)
    """What the points are colored by."""
    style: Style = field(default_factory=Style)
    """How they are shown."""
    has_size: bool = False
    """Whether the caller chose the size."""
    passes: tuple[str, ...] = ()
    """What else is drawn: `z2p_core.pass_names.PASSES`."""
    zoom: Any = None
    pan: Any = None
    cloud_colors: Sequence[Any] = ()
    """Value of the control ``color`` for each cloud, as text or numbers; empty for one that all share."""


@dataclass(frozen=True)
class FilmRequest:
    """What the user asks of a film, in the words and numbers of `z2p_core.animate`, checked."""

    arrange: str = "series"
    frames: int = 48
    fps: float = 24.0
    motion: str = "turn"
    hold: int = 1
    blend: int = 0
    blend_by: str = "auto"
    turns: float = 0.0
    closes: bool = False
    reference: int = 0
    on_frame: Callable[[int, int], None] | None = None
    """Called with the number of frames done, and of all."""


@dataclass(frozen=True)
class RenderedImage:
    """The picture of one cloud."""

    array: np.ndarray
    """(H, W, 4) uint8, straight sRGB RGBA."""
    record: Mapping[str, Any]
    """All that made it, JSON-able."""
    notes: tuple[str, ...] = ()
    """What was left out or guessed, in words."""
    passes: Mapping[str, np.ndarray] = field(default_factory=dict)
    """The passes that the request asks for."""


class Backend(Protocol):
    """Renders clouds and encodes images; keeps the weights that it has loaded."""

    def render_arrays(self, clouds: Sequence[np.ndarray], request: RenderRequest) -> list[RenderedImage]:
        """An image of each cloud (N, 3) float64; rows that are not finite are dropped and noted."""

    def render_file(self, path: Path, request: RenderRequest) -> list[RenderedImage]:
        """An image of each cloud in a file."""

    def read_cameras(self, path: Path) -> list[PinholeCamera]:
        """The cameras in the data's units of a file."""

    def save_passes(
        self, passes: Mapping[str, np.ndarray], camera: PinholeCamera, picture: Path, format: str
    ) -> list[Path]:
        """Write passes and their camera beside a picture; the paths of the files."""

    def animate(
        self, clouds: Sequence[np.ndarray] | Sequence[Path], request: RenderRequest, film: FilmRequest, path: Path
    ) -> list[str]:
        """Writes a film of clouds (N, 3) float64, or of those in files; what was left out or guessed, in words."""

    def save_image(self, array: np.ndarray, record: Mapping[str, Any], path: Path) -> None:
        """Write an image (H, W, 4) uint8 with its record, in the format of the path's suffix."""

    def encode_png(self, array: np.ndarray, record: Mapping[str, Any]) -> bytes:
        """An image (H, W, 4) uint8 with its record, as a PNG file."""

    def parse_background(self, background: Any) -> tuple[float, float, float] | None:
        """sRGB in [0, 1] of a CSS name, #hex or three numbers; None for a transparent one."""

    def start_viewer(self, points: Any, fields: Sequence[Mapping[str, np.ndarray]], up: str) -> Any:
        """A running viewer, with an `address` and a method `close`; see `z2p_core.view`."""

    def draw_message(self, text: str, size: tuple[int, int]) -> np.ndarray:
        """Image (H, W, 4) uint8 that shows the text, instead of a cloud that could not be rendered."""


@cache
def load_backend() -> Backend:
    """The installed backend.

    Raises:
        LookupError: only the core is installed.
    """
    installed = list(entry_points(group=GROUP))
    if not installed:
        raise LookupError(f"z2p_core is here, but nothing that draws is installed; {install_advice()}")
    backend: Backend = installed[0].load()()
    return backend
