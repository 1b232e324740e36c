"""All that a plugin author reads: the things z2p lets a stranger replace or add.

A plugin is one class in one file, named in one entry point of its package. Built-in plugins use the same door.

=============================  =====================  ===========================================
entry-point group              subclass               example
=============================  =====================  ===========================================
``z2p.controls``               `Control`              metallic: a number the user moves
``z2p.zbuffers``               `ZBuffer`              the paper's 5x5 splat (Eq. 1)
``z2p.gbuffers``               `GBuffer`              lit surfels and their shadow: a rough rendering
``z2p.encoders``               `PositionalEncoder`    random Fourier features (Eq. 3)
``z2p.engines``                `Engine`               onnxruntime: what runs the trained network
``z2p.samplers``               `Sampler`              farthest-point sampling of a mesh
``z2p.readers``                `Reader`               a point-cloud file format
``z2p.baselines``              `Baseline`             ball pivoting, to compare pictures with
``z2p.painters``               `Painter`              depth filled in on the screen, to compare with as well
=============================  =====================  ===========================================

Every plugin has a ``name`` (that of its entry point) and a ``version``: raise the version whenever its results change.
Randomness comes only from the ``rng`` argument. ``z2p_core.testing`` holds the contract suite that the built-ins pass.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from z2p_core.contracts.baseline import Baseline as Baseline
from z2p_core.contracts.baseline import Painter as Painter
from z2p_core.contracts.engine import Engine as Engine
from z2p_core.contracts.engine import TrainedNetwork as TrainedNetwork
from z2p_core.errors.messages import UserError
from z2p_core.scene import SceneDescription

if TYPE_CHECKING:
    from z2p_core.camera import Camera

Value = tuple[float, ...]
"""What a control is set to: one float for each component of its slider, in the slider's units."""


class SettingError(UserError):
    """A setting that no control can take; the message says what was expected, what came, and how to mend it."""


@dataclass(frozen=True)
class Slider:
    """What a user moves: from this alone come the command-line option and a viewer's slider.

    Each tuple has one entry for each component (one for roughness; three for the light: radius, azimuth, elevation).
    """

    components: tuple[str, ...]
    low: Value
    high: Value
    default: Value
    help: str
    unit: str = ""
    metavar: str = ""

    def __post_init__(self) -> None:
        sizes = {len(self.components), len(self.low), len(self.high), len(self.default)}
        if sizes != {len(self.components)} or not self.components:
            raise ValueError(
                f"slider: components, low, high and default need one entry each per component, got lengths {sizes}"
            )
        for name, low, default, high in zip(self.components, self.low, self.default, self.high, strict=True):
            if not low <= default <= high or low == high:
                raise ValueError(f"slider: {name} needs low <= default <= high and a range, got {low, default, high}")


class Control(ABC):
    """One thing the user steers, told in one file: its slider, how it is drawn, encoded, and applied to the scene."""

    name: ClassVar[str]
    version: ClassVar[str]
    slider: ClassVar[Slider]

    @property
    def size(self) -> int:
        """How many numbers it adds to the settings vector s (paper section 3.3); the length of `encode`'s result."""
        return len(self.slider.components)

    def parse(self, text: str) -> Value:
        """Value that the user's text stands for: comma-separated floats inside the slider's range.

        Raises:
            SettingError: the text has another form, or a number lies outside its range.
        """
        slider = self.slider
        expected = ",".join(slider.components)
        try:
            value = tuple(float(part) for part in text.split(","))
        except ValueError:
            value = ()
        if len(value) != len(slider.components):
            raise SettingError(f"--{self.name}: expected {expected} as numbers, got {text!r}")
        return self.check(value)

    def check(self, value: Value) -> Value:
        """The value itself, when every component is finite and inside the slider's range.

        Raises:
            SettingError: a component is outside; the message names it and its range.
        """
        slider = self.slider
        if len(value) != len(slider.components):
            raise SettingError(f"{self.name}: expected {len(slider.components)} numbers, got {value!r}")
        for component, number, low, high in zip(slider.components, value, slider.low, slider.high, strict=True):
            if not low <= number <= high:  # also false for nan
                raise SettingError(
                    f"--{self.name}: {component} is {number:g}, expected {low:g} to {high:g} {slider.unit}".rstrip()
                )
        return value

    def draw(self, rng: np.random.Generator) -> Value:
        """Random value for one training render; uniform over the slider unless a control overrides it."""
        return tuple(float(rng.uniform(low, high)) for low, high in zip(self.slider.low, self.slider.high, strict=True))

    def encode(self, value: Value) -> tuple[float, ...]:
        """The `size` numbers for the settings vector; the slider's range mapped to [0, 1] unless overridden."""
        ends = zip(value, self.slider.low, self.slider.high, strict=True)
        return tuple((number - low) / (high - low) for number, low, high in ends)

    def mirrored(self, value: Value) -> Value:
        """Value for the same scene with left and right exchanged, as training shows it; itself unless overridden."""
        return value

    @abstractmethod
    def apply(self, value: Value, scene: SceneDescription) -> None:
        """Write the value into the description of the Blender scene, e.g. ``scene.material["Metallic"] = value[0]``."""


class ZBuffer(ABC):
    """Turns a projected cloud into the picture that the network reads."""

    name: ClassVar[str]
    version: ClassVar[str]
    channels: ClassVar[int]

    @abstractmethod
    def draw(self, cloud: np.ndarray, camera: Camera) -> np.ndarray:
        """Picture (channels, height, width) float32 of a cloud (N, 3) float32 in world units; 0 where nothing is."""

    def draw_into(self, out: np.ndarray, cloud: np.ndarray, camera: Camera) -> None:
        """Draws all of `out`, contiguous, whatever is in it; one that does so without a copy overrides this."""
        out[...] = self.draw(cloud, camera)


class GBuffer(ABC):
    """Draws rough features of the lit scene from the bare cloud, which the network reads beside the z-buffer.

    A G-buffer is what deferred shading calls the pictures (depth, normals, light) that a last pass makes an image of.
    Unlike a `ZBuffer` it knows the whole scene, and may look at a point's neighbours.
    """

    name: ClassVar[str]
    version: ClassVar[str]
    channels: ClassVar[int]
    refines: ClassVar[str] = ""
    """Name of a G-buffer whose channels mean the same, so that its weights can be trained on with this one."""

    @abstractmethod
    def draw(self, cloud: np.ndarray, camera: Camera, scene: SceneDescription) -> np.ndarray:
        """Picture (channels, height, width) float32, about [-1, 1], of a cloud (N, 3) float32 in world units.

        `scene` has the light, the material and the floor; a floor of None touches the cloud's lowest point. Its
        rotation and lift are those of the cloud already.
        """

    def draw_into(self, out: np.ndarray, cloud: np.ndarray, camera: Camera, scene: SceneDescription) -> None:
        """Draws all of `out`, contiguous, whatever is in it; one that does so without a copy overrides this."""
        out[...] = self.draw(cloud, camera, scene)

    def reconcile(self, picture: np.ndarray, features: np.ndarray, points: int) -> None:  # noqa: B027 - most need none
        """Moves the network's picture (4, H, W), colour times alpha and alpha, towards what it was drawn of, in place.

        `features` (channels, H, W) are those of a cloud of so many points. Where they are as near to the truth as the
        picture, and err in another way, a mean of both is nearer.
        """

    def elsewhere(self, features: np.ndarray, points: int) -> tuple[np.ndarray, np.ndarray] | None:
        """What a picture is where the cloud is not; None if only a network can tell.

        Of features (channels, H, W) of so many points: first (H, W), above 0 where the cloud shows, or what else the
        network has to mend; then the picture (4, H, W), as networks draw it, of all the rest.
        """
        return None


class PositionalEncoder(ABC):
    """Features of a pixel's place in the full frame, joined to the network's input (paper section 3.3, Eq. 3)."""

    name: ClassVar[str]
    version: ClassVar[str]

    @classmethod
    @abstractmethod
    def create(cls, rng: np.random.Generator) -> PositionalEncoder:
        """Encoder with its random numbers drawn, once, at the start of training."""

    @classmethod
    @abstractmethod
    def from_state(cls, state: dict[str, Any]) -> PositionalEncoder:
        """The encoder whose `state` was saved with the weights."""

    @property
    @abstractmethod
    def state(self) -> dict[str, Any]:
        """What must be saved with the weights to rebuild it: JSON-able numbers and lists."""

    @property
    @abstractmethod
    def channels(self) -> int:
        """How many features a pixel gets; 0 for none."""

    @abstractmethod
    def encode(self, u: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Features (channels, H, W) float32 of pixel coordinates u, v (H, W), [0, 1] over the full square frame."""


class Sampler(ABC):
    """Draws points on the surface of a mesh."""

    name: ClassVar[str]
    version: ClassVar[str]
    packages: ClassVar[tuple[str, ...]] = ()
    """Distributions whose versions count, as the code does, when results are told stale: ``("open3d",)``."""

    @abstractmethod
    def sample(self, vertices: np.ndarray, faces: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
        """Exactly `count` points (count, 3) float64 on the triangles faces (M, 3) int of vertices (V, 3) float64."""


@dataclass(frozen=True)
class Sensor:
    """Where a depth camera or scanner stood, in its file's axes."""

    position: np.ndarray
    """Place (3,) float64 in the file's units."""
    rotation: np.ndarray
    """Matrix (3, 3) float64 from the sensor's OpenCV axes (+X right, +Y down, +Z forward) to the file's axes."""


@dataclass(frozen=True)
class RawCloud:
    """One cloud as its file has it: points (N, 3) float64, and the sensor when the file tells of one."""

    points: np.ndarray
    sensor: Sensor | None = None
    total: int | None = None
    """How many points the file has, where those here only stand for them (`z2p_core.formats.row_subsampling`)."""
    note: str = ""
    """What the reader took for granted or left out, in a few words for the file's line."""
    up: str = ""
    """The file's axis that points up, such as ``-Y``, where its format or contents tell; empty where they do not."""
    up_reason: str = ""
    """What tells it, in a few words: ``the axes of COLMAP``."""
    up_certain: bool = True
    """False where the axis is only usual for such files, so that the cloud's shape may overrule it."""
    upward: np.ndarray | None = None
    """The direction (3,) that points up, where it is none of the file's axes; `up` is the nearest one then."""
    seen_from: np.ndarray | None = None
    """A place (3,) from which people looked at it, where the file or what lies beside it tells of cameras."""


MEMORY_A_POINT = 170
"""Bytes that a point takes at the height of reading and placing it: seven times x, y, z in float64."""
MEMORY_A_BYTE = MEMORY_A_POINT // 12
MEMORY_A_CHARACTER = 26
"""The same for a byte of text that is read as a whole and cut into words."""


class Reader(ABC):
    """Reads one family of point-cloud files."""

    name: ClassVar[str]
    version: ClassVar[str]
    suffixes: ClassVar[tuple[str, ...]]
    """Lower-case, with the dot: ``(".las", ".laz")``."""
    packages: ClassVar[tuple[str, ...]] = ()
    """Distributions whose versions count, as the code does, when results are told stale: ``("open3d",)``."""
    columns: Sequence[str] | None = None
    """What the user says that a text file's columns hold: ``("x", "y", "z", "r", "g", "b")``; others ignore it."""
    takes_columns: ClassVar[bool] = True
    """Whether it may read by `columns`; where it does not, the file's line says that they were ignored."""

    def memory(self, path: Path) -> int:
        """Bytes that reading and placing the file take at the most, roughly: more than is free, and it is refused.

        The default fits packed float32 coordinates; formats that pack tighter count their points instead.
        """
        return MEMORY_A_BYTE * path.stat().st_size

    def is_fragile(self, path: Path) -> bool:
        """Whether its library may end the whole process on such a file, if it is damaged.

        Then `read` runs in a process of its own, which takes a fifth of a second more: the class must be importable.
        """
        return False

    @abstractmethod
    def read(self, path: Path) -> Sequence[RawCloud | np.ndarray]:
        """List of the clouds in the file, each (N, 3) float64 in its own units; one for most formats, B for a batch.

        A plain array stands for a cloud without a sensor. Rows that are not finite stay in: the caller drops and
        counts them.

        Raises:
            ScanError: the file cannot be a cloud of this format, or lies about its size.
        """


class ScanError(UserError):
    """A scan that cannot be used; the message says what was expected, what came, and what to do."""
