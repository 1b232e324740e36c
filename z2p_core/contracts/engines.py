"""Checks of `Engine` plugins: an engine computes what the torch network computes, whatever the image's size."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np

from z2p_core.contracts.assertions import check_array, check_class, expect, same
from z2p_core.interfaces import Engine, TrainedNetwork

SIZES = ((64, 64), (97, 61), (33, 130), (128, 96), (256, 256))
"""Sizes of the images that an engine is tried with: portrait and landscape, multiples of the stride and others."""
EXACT_TOLERANCE = 2 / 255
"""Largest difference from torch that an exact engine may have, at the `EXACT_QUANTILE` of all values."""
EXACT_QUANTILE = 0.999
INEXACT_TOLERANCE = 24 / 255
"""Largest mean difference from torch that another engine may have with random weights. It is largest on processors
without VNNI, where sums of 8-bit products saturate; trained weights come nearer, and an evaluation measures them."""

Inputs = tuple[np.ndarray, np.ndarray, np.ndarray]


def check_engine(engine_class: type[Engine], network: TrainedNetwork, cell: int) -> None:
    """None when the class keeps what `Engine` promises on a network whose pixel blocks have sides of `cell`.

    Raises:
        AssertionError: it does not; the message says what was expected and what came.
    """
    check_class("engines", engine_class, Engine)
    expect(engine_class.installed(), f"{engine_class.name}: its library {engine_class.package} is not installed")
    name, engine = engine_class.name, engine_class(network, threads=1)
    rng = np.random.default_rng(0)
    for batch, (width, height) in enumerate(SIZES, start=1):
        inputs = _inputs(network, cell, batch % 3 + 1, width, height, rng)
        given = tuple(array.copy() for array in inputs)
        picture = engine.run(*inputs)
        what = f"{name}: {batch % 3 + 1} pictures of {width} x {height}"
        check_array(picture, (batch % 3 + 1, 4, height, width), np.float32, what)
        expect(bool(picture.min() >= 0 and picture.max() <= 1), f"{what}: expected values in [0, 1]")
        kept = picture.copy()
        same(engine.run(*inputs), kept, f"{what}: drawn twice")
        same(picture, kept, f"{what}: the picture given first, after another run")
        for array, before in zip(inputs, given, strict=True):
            same(array, before, f"{what}: its inputs afterwards")
        off = np.abs(picture - _reference(network, inputs))
        far, most = off.mean(), INEXACT_TOLERANCE
        if engine_class.exact:
            far, most = np.quantile(off, EXACT_QUANTILE), EXACT_TOLERANCE
        expect(far <= most, f"{what}: expected torch's within {most:.4f}, got {far:.4f} off")
    _check_threads(engine, [_inputs(network, cell, 1, *size, rng) for size in SIZES[:4]])


def _check_threads(engine: Engine, tried: list[Inputs]) -> None:
    alone = [engine.run(*inputs) for inputs in tried]
    with ThreadPoolExecutor(len(tried)) as pool:
        together = list(pool.map(lambda inputs: engine.run(*inputs), tried * 3))
    for picture, expected in zip(together, alone * 3, strict=True):
        same(picture, expected, f"{engine.name}: run by several threads at once")


def _inputs(
    network: TrainedNetwork, cell: int, batch: int, width: int, height: int, rng: np.random.Generator
) -> Inputs:
    shapes = (
        (batch, network.buffer_channels, height, width),
        (network.encoder_channels, -(-height // cell), -(-width // cell)),
        (batch, network.settings),
    )
    buffers, encoding, settings = (rng.random(shape, dtype=np.float32) for shape in shapes)
    buffers *= rng.random((batch, 1, height, width), dtype=np.float32) < 0.3  # mostly background, as clouds are
    return buffers, encoding, settings


def _reference(network: TrainedNetwork, inputs: Inputs) -> np.ndarray:
    import torch

    with torch.inference_mode():
        picture: np.ndarray = network.module()(*map(torch.from_numpy, inputs)).numpy()
    return picture
