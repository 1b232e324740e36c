"""What pictures are compared with: baselines, which make a mesh for Blender, and painters, which draw outright."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, ClassVar

import numpy as np

if TYPE_CHECKING:
    from z2p_core.camera import Camera
    from z2p_core.scene import SceneDescription


class Timed:
    """Something whose steps are timed as they run."""

    @property
    def seconds(self) -> dict[str, float]:
        """Step -> seconds that it took so far, in the order in which they ran; empty where no step is told."""
        seconds: dict[str, float] = self.__dict__.setdefault("_seconds", {})
        return seconds

    @contextmanager
    def timed(self, step: str) -> Iterator[None]:
        """Adds what runs inside to the seconds of a step."""
        started = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[step] = self.seconds.get(step, 0.0) + time.perf_counter() - started


class Baseline(ABC, Timed):
    """Turns a bare cloud into a mesh, which Blender renders: what evaluation compares z2p with."""

    name: ClassVar[str]
    version: ClassVar[str]
    packages: ClassVar[tuple[str, ...]] = ()
    """Distributions whose versions count, as the code does, when results are told stale: ``("open3d",)``."""
    for_view: ClassVar[bool] = False
    """Whether a mesh serves one viewpoint alone, and is made anew for another."""

    @abstractmethod
    def reconstruct(self, cloud: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """Vertices (V, 3) float64 and triangles (M, 3) int, M >= 1, of a cloud (N, 3) float in world units.

        The cloud has neither normals nor colours and lies in the unit sphere; so does the mesh, in the same place.

        Raises:
            ScanError: no mesh can be made of this cloud; evaluation then counts an empty picture and goes on.
        """

    def reconstruct_for(
        self, cloud: np.ndarray, viewer: np.ndarray, rng: np.random.Generator
    ) -> tuple[np.ndarray, np.ndarray]:
        """The same, to be seen from `viewer` (3,), in the cloud's axes; one that is `for_view` overrides this."""
        return self.reconstruct(cloud, rng)


class Painter(ABC, Timed):
    """Draws a picture of a bare cloud without a mesh and without Blender."""

    name: ClassVar[str]
    version: ClassVar[str]
    packages: ClassVar[tuple[str, ...]] = ()
    """Distributions whose versions count, as the code does, when results are told stale: ``("open3d",)``."""

    @abstractmethod
    def paint(self, cloud: np.ndarray, camera: Camera, scene: SceneDescription) -> np.ndarray:
        """Picture (H, W, 4) float32 in [0, 1], straight sRGB RGBA, of a cloud (N, 3) float32 in world units.

        The cloud is placed already: the scene's rotation and lift are in it. The scene tells light, material, floor.

        Raises:
            ScanError: no picture can be made of this cloud; evaluation then counts an empty one and goes on.
        """
