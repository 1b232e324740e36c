"""Shipping: a finished run's weights become a small set of files that engines draw from."""

from __future__ import annotations

import importlib.util
import json
import shutil
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import pytest

from z2p_core.config import EvaluateConfig, to_dict
from z2p_core.quality.metrics import METRIC_NAMES
from z2p_renderer.pipeline.inference.renderer import Renderer
from z2p_renderer.storage.models.checkpoints import load_weights, save_weights

ROOT = Path(__file__).parents[2]
TRAINING = {"steps": 5, "batch": 2, "renders": 3, "meshes": 1, "start": ""}


@pytest.fixture
def ship(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    spec = importlib.util.spec_from_file_location("ship_weights", ROOT / "scripts" / "ship_weights.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    monkeypatch.setattr(module, "SHIPPED_FOLDER", tmp_path / "shipped")
    (tmp_path / "shipped").mkdir()
    return module


@pytest.fixture
def run(tmp_path: Path, make_weights: Callable[..., Path]) -> Path:
    weights = load_weights(make_weights())
    folder = tmp_path / "runs" / "tiny"
    save_weights(folder / "weights.safetensors", weights.tensors, {**weights.card, "training": TRAINING})
    figures = dict.fromkeys(METRIC_NAMES, 1.0)
    metrics = {"settings": {"config": to_dict(EvaluateConfig(views=1, points=300, resolution=64))},
               "means": figures, "spread": figures, "meshes": {"one": figures}}  # fmt: skip
    (folder / "metrics.json").write_text(json.dumps(metrics))
    return folder


def test_without_meshes_the_float32_form_ships_alone(ship: ModuleType, run: Path) -> None:
    ship.main(run, "tiny", None, None)
    assert {file.name for file in ship.SHIPPED_FOLDER.iterdir()} == {"tiny.safetensors", "tiny.graph", "tiny.md"}
    assert Renderer(ship.SHIPPED_FOLDER / "tiny.safetensors").engine == "onnxruntime"
    ship.main(run, "tiny", None, None)  # again, over what is there
    assert "Measured" in (ship.SHIPPED_FOLDER / "tiny.md").read_text()


@pytest.mark.slow
@pytest.mark.parametrize("worse", [0.0, 0.5])
def test_eight_bits_ship_where_they_are_good_enough(
    ship: ModuleType, run: Path, monkeypatch: pytest.MonkeyPatch, worse: float
) -> None:
    def measured(weights: Path, config: EvaluateConfig, meshes: Path, truth: Path, engine: str) -> dict[str, float]:
        assert Renderer(weights, engine=engine).engine == engine and config.points == 300
        return {name: 1 - worse * (engine == "onnxruntime-int8") for name in METRIC_NAMES}

    monkeypatch.setattr(ship, "measure", measured)
    ship.main(run, "tiny", run, None)
    assert (ship.SHIPPED_FOLDER / "tiny.int8.graph").exists() is (worse == 0)
    assert ("| onnxruntime-int8 |" in (ship.SHIPPED_FOLDER / "tiny.md").read_text()) is (worse == 0)


def test_exceeding_the_size_limit_is_an_error(ship: ModuleType, run: Path) -> None:
    shutil.copy(run / "weights.safetensors", ship.SHIPPED_FOLDER / "large.safetensors")
    with (ship.SHIPPED_FOLDER / "large.safetensors").open("ab") as file:
        file.truncate(40_000_001)
    with pytest.raises(SystemExit, match="tiny does not fit"):
        ship.main(run, "tiny", None, None)
