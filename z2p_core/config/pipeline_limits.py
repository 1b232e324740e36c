"""Limits of all values of the pipeline's configuration, checked when the plan is made, not hours later."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from z2p_core import registry
from z2p_core.config.pipeline import DENOISE_QUALITIES, RENDER_PASSES, ConfigError, PipelineConfig, training_fault
from z2p_core.errors.value_limits import (
    Boolean,
    Choice,
    Count,
    DataclassFields,
    Limit,
    LimitError,
    ListOf,
    Number,
    OrNone,
    Text,
    check_fields,
)
from z2p_core.meshes.synthetic_noise import NOISE_KINDS
from z2p_core.network.tensor_shapes import KINDS as NETWORKS
from z2p_core.network.tensor_shapes import SIZE_LIMITS, network_config_fault
from z2p_core.quality.metrics import SSIM_WINDOW

MIN_SIDE_PIXELS = SSIM_WINDOW
"""Structural similarity, which training and evaluation measure, is undefined for smaller images."""
MAX_SIDE_PIXELS = 8192
SEED_LIMIT = Count(0, 2**32 - 1)
SIDE_LIMIT = Count(MIN_SIDE_PIXELS, MAX_SIDE_PIXELS)
SAMPLES_LIMIT = Count(1, 65_536)
POINTS_LIMIT = Count(1, 20_000_000)
ELEVATION_LIMIT = Number(0, 89)
FOLDER_LIMIT = Text("a folder, as text without control characters")
NAME_LIMIT = Text("a plain folder name of up to 100 characters", r"[^./\\\x00-\x1f\x7f-][^/\\\x00-\x1f\x7f]*", 100)
_WEIGHT = Number(0, 1e6)


@dataclass(frozen=True)
class Plugin:
    """The name of an installed plugin of some groups, or one of the names `also`."""

    groups: tuple[str, ...]
    also: tuple[str, ...] = ()

    @property
    def known(self) -> list[str]:
        return [*(name for group in self.groups for name in registry.names(group)), *self.also]

    @property
    def expected(self) -> str:
        return f"an installed {self.groups[0][:-1]} ({', '.join(self.known) or 'there is none'})"

    def allows(self, value: Any) -> bool:
        return isinstance(value, str) and value in self.known


SAMPLE: dict[str, Limit | DataclassFields] = {
    "sampler": Plugin(("samplers",)),
    "points": POINTS_LIMIT,
    "seed": SEED_LIMIT,
}
RENDER: dict[str, Limit | DataclassFields] = {
    "controls": ListOf(Plugin(("controls",)), 1, 100, distinct=True),
    "views": Count(1, 100_000),
    "chunk": Count(1, 100_000),
    "resolution": SIDE_LIMIT,
    "samples": SAMPLES_LIMIT,
    "denoise": Choice(DENOISE_QUALITIES),
    "bounces": Count(0, 1024),
    "upright": Number(0, 1),
    "passes": ListOf(Choice(RENDER_PASSES), 0, len(RENDER_PASSES), distinct=True),
    "seed": SEED_LIMIT,
    "textures": ListOf(Plugin(("textures",)), 0, 100, distinct=True),
    "textured_share": Number(0, 1),
}
SHARD: dict[str, Limit | DataclassFields] = {"resolution": SIDE_LIMIT}
NETWORK: dict[str, Limit | DataclassFields] = {
    "kind": Choice(NETWORKS),
    **SIZE_LIMITS,
    "zbuffer": Plugin(("zbuffers",)),
    "gbuffer": Plugin(("gbuffers",)),
    "encoder": Plugin(("encoders",)),
    "conditions": ListOf(Plugin(("conditions",)), 0, 100, distinct=True),
}
LOSS: dict[str, Limit | DataclassFields] = {
    **dict.fromkeys(
        ("color_l2", "magnitude_l1", "alpha_l1", "color_l1", "ssim", "gradient_l1", "visible", "flip", "foreground"),
        _WEIGHT,
    ),
    "masked": Boolean(),
}
TRAIN: dict[str, Limit | DataclassFields] = {
    "network": DataclassFields(NETWORK),
    "loss": DataclassFields(LOSS),
    "start": Text("the name or file of weights"),
    "teacher": Text("the name or file of weights"),
    "teacher_share": Number(0, 1),
    "haze": Number(0, 1),
    "resolutions": ListOf(SIDE_LIMIT, 0, 1000),
    "steps": Count(1, 100_000_000),
    "batch": Count(1, 4096),
    "learning_rate": Number(1e-12, 10),
    "warmup": Count(0, 100_000_000),
    "points": ListOf(POINTS_LIMIT, 2, 2),
    "reuse": Count(1, 1_000_000),
    "even": Number(0, 1),
    "holes": Number(0, 1),
    "cropped": Boolean(),
    "mirror": Boolean(),
    "noise": Choice(NOISE_KINDS),
    "noise_scale": Number(0, 10),
    "average": Number(0, 1 - 1e-9),
    "validate_every": Count(1, 100_000_000),
    "validation_share": Number(0, 0.9),
    "checkpoint_every": Count(1, 100_000_000),
    "seed": SEED_LIMIT,
}
EVALUATE: dict[str, Limit | DataclassFields] = {
    "views": Count(1, 100_000),
    "points": POINTS_LIMIT,
    "noise": Number(0, 10),
    "sampler": Plugin(("samplers",)),
    "resolution": SIDE_LIMIT,
    "samples": SAMPLES_LIMIT,
    "denoise": Choice(DENOISE_QUALITIES),
    "bounces": Count(0, 1024),
    "supersample": Count(1, 8),
    "elevation": OrNone(ELEVATION_LIMIT),
    "seed": SEED_LIMIT,
    "seeds": Count(1, 10_000),
    "textures": ListOf(Plugin(("textures",)), 0, 100, distinct=True),
}
PIPELINE: dict[str, Limit | DataclassFields] = {
    "name": NAME_LIMIT,
    "meshes": FOLDER_LIMIT,
    "evaluate_meshes": FOLDER_LIMIT,
    "sample": DataclassFields(SAMPLE),
    "render": DataclassFields(RENDER),
    "shard": DataclassFields(SHARD),
    "train": DataclassFields(TRAIN),
    "evaluate": DataclassFields(EVALUATE),
}


def check_values(config: PipelineConfig) -> None:
    """Checks that each value of the config is within its limits, and that the values are consistent.

    Raises:
        ConfigError: a value is out of its limits, or contradicts others; the message names the key.
        PluginError: a plugin is not installed.
    """
    check_limits(config, PIPELINE)
    if config.render.resolution % config.shard.resolution:
        raise ConfigError(
            f"shard.resolution: expected a divisor of render.resolution ({config.render.resolution}), "
            f"got {config.shard.resolution}"
        )
    if config.render.textures and "color" not in config.render.controls:
        raise ConfigError("render.textures: expected color among render.controls, which textures take the place of, "
                          f"got {', '.join(config.render.controls)}")
    _check_textures_can_be_drawn(config)
    if fault := training_fault(config.train, config.shard.resolution):
        raise ConfigError(f"train.{fault}")
    terms = [name for name in LOSS if name not in ("foreground", "masked")]
    if not any(getattr(config.train.loss, name) for name in terms):
        raise ConfigError(f"train.loss: expected a weight above 0 for one of {', '.join(terms)}")
    if fault := network_config_fault(config.train.network):
        raise ConfigError(f"train.network.{fault}")


def _check_textures_can_be_drawn(config: PipelineConfig) -> None:
    """
    Raises:
        ConfigError: textures or conditions with a G-buffer that draws no textures, or conditions without textures.
        PluginError: the G-buffer fails to load.
    """
    network = config.train.network
    if network.conditions and not config.render.textures:
        raise ConfigError("train.network.conditions: expected textures in render.textures, from which the network "
                          f"learns what {', '.join(network.conditions)} shows, got none")
    if config.render.textures and config.train.teacher:
        raise ConfigError("train.teacher: expected none with render.textures, which teachers do not draw, got "
                          f"{config.train.teacher!r}")
    if config.render.textures and not registry.load("gbuffers", network.gbuffer).draws_textures:
        raise ConfigError("train.network.gbuffer: expected one that draws textures, for render.textures names some, "
                          f"got {network.gbuffer!r}")


def check_limits(config: Any, limits: dict[str, Limit | DataclassFields], prefix: str = "") -> None:
    """Checks that each value of a config dataclass is within its limits.

    Raises:
        ConfigError: a value is not; the message names the key.
        PluginError: a plugin is not installed.
    """
    try:
        check_fields(config, limits, prefix)
    except LimitError as error:
        raise (registry.PluginError if isinstance(error.limit, Plugin) else ConfigError)(str(error)) from None
