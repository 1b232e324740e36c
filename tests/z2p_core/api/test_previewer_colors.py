"""Previews of colored clouds: a color, scalar or label for each point, of a batch one entry for each cloud."""

from __future__ import annotations

import numpy as np
import pytest

import z2p_core
from z2p_core.api.render import RenderWarning

RNG = np.random.default_rng(0)
BATCH = RNG.normal(size=(2, 300, 3))


@pytest.fixture(scope="module")
def preview() -> z2p_core.Previewer:
    return z2p_core.Previewer(size=32)


def test_each_cloud_of_a_batch_has_its_colors(preview: z2p_core.Previewer) -> None:
    red, blue = np.tile([0.9, 0.1, 0.1], (300, 1)), np.tile([0.1, 0.1, 0.9], (300, 1))
    sheet = preview(BATCH, np.stack([red, blue])).astype(int)
    first, second = sheet[..., :32].sum(axis=(1, 2)), sheet[..., 32:].sum(axis=(1, 2))
    assert preview.error is None and first[0] > first[2] and second[2] > second[0]


def test_scalars_of_a_batch_have_one_scale(preview: z2p_core.Previewer) -> None:
    low, high = np.zeros(300), np.ones(300)
    sheet = preview(BATCH, [low, high])
    alone = z2p_core.render(BATCH[1], colors=high, clim=(0, 1), view=(30.0, 20.0), size=32, background="white").array
    assert np.array_equal(sheet[..., 32:], alone[..., :3].transpose(2, 0, 1))


def test_wrong_colors_become_a_notice(preview: z2p_core.Previewer) -> None:
    with pytest.warns(RenderWarning, match="expected colors for each of 2 clouds, got 1"):
        assert preview(BATCH, [np.zeros(300)]).shape == (3, 32, 32)
    with pytest.warns(RenderWarning, match="for each of the 300 points, got 20"):
        preview(BATCH[0], np.zeros(20))
