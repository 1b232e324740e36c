"""Colors of every kind of number become sRGB from 0 to 1."""

from __future__ import annotations

import numpy as np
import pytest

from z2p_core.formats.color_values import srgb_from_numbers, srgb_from_packed, srgb_from_sh

SHARES = np.array([[0.0, 0.5, 1.0], [0.25, 1.0, 0.75]])


@pytest.mark.parametrize(("dtype", "scale", "kind"), [
    (np.uint8, 255, "8-bit"), (np.uint16, 255, "8-bit, in 16-bit integers"), (np.uint16, 65535, "16-bit"),
    (np.int64, 255, "8-bit"), (np.float32, 255, "8-bit"), (np.float64, 65535, "16-bit"), (np.float32, 1, "shares of 1"),
])  # fmt: skip
def test_each_kind_of_number_is_told_apart(dtype: type, scale: int, kind: str) -> None:
    srgb, found = srgb_from_numbers((SHARES * scale).astype(dtype))
    assert found == kind
    assert np.abs(srgb - SHARES).max() <= 1 / min(scale, 255) if scale > 1 else np.allclose(srgb, SHARES)


def test_alpha_is_left_out_and_unknown_colors_are_nan() -> None:
    colors = np.array([[0, 0, 255, 255], [np.nan, 1, 2, 255]])
    srgb, _ = srgb_from_numbers(colors)
    assert srgb[0].tolist() == [0, 0, 1] and np.isnan(srgb[1]).all()


@pytest.mark.parametrize("values", [[[-1, 0, 0]], [[70000, 0, 0]], [[np.nan, 0, 0]]])
def test_numbers_that_are_no_colors_have_no_kind(values: list[list[float]]) -> None:
    srgb, kind = srgb_from_numbers(np.array(values, dtype=np.float64))
    assert kind == "" and np.isnan(srgb).all()


def test_floats_that_round_beyond_their_range_are_clipped() -> None:
    srgb, kind = srgb_from_numbers(np.array([[1 + 1e-7, -1e-9, 0.5], [np.nan, 0, 0]]))
    assert kind == "shares of 1" and srgb[0].tolist() == [1, 0, 0.5] and np.isnan(srgb[1]).all()


def test_packed_floats_survive_double_precision() -> None:
    bits = np.array([0x00FF8000, 0xFF102030, 0x50102030, 0x7FC00000], dtype=np.uint32)
    wide = bits.view(np.float32).astype(np.float64)
    bytes_of_colors = 255 * srgb_from_packed(wide)
    assert bytes_of_colors[0].tolist() == [255, 128, 0]
    assert np.allclose(bytes_of_colors[1:3], [16, 32, 48])
    assert np.isnan(bytes_of_colors[3]).all()


@pytest.mark.parametrize("dtype", ["<f4", ">f4", "<u4", ">u4", "<i4", "f8", "i8"])
def test_packed_colors_of_any_type(dtype: str) -> None:
    bits = np.array([0x00FF8000, 0x00102030], dtype=np.uint32)
    kind = np.dtype(dtype)
    is_bit_pattern = kind.itemsize == 4
    packed = bits.view(np.float32).astype(kind) if kind.kind == "f" and is_bit_pattern else bits.astype(kind)
    assert np.allclose(srgb_from_packed(packed) * 255, [[255, 128, 0], [16, 32, 48]])


def test_spherical_harmonics_of_degree_zero_are_clipped() -> None:
    assert np.allclose(srgb_from_sh(np.array([[0.0, 10.0, -10.0]])), [[0.5, 1.0, 0.0]])
