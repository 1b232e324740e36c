"""Which weights render a cloud: those that the user names or, for ``auto``, shipped ones by the cloud's noise."""

from __future__ import annotations

from collections.abc import Collection
from functools import cached_property
from pathlib import Path
from threading import Lock

import numpy as np

from z2p_core.interfaces import Control, SettingError, Value
from z2p_core.surface.noise_level import NOISY_NOISE_TO_SPACING, noise_to_spacing
from z2p_renderer.pipeline.inference.engine_selection import check_engine
from z2p_renderer.pipeline.inference.renderer import Renderer
from z2p_renderer.storage.models.checkpoints import shipped_weights

AUTO = "auto"
"""Stands for weights that are selected for each cloud."""
DEFAULT_WEIGHTS = "regular"
"""Shipped weights for clean clouds."""
NOISY_CLOUD_WEIGHTS = "denoise"
"""Shipped weights for noisy clouds; they carry the same controls as the default ones."""


class AutoRenderer:
    """Selects a `Renderer` for each cloud: the default weights, or those for noisy clouds. Threads may share one.

    Each of the two starts its engine when the first cloud needs it.
    """

    def __init__(self, threads: int | None = None, engine: str | None = None) -> None:
        """See `Renderer` for the arguments and errors."""
        if engine is not None:
            check_engine(engine)
        self._options, self._lock = (threads, engine), Lock()
        self._default = Renderer(DEFAULT_WEIGHTS, threads, engine, lazy=True)

    @property
    def controls(self) -> dict[str, Control]:
        """The controls that both weights carry, in the order of the settings vector."""
        return self._default.controls

    @property
    def fixed_elevation(self) -> float | None:
        """See `Renderer.fixed_elevation`."""
        return self._default.fixed_elevation

    @property
    def draws_colors(self) -> bool:
        """See `Renderer.draws_colors`."""
        return self._default.draws_colors

    def settings(self, values: dict[str, Value]) -> dict[str, Value]:
        """See `Renderer.settings`."""
        return self._default.settings(values)

    @property
    def without_network(self) -> Renderer:
        """The default renderer, whose engine need not run: for styles without a network."""
        return self._default

    def select(self, cloud: np.ndarray) -> tuple[Renderer, str]:
        """The renderer for a placed cloud (N, 3) float32, started; and the reason in words if it is not the default."""
        noise = noise_to_spacing(cloud)
        with self._lock:  # several threads must not start the same engine
            if noise < NOISY_NOISE_TO_SPACING or NOISY_CLOUD_WEIGHTS not in shipped_weights():
                self._default.start()
                return self._default, ""
            return self._noisy, f"weights {NOISY_CLOUD_WEIGHTS}: its points scatter by {noise:.1f} of their spacing"

    @cached_property
    def _noisy(self) -> Renderer:
        return Renderer(NOISY_CLOUD_WEIGHTS, *self._options)


AnyRenderer = Renderer | AutoRenderer
"""A renderer with weights of its own, or one that selects them for each cloud."""


def load_renderer(
    weights: str | Path, controls: Collection[str], threads: int | None = None, engine: str | None = None
) -> AnyRenderer:
    """Renderer of `weights`, a shipped name or a file; for ``auto`` one of shipped weights that carry these controls.

    `threads` and `engine` are as for `Renderer`.

    Raises:
        SettingError: no shipped weights carry all of the controls.
        WeightsError, PluginError: see `Renderer`.
    """
    if str(weights) != AUTO:
        return Renderer(weights, threads, engine)
    automatic = AutoRenderer(threads, engine)
    if set(controls) - {"elevation"} <= set(automatic.controls):
        return automatic
    for name in shipped_weights():
        if name not in (DEFAULT_WEIGHTS, NOISY_CLOUD_WEIGHTS):
            renderer = Renderer(name, threads, engine)
            if set(controls) <= set(renderer.controls):
                return renderer
    missing = ", ".join(sorted(set(controls) - set(automatic.controls)))
    raise SettingError(f"no weights that come with z2p carry {missing} (with all else that is asked); choose "
                       "others (--weights, in Python weights=), or leave it out")


def select_renderer(
    renderer: AnyRenderer, cloud: np.ndarray, needs_network: bool = True
) -> tuple[Renderer, str]:  # fmt: skip
    """The renderer for a placed cloud (N, 3) float32, with fixed weights; and why `AutoRenderer` chose these, if so."""
    if not needs_network:
        return (renderer.without_network if isinstance(renderer, AutoRenderer) else renderer), ""
    return renderer.select(cloud) if isinstance(renderer, AutoRenderer) else (renderer, "")
