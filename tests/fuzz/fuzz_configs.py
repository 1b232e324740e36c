"""Configs of pipelines, reports and ablations with odd values: refused when they are planned, or sound throughout."""

from __future__ import annotations

import json
import math
import tomllib
from collections.abc import Callable, Iterator
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from changed_bytes import changed as changed_bytes
from changed_values import DEEP, LONG, ODD, RAW, changed
from PIL import ImageColor

from z2p_core import registry
from z2p_core.config import ConfigError, NetworkConfig, PipelineConfig, parse_config, to_dict
from z2p_core.config.ablation import parse_ablations
from z2p_core.config.report import parse_report
from z2p_core.interfaces import ScanError, SettingError
from z2p_core.registry import PluginError
from z2p_renderer.workflows.ablation.plan import make_ablation_plan
from z2p_renderer.workflows.plan import make_plan
from z2p_renderer.workflows.report.plan import make_report_plan

KINDS = ("pipeline",) * 5 + ("ablations", "ablations", "report")
CONFIGS = Path(__file__).parents[2] / "configs"
MOST_PARAMETERS = 3e9
"""Of a network; what has more is a slip."""

Fits = Callable[[Any], bool]


def number(low: float, high: float) -> Fits:
    """Whether a value is a number from low to high."""
    return lambda value: math.isfinite(value) and low <= value <= high


COUNT, SEED, SHARE, WEIGHT, SIDE = number(1, 1e10), number(0, 2**64), number(0, 1), number(0, 1e9), number(1, 65536)
FITS: dict[str, Fits] = {
    "sample.points": COUNT, "sample.seed": SEED,
    "render.views": COUNT, "render.chunk": COUNT, "render.resolution": SIDE, "render.samples": COUNT,
    "render.bounces": number(0, 1e6), "render.upright": SHARE, "render.seed": SEED, "shard.resolution": SIDE,
    "train.network.unshuffle": SIDE, "train.network.fine": number(0, 1e5), "train.network.refine": number(0, 1e5),
    "train.network.mapping": number(1, 1e6),
    **{f"train.loss.{name}": WEIGHT for name in ("color_l2", "magnitude_l1", "alpha_l1", "color_l1", "ssim",
    "gradient_l1",
                                                 "visible", "flip", "foreground")},
    "train.teacher_share": SHARE, "train.haze": SHARE, "train.steps": COUNT, "train.batch": COUNT,
    "train.learning_rate": number(1e-300, 100), "train.warmup": number(0, 1e10), "train.reuse": COUNT,
    "train.even": SHARE,
    "train.holes": SHARE, "train.noise_scale": number(0, 100), "train.average": number(0, 1),
    "train.validate_every": COUNT, "train.validation_share": SHARE, "train.checkpoint_every": COUNT, "train.seed": SEED,
    "evaluate.views": COUNT, "evaluate.points": COUNT, "evaluate.noise": number(0, 100), "evaluate.resolution": SIDE,
    "evaluate.samples": COUNT, "evaluate.bounces": number(0, 1e6), "evaluate.supersample": number(1, 8),
    "evaluate.seed": SEED, "evaluate.seeds": COUNT,
}  # fmt: skip
"""Dotted key of a pipeline's config -> whether a value can be."""
LEVELS: dict[str, Fits] = {
    "base": number(-math.inf, math.inf), "noise": number(0, 100), "density": COUNT, "inner": number(0, 1),
    "scale": number(1e-6, 1e3),
    "lift": number(0, 100), "light": number(-360, 360), "turning": number(-1e6, 1e6), "sheet": number(0, 100),
    "scene": number(1, 1e4), "bumps": number(0, 1e6), "gap": number(0, 100),
    "single": lambda level: level in ("clean", "noise", "holes"), "color": lambda level: bool(ImageColor.getrgb(level)),
    "sampling": lambda level: level == "non-uniform" or level in registry.names("samplers"),
    "texture": lambda level: level == "none" or level in registry.names("textures"),
    "material": lambda level: len(parts := level.split(",")) == 2 and all(0 <= float(part) <= 1 for part in parts),
}  # fmt: skip
"""Sweep of a report -> whether a level can be."""


def make(rng: np.random.Generator, folder: Path) -> None:
    """A TOML file, in which a few values are others."""
    kind = str(rng.choice(KINDS))
    tree = json.loads(json.dumps(_base(kind)))
    if rng.random() < 0.6:
        _replace_one(tree, rng)
    else:
        tree = changed(tree, rng)
    text = toml_text(tree if isinstance(tree, dict) else {"name": tree}).encode()
    (folder / f"{kind}.toml").write_bytes(changed_bytes(text, rng) if rng.random() < 0.08 else text)


def check(folder: Path) -> str:
    """What came of it."""
    (path,) = folder.iterdir()
    kind = path.stem
    try:
        text = path.read_text(encoding="utf-8")
    except UnicodeDecodeError:
        return "no text"
    try:
        match kind:
            case "pipeline":
                _check_pipeline(make_plan(parse_config(text)).config)
            case "report":
                _check_report(make_report_plan(parse_report(text)).config)
            case _:
                for variant in make_ablation_plan(parse_ablations(text)).config.variants:
                    _check_pipeline(variant.config)
    except (ConfigError, SettingError, ScanError, PluginError) as error:
        assert "\n" not in str(error) and len(str(error)) < 2500, f"a message that is no line: {str(error)[:300]!r}"
        return f"{kind} refused"
    return f"{kind} planned"


def toml_text(tree: dict[str, Any]) -> str:
    """The tree as TOML; what has no form there is left out, or stands as a text."""
    return "".join(f"{json.dumps(str(key))} = {_toml(value)}\n" for key, value in tree.items() if value is not None)


def _toml(value: Any) -> str:
    if isinstance(value, dict):
        return (
            "{"
            + ", ".join(f"{json.dumps(str(key))} = {_toml(one)}" for key, one in value.items() if one is not None)
            + "}"
        )
    if isinstance(value, list):
        return "[" + ", ".join(_toml(one) for one in value if one is not None) + "]"
    if isinstance(value, float) and not math.isfinite(value):
        return "nan" if math.isnan(value) else "inf" if value > 0 else "-inf"
    if isinstance(value, str) and value in (DEEP, LONG):
        return RAW[value]
    if isinstance(value, str):
        return json.dumps(value.encode("utf-8", errors="replace").decode()).replace("\x7f", "\\u007f")
    return repr(value).lower() if not isinstance(value, int) or isinstance(value, bool) else str(value)


@lru_cache(maxsize=4)
def _base(kind: str) -> dict[str, Any]:
    """A config of that kind with all its keys."""
    if kind == "pipeline":
        return dict(to_dict(PipelineConfig()))
    tree = tomllib.loads((CONFIGS / f"{kind}.toml").read_text())
    if kind == "report":
        return {
            **tree,
            "views": 1,
            "seed": 0,
            "time_repeats": 3,
            "trust_draws": 8,
            "weights": ["regular"],
            "meshes": "builtin",
        }
    tree["variants"] = dict(list(tree["variants"].items())[:3])
    return tree


def _replace_one(tree: dict[str, Any], rng: np.random.Generator) -> None:
    """Put an odd value, or one of another magnitude, in place of one of the leaves."""
    leaves = list(_leaves(tree))
    holder, key = leaves[rng.integers(len(leaves))]
    old = holder[key]
    if isinstance(old, int | float) and not isinstance(old, bool) and rng.random() < 0.5:
        with_sign = [
            0,
            -1,
            1,
            3,
            -old,
            old * 7,
            old * 10**6,
            old + 1,
            10**12,
            2**31,
            0.3,
            1.5,
            -0.5,
            math.nan,
            math.inf,
        ]
        holder[key] = with_sign[rng.integers(len(with_sign))]
        if type(old) is int and rng.random() < 0.5 and math.isfinite(holder[key]):
            holder[key] = int(holder[key])
        return
    holder[key] = ODD[rng.integers(len(ODD))]


def _leaves(tree: Any) -> Iterator[tuple[Any, Any]]:
    for key, value in tree.items() if isinstance(tree, dict) else enumerate(tree):
        if isinstance(value, dict | list) and value:
            yield from _leaves(value)
        else:
            yield tree, key


def _check_pipeline(config: PipelineConfig) -> None:
    """A plan that is made can be carried out, as far as values tell."""
    tree = to_dict(config)
    for key, fits in FITS.items():
        value: Any = tree
        for part in key.split("."):
            value = value[part]
        assert fits(value), f"planned with {key} = {value!r}"
    elevation = tree["evaluate"]["elevation"]
    assert elevation is None or -90 <= elevation <= 90, f"planned with evaluate.elevation = {elevation!r}"
    assert all(number(1, 1e6)(width) for width in config.train.network.widths), config.train.network
    assert all(number(1, 1e10)(count) for count in config.train.points), config.train.points
    assert len(set(config.render.passes)) == len(config.render.passes), config.render.passes
    loss = tree["train"]["loss"]
    assert any(loss[name] > 0 for name in loss if name not in ("foreground", "masked")), (
        f"planned without a loss: {loss}"
    )
    _check_network(config.train.network, config.shard.resolution)


def _check_network(config: NetworkConfig, side: int) -> None:
    """The network can be built, and takes a picture of that side; nothing is reckoned."""
    import torch

    from z2p_core.network.unet import build_network

    with torch.device("meta"):
        network = build_network(config, 5, 0, 7)
        assert sum(tensor.numel() for tensor in network.parameters()) < MOST_PARAMETERS, f"planned with {config}"
        cells = -(-side // config.unshuffle)
        network(torch.zeros(1, 5, side, side), torch.zeros(0, cells, cells), torch.zeros(1, 7))


def _check_report(config: Any) -> None:
    for key, fits in {"views": COUNT, "points": COUNT, "resolution": number(32, 65536), "samples": COUNT, "seed": SEED,
                      "time_repeats": COUNT, "trust_draws": number(0, 1e6), "trust_meshes": number(0,
                      1e9)}.items():  # fmt: skip
        assert fits(getattr(config, key)), f"planned with {key} = {getattr(config, key)!r}"
    for name, sweep in config.sweeps().items():
        assert sweep.meshes >= 0, f"planned with {name}.meshes = {sweep.meshes}"
        for level in sweep.levels:
            assert LEVELS[name](level), f"planned with a level {level!r} of {name}"
