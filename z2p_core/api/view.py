"""`view`: look around points in a notebook or in the browser."""

from __future__ import annotations

import html
from collections import ChainMap
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from z2p_core.api.backend import load_backend
from z2p_core.api.point_arrays import point_arrays
from z2p_core.api.point_colors import are_scalars, parse_colors, split_by_cloud, split_scalars

GIVEN_VALUES = "values"
"""Name of the field that scalars given as colors become."""


class RunningViewer(Protocol):
    """What the backend starts."""

    address: str

    def close(self) -> None:
        """End it."""


class Viewer:
    """A page that shows points, in the notebook's cell or at `address`; `close` ends it, as the program's end does."""

    def __init__(self, running: RunningViewer, height: int) -> None:
        self._running, self._height = running, height

    @property
    def address(self) -> str:
        """Where a browser on this machine finds the page."""
        return self._running.address

    def close(self) -> None:
        """End the viewer; a second time does nothing."""
        self._running.close()

    def __repr__(self) -> str:
        return f"<Viewer at {self.address}>"

    def _repr_html_(self) -> str:
        address = html.escape(self.address, quote=True)
        return (
            f'<iframe src="{address}" width="100%" height="{self._height}" style="border:0" '
            f'allow="clipboard-write"></iframe><div><a href="{address}" target="_blank">open in a tab</a></div>'
        )


def view(points: Any, colors: Any = None, *, up: str | None = None, height: int = 640) -> Viewer:
    """Look around points: in a notebook the page shows itself in the cell, elsewhere open its `address` in a browser.

    The page's buttons save pictures to the folder ``pictures`` and copy the call that makes the same picture.

    Args:
        points: as for `z2p_core.render`; or the path of a file, or a list of paths.
        colors: sRGB or scalars for each point, as for `z2p_core.render`; for files, the page chooses.
        up: the axis that points up at first. None: ``auto`` for files, else ``+Z``.
        height: of the cell, in pixels.

    Raises:
        ScanError: the points are no cloud (a ValueError).
        SettingError: the colors are none (a ValueError).
    """
    is_list_of_paths = (
        isinstance(points, list | tuple) and points and all(isinstance(one, str | Path) for one in points)
    )
    if isinstance(points, str | Path) or is_list_of_paths:
        paths = [Path(points)] if isinstance(points, str | Path) else [Path(one) for one in points]
        return Viewer(load_backend().start_viewer(paths, (), up or "auto"), height)
    given = point_arrays(points)
    fields: Sequence[Mapping[str, np.ndarray]] = given.fields or [{} for _ in given.clouds]
    if colors is not None:
        is_scalar = are_scalars(colors, given.clouds)
        parts = split_scalars(colors, given.clouds) if is_scalar else split_by_cloud(parse_colors(colors), given.clouds)
        name = GIVEN_VALUES if is_scalar else "rgb"
        fields = [ChainMap({name: part}, dict(other)) for part, other in zip(parts, fields, strict=True)]
    return Viewer(load_backend().start_viewer(given.clouds, fields, up or "+Z"), height)
