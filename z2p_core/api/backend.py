"""The door from the pure core to what draws: found through the entry point ``z2p.studio``, never imported."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from importlib.metadata import entry_points
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from z2p_core.errors.install_advice import install_advice

if TYPE_CHECKING:
    from z2p_core.api.picture import Picture
    from z2p_core.placement.viewpoint import Viewpoint

GROUP = "z2p.studio"


@dataclass(frozen=True)
class RenderRequest:
    """How pictures are to look, in the user's own words and numbers; the studio checks them."""

    up: str = "+Z"
    view: str | float | tuple[float, float] = "auto"
    azimuth: float = 0.0
    camera: Viewpoint | Picture | Mapping[str, Any] | str | Path | None = None
    controls: Mapping[str, Any] = field(default_factory=dict)
    size: tuple[int, int] = (512, 512)
    background: Any = None
    supersample: int = 1
    tight: bool = False
    keep_outliers: bool = False
    cut_top: float = 0.0
    smooth: Any = "auto"
    margin: Any = None
    weights: str | Path = "auto"
    colors: Sequence[Sequence[float]] = ()
    """sRGB in [0, 1] of each cloud, or one for all of them, in place of the control's."""


class Backend(Protocol):
    """Draws and encodes pictures; keeps the weights that it has loaded."""

    def draw(self, clouds: Sequence[np.ndarray], request: RenderRequest) -> list[Picture]:
        """A picture of each cloud (N, 3) float64; rows that are not finite are dropped and noted."""

    def draw_file(self, path: Path, request: RenderRequest) -> list[Picture]:
        """A picture of each cloud in a file."""

    def save(self, picture: Picture, path: Path) -> Path:
        """The path, once the picture is written there, in the format of its suffix."""

    def png(self, picture: Picture) -> bytes:
        """The picture as a PNG file."""

    def over(self, picture: Picture, background: Any) -> Picture:
        """The picture made opaque."""

    def notice(self, text: str, size: tuple[int, int]) -> np.ndarray:
        """Picture (H, W, 4) uint8 that says the text, in place of one that could not be drawn."""


@cache
def load_backend() -> Backend:
    """The installed studio.

    Raises:
        LookupError: z2p is not installed as a whole.
    """
    found = list(entry_points(group=GROUP))
    if not found:
        raise LookupError("z2p_core is here, but nothing that draws is installed; "
                          f"{install_advice()}")
    drawing: Backend = found[0].load()()
    return drawing
