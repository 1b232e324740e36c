"""The last two convolutions without an engine match torch at any size."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from z2p_core.config import NetworkConfig
from z2p_core.network.final_convs import FinalConvs

torch = pytest.importorskip("torch")
CHANNELS = 5


def tensors(units: int, rng: np.random.Generator) -> dict[str, np.ndarray]:
    shapes = {"look.weight": (units, 4 + CHANNELS, 3, 3), "look.bias": (units,),
              "touch.weight": (4, units, 3, 3), "touch.bias": (4,)}  # fmt: skip
    return {name: (0.3 * rng.standard_normal(shape)).astype(np.float16) for name, shape in shapes.items()}


def by_torch(of: dict[str, np.ndarray], cells: np.ndarray, buffers: np.ndarray, cell: int) -> np.ndarray:
    weights = {name: torch.from_numpy(array.astype(np.float32)) for name, array in of.items()}
    picture = torch.nn.functional.pixel_shuffle(torch.from_numpy(cells), cell)
    seen = torch.cat([picture, torch.from_numpy(buffers)], dim=1)
    for name in ("look", "touch"):
        seen = torch.nn.functional.conv2d(seen, weights[f"{name}.weight"], weights[f"{name}.bias"], padding=1)
        seen = torch.relu(seen) if name == "look" else picture + seen
    drawn: np.ndarray = seen.clamp(0, 1).numpy()
    return drawn


@pytest.mark.parametrize(
    ("cell", "units", "width", "height"),
    [(4, 16, 96, 64), (4, 8, 4, 4), (2, 6, 94, 130), (3, 1, 189, 66), (1, 5, 97, 1), (4, 16, 484, 200), (5, 9, 95, 5)],
)
def test_final_convs_match_torch(cell: int, units: int, width: int, height: int) -> None:
    rng = np.random.default_rng(width)
    touch = FinalConvs.from_tensors(of := tensors(units, rng), NetworkConfig(unshuffle=cell, refine=units, widths=(8,)))
    cells = rng.random((2, 4 * cell**2, height // cell, width // cell), dtype=np.float32)
    buffers = rng.standard_normal((2, CHANNELS, height, width), dtype=np.float32)
    assert touch is not None
    np.testing.assert_allclose(touch.finish(cells, buffers), by_torch(of, cells, buffers, cell), atol=1e-5)


def test_one_core_and_two_give_the_same_rows() -> None:
    rng = np.random.default_rng(0)
    touch = FinalConvs.from_tensors(tensors(16, rng), NetworkConfig())
    cells = rng.random((1, 64, 40, 50), dtype=np.float32)
    buffers = rng.random((1, CHANNELS, 160, 200), dtype=np.float32)
    assert touch is not None
    drawn = touch.finish(cells, buffers)
    upper = touch.finish(cells[:, :, :15], buffers[:, :, :60])  # so few rows are drawn by one core
    assert np.array_equal(upper[:, :, :58], drawn[:, :, :58]) and not np.array_equal(upper[:, :, 59], drawn[:, :, 59])


@pytest.mark.parametrize(("width", "height", "wide", "high"), [(64, 32, 64, 32), (65, 31, 96, 32), (1, 33, 32, 64)])
def test_buffers_are_zero_padded_to_the_networks_stride(width: int, height: int, wide: int, high: int) -> None:
    rng = np.random.default_rng(0)
    touch = FinalConvs.from_tensors(tensors(4, rng), NetworkConfig(unshuffle=4, widths=(8, 8, 8, 8), refine=4))
    buffers = rng.random((2, CHANNELS, height, width), dtype=np.float32)
    assert touch is not None and touch.stride == 32
    padded = touch.padded(buffers)
    assert padded.shape == (2, CHANNELS, high, wide) and np.array_equal(padded[:, :, :height, :width], buffers)
    assert padded.sum() == pytest.approx(buffers.sum(), rel=1e-4)


@pytest.mark.parametrize("shape", [{"refine": 0}, {"kind": "adain_unet"}])
def test_networks_without_final_convolutions_give_none(shape: dict[str, Any]) -> None:
    assert FinalConvs.from_tensors({}, NetworkConfig(**shape)) is None


@pytest.mark.parametrize(
    ("cells", "buffers"),
    [((64, 8, 9), (CHANNELS, 32, 32)), ((16, 8, 8), (CHANNELS, 32, 32)), ((64, 8, 8), (CHANNELS - 1, 32, 32))],
)
def test_shapes_that_do_not_fit_are_refused(cells: tuple[int, ...], buffers: tuple[int, ...]) -> None:
    touch = FinalConvs.from_tensors(tensors(16, np.random.default_rng(0)), NetworkConfig())
    assert touch is not None
    with pytest.raises(ValueError, match="expected cells of 4 pixels a side"):
        touch.finish(np.zeros((1, *cells), np.float32), np.zeros((1, *buffers), np.float32))
