"""Positional encoders: Eq. 3 by hand, and a state that survives JSON."""

import json

import numpy as np

from z2p_core.camera import Camera
from z2p_renderer.plugins.encoders.fourier import Fourier
from z2p_renderer.plugins.encoders.none import NoEncoder


def test_fourier_is_eq3():
    encoder = Fourier.create(np.random.default_rng(3))
    omega = encoder.state["omega"]
    assert len(omega) == 10 and len(set(omega)) == 10 and all(0 <= value <= 10 for value in omega)
    features = encoder.encode(np.array([[0.25, 0.5]], np.float32), np.array([[0.75, 1.0]], np.float32))
    assert features.shape == (40, 1, 2) == (encoder.channels, 1, 2) and features.dtype == np.float32
    for j, w in enumerate(omega):
        by_hand = [np.sin(w * 0.25), np.sin(w * 0.75), np.cos(w * 0.25), np.cos(w * 0.75)]
        np.testing.assert_allclose(features[[j, 10 + j, 20 + j, 30 + j], 0, 0], by_hand, atol=1e-5)


def test_state_survives_json_and_seeds_give_the_same_encoder():
    encoder = Fourier.create(np.random.default_rng(3))
    again = Fourier.from_state(json.loads(json.dumps(encoder.state)))
    u, v = Camera(20, 12).frame_coordinates()
    np.testing.assert_array_equal(again.encode(u, v), encoder.encode(u, v))
    assert Fourier.create(np.random.default_rng(3)).state == encoder.state
    assert Fourier.create(np.random.default_rng(4)).state != encoder.state


def test_none_has_no_channel():
    encoder = NoEncoder.from_state(NoEncoder.create(np.random.default_rng(0)).state)
    u, v = Camera(20, 12).frame_coordinates(4)
    assert encoder.encode(u, v).shape == (encoder.channels, *u.shape) == (0, 3, 5)
