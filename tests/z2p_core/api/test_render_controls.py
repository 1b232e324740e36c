"""Keywords of `z2p_core.render` come from the installed controls, those of other packages included."""

from __future__ import annotations

import inspect
import json
from collections.abc import Callable
from importlib.metadata import EntryPoint
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import z2p_core
from z2p_core import registry

COAT = Path(__file__).parents[3] / "examples" / "plugins" / "z2p-coat"
CLOUD = np.random.default_rng(0).normal(size=(300, 3))


@pytest.fixture
def coated(monkeypatch: pytest.MonkeyPatch, make_weights: Callable[..., Path]) -> Path:
    """Weights that carry the example plugin's control, which is installed for this test only."""
    monkeypatch.syspath_prepend(COAT)
    installed_entries = registry._entries
    mine = {**installed_entries("controls"), "coat": (EntryPoint("coat", "z2p_coat:Coat", "z2p.controls"),)}
    monkeypatch.setattr(registry, "_entries", lambda group: mine if group == "controls" else installed_entries(group))
    return make_weights(("color", "coat"), gbuffer="none")


def test_a_plugins_control_is_a_keyword(coated: Path) -> None:
    bare, varnished = (z2p_core.render(CLOUD, coat=value, weights=coated, size=32) for value in (0.0, 0.5))
    assert (bare.record["controls"]["coat"], varnished.record["controls"]["coat"]) == ([0.0], [0.5])
    assert not np.array_equal(bare.array, varnished.array)
    assert np.array_equal(varnished.array, z2p_core.render(CLOUD, coat="0.5", weights=coated, size=32).array)
    assert z2p_core.render(CLOUD, coat=None, weights=coated, size=32).record["controls"]["coat"] == [0.0]


def test_the_control_checks_its_value(coated: Path) -> None:
    with pytest.raises(z2p_core.SettingError, match=r"^coat: coat is 2, expected 0 to 1"):
        z2p_core.render(CLOUD, coat=2, weights=coated, size=32)
    with pytest.raises(z2p_core.SettingError, match=r"^coat: expected coat as numbers, got 'thick'"):
        z2p_core.render(CLOUD, coat="thick", weights=coated, size=32)


def test_previews_batches_and_rerender_accept_the_control(coated: Path, tmp_path: Path) -> None:
    preview = z2p_core.Previewer(size=32, coat=0.5, weights=coated)
    preview(CLOUD)
    assert preview.error is None
    batch = z2p_core.render([CLOUD, 2 * CLOUD], coat=0.5, weights=coated, size=32)
    assert [picture.record["controls"]["coat"] for picture in batch] == [[0.5], [0.5]]
    np.save(tmp_path / "scan.npy", CLOUD)
    z2p_core.render(tmp_path / "scan.npy", coat=0.5, weights=coated, size=32).save(tmp_path / "scan.png")
    from z2p_renderer.pipeline.cli import main

    for options, coat in (((), 0.5), (("--coat", "0.25"), 0.25)):
        again = tmp_path / f"{coat}.png"
        done = CliRunner().invoke(main, ["rerender", str(tmp_path / "scan.png"), "-o", str(again), "--weights",
                                         str(coated), *options])  # fmt: skip
        assert done.exit_code == 0, done.output
        record = json.loads(CliRunner().invoke(main, ["info", "--json", str(again)]).output)
        assert record["controls"]["coat"] == [coat]


def test_weights_without_the_control_refuse_it(coated: Path, make_weights: Callable[..., Path]) -> None:
    with pytest.raises(z2p_core.SettingError, match="do not carry the control 'coat'"):
        z2p_core.render(CLOUD, coat=0.5, weights=make_weights(("color",), gbuffer="none"), size=32)
    with pytest.raises(z2p_core.SettingError, match="no weights that come with z2p carry coat"):
        z2p_core.render(CLOUD, coat=0.5, size=32)


def test_an_unknown_keyword_is_a_type_error() -> None:
    with pytest.raises(TypeError, match=r"unknown argument 'rougness' \(did you mean roughness\?\); expected points"):
        z2p_core.render(CLOUD, rougness=0.2)
    with pytest.raises(z2p_core.SettingError, match="'coat'"):
        z2p_core.render(CLOUD, coat=0.5)


def test_help_shows_every_installed_control() -> None:
    parameters = inspect.signature(z2p_core.render).parameters
    assert set(registry.names("controls")) <= set(parameters)
    for name in registry.names("controls"):
        assert parameters[name].kind is inspect.Parameter.KEYWORD_ONLY and parameters[name].default is None
        assert name in (z2p_core.render.__doc__ or "")
