"""Configs with one value changed."""

from dataclasses import replace

from z2p_core.config import PipelineConfig


def edited(config: PipelineConfig, path: str, value: object) -> PipelineConfig:
    """The config with the value at a dotted path replaced."""
    head, _, rest = path.partition(".")
    return replace(config, **{head: edited(getattr(config, head), rest, value) if rest else value})
