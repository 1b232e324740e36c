"""No positional encoding: the ablation of the paper's section 4.6."""

from __future__ import annotations

from typing import Any

import numpy as np

from z2p_core.interfaces import PositionalEncoder


class NoEncoder(PositionalEncoder):
    """Adds no channel."""

    name = "none"
    version = "1"

    @classmethod
    def create(cls, rng: np.random.Generator) -> NoEncoder:
        return cls()

    @classmethod
    def from_state(cls, state: dict[str, Any]) -> NoEncoder:
        return cls()

    @property
    def state(self) -> dict[str, Any]:
        return {}

    @property
    def channels(self) -> int:
        return 0

    def encode(self, u: np.ndarray, v: np.ndarray) -> np.ndarray:
        return np.zeros((0, *u.shape), dtype=np.float32)
