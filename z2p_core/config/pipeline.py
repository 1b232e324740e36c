"""The pipeline's configuration: a frozen dataclass per stage, with the defaults of the `quick` pipeline.

TOML files in `configs/` override them.
"""

from __future__ import annotations

import dataclasses
import typing
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from z2p_core.errors.messages import UserError
from z2p_core.errors.value_limits import describe_value
from z2p_core.meshes.synthetic_noise import NOISE_KINDS

DENOISE_QUALITIES = ("off", "fast", "balanced", "high")
"""Values of `denoise`: OpenImageDenoise's quality, or none."""
RENDER_PASSES = ("depth", "normal", "shadow")
"""Extra passes that Blender can write."""
FINE_BLOCK = 2
"""Side of the pixel blocks on which `NetworkConfig.fine` convolutions work."""


class ConfigError(UserError):
    """A configuration that cannot be used; the message names the key, the expectation and the value."""


@dataclass(frozen=True)
class SampleConfig:
    """The pool of points sampled once on each mesh; training draws a new cloud from it for every sample."""

    sampler: str = "uniform"
    points: int = 50_000
    seed: int = 0


@dataclass(frozen=True)
class RenderConfig:
    """Cycles renders of each mesh."""

    controls: tuple[str, ...] = ("color", "light", "elevation")
    views: int = 6
    chunk: int = 10
    """Views per task."""
    resolution: int = 128
    samples: int = 4
    """Cycles samples per pixel. Noise averages out over the targets; the bias of denoising few samples does not."""
    denoise: str = "fast"
    """``off``, ``fast``, ``balanced`` or ``high``: OpenImageDenoise's quality."""
    bounces: int = 3
    upright: float = 0.5
    """Share of the views that rotate the mesh about +Z only; the others use any rotation."""
    passes: tuple[str, ...] = ()
    """Extra passes to keep: any of ``depth``, ``normal``, ``shadow``."""
    seed: int = 0
    textures: tuple[str, ...] = ()
    """Textures of which a random one gives a view's mesh its colors; none leaves all in the color of the controls."""
    textured_share: float = 0.7
    """Share of the views with a texture, where there are textures."""


@dataclass(frozen=True)
class ShardConfig:
    """HDF5 shards, one for each mesh."""

    resolution: int = 128
    """Side of the stored images, the largest that training can use: the render's, or a divisor of it."""


@dataclass(frozen=True)
class NetworkConfig:
    """Shape of the network; saved with the weights, and sufficient to rebuild it."""

    kind: str = "unshuffle_unet"
    """``unshuffle_unet`` (fast) or ``adain_unet`` (the paper's)."""
    widths: tuple[int, ...] = (48, 64, 96, 128)
    """Channels at each level, finest first."""
    unshuffle: int = 4
    """Side of the pixel blocks folded into channels before the first level; the paper's network has none (1)."""
    fine: int = 0
    """Channels of the fast network's convolutions on blocks of 2x2 pixels after the U-Net; 0 for none (the paper)."""
    refine: int = 16
    """Channels of its final convolutions on single pixels, which cost engines time; 0 for none (the paper)."""
    mapping: int = 512
    """Length of w, the mapped settings vector."""
    conditioning: str = "adain"
    """``adain``: the settings modulate features (paper Eq. 2); ``input``: they are constant channels of the input."""
    zbuffer: str = "splats"
    gbuffer: str = "surfels"
    """Features of the lit scene beside the z-buffer; ``none`` leaves light to the settings vector alone (the paper)."""
    encoder: str = "none"
    """``fourier`` encodes each pixel's position (paper section 3.3); unnecessary with a G-buffer."""
    conditions: tuple[str, ...] = ()
    """Pictures of a cloud's own colors that the network reads after the G-buffer, such as ``albedo``; none leaves
    these colors to demodulation alone."""

    @property
    def stride(self) -> int:
        """Image pixels along the side of one pixel of the coarsest level."""
        return self.unshuffle * 2 ** (len(self.widths) - 1)


@dataclass(frozen=True)
class LossConfig:
    """Weights of the loss terms (`z2p_core.quality.losses`); a term of weight 0 is not computed."""

    color_l2: float = 0.0
    magnitude_l1: float = 0.0
    alpha_l1: float = 1.0
    color_l1: float = 1.0
    ssim: float = 0.2
    gradient_l1: float = 0.5
    visible: float = 0.0
    """Visible differences: a simplified FLIP, in which small differences count more than in the colour terms."""
    flip: float = 0.0
    """FLIP itself, edges and points included, for every fourth image of a batch, as it is slow."""
    foreground: float = 1.0
    """Additional weight of colour errors on the object."""
    masked: bool = False
    """Colour terms on the object alone, as in the script of the paper's authors."""


@dataclass(frozen=True)
class TrainConfig:
    """One training run; `steps` and `batch` determine the number of samples."""

    network: NetworkConfig = field(default_factory=NetworkConfig)
    loss: LossConfig = field(default_factory=LossConfig)
    start: str = ""
    """Weights to fine-tune, a shipped name or a file; empty starts from random weights. They must have the same
    `network`, but may lack the last controls and conditions, and may have the G-buffer that this one refines."""
    teacher: str = ""
    """Weights to distil, a shipped name or a file; empty for none. They draw each cloud at the shards' resolution (with
    `mirror` also mirrored, and the mean is taken), downsampled to the training side if that is smaller."""
    teacher_share: float = 0.5
    """The teacher's share of the target on the object; the rest is the render."""
    haze: float = 0.0
    """Bias in alpha by which noise darkens faint shadows on the renders' floor; it is removed from the targets. 0.0025
    for 4 to 16 samples with fast denoising (`scripts/measure_shadow_bias.py`)."""
    resolutions: tuple[int, ...] = ()
    """Image sides trained at, alternating by step, each a divisor of the shards'; empty for theirs alone. Steps at
    larger sides take fewer samples, so that all steps cost the same. Buffers are drawn at each side, never resized."""
    steps: int = 150
    batch: int = 8
    """Samples per step at the smallest side."""
    learning_rate: float = 1e-3
    warmup: int = 50
    points: tuple[int, int] = (1_000, 20_000)
    """Fewest and most points of a cloud, log-uniform for each sample."""
    reuse: int = 1
    """Epochs for which a render keeps its cloud, as drawing buffers may take longer than a training step."""
    even: float = 0.0
    """Share of the clouds that are evenly spaced, as after a voxel filter; the others are random."""
    holes: float = 0.0
    """Share of the clouds with holes, as scans have them; the network learns to close them."""
    cropped: bool = False
    """Trains on crops around the clouds, about as tight as those that inference gives to the network."""
    mirror: bool = False
    """Mirrors a random half of the samples left to right, anew whenever their clouds are drawn."""
    noise: str = "none"
    """``none``, ``uniform`` or ``gaussian``."""
    noise_scale: float = 0.0
    """Largest noise amplitude, in units of the mesh's radius; each sample's is uniform from 0 to it."""
    average: float = 0.999
    """Decay of the exponential moving average of the weights, which is what is saved; 0 for none."""
    validate_every: int = 75
    validation_share: float = 0.05
    """Share of the shards' samples held out for validation."""
    checkpoint_every: int = 50
    seed: int = 0


@dataclass(frozen=True)
class EvaluateConfig:
    """How weights are measured."""

    views: int = 2
    points: int = 5_000
    noise: float = 0.0
    """Standard deviation of Gaussian noise, in units of the mesh's radius."""
    sampler: str = "uniform"
    resolution: int = 128
    samples: int = 16
    denoise: str = "high"
    bounces: int = 3
    supersample: int = 1
    """Factor by which the weights draw larger before their picture is downsampled to `resolution`."""
    elevation: float | None = 20.0
    """Camera elevation of every view in degrees; None samples it as in training."""
    seed: int = 0
    seeds: int = 1
    """Number of seeds, from `seed` on, each with its own views, clouds and noise."""
    textures: tuple[str, ...] = ()
    """Textures whose colors meshes and clouds have, one after the other; none leaves them in one color."""


@dataclass(frozen=True)
class PipelineConfig:
    """Everything that FullPipeline makes, from meshes to metrics."""

    name: str = "quick"
    meshes: str = "builtin"
    """A folder of meshes, or ``builtin`` for the shapes of `pipeline.shapes`."""
    evaluate_meshes: str = ""
    """A folder of meshes not used in training; empty for the built-in validation shapes, or the training meshes."""
    sample: SampleConfig = field(default_factory=SampleConfig)
    render: RenderConfig = field(default_factory=RenderConfig)
    shard: ShardConfig = field(default_factory=ShardConfig)
    train: TrainConfig = field(default_factory=TrainConfig)
    evaluate: EvaluateConfig = field(default_factory=EvaluateConfig)


def parse_config(text: str, source: str = "config") -> PipelineConfig:
    """PipelineConfig of a TOML text; missing keys keep their defaults.

    Raises:
        ConfigError: not TOML, an unknown key, or a value of the wrong type.
    """
    config: PipelineConfig = from_dict(PipelineConfig, toml_tables(text, source), source)
    return config


def toml_tables(text: str, source: str) -> dict[str, Any]:
    """The tables of a TOML text.

    Raises:
        ConfigError: not TOML, numbers of thousands of digits, or tables nested too deeply.
    """
    import tomllib  # late: inference reads no TOML

    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # TOML's own error is a ValueError
        raise ConfigError(f"{source}: not valid TOML: {error}") from error


def batch_size(side: int, batch: int, sides: Sequence[int]) -> int:
    """Samples of a training step at `side`, one of the alternating `sides`: fewer at larger ones, for equal cost."""
    return max(1, round(batch * (min(sides) / side) ** 2))


def samples_until(step: int, batch: int, sides: Sequence[int]) -> int:
    """Samples that a training has seen after `step` steps at alternating `sides`."""
    sizes = [batch_size(side, batch, sides) for side in sides]
    rounds, rest = divmod(step, len(sizes))
    return rounds * sum(sizes) + sum(sizes[:rest])


def training_fault(config: TrainConfig, resolution: int) -> str:
    """Error message for a training config on shards of that resolution; empty if it is valid."""
    for side in config.resolutions:
        if side < 1 or resolution % side:
            return f"resolutions: expected divisors of the shards' {resolution}, got {side}"
    low, high = config.points
    if not 1 <= low <= high:
        return f"points: expected 1 <= smallest <= largest cloud, got {low} and {high}"
    for name in ("steps", "batch", "reuse", "validate_every", "checkpoint_every"):
        if (number := getattr(config, name)) < 1:
            return f"{name}: expected 1 or more, got {number}"
    for name, what in (("even", "clouds"), ("holes", "clouds"), ("teacher_share", "target")):
        if not 0 <= (share := getattr(config, name)) <= 1:
            return f"{name}: expected a share from 0 to 1 of the {what}, got {share:g}"
    if config.noise not in NOISE_KINDS:
        return f"noise: expected one of {', '.join(NOISE_KINDS)}, got {config.noise!r}"
    return ""


def to_dict(config: Any) -> dict[str, Any]:
    """Nested dict of a config dataclass, tuples as lists: can be written as JSON and read back by `from_dict`."""
    return {field.name: _plain(getattr(config, field.name)) for field in dataclasses.fields(config)}


def from_dict(kind: type[Any], data: dict[str, Any], source: str = "config") -> Any:
    """Config dataclass `kind` from a nested dict.

    Raises:
        ConfigError: an unknown key, or a value of the wrong type.
    """
    hints = typing.get_type_hints(kind)
    unknown = sorted(set(data) - set(hints))
    if unknown:
        raise ConfigError(f"{source}: unknown key {describe_value(unknown[0])}; known: {', '.join(hints)}")
    return kind(**{key: _read(hints[key], value, f"{source}: {key}") for key, value in data.items()})


def _plain(value: Any) -> Any:
    if dataclasses.is_dataclass(value):
        return to_dict(value)
    return list(value) if isinstance(value, tuple) else value


def _read(hint: Any, value: Any, source: str) -> Any:
    if dataclasses.is_dataclass(hint):
        if not isinstance(value, dict):
            raise ConfigError(f"{source}: expected a table, got {describe_value(value)}")
        return from_dict(typing.cast(type[Any], hint), value, source)
    arguments = typing.get_args(hint)
    if typing.get_origin(hint) is tuple:
        if not isinstance(value, list):
            raise ConfigError(f"{source}: expected a list, got {describe_value(value)}")
        if Ellipsis not in arguments and len(value) != len(arguments):
            raise ConfigError(f"{source}: expected {len(arguments)} values, got {describe_value(value)}")
        return tuple(_read(arguments[0], item, source) for item in value)
    if type(None) in arguments:
        return None if value is None else _read(arguments[0], value, source)
    if (
        hint is float and type(value) is int and abs(value) < 2**1000
    ):  # larger integers do not fit and are refused below
        return float(value)
    if type(value) is not hint:
        raise ConfigError(f"{source}: expected {hint.__name__}, got {describe_value(value)}")
    return value
