"""Settings for every test: property tests draw the same examples each time, and a busy machine fails none of them."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import settings

LAST = ("touch", "sharpen.leave")
"""Layers that go over a network's picture once more."""

BLENDER = ("workflows/", "pipeline/evaluation/", "pipeline/rendering/",
           "pipeline/test_shapes", "benchmarks/", "examples/test_coat_example")  # fmt: skip
"""Where slow tests run Blender, whose module there is not for every Python."""
LACKING = [name for name in ("bpy", "luigi") if find_spec(name) is None]
collect_ignore = ["workflows"] if "luigi" in LACKING else []

os.environ["Z2P_CACHE"] = ""  # nothing of the user's is touched
settings.register_profile("steady", deadline=None, derandomize=True, database=None)
settings.load_profile("steady")


def pytest_report_header() -> str | None:
    """What the summary of a run begins with."""
    return f"not tested, without {' and '.join(LACKING)}: the pipeline" if LACKING else None


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Tests that run Blender are skipped where there is none, and say so."""
    none = pytest.mark.skip(reason=f"bpy, which is Blender, is not installed for Python {sys.version.split()[0]}")
    for item in items:
        where = item.path.relative_to(Path(__file__).parent).as_posix()
        if "bpy" in LACKING and item.get_closest_marker("slow") and where.startswith(BLENDER):
            item.add_marker(none)


@pytest.fixture(scope="session")
def make_weights(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Path]:
    """Function that writes random weights for the given controls and network, and returns their file."""
    import torch

    from z2p_core import registry
    from z2p_core.config import NetworkConfig, to_dict
    from z2p_core.network.unet import build_network
    from z2p_renderer.storage.models.checkpoints import save_weights

    def make(
        controls: tuple[str, ...] = ("color", "light", "elevation"), fixed_elevation: float | None = None,
        cropped: bool = False, **network_shape: Any,
    ) -> Path:
        carried = [registry.load("controls", name)() for name in controls]
        config = NetworkConfig(**{"widths": (16, 16), "mapping": 16, **network_shape})
        zbuffer, gbuffer = registry.load("zbuffers", config.zbuffer), registry.load("gbuffers", config.gbuffer)
        encoder = registry.load("encoders", config.encoder).create(np.random.default_rng(0))
        torch.manual_seed(0)
        settings = sum(control.size for control in carried)
        network = build_network(config, zbuffer.channels + gbuffer.channels, encoder.channels, settings)
        with torch.no_grad():
            for name, parameter in network.named_parameters():
                # the last look at the picture sums over many pixels: as loud as the rest it would drown it
                parameter.copy_(torch.randn_like(parameter) * (0.02 if name.startswith(LAST) else 0.15))
        path = tmp_path_factory.mktemp("weights") / "tiny.safetensors"
        card = {
            "network": to_dict(config),
            "zbuffer": {"name": zbuffer.name, "version": zbuffer.version},
            "gbuffer": {"name": gbuffer.name, "version": gbuffer.version},
            "encoder": {"name": encoder.name, "version": type(encoder).version, "state": encoder.state},
            "controls": [{"name": one.name, "version": one.version, "size": one.size} for one in carried],
            "resolution": [64],
            "fixed_elevation": fixed_elevation,
            "training": {"cropped": cropped},
        }
        save_weights(path, network.state_dict(), card)
        return path

    return make
