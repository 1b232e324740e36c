"""The PNG encoder: other readers see the same pixels and texts, and the checksums are right."""

from __future__ import annotations

import io

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from z2p_renderer.storage.images.png import encode_png


@given(st.integers(1, 40), st.integers(1, 40), st.sampled_from([3, 4]), st.integers(0, 2**32 - 1))
def test_pixels_survive(height: int, width: int, channels: int, seed: int) -> None:
    picture = np.random.default_rng(seed).integers(0, 256, (height, width, channels), dtype=np.uint8)
    with Image.open(io.BytesIO(encode_png(picture, {}))) as read:
        assert read.mode == ("RGB" if channels == 3 else "RGBA") and read.size == (width, height)
        assert np.array_equal(np.asarray(read), picture)


def test_a_view_into_a_larger_array_is_encoded() -> None:
    picture = np.random.default_rng(0).integers(0, 256, (60, 80, 4), dtype=np.uint8)[5:50:2, 3:70]
    assert np.array_equal(np.asarray(Image.open(io.BytesIO(encode_png(picture, {})))), picture)


def test_texts_survive_and_checksums_are_right() -> None:
    content = encode_png(np.zeros((3, 5, 4), np.uint8), {"z2p": '{"a": 1}', "Title": "x"})
    with Image.open(io.BytesIO(content)) as read:
        read.verify()  # checks every chunk's sum
        assert read.info == {"z2p": '{"a": 1}', "Title": "x"}
    damaged = bytearray(content)
    damaged[60] ^= 1
    with pytest.raises((OSError, SyntaxError)), Image.open(io.BytesIO(damaged)) as read:
        read.verify()


def test_shaded_pictures_are_compressed() -> None:
    ramp = np.arange(256, dtype=np.uint8)
    picture = np.stack(np.broadcast_arrays(ramp, ramp[:, None], np.uint8(7), np.uint8(255)), axis=-1)
    assert len(encode_png(picture, {})) < picture.nbytes / 20
