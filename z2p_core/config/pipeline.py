"""One frozen dataclass a stage; their defaults are the `quick` pipeline. TOML files in `configs/` override them."""

from __future__ import annotations

import dataclasses
import typing
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from z2p_core.errors.messages import UserError
from z2p_core.errors.value_limits import describe_value
from z2p_core.meshes.synthetic_noise import NOISE_KINDS

FINE_BLOCK = 2
"""Side of the pixel blocks in which the fast network goes over its picture."""


class ConfigError(UserError):
    """A configuration that cannot be used; the message names the key, what was expected and what came."""


@dataclass(frozen=True)
class SampleConfig:
    """Points drawn once from each mesh; training draws its fresh clouds from this pool."""

    sampler: str = "uniform"
    points: int = 50_000
    seed: int = 0


@dataclass(frozen=True)
class RenderConfig:
    """Cycles renders of each mesh."""

    controls: tuple[str, ...] = ("color", "light", "elevation")
    views: int = 6
    chunk: int = 10
    """Views rendered by one task."""
    resolution: int = 128
    samples: int = 4
    """Cycles samples a pixel. Noise averages out over the targets; what denoising few of them smears is learnt."""
    denoise: str = "fast"
    """``off``, ``fast``, ``balanced`` or ``high``: OpenImageDenoise's quality."""
    bounces: int = 3
    upright: float = 0.5
    """Share of the views that turn the mesh about +Z only; the others turn it any way."""
    passes: tuple[str, ...] = ()
    """Extra passes to keep: any of ``depth``, ``normal``, ``shadow``."""
    seed: int = 0


@dataclass(frozen=True)
class ShardConfig:
    """HDF5 shards, one for each mesh."""

    resolution: int = 128
    """Side of the stored pictures, the largest that training can use; the render's or a divisor of it."""


@dataclass(frozen=True)
class NetworkConfig:
    """Shape of the network; saved with the weights and enough to rebuild it."""

    kind: str = "unshuffle_unet"
    """``unshuffle_unet`` (fast) or ``adain_unet`` (the paper's)."""
    widths: tuple[int, ...] = (48, 64, 96, 128)
    """Channels at each level, finest first."""
    unshuffle: int = 4
    """Side of the pixel blocks folded into channels before the first level; the paper's network has none (1)."""
    fine: int = 0
    """Channels with which the fast network goes over its picture in blocks of 2x2 pixels; 0 for none (the paper)."""
    refine: int = 16
    """Channels with which it goes over single pixels after that, which takes engines longer; 0 for none (the paper)."""
    mapping: int = 512
    """Length of w, the mapped settings vector."""
    conditioning: str = "adain"
    """``adain``: the settings modulate features (paper Eq. 2); ``input``: they are constant channels of the input."""
    zbuffer: str = "splats"
    gbuffer: str = "surfels"
    """Rough features of the lit scene beside the z-buffer; ``none`` leaves light to the settings alone (the paper)."""
    encoder: str = "none"
    """``fourier`` tells where in the picture a pixel lies (paper section 3.3), which a G-buffer makes needless."""

    @property
    def stride(self) -> int:
        """Pixels of the picture along a side of one at the coarsest level."""
        return self.unshuffle * 2 ** (len(self.widths) - 1)


@dataclass(frozen=True)
class LossConfig:
    """Weights of the loss terms; a term of weight 0 is not computed."""

    color_l2: float = 0.0
    magnitude_l1: float = 0.0
    alpha_l1: float = 1.0
    color_l1: float = 1.0
    ssim: float = 0.2
    gradient_l1: float = 0.5
    visible: float = 0.0
    """Differences as an eye sees them, among which small ones count more than they do in the colour terms (FLIP)."""
    flip: float = 0.0
    """FLIP itself, edges and points included, of every fourth picture: it is slow."""
    foreground: float = 1.0
    """How much more colour errors weigh on the object than elsewhere."""
    masked: bool = False
    """Colour terms on the object alone, as the paper's authors' script does."""


@dataclass(frozen=True)
class TrainConfig:
    """One training run; `steps` and `batch` together say how many samples are seen."""

    network: NetworkConfig = field(default_factory=NetworkConfig)
    loss: LossConfig = field(default_factory=LossConfig)
    start: str = ""
    """Weights to fine-tune: a shipped name, or a file; empty begins at random. They must be of this very network, but
    may lack the last of the controls, and know a G-buffer that this one refines."""
    teacher: str = ""
    """Weights to learn from beside the renders, a shipped name or a file; empty for none. They draw each cloud at the
    shards' resolution, with `mirror` in a mirror as well, and the mean is shrunk to the side trained at, where that is
    smaller."""
    teacher_share: float = 0.5
    """Their share of the target that is learnt, where the object is; the rest is the render's."""
    haze: float = 0.0
    """By how much noise darkens faint shade on the renders' floor, in alpha, which is taken from what is learnt: 0.0025
    for 4 to 16 samples with fast denoising (`scripts/measure_haze.py`)."""
    resolutions: tuple[int, ...] = ()
    """Sides trained at, in turn step by step, each a divisor of the shards'; empty for theirs alone. A step at a larger
    side takes fewer samples, so that all steps cost the same. Clouds are drawn anew at each side, never resized."""
    steps: int = 150
    batch: int = 8
    """Samples a step at the smallest side."""
    learning_rate: float = 1e-3
    warmup: int = 50
    points: tuple[int, int] = (1_000, 20_000)
    """Smallest and largest cloud, drawn log-uniformly for each sample."""
    reuse: int = 1
    """Epochs for which a render keeps its cloud: drawing buffers may take longer than learning from them."""
    even: float = 0.0
    """Share of the clouds that are spread evenly, as voxel filters leave them; the others are random."""
    holes: float = 0.0
    """Share of the clouds that miss some patches, as scans do; the network learns to close them."""
    cropped: bool = False
    """Learnt from windows around the clouds, at least as narrow as what the weights are then given of a picture."""
    mirror: bool = False
    """Half of the samples have left and right exchanged, another half each time their clouds are drawn."""
    noise: str = "none"
    """``none``, ``uniform`` or ``gaussian``."""
    noise_scale: float = 0.0
    """Largest noise amplitude, in units of the mesh's radius; each sample draws its own up to it."""
    average: float = 0.999
    """Decay of the weights' exponential moving average, which is what ships; 0 for none."""
    validate_every: int = 75
    validation_share: float = 0.05
    """Share of the shards' samples kept from training for the learning curve."""
    checkpoint_every: int = 50
    seed: int = 0


@dataclass(frozen=True)
class EvaluateConfig:
    """How finished weights are measured."""

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
    """How much larger the weights draw before their picture is shrunk to the resolution."""
    elevation: float | None = 20.0
    """Camera elevation of every view in degrees; None draws it as training does."""
    seed: int = 0
    seeds: int = 1
    """How many seeds from `seed` on are measured, each with views, clouds and noise of its own."""


@dataclass(frozen=True)
class PipelineConfig:
    """Everything that FullPipeline makes, from meshes to metrics."""

    name: str = "quick"
    meshes: str = "builtin"
    """A folder of meshes, or ``builtin`` for shapes that the project makes itself."""
    evaluate_meshes: str = ""
    """A folder of meshes never trained on; empty for the built-in ones kept aside, or the training meshes."""
    sample: SampleConfig = field(default_factory=SampleConfig)
    render: RenderConfig = field(default_factory=RenderConfig)
    shard: ShardConfig = field(default_factory=ShardConfig)
    train: TrainConfig = field(default_factory=TrainConfig)
    evaluate: EvaluateConfig = field(default_factory=EvaluateConfig)


def parse_config(text: str, source: str = "config") -> PipelineConfig:
    """PipelineConfig of a TOML text; what it leaves out keeps the defaults.

    Raises:
        ConfigError: not TOML, an unknown key, or a value of the wrong type.
    """
    config: PipelineConfig = from_dict(PipelineConfig, toml_tables(text, source), source)
    return config


def toml_tables(text: str, source: str) -> dict[str, Any]:
    """The tables of a TOML text.

    Raises:
        ConfigError: not TOML, numbers of thousands of digits, or tables nested as no config is.
    """
    import tomllib  # late: pictures need none

    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # TOML's own error is a ValueError
        raise ConfigError(f"{source}: not valid TOML: {error}") from error


def batch_size(side: int, batch: int, sides: Sequence[int]) -> int:
    """Samples of a training step at one of the sides that take turns: fewer at larger ones, for as many pixels."""
    return max(1, round(batch * (min(sides) / side) ** 2))


def samples_until(step: int, batch: int, sides: Sequence[int]) -> int:
    """Samples that a training has seen after so many steps, at sides that take turns."""
    sizes = [batch_size(side, batch, sides) for side in sides]
    turns, more = divmod(step, len(sizes))
    return turns * sum(sizes) + sum(sizes[:more])


def training_fault(config: TrainConfig, resolution: int) -> str:
    """What cannot be about a training on shards of that resolution, in words; empty where all is well."""
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
    """Plain nested dict of any config dataclass, tuples as lists: JSON-able, and `from_dict` reads it back."""
    return {
        field.name: _plain(getattr(config, field.name)) for field in dataclasses.fields(config)
    }


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
    if hint is float and type(value) is int and abs(value) < 2**1000:  # what is larger is refused below
        return float(value)
    if type(value) is not hint:
        raise ConfigError(f"{source}: expected {hint.__name__}, got {describe_value(value)}")
    return value
