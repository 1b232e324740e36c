"""Colormaps by name, reversed, in bands, and what an unknown name's error says."""

from __future__ import annotations

import logging

import numpy as np
import pytest

from z2p_core.coloring.colormaps import COMMON_COLORMAPS, colormap_lut
from z2p_core.interfaces import SettingError


@pytest.mark.parametrize("name", [*COMMON_COLORMAPS, "crameri:batlow", "VIRIDIS", "cmc.vik", "cet_fire", "tab10_r"])
def test_tables_have_256_colors(name: str) -> None:
    lut = colormap_lut(name)
    assert lut.shape == (256, 3) and lut.dtype == np.float32
    assert lut.min() >= 0 and lut.max() <= 1


def test_viridis_is_matplotlibs() -> None:
    from matplotlib import colormaps

    np.testing.assert_allclose(colormap_lut("viridis"), colormaps["viridis"](np.arange(256))[:, :3], atol=1e-6)


def test_r_reverses_a_map() -> None:
    assert np.array_equal(colormap_lut("turbo_r"), colormap_lut("turbo")[::-1])


def test_maps_of_ten_colors_hold_ten_bands() -> None:
    lut = colormap_lut("tab10")
    assert 1 + (np.diff(lut, axis=0) != 0).any(axis=1).sum() == 10
    counts = np.unique(lut, axis=0, return_counts=True)[1]
    assert counts.min() >= 25 and counts.max() <= 26


@pytest.mark.parametrize("name", ["coolwarm", "fire", "RdBu", "rainbow", "ocean", "copper_r"])
def test_shared_names_raise_no_warning(name: str, caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.WARNING):
        colormap_lut.__globals__["_cached_lut"].cache_clear()
        colormap_lut(name)
    assert not caplog.records


@pytest.mark.parametrize(("name", "meant"), [("virdis", "viridis"), ("virdis_r", "viridis_r"), ("Batlwo", "batlow")])
def test_a_slip_is_told(name: str, meant: str) -> None:
    with pytest.raises(SettingError, match=rf"Did you mean {meant}\?"):
        colormap_lut(name)


@pytest.mark.parametrize("name", ["no such map", "", "_r", ":", "viridis_r_r", 5, None])
def test_unknown_names_list_common_ones(name: object) -> None:
    with pytest.raises(SettingError, match="viridis"):
        colormap_lut(name)  # type: ignore[arg-type]


def test_tables_cannot_be_changed() -> None:
    with pytest.raises(ValueError, match="read-only"):
        colormap_lut("viridis")[0] = 0
