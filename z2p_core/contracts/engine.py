"""What runs a trained network: an engine, and the forms in which it is handed the network."""

from __future__ import annotations

import importlib.util
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar, Protocol

import numpy as np


class Shelf(Protocol):
    """Where an engine keeps what takes it long to work out, from one process to the next; anything may be gone."""

    def get(self, key: str) -> bytes | None:
        """What was kept under a key, as it was; None where there is none."""

    def put(self, key: str, content: bytes) -> None:
        """Keeps it, if that can be done."""


class LastSteps(Protocol):
    """What is left to do after a model that ends before its network does; `z2p_core.network.final_convs` for shipped ones."""

    def padded(self, buffers: np.ndarray) -> np.ndarray:
        """Buffers (B, C, H, W) with the zeros around them that the model reads."""

    def finish(self, cells: np.ndarray, buffers: np.ndarray) -> np.ndarray:
        """Pictures (B, 4, H, W) in [0, 1] from what the model gave of buffers (B, C, H, W)."""


@dataclass(frozen=True)
class TrainedNetwork:
    """A trained network in the forms that engines take; see `z2p_core.network.unet.build_network` for what it computes."""

    buffer_channels: int
    encoder_channels: int
    settings: int
    onnx: bytes | None
    """ONNX model with inputs ``buffers``, ``encoding`` and ``settings`` and one output, of any batch, height and width:
    ``picture``, or ``cells`` of one that ends before its network does (`LastSteps`). None where no export lies beside
    the weights."""
    module: Callable[[], Any]
    """Gives the torch module in evaluation mode, float32, on the CPU; imports torch, so only what needs it calls it."""
    int8: bytes | None = None
    """ONNX model like the other, whose inner convolutions are in 8 bits (QDQ); None where the weights have none."""
    shelf: Shelf | None = None
    """For what the engine makes of the network; None: nowhere."""
    windows: bool = False
    """Whether it gets windows of pictures, each of another size: an engine that prepares for a size had better not."""


class Engine(ABC):
    """Computes the network's pictures, with a library of its own. Several threads may call `run` at once."""

    name: ClassVar[str]
    version: ClassVar[str]
    package: ClassVar[str]
    """The library's import name. The plugin's module must not import it: only `__init__` does."""
    rank: ClassVar[int]
    """Where the user forces none, the installed engine of the lowest rank runs, of those that may `unasked`."""
    reads_onnx: ClassVar[bool] = True
    """Whether it needs `TrainedNetwork.onnx`; False for one that takes the torch module."""
    reads_int8: ClassVar[bool] = False
    """Whether it is `TrainedNetwork.int8` that it needs instead."""
    exact: ClassVar[bool] = True
    """Whether it keeps within 2/255 of torch; what does not says so, and `z2p evaluate --engine` judges it."""

    last: LastSteps | None = None
    """What `draw` does after `run`, where the model leaves out the last of its network."""

    @classmethod
    def unasked(cls) -> bool:
        """Whether it may run where the user forces none: exact ones may, others where they are quicker than those."""
        return cls.exact

    @classmethod
    def installed(cls) -> bool:
        """Whether its library is there; nothing is imported to find out."""
        return importlib.util.find_spec(cls.package) is not None

    @abstractmethod
    def __init__(self, network: TrainedNetwork, threads: int | None = None) -> None:
        """Engine ready to run that network on at most so many threads, None for as many as there are cores."""

    @abstractmethod
    def run(self, buffers: np.ndarray, encoding: np.ndarray, settings: np.ndarray) -> np.ndarray:
        """What the model gives, most often pictures (B, 4, H, W) float32 in [0, 1], colour times alpha and alpha.

        Of buffers (B, C, H, W), the encoding (E, h, w) of the pixel blocks' centres (sides rounded up) and settings
        (B, S) in [0, 1], all float32; H, W >= 32. Where `exact`, within 2/255 of the torch network at the 99.9th
        percentile.
        """

    def draw(self, buffers: np.ndarray, encoding: np.ndarray, settings: np.ndarray) -> np.ndarray:
        """The whole network's pictures (B, 4, H, W), of the same inputs as `run`."""
        if self.last is None:
            return self.run(buffers, encoding, settings)
        height, width = buffers.shape[2:]
        padded = self.last.padded(buffers)
        return self.last.finish(self.run(padded, encoding, settings), padded)[:, :, :height, :width]
