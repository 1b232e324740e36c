"""The pipeline's configuration: TOML to frozen dataclasses and back; errors name the key."""

from __future__ import annotations

import dataclasses
import json

import pytest

from z2p_core.config import (
    ConfigError,
    EvaluateConfig,
    NetworkConfig,
    PipelineConfig,
    from_dict,
    parse_config,
    samples_until,
    to_dict,
)

EXAMPLE = """
name = "tiny"
[render]
controls = ["color", "light", "coat"]
views = 3
upright = 1
[train.network]
widths = [16, 32]
kind = "adain_unet"
[train]
steps = 4
points = [100, 200]
"""


def test_missing_keys_keep_their_defaults() -> None:
    config = parse_config(EXAMPLE)
    assert config.name == "tiny"
    assert config.render.controls == ("color", "light", "coat")
    assert config.render.resolution == PipelineConfig().render.resolution
    assert config.train.network.widths == (16, 32)
    assert config.train.network.encoder == NetworkConfig().encoder
    assert config.train.points == (100, 200)
    assert config.evaluate == EvaluateConfig()
    assert parse_config("") == PipelineConfig()


def test_integer_is_accepted_as_a_float() -> None:
    upright = parse_config(EXAMPLE).render.upright
    assert upright == 1.0 and isinstance(upright, float)


@pytest.mark.parametrize("config", [PipelineConfig(), parse_config(EXAMPLE), NetworkConfig(widths=(8,))])
def test_to_dict_and_json_and_back(config: PipelineConfig | NetworkConfig) -> None:
    assert from_dict(type(config), json.loads(json.dumps(to_dict(config)))) == config


def test_none_survives() -> None:
    config = EvaluateConfig(elevation=None)
    assert from_dict(EvaluateConfig, json.loads(json.dumps(to_dict(config)))).elevation is None


def test_configs_are_frozen() -> None:
    with pytest.raises(dataclasses.FrozenInstanceError):
        PipelineConfig().name = "other"  # type: ignore[misc]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("views = 3", "tiny.toml: unknown key 'views'; known: name, meshes"),
        ("[render]\nveiws = 3", "render: unknown key 'veiws'; known: controls, views"),
        ("[train.network]\ndepth = 3", "train: network: unknown key 'depth'"),
        ("[render]\nviews = 'many'", "render: views: expected int, got 'many'"),
        ("[render]\nviews = 2.5", "render: views: expected int, got 2.5"),
        ("[render]\nviews = true", "render: views: expected int, got True"),
        ("[render]\ncontrols = 'color'", "render: controls: expected a list, got 'color'"),
        ("[render]\ncontrols = [1]", "render: controls: expected str, got 1"),
        ("render = 5", "render: expected a table, got 5"),
        ("[evaluate]\nelevation = 'high'", "evaluate: elevation: expected float, got 'high'"),
        ("[train]\npoints = [5]", "train: points: expected 2 values, got [5]"),
        ("[render", "tiny.toml: not valid TOML"),
    ],
)
def test_error_names_the_key(text: str, message: str) -> None:
    with pytest.raises(ConfigError) as caught:
        parse_config(text, "tiny.toml")
    assert message in str(caught.value)


def test_steps_at_larger_sides_count_for_fewer_samples() -> None:
    assert [samples_until(step, 8, (256,)) for step in (0, 1, 5)] == [0, 8, 40]
    assert [samples_until(step, 8, (256, 256, 256, 512)) for step in (1, 3, 4, 5, 5000)] == [8, 24, 26, 34, 32_500]
