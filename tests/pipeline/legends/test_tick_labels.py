"""Ticks are round, lie within the limits, and their texts tell them apart."""

from __future__ import annotations

import numpy as np
import pytest

from z2p_renderer.pipeline.legends.tick_labels import choose_ticks


@pytest.mark.parametrize(
    ("limits", "texts"),
    [
        ((0, 1), ["0.0", "0.2", "0.4", "0.6", "0.8", "1.0"]),
        ((-1.2, 1.3), ["−1.0", "−0.5", "0.0", "0.5", "1.0"]),
        ((0, 65535), ["0", "20000", "40000", "60000"]),
        ((0, 1e6), ["0", "2×10⁵", "4×10⁵", "6×10⁵", "8×10⁵", "10×10⁵"]),
        ((-3e-7, 1e-7), ["−3×10⁻⁷", "−2×10⁻⁷", "−1×10⁻⁷", "0", "1×10⁻⁷"]),
        ((1234567811.0, 1234567859.0), ["1234567820", "1234567830", "1234567840", "1234567850"]),
        ((5, 5), ["5"]), ((0, 0), ["0"]), ((1e9, 1e9), ["1000000000"]), ((-0.125, -0.125), ["−0.125"]),
        ((1.5e-9, 1.5e-9), ["1.5×10⁻⁹"]),
    ],
)  # fmt: skip
def test_texts_are_readable(limits: tuple[float, float], texts: list[str]) -> None:
    assert choose_ticks(*limits, 6)[1] == texts


@pytest.mark.parametrize("most", [0, 1, 2, 6])
def test_any_limits_have_ticks_within_them(most: int) -> None:
    rng = np.random.default_rng(most)
    for _ in range(300):
        middle, span = rng.normal() * 10.0 ** rng.uniform(-12, 12), 10.0 ** rng.uniform(-12, 12)
        low, high = middle - span, middle + span
        ticks, texts = choose_ticks(low, high, most)
        assert 1 <= len(ticks) <= max(most, 2) + 1
        assert all(low <= tick <= high for tick in ticks)
        assert sorted(set(ticks)) == ticks and len(set(texts)) == len(texts)


@pytest.mark.parametrize("limits", [(-1e308, 1e308), (0, 5e-324), (1e-310, 1e-300), (1e15, 1e15 + 0.125)])
def test_extreme_limits_have_ticks(limits: tuple[float, float]) -> None:
    ticks, texts = choose_ticks(*limits, 6)
    assert len(ticks) == len(texts) >= 1
