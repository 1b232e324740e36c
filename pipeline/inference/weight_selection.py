"""Weights that suit what is asked and what comes: unless the user names some, z2p chooses among those it ships."""

from __future__ import annotations

from collections.abc import Collection
from functools import cached_property
from pathlib import Path
from threading import Lock

import numpy as np

from z2p_core.interfaces import SettingError
from z2p_core.surface.normals import scatter
from z2p_renderer.pipeline.inference.engine_selection import check_engine
from z2p_renderer.pipeline.inference.renderer import Renderer
from z2p_renderer.storage.models.checkpoints import shipped_weights

AUTO = "auto"
DEFAULT_WEIGHTS, NOISY_CLOUD_WEIGHTS = "regular", "denoise"
"""Of the shipped weights, those for clean clouds and those for noisy ones; both carry the same controls."""
MIN_NOISE_TO_SPACING = 0.2
"""Scatter of a cloud's points about their surface, in spacings, from which on it counts as noisy. Up to 0.16 (5,000
points, noise of 0.005) the usual weights are as good on the whole and better on the object; from 0.3 on the others are
better."""


class AutoRenderer(Renderer):
    """The usual weights, and for noisy clouds those made for noise; each starts when the first cloud asks for it."""

    def __init__(self, threads: int | None = None, engine: str | None = None) -> None:
        if engine is not None:
            check_engine(engine)
        super().__init__(DEFAULT_WEIGHTS, threads, engine, lazy=True)
        self._options, self._lock = (threads, engine), Lock()

    @property
    def sole_weights(self) -> str | None:
        return None

    def suited(self, cloud: np.ndarray) -> tuple[Renderer, str]:
        """The renderer for a placed cloud (N, 3) float32, and why it is not the usual one, or nothing."""
        noise = scatter(cloud)
        with self._lock:  # of several threads, one starts an engine
            if noise < MIN_NOISE_TO_SPACING or NOISY_CLOUD_WEIGHTS not in shipped_weights():
                self._engine  # noqa: B018
                return self, ""
            return self._noisy, f"weights {NOISY_CLOUD_WEIGHTS}: its points scatter by {noise:.1f} of their spacing"

    @cached_property
    def _noisy(self) -> Renderer:
        return Renderer(NOISY_CLOUD_WEIGHTS, *self._options)


def load_renderer(
    weights: str | Path, asked: Collection[str], threads: int | None = None, engine: str | None = None
) -> Renderer:
    """Renderer of `weights`, a shipped name or a file; or, for ``auto``, of shipped ones that carry the controls asked.

    Raises:
        SettingError: no shipped weights carry them all.
        WeightsError, PluginError: see `Renderer`.
    """
    if str(weights) != AUTO:
        return Renderer(weights, threads, engine)
    usual = AutoRenderer(threads, engine)
    if set(asked) - {"elevation"} <= set(usual.controls):
        return usual
    for name in shipped_weights():
        if name not in (DEFAULT_WEIGHTS, NOISY_CLOUD_WEIGHTS):
            renderer = Renderer(name, threads, engine)
            if set(asked) <= set(renderer.controls):
                return renderer
    missing = ", ".join(sorted(set(asked) - set(usual.controls)))
    raise SettingError(f"no weights that come with z2p carry {missing} (with all else that is asked); choose "
                       "others (--weights, in Python weights=), or leave it out")
