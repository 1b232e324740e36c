"""Configurations, their TOML texts and the limits of their values: of the pipeline, of ablations and of the report.

The pipeline's dataclasses and its functions are importable from here.
"""

from z2p_core.config.pipeline import (
    FINE_BLOCK,
    ConfigError,
    EvaluateConfig,
    LossConfig,
    NetworkConfig,
    PipelineConfig,
    RenderConfig,
    SampleConfig,
    ShardConfig,
    TrainConfig,
    batch_size,
    from_dict,
    parse_config,
    samples_until,
    to_dict,
    toml_tables,
    training_fault,
)

__all__ = [
    "FINE_BLOCK",
    "ConfigError",
    "EvaluateConfig",
    "LossConfig",
    "NetworkConfig",
    "PipelineConfig",
    "RenderConfig",
    "SampleConfig",
    "ShardConfig",
    "TrainConfig",
    "batch_size",
    "from_dict",
    "parse_config",
    "samples_until",
    "to_dict",
    "toml_tables",
    "training_fault",
]
