"""Checks of `PositionalEncoder` plugins."""

from __future__ import annotations

import json

import numpy as np

from z2p_core.camera import Camera
from z2p_core.contracts.assertions import check_array, check_class, expect, plain_json, same
from z2p_core.interfaces import PositionalEncoder


def check_encoder(encoder_class: type[PositionalEncoder]) -> None:
    """None when the class keeps what `PositionalEncoder` promises: its saved state rebuilds it, pixel by pixel.

    Raises:
        AssertionError: it does not; the message says what was expected and what came.
    """
    check_class("encoders", encoder_class, PositionalEncoder)
    name = encoder_class.name
    encoder = encoder_class.create(np.random.default_rng(0))
    u, v = Camera(48, 32).frame_coordinates()
    encoding = encoder.encode(u, v)
    check_array(encoding, (encoder.channels, *u.shape), np.float32, f"{name}: encode")
    same(encoder.encode(u, v), encoding, f"{name}: the same pixels encoded twice")
    twin = encoder_class.create(np.random.default_rng(0))
    expect(twin.state == encoder.state, f"{name}: create gives another state for the same rng")
    rebuilt = encoder_class.from_state(json.loads(plain_json(encoder.state, f"{name}: state")))
    same(rebuilt.encode(u, v), encoding, f"{name}: rebuilt from its state, encode")
    crop = (slice(5, 20), slice(7, 30))
    same(encoder.encode(u[crop], v[crop]), encoding[:, *crop], f"{name}: a crop, which must keep the frame's values")
