"""The configuration of ablations: variants change only their own keys; errors name variant and key."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from z2p_core.config import ConfigError, parse_config
from z2p_core.config.ablation import BASE, parse_ablations, with_meshes

BASE_TOML = """name = "small"
[render]
views = 3
[train]
steps = 4
[train.loss]
ssim = 0.5
"""
EXAMPLE = """
[variants.no-ssim]
title = "no SSIM"
why = "to see"
train.loss.ssim = 0.0
[variants.two]
title = "narrow and coarse"
why = "to see"
[variants.two.train.network]
widths = [8, 16]
unshuffle = 8
[variants.again]
title = "another seed"
why = "chance"
train.seed = 1
"""


def test_variant_is_the_base_with_its_changes() -> None:
    config = parse_ablations(BASE_TOML + EXAMPLE)
    assert config.base == parse_config(BASE_TOML) and config.name == "small"
    base, no_ssim, two, _ = config.variants
    assert (base.name, base.config, dict(base.changes)) == (BASE, config.base, {})
    loss = replace(config.base.train.loss, ssim=0.0)
    assert no_ssim.config == replace(config.base, train=replace(config.base.train, loss=loss))
    assert dict(no_ssim.changes) == {"loss.ssim": (0.5, 0.0)}
    assert dict(two.changes) == {"network.widths": ([48, 64, 96, 128], [8, 16]), "network.unshuffle": (4, 8)}
    assert (two.title, two.why, two.config.train.loss) == ("narrow and coarse", "to see", config.base.train.loss)
    assert [one.is_repeat for one in config.variants] == [False, False, False, True]


def test_meshes_are_those_of_all_variants() -> None:
    config = with_meshes(parse_ablations(BASE_TOML + EXAMPLE), "mine", "")
    assert {(one.config.meshes, one.config.evaluate_meshes) for one in config.variants} == {("mine", "")}
    assert config.base == config.variants[0].config


def test_shipped_ablations_cover_paper_and_network() -> None:
    path = Path(__file__).parents[3] / "configs" / "ablations.toml"
    variants = parse_ablations(path.read_text(encoding="utf-8"), str(path)).variants
    touched = {key for variant in variants for key in variant.changes}
    assert {"network.conditioning", "network.encoder", "network.gbuffer", "network.zbuffer", "network.unshuffle",
            "network.widths", "network.refine", "loss.ssim", "loss.masked", "reuse", "seed"} <= touched  # fmt: skip
    assert len({variant.title for variant in variants}) == len(variants)


LINES = 'title = "t"\nwhy = "w"\n'


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", r"expected one or more tables \[variants.NAME\]"),
        ("variants = 3", "expected one or more tables"),
        ("[variants", "a.toml: not valid TOML"),
        ("veiws = 3\n[variants.x]\n" + LINES, "a.toml: unknown key 'veiws'"),
        ("[variants]\nx = 3", "variants.x: expected a table, got 3"),
        ("[variants.base]\n" + LINES, "variants.base: expected a name .* other than 'base'"),
        ("[variants.'a/b']\n" + LINES, "variants.a/b: expected a name of letters"),
        ("[variants.x]\nwhy = 'w'", "variants.x: title: expected a line of text, got None"),
        ("[variants.x]\n" + LINES, r"variants.x: expected a value of train.\* that differs"),
        ("[variants.x]\n" + LINES + "train.loss.ssim = 0.2", r"variants.x: expected a value of train.\* that differs"),
        ("[variants.x]\n" + LINES + "train.loss.sim = 0", "x: train: loss: unknown key 'sim'; known: color_l2"),
        ("[variants.x]\n" + LINES + "train.loss = 0", "variants.x: train: loss: expected a table, got 0"),
        ("[variants.x]\n" + LINES + "train = 0", "variants.x: train: expected a table, got 0"),
        ("[variants.x]\n" + LINES + "loss.ssim = 0", "variants.x: unknown key 'loss'; known: title, why, train"),
        ("[variants.x]\n" + LINES + "evaluate.views = 9", "variants.x: unknown key 'evaluate'"),
        ("[variants.x]\n" + LINES + "train.seed = 'a'", "variants.x: train: seed: expected int, got 'a'"),
        ("[variants.x]\n" + LINES + "train.steps = 9", "variants.x: train.steps: expected the base's"),
    ],
)
def test_error_names_the_variant_and_key(text: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        parse_ablations(text, "a.toml")
