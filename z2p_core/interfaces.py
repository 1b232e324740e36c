"""What a plugin can replace or add, and all that its author needs to read.

A plugin is one class in one file, named by one entry point of its package. The built-in plugins are found in the same
way. For each kind: the entry-point group, the class to derive from, the methods to write, and when z2p calls them.

====================  ===================  =======================  ==================================================
group                 class                methods                  called
====================  ===================  =======================  ==================================================
``z2p.controls``      `Control`            slider, apply            once a picture or render: a number the user moves
``z2p.zbuffers``      `ZBuffer`            draw                     once a picture: nearest points as an image (Eq. 1)
``z2p.gbuffers``      `GBuffer`            draw                     once a picture: a rough rendering of the lit scene
``z2p.conditions``    `Condition`          draw_into                once a picture: the cloud's own colors as an image
``z2p.encoders``      `PositionalEncoder`  create, from_state,      once an image size: features of a pixel's place
                                           state, channels, encode  (Eq. 3)
``z2p.engines``       `Engine`             __init__, run            once a picture: runs the trained network
``z2p.samplers``      `Sampler`            sample                   once a training mesh: points on its surface
``z2p.textures``      `Texture`            albedo                   once a mesh or cloud: colors of its places
``z2p.readers``       `Reader`             suffixes, read           once a file: points from a file format
``z2p.baselines``     `Baseline`           reconstruct              once a cloud in evaluation: a mesh to compare with
``z2p.painters``      `Painter`            paint                    once a picture in evaluation: an image to compare
====================  ===================  =======================  ==================================================

Every plugin has a ``name``, that of its entry point, and a ``version``: raise the version whenever its results change,
for weights and kept results are bound to it. Classes are instantiated without arguments, except engines and encoders.
Random numbers come only from the ``rng`` argument. Several threads may call a plugin's methods at once.

Arrays are numpy's, C-contiguous. Clouds (N, 3) are float32 in world units: +Z is up, the object is in the unit sphere
around the origin, and the camera looks at the origin from the -Y side (`z2p_core.camera.Camera`). Images are
channels first, (C, H, W), unless a docstring says otherwise. "Premultiplied" is color times alpha.

`z2p_core.testing` has a `check_*` function for each kind of plugin: the tests that the built-in ones pass.
"""

from __future__ import annotations

import importlib.util
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Protocol

import numpy as np

from z2p_core.errors.messages import UserError
from z2p_core.formats.field_names import field_key
from z2p_core.formats.row_subsampling import MAX_ROWS
from z2p_core.scene import SceneDescription

if TYPE_CHECKING:
    from z2p_core.camera import Camera

Value = tuple[float, ...]
"""What a control is set to: one float for each component of its slider, in the slider's units."""


class SettingError(UserError):
    """A setting that is invalid; the message names what was expected, what came, and how to mend it."""


class ScanError(UserError):
    """A point cloud that cannot be used; the message names what was expected, what came, and how to mend it."""


@dataclass(frozen=True)
class Slider:
    """Range of a control's value. The command-line option and the keyword of `z2p_core.render` are made from it.

    Each tuple has one entry for each component: one for roughness; three for the light (radius, azimuth, elevation).

    Raises:
        ValueError: the tuples differ in length, or a component has no range around its default.
    """

    components: tuple[str, ...]
    """Names of the components, as error messages and ``R,AZ,EL`` forms list them."""
    low: Value
    high: Value
    default: Value
    """The value of a picture for which the user sets nothing."""
    help: str
    """One line for ``--help``."""
    unit: str = ""
    """Unit in error messages, such as ``degrees``."""
    metavar: str = ""
    """The option's placeholder in ``--help``, such as ``0..1``."""

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
    """One setting of a picture: its slider, and how it is parsed, sampled, encoded, and applied to the scene.

    The network reads the encodings of all its controls, one after another, as the settings vector s (paper section
    3.3). Weights carry the controls that they were trained with.
    """

    name: ClassVar[str]
    version: ClassVar[str]
    slider: ClassVar[Slider]

    @property
    def size(self) -> int:
        """How many numbers it adds to the settings vector: the length of `encode`'s result."""
        return len(self.slider.components)

    def parse(self, text: str) -> Value:
        """Value for the user's text: comma-separated floats inside the slider's range, unless overridden.

        Called for the command line's option, and for text given to `z2p_core.render`.

        Raises:
            SettingError: the text has another form, or a number is outside its range.
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
        """The value itself, if every component is inside the slider's range.

        Called for numbers given to `z2p_core.render` or kept in a picture's record.

        Raises:
            SettingError: the number of components is wrong, or one is outside its range or not a number.
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
        """Sample a random value for one training render: uniform over the slider's range, unless overridden."""
        return tuple(float(rng.uniform(low, high)) for low, high in zip(self.slider.low, self.slider.high, strict=True))

    def encode(self, value: Value) -> tuple[float, ...]:
        """The `size` numbers for the settings vector: the slider's range mapped to [0, 1], unless overridden."""
        ends = zip(value, self.slider.low, self.slider.high, strict=True)
        return tuple((number - low) / (high - low) for number, low, high in ends)

    def mirrored(self, value: Value) -> Value:
        """The value for the scene with left and right exchanged, for augmentation: the same one, unless overridden."""
        return value

    @abstractmethod
    def apply(self, value: Value, scene: SceneDescription) -> None:
        """Write the value into the scene, e.g. ``scene.material["Metallic"] = value[0]``.

        Called before a scene is rendered by Blender, for training, and before `GBuffer.draw`, for every picture.
        """


class ZBuffer(ABC):
    """Rasterizes a cloud into the first channels that the network reads: the nearest points, seen by the camera."""

    name: ClassVar[str]
    version: ClassVar[str]
    channels: ClassVar[int]
    """How many channels `draw` gives."""

    @abstractmethod
    def draw(self, cloud: np.ndarray, camera: Camera) -> np.ndarray:
        """Image (channels, height, width) float32 of a cloud (N, 3); 0 where there is no point.

        The order of the points must not matter, and `cloud` must not be changed.
        """

    def draw_into(self, out: np.ndarray, cloud: np.ndarray, camera: Camera) -> None:
        """Write the same image into `out`, whatever it holds. z2p calls this; override it to save a copy."""
        out[...] = self.draw(cloud, camera)


@dataclass(frozen=True)
class PointColors:
    """Colors of a surface at K points on it, which need not be the points that the surface is made of."""

    points: np.ndarray
    """(K, 3) float32, world units."""
    albedo: np.ndarray
    """(K, 3) float32, linear base color in [0, 1]."""
    relight: float = 1.0
    """How much of the scene's light falls on them, 0 to 1. Colors of photographs have light of their own; with 0 they
    are shown as they are, with the shadow on the floor."""


class GBuffer(ABC):
    """Renders features of the lit scene from the bare cloud, which the network reads after the z-buffer's channels.

    In deferred shading, a G-buffer is the set of images (depth, normals, light) from which a last pass makes the
    picture. Unlike a `ZBuffer`, it gets the whole scene, and it may use a point's neighbors.
    """

    name: ClassVar[str]
    version: ClassVar[str]
    channels: ClassVar[int]
    """How many channels `draw` gives; 0 for none."""
    draws_textures: ClassVar[bool] = False
    """Whether `draw_textured_into` is implemented."""
    refines: ClassVar[str] = ""
    """Name of a G-buffer whose channels have the same meaning: its weights can be trained further with this one."""

    @abstractmethod
    def draw(self, cloud: np.ndarray, camera: Camera, scene: SceneDescription) -> np.ndarray:
        """Features (channels, height, width) float32, about [-1, 1], of a cloud (N, 3).

        `scene` has the light, the material and the floor's height; a floor of None touches the cloud's lowest point.
        The cloud is already turned and lifted as the scene's ``rotation`` and ``lift`` say. The order of the points
        must not matter; neither `cloud` nor `scene` may be changed. N may be 0.
        """

    def draw_into(self, out: np.ndarray, cloud: np.ndarray, camera: Camera, scene: SceneDescription) -> None:
        """Write the same features into `out`, whatever it holds. z2p calls this; override it to save a copy."""
        out[...] = self.draw(cloud, camera, scene)

    def draw_textured_into(
        self, out: np.ndarray, cloud: np.ndarray, colors: PointColors, camera: Camera, scene: SceneDescription
    ) -> np.ndarray:
        """Write `draw_into`'s features, and return the radiance of the cloud in its own colors relative to them.

        Called instead of `draw_into` for a cloud whose points have colors, if the class `draws_textures`.

        Args:
            out: (channels, H, W) float32; it receives the features of the cloud in the scene's base color, but for
                light on the floor, which may be that of its own colors.
            cloud: (N, 3) float32.
            colors: the surface's own colors.
            camera: as for `draw`.
            scene: as for `draw`.

        Returns:
            (4, H, W) float32: linear radiance of the surface in its own colors over that in the scene's base color
            (red, green, blue), and its coverage in [0, 1]. z2p multiplies the finished picture by that ratio, so that
            the network renders light and does not filter texture.
        """
        raise NotImplementedError(f"the G-buffer {self.name!r} draws no textures")

    def prepare(self, cloud: np.ndarray, colors: PointColors | None = None) -> PreparedCloud:
        """The cloud (N, 3), in its own `colors` if given, for many images from other sides and in other light.

        Override it to keep what these images share. By default, each is drawn anew from the turned cloud.
        """
        return PreparedCloud(self, cloud, colors)

    def reconcile(self, picture: np.ndarray, features: np.ndarray, points: int) -> None:  # noqa: B027 - most need none
        """Blend the network's output towards the rough rendering, in place. Called once a picture, after the network.

        Args:
            picture: (4, H, W) float32, premultiplied sRGB and alpha; it is changed.
            features: (channels, H, W) float32, what `draw` gave.
            points: number of points in the cloud.

        Where the features are as accurate as the network, and err independently, a mean of both is more accurate.
        """

    def rough_picture(self, features: np.ndarray) -> np.ndarray | None:
        """The picture (4, H, W) float32, premultiplied sRGB and alpha, that the features alone make; None without one.

        It is shown for cameras that the network was not trained for. `features` (channels, H, W) are what `draw` gave.
        """
        return None

    def elsewhere(self, features: np.ndarray, points: int) -> tuple[np.ndarray, np.ndarray] | None:
        """The picture outside the cloud, so that the network runs only on a crop around it; None if it cannot be told.

        Called before the network, for weights that were trained on crops.

        Args:
            features: (channels, H, W) float32, what `draw` gave.
            points: number of points in the cloud.

        Returns:
            A mask (H, W) float32, above 0 where the network is needed; and the picture (4, H, W) float32, premultiplied
            sRGB and alpha, that holds elsewhere.
        """
        return None


class PreparedCloud:
    """A cloud of which a G-buffer draws many images; made by `GBuffer.prepare`. Several threads may share one.

    An image does not depend on those that were drawn before it, beyond rounding.
    """

    def __init__(self, gbuffer: GBuffer, cloud: np.ndarray, colors: PointColors | None) -> None:
        self._gbuffer, self._cloud, self._colors = gbuffer, cloud, colors

    def recolored(self, colors: PointColors | None) -> PreparedCloud:
        """The same cloud in other colors, or in the scene's base color (None); what both share is kept."""
        return PreparedCloud(self._gbuffer, self._cloud, colors)

    def draw_into(
        self, out: np.ndarray, azimuth: float, camera: Camera, scene: SceneDescription
    ) -> np.ndarray | None:  # fmt: skip
        """Write the features of the cloud, turned by `azimuth` degrees about +Z counter-clockwise from above.

        Args:
            out: (channels, H, W) float32, which receives what `GBuffer.draw_into` or `draw_textured_into` would write.
            azimuth: how far the cloud is turned before `camera` and `scene`, which both stay where they are.
            camera: as for `GBuffer.draw`.
            scene: as for `GBuffer.draw`; its light may have any azimuth.

        Returns:
            What `draw_textured_into` returns, for a cloud that was prepared with colors; else None.
        """
        from z2p_core.camera import turn  # late, as few processes draw here

        rotation = turn(azimuth).astype(np.float32).T
        cloud = self._cloud @ rotation if azimuth else self._cloud
        if self._colors is None:
            self._gbuffer.draw_into(out, cloud, camera, scene)
            return None
        colors = replace(self._colors, points=self._colors.points @ rotation) if azimuth else self._colors
        return self._gbuffer.draw_textured_into(out, cloud, colors, camera, scene)


@dataclass(frozen=True)
class ColoredCloud:
    """A cloud with colors of its own, and what the G-buffer has drawn of it."""

    cloud: np.ndarray
    """(N, 3) float32, world units."""
    colors: PointColors
    """The surface's own colors; all alike for a cloud in one color."""
    neutral: np.ndarray
    """(3,) float32, the linear base color in which the network renders the cloud: that of the scene."""
    relative: np.ndarray
    """(4, H, W) float32, what `GBuffer.draw_textured_into` returned."""


class Condition(ABC):
    """A picture of a cloud's own colors, which the network reads after the G-buffer's channels.

    Without one, the network knows nothing of these colors: it renders the cloud in one neutral color, and its picture
    is multiplied by the relative radiance that the G-buffer has drawn. With one, it can shape the neutral picture so
    that the product is better. Only for weights with a control ``color`` and a G-buffer that `draws_textures`.
    """

    name: ClassVar[str]
    version: ClassVar[str]
    channels: ClassVar[int]
    """How many channels `draw_into` writes, at least 1."""

    @abstractmethod
    def draw_into(self, out: np.ndarray, colored: ColoredCloud, camera: Camera, scene: SceneDescription) -> None:
        """Write an image (channels, height, width) float32, about [-1, 1], into `out`, whatever it holds.

        It is 0 where the cloud is not. `colored` may not be changed; `camera` and `scene` are those of
        `GBuffer.draw`. The order of the points must not matter, and N may be 0.
        """


class PositionalEncoder(ABC):
    """Features of a pixel's position in the full frame, appended to the network's input (paper section 3.3, Eq. 3)."""

    name: ClassVar[str]
    version: ClassVar[str]

    @classmethod
    @abstractmethod
    def create(cls, rng: np.random.Generator) -> PositionalEncoder:
        """A new encoder with its random numbers drawn. Called once, at the start of a training."""

    @classmethod
    @abstractmethod
    def from_state(cls, state: dict[str, Any]) -> PositionalEncoder:
        """The encoder with that `state`. Called when weights are loaded; the state comes from their file."""

    @property
    @abstractmethod
    def state(self) -> dict[str, Any]:
        """What the weights' file must hold to rebuild the encoder: JSON-able finite numbers and lists."""

    @property
    @abstractmethod
    def channels(self) -> int:
        """Number of features of a pixel; 0 for none."""

    @abstractmethod
    def encode(self, u: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Features (channels, H, W) float32 at pixel coordinates u, v (H, W), in [0, 1] over the full square frame.

        A pixel's features depend on its own u and v only, so that a crop gets those of the frame.
        """


class EngineCache(Protocol):
    """Keeps what an engine prepares, from one process to the next. Entries may vanish at any time."""

    def get(self, key: str) -> bytes | None:
        """The content that was put under that key, unchanged; None if it is not there."""

    def put(self, key: str, content: bytes) -> None:
        """Keep the content under that key, if the disk allows it."""


class FinalLayers(Protocol):
    """The layers after a model that leaves out the last ones of its network: `z2p_core.network.final_convs`."""

    def padded(self, buffers: np.ndarray) -> np.ndarray:
        """Buffers (B, C, H, W) with the zero padding that the model expects."""

    def finish(self, cells: np.ndarray, buffers: np.ndarray) -> np.ndarray:
        """Images (B, 4, H, W) in [0, 1] from the model's output for padded buffers (B, C, H, W)."""


@dataclass(frozen=True)
class TrainedNetwork:
    """A trained network in the forms that engines take; `z2p_core.network.unet.build_network` defines it."""

    buffer_channels: int
    """C: channels of the z-buffer and the G-buffer together."""
    encoder_channels: int
    """E: channels of the positional encoder; 0 for none, then the model has no input ``encoding``."""
    settings: int
    """S: length of the settings vector."""
    onnx: bytes | None
    """ONNX model with inputs ``buffers``, ``encoding`` and ``settings`` for any batch, height and width, and one
    output: ``picture``; or ``cells``, where it leaves out the final layers (`FinalLayers`). None if there is no export
    beside the weights."""
    module: Callable[[], Any]
    """Makes the torch module in evaluation mode, float32, on the CPU. It imports torch: call it only where needed."""
    int8: bytes | None = None
    """ONNX model with the same inputs, whose inner convolutions are in 8 bits (QDQ); None if the weights have none."""
    shelf: EngineCache | None = None
    """Cache for what the engine prepares; None for no cache."""
    windows: bool = False
    """Whether it runs on crops, each of another size: then an engine should not prepare for one size."""


class Engine(ABC):
    """Runs the trained network with some library. Several threads may call `run` at once.

    z2p takes the engine that the user names; otherwise, of the installed engines that can run the weights and allow it
    (`unasked`), the one of lowest `rank`.
    """

    name: ClassVar[str]
    version: ClassVar[str]
    package: ClassVar[str]
    """The library's import name. Import it in `__init__` only: the plugin's module is imported to list engines."""
    rank: ClassVar[int]
    """Automatic selection prefers lower ranks."""
    reads_onnx: ClassVar[bool] = True
    """Whether it needs `TrainedNetwork.onnx`; False if it takes the torch module."""
    reads_int8: ClassVar[bool] = False
    """Whether it needs `TrainedNetwork.int8` instead."""
    exact: ClassVar[bool] = True
    """Whether its results are within 2/255 of torch's. If not, `z2p evaluate --engine` measures what it loses."""

    last: FinalLayers | None = None
    """What `draw` runs after the model, where that leaves out the final layers. z2p sets it."""

    @classmethod
    def unasked(cls) -> bool:
        """Whether automatic selection may pick this engine: exact ones, unless overridden."""
        return cls.exact

    @classmethod
    def installed(cls) -> bool:
        """Whether its library is installed; nothing is imported."""
        return importlib.util.find_spec(cls.package) is not None

    @abstractmethod
    def __init__(self, network: TrainedNetwork, threads: int | None = None) -> None:
        """Prepare to run that network on at most so many threads; None for as many as there are cores."""

    @abstractmethod
    def run(self, buffers: np.ndarray, encoding: np.ndarray, settings: np.ndarray) -> np.ndarray:
        """The model's output: usually images (B, 4, H, W) float32 in [0, 1], premultiplied sRGB and alpha.

        Args:
            buffers: (B, C, H, W) float32; H, W >= 32.
            encoding: (E, h, w) float32, at the centers of the network's pixel cells (sides rounded up).
            settings: (B, S) float32 in [0, 1].

        If `exact`, the result is within 2/255 of the torch network's at the 99.9th percentile. The inputs must not be
        changed, nor an array that was returned before.
        """

    def draw(self, buffers: np.ndarray, encoding: np.ndarray, settings: np.ndarray) -> np.ndarray:
        """The whole network's images (B, 4, H, W) for the inputs of `run`: the model, then the final layers."""
        if self.last is None:
            return self.run(buffers, encoding, settings)
        height, width = buffers.shape[2:]
        padded = self.last.padded(buffers)
        return self.last.finish(self.run(padded, encoding, settings), padded)[:, :, :height, :width]


class Sampler(ABC):
    """Samples points on the surface of a mesh, for training and evaluation."""

    name: ClassVar[str]
    version: ClassVar[str]
    packages: ClassVar[tuple[str, ...]] = ()
    """Distributions that shape the result, such as ``("open3d",)``: results are stale when their versions change."""

    @abstractmethod
    def sample(self, vertices: np.ndarray, faces: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
        """Exactly `count` points (count, 3) float64 on triangles.

        Args:
            vertices: (V, 3) float64; must not be changed.
            faces: (M, 3) int, indices of vertices; must not be changed.
        """


class Texture(ABC):
    """A solid texture: the color of every place in space, so that a mesh and the points on it can get the same colors.

    Evaluation and training give its colors to meshes, which Blender renders, and to the clouds sampled on them.
    """

    name: ClassVar[str]
    version: ClassVar[str]
    period: tuple[float, float] = (0.15, 0.4)
    """Shortest and longest period in world units (the object's radius is 1), between which `albedo` draws its own."""

    @abstractmethod
    def albedo(self, positions: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Base colors (N, 3) float32, linear and in [0, 1], at positions (N, 3) in the unit sphere.

        What is random about the texture comes from `rng` and is drawn in the same way for any positions: equal
        generators give the same texture, in which the color of a place does not depend on the other ones.
        """


@dataclass(frozen=True)
class Sensor:
    """Pose of the depth camera or scanner that took a cloud, in the file's axes."""

    position: np.ndarray
    """Position (3,) float64 in the file's units."""
    rotation: np.ndarray
    """Matrix (3, 3) float64 from the sensor's OpenCV axes (+X right, +Y down, +Z forward) to the file's axes."""


@dataclass(frozen=True)
class RawCloud:
    """One cloud as its file has it, and what the file says about it."""

    points: np.ndarray
    """(N, 3) float64, in the file's axes and units."""
    sensor: Sensor | None = None
    """The sensor's pose, if the file has it."""
    total: int | None = None
    """Number of points in the file, where `points` is only a subsample (`z2p_core.formats.row_subsampling`)."""
    note: str = ""
    """What the reader assumed or left out, in a few words, shown in the file's line."""
    up: str = ""
    """The file's axis that points up, such as ``-Y``, where its format or contents tell; empty if unknown."""
    up_reason: str = ""
    """Why, in a few words: ``the axes of COLMAP``."""
    up_certain: bool = True
    """False if the axis is only usual for such files, so that the cloud's shape may overrule it."""
    upward: np.ndarray | None = None
    """The direction (3,) that points up, if it is none of the file's axes; `up` is then the nearest axis."""
    seen_from: np.ndarray | None = None
    """A place (3,) from which the object was looked at, where the file, or one beside it, has camera poses."""
    fields: Mapping[str, np.ndarray] = field(default_factory=dict)
    """What else the file has of each point: rows as those of `points`, by the file's own names, of any numeric type.

    (N,) are scalars or, if they are integers, maybe labels. Two names have a meaning, whatever the file calls them:
    ``rgb`` (N, 3), floats: sRGB color in [0, 1], NaN where unknown (`z2p_core.formats.color_values` converts);
    ``normal`` (N, 3), floats: of any length, on either side. A reader gives what `Reader.wants`, and may give more.
    """
    field_names: Sequence[str] = ()
    """All names that `fields` could have, in the file's order, read or not; empty: those that it has."""
    class_names: Mapping[str, Mapping[int, str]] = field(default_factory=dict)
    """Of a field of labels, what some of its values stand for: ``{"classification": {2: "ground"}}``."""
    units: Mapping[str, str] = field(default_factory=dict)
    """Of a field, the unit of its values, where the file or its format says: ``{"gps_time": "s"}``."""
    color_kind: str = ""
    """What numbers the file has for ``rgb``, in a few words: ``16-bit``, ``spherical harmonics of degree 0``."""


MEMORY_A_POINT = 170
"""Peak memory, in bytes, of reading and placing one point: seven times x, y, z in float64."""
MEMORY_A_BYTE = MEMORY_A_POINT // 12
"""The same for each byte of a file of packed float32 coordinates."""
MEMORY_A_CHARACTER = 26
"""The same for each byte of text that is read whole and split into words."""


class Reader(ABC):
    """Reads one family of point-cloud files. Chosen by the file's suffix."""

    name: ClassVar[str]
    version: ClassVar[str]
    suffixes: ClassVar[tuple[str, ...]]
    """Suffixes of its files, lower-case, with the dot: ``(".las", ".laz")``."""
    packages: ClassVar[tuple[str, ...]] = ()
    """Distributions that shape the result, such as ``("open3d",)``: results are stale when their versions change."""
    columns: Sequence[str] | None = None
    """What the user says a text file's columns are: ``("x", "y", "z", "r", "g", "b")``. z2p sets it before `read`."""
    takes_columns: ClassVar[bool] = True
    """Whether it uses `columns`; if not, the file's line says that they were ignored."""
    wanted: Collection[str] | None = ("rgb",)
    """Names of the fields that z2p needs, None for all of the file's. z2p sets it before `read`."""
    max_rows: int = MAX_ROWS
    """How many points the picture can show: readers of large files keep so many, spread over the file. z2p sets it."""

    def memory(self, path: Path) -> int:
        """Rough peak memory, in bytes, of reading and placing the file. Called first: z2p refuses what does not fit.

        The default suits packed float32 coordinates; formats that are packed tighter should count their points.
        """
        return MEMORY_A_BYTE * path.stat().st_size

    def wants(self, name: str) -> bool:
        """Whether z2p needs the field of that name; capitals, spaces and the like make no difference."""
        return self.wanted is None or field_key(name) in {field_key(wanted) for wanted in self.wanted}

    def is_fragile(self, path: Path) -> bool:
        """Whether its library may crash the process on a damaged file of this kind.

        Then `read` runs in a process of its own, which takes 0.2 s longer; the class must be importable by its name.
        """
        return False

    @abstractmethod
    def read(self, path: Path) -> Sequence[RawCloud | np.ndarray]:
        """List of the clouds in the file: one for most formats, B for a batch.

        An array (N, 3) float64 stands for a `RawCloud` without further information. Keep rows that are not finite: the
        caller drops and counts them.

        Raises:
            ScanError: the file is not of this format, is damaged, or holds no points.
        """


class Timed:
    """Base of plugins whose steps are timed."""

    @property
    def seconds(self) -> dict[str, float]:
        """Step -> seconds so far, in the order in which the steps first ran; empty if none was timed."""
        seconds: dict[str, float] = self.__dict__.setdefault("_seconds", {})
        return seconds

    @contextmanager
    def timed(self, step: str) -> Iterator[None]:
        """Add the time that the ``with`` block takes to the seconds of a step."""
        started = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[step] = self.seconds.get(step, 0.0) + time.perf_counter() - started


class Baseline(ABC, Timed):
    """Reconstructs a mesh from a bare cloud, which Blender then renders: evaluation compares z2p with it."""

    name: ClassVar[str]
    version: ClassVar[str]
    packages: ClassVar[tuple[str, ...]] = ()
    """Distributions that shape the result, such as ``("open3d",)``: results are stale when their versions change."""
    for_view: ClassVar[bool] = False
    """Whether a mesh is only good for one viewpoint, so that every view needs its own."""

    @abstractmethod
    def reconstruct(self, cloud: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """Vertices (V, 3) float64 and triangles (M, 3) int, M >= 1, of a cloud (N, 3) float in world units.

        The cloud has no normals and no colors. The mesh lies where the cloud lies, in the unit sphere.

        Raises:
            ScanError: this cloud cannot be reconstructed; evaluation then counts an empty picture and goes on.
        """

    def reconstruct_for(
        self, cloud: np.ndarray, viewer: np.ndarray, rng: np.random.Generator
    ) -> tuple[np.ndarray, np.ndarray]:
        """The mesh to be seen from `viewer` (3,), in the cloud's axes. Override it if `for_view`."""
        return self.reconstruct(cloud, rng)

    def reconstruct_colored(
        self, cloud: np.ndarray, albedo: np.ndarray, viewer: np.ndarray, rng: np.random.Generator
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The mesh for `viewer` of a cloud whose points have linear base colors (N, 3), and those of its vertices.

        Override it where the colors help, or where a vertex belongs to one point: by default, each vertex of
        `reconstruct_for` gets the mean of the points around it, weighted by their inverse squared distance.

        Returns:
            Vertices (V, 3) float64, triangles (M, 3) int, and linear base colors (V, 3) float in [0, 1].
        """
        from z2p_core.meshes.vertex_colors import interpolate_colors  # late: only evaluation needs it

        vertices, faces = self.reconstruct_for(cloud, viewer, rng)
        return vertices, faces, interpolate_colors(vertices, cloud, albedo)


class Painter(ABC, Timed):
    """Draws a picture of a bare cloud by itself, without a mesh or Blender: evaluation compares z2p with it."""

    name: ClassVar[str]
    version: ClassVar[str]
    packages: ClassVar[tuple[str, ...]] = ()
    """Distributions that shape the result, such as ``("open3d",)``: results are stale when their versions change."""

    @abstractmethod
    def paint(self, cloud: np.ndarray, camera: Camera, scene: SceneDescription) -> np.ndarray:
        """Image (H, W, 4) float32 in [0, 1], straight sRGB RGBA, of a cloud (N, 3).

        `scene` has the light, the material and the floor; the cloud is already turned and lifted as it says.

        Raises:
            ScanError: this cloud cannot be drawn; evaluation then counts an empty picture and goes on.
        """

    def paint_colored(
        self, cloud: np.ndarray, albedo: np.ndarray, camera: Camera, scene: SceneDescription
    ) -> np.ndarray:
        """The image of a cloud whose points have linear base colors (N, 3), in place of the scene's material's.

        Override it to draw them: by default, the image is that in their mean color.
        """
        mean = albedo.mean(axis=0, dtype=np.float64) if len(albedo) else np.zeros(3)
        material = {**scene.material, "Base Color": (*mean.tolist(), 1.0)}
        return self.paint(cloud, camera, replace(scene, material=material))
