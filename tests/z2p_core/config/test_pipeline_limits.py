"""Every value of every configuration has a limit, and what lies outside is refused with its key."""

import dataclasses
import math

import pytest

from z2p_core.config import ConfigError, PipelineConfig, from_dict, to_dict
from z2p_core.config.pipeline_limits import PIPELINE, check_limits, check_values
from z2p_core.config.report import ReportConfig, check_report
from z2p_core.config.report_limits import REPORT
from z2p_core.errors.value_limits import DataclassFields
from z2p_core.registry import PluginError

CONFIGS = ((PipelineConfig(), PIPELINE), (ReportConfig(), REPORT))
ABSURD = (None, True, -1, -0.5, 10**12, 10**400, 1e300, math.nan, math.inf, -math.inf, "x\0", "y" * 10_000, b"", (),
          ("a",) * 5, ((1, 2),), {}, 1j)  # fmt: skip
FREE = {
    "render.passes": [()], "train.resolutions": [()], "train.network.widths": [], "evaluate.elevation": [None],
    "evaluate.textures": [()], "render.textures": [()], "train.network.conditions": [()],
    "render.textured_share": [],
    "weights": [(), ("a",) * 5], "baselines": [()], "train.loss.masked": [True], "train.cropped": [True],
    "train.mirror": [True],
}  # fmt: skip
"""What of `ABSURD` is none for a field."""


def leaves(config, prefix=""):
    for field in dataclasses.fields(config):
        value = getattr(config, field.name)
        if dataclasses.is_dataclass(value):
            yield from leaves(value, f"{prefix}{field.name}.")
        else:
            yield prefix + field.name


def edited(config, path, value):
    head, _, rest = path.partition(".")
    return dataclasses.replace(config, **{head: edited(getattr(config, head), rest, value) if rest else value})


def tables(config, limits):
    yield type(config), set(limits), {field.name for field in dataclasses.fields(config)}
    for name, limit in limits.items():
        if isinstance(limit, DataclassFields):
            yield from tables(getattr(config, name), limit.limits)


@pytest.mark.parametrize("config, limits", CONFIGS, ids=["pipeline", "report"])
def test_every_field_has_a_limit_and_every_limit_a_field(config, limits):
    for kind, limited_fields, fields in tables(config, limits):
        assert limited_fields == fields, kind
    check_limits(config, limits)  # and the defaults are within


CASES = [(config, limits, path) for config, limits in CONFIGS for path in leaves(config)]


@pytest.mark.parametrize("config, limits, path", CASES, ids=[case[2] for case in CASES])
def test_absurd_values_are_refused_with_their_key(config, limits, path):
    for value in ABSURD:
        free = FREE.get(path, [()] if path.endswith(".levels") else [])
        if any(value == one and type(value) is type(one) for one in free):
            check_limits(edited(config, path, value), limits)
            continue
        with pytest.raises((ConfigError, PluginError)) as refused:
            check_limits(edited(config, path, value), limits)
        assert path in str(refused.value) and len(str(refused.value)) < 600


def test_textures_need_color_and_a_gbuffer_that_draws_them_and_no_teacher():
    textured = edited(PipelineConfig(), "render.textures", ("stripes",))
    check_values(textured)
    for path, value, words in [
        ("render.controls", ("light",), "expected color among"), ("train.network.gbuffer", "none", "draws textures"),
        ("train.teacher", "regular", "expected none with render.textures"),
    ]:  # fmt: skip
        with pytest.raises(ConfigError, match=words):
            check_values(edited(textured, path, value))


def test_inconsistent_values_are_refused():
    for path, value, words in [
        ("shard.resolution", 100, "divisor of render.resolution"), ("train.points", (500, 100), "smallest <= largest"),
        ("train.resolutions", (100,), "divisors"), ("train.network.unshuffle", 3, ""),
        ("train.network.widths", (4096,) * 10, "500,000,000 weights"),
        ("train.network.conditions", ("albedo",), "expected textures in render.textures"),
    ]:  # fmt: skip
        config = edited(PipelineConfig(), path, value)
        if words:
            with pytest.raises(ConfigError, match=words):
                check_values(config)
        else:
            check_values(config)
    loss = {name: 0.0 for name, value in to_dict(PipelineConfig().train.loss).items() if name != "masked"}
    with pytest.raises(ConfigError, match=r"train\.loss: expected a weight above 0"):
        check_values(from_dict(PipelineConfig, {"train": {"loss": loss}}))


def test_report_error_names_its_file():
    with pytest.raises(ConfigError, match=r"mine\.toml: noise\.levels\[1\]: expected a number from 0 to 10, got -1"):
        check_report(edited(ReportConfig(), "noise.levels", (0.0, -1.0)), "mine.toml")
