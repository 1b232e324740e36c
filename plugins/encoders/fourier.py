"""Positional encoding by random Fourier features (paper section 3.3, Eq. 3)."""

from __future__ import annotations

from typing import Any

import numpy as np

from z2p_core.interfaces import PositionalEncoder

FREQUENCIES = 10
HIGHEST = 10.0


class Fourier(PositionalEncoder):
    """sin(w u), sin(w v), cos(w u), cos(w v) for ten frequencies w drawn once from U[0, 10]: 40 channels."""

    name = "fourier"
    version = "1"

    def __init__(self, omega: np.ndarray) -> None:
        self.omega = omega

    @classmethod
    def create(cls, rng: np.random.Generator) -> Fourier:
        return cls(rng.uniform(0.0, HIGHEST, FREQUENCIES).astype(np.float32))

    @classmethod
    def from_state(cls, state: dict[str, Any]) -> Fourier:
        return cls(np.array(state["omega"], dtype=np.float32))

    @property
    def state(self) -> dict[str, Any]:
        return {"omega": [float(omega) for omega in self.omega]}

    @property
    def channels(self) -> int:
        return 4 * len(self.omega)

    def encode(self, u: np.ndarray, v: np.ndarray) -> np.ndarray:
        phase_u = self.omega[:, None, None] * u  # (10, H, W)
        phase_v = self.omega[:, None, None] * v
        waves = [np.sin(phase_u), np.sin(phase_v), np.cos(phase_u), np.cos(phase_v)]
        return np.concatenate(waves).astype(np.float32)
