"""Per-point colours in `z2p_core.render`: their mean is the object's colour."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import z2p_core
from z2p_core.api.render import RenderWarning


def test_each_cloud_of_a_batch_has_the_mean_of_its_own_colours(cloud: np.ndarray, tiny_weights: Path) -> None:
    small: dict[str, Any] = {"weights": tiny_weights, "size": 48}
    red, blue = np.tile((1.0, 0.0, 0.0), (len(cloud), 1)), np.tile((0.0, 0.0, 1.0), (len(cloud), 1))
    alone = [z2p_core.render(cloud, color=color, **small).array for color in ("red", "blue")]
    with pytest.warns(RenderWarning, match="their mean, #ff0000, #0000ff;"):
        together = z2p_core.render(np.stack([cloud, cloud]), colors=np.stack([red, blue]), **small)
    for part, own in zip(together.parts, alone, strict=True):
        assert np.array_equal(part.array, own)
    with pytest.warns(RenderWarning, match="their mean"):
        uneven = z2p_core.render([cloud, cloud[:900]], colors=[blue, red[:900]], **small)
    cut = z2p_core.render(cloud[:900], color="red", **small)
    assert np.array_equal(uneven.parts[1].array, cut.array)
    with pytest.warns(RenderWarning, match="their mean, #ff0000;"):
        shared = z2p_core.render([cloud, cloud], colors=red, **small)
    assert all(np.array_equal(part.array, alone[0]) for part in shared.parts)
