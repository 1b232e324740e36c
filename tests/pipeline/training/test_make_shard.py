"""A shard holds what was rendered, area-averaged in linear light, with the settings in the controls' order."""

import json

import numpy as np
import pytest
from PIL import Image

from z2p_core.config import ConfigError, ShardConfig
from z2p_core.scene import SceneDescription
from z2p_core.settings import settings_vector
from z2p_renderer.pipeline.rendering.views import load_controls
from z2p_renderer.pipeline.training.make_shard import make_shard, read_view
from z2p_renderer.storage.shards import Shard

VALUES = {"color": [0.1, 0.2, 0.3], "light": [3.0, 90.0, 50.0], "elevation": [40.0]}


@pytest.fixture
def controls():
    return load_controls(("color", "light", "elevation"))


@pytest.fixture
def renders(tmp_path):
    """Two chunk folders with three 4x4 views; view n is grey n*40 in its left half, and transparent white right."""
    for index, folder in enumerate(["b", "b", "a"]):
        place = tmp_path / folder
        place.mkdir(exist_ok=True)
        picture = np.zeros((4, 4, 4), np.uint8)
        picture[:, 1:] = (255, 255, 255, 0)
        picture[:, :1] = (index * 40, index * 40, index * 40, 255)
        stem = place / f"view_{index:05d}"
        Image.fromarray(picture).save(f"{stem}.png")
        Image.fromarray(picture[..., 3]).save(f"{stem}.coverage.png")
        scene = SceneDescription(elevation=40.0, lift=0.25).to_json()
        stem.with_suffix(".json").write_text(json.dumps({"scene": scene, "values": VALUES}))
    np.save(tmp_path / "pool.npy", np.ones((7, 3), np.float32))
    return tmp_path


def test_views_are_ordered_by_number_across_folders(renders, controls):
    folders = [renders / "a", renders / "b"]
    shard = Shard(make_shard(folders, renders / "pool.npy", ShardConfig(resolution=4), controls, renders / "out", "x"))
    assert [int(shard.read(row).rgba[0, 0, 0]) for row in range(len(shard))] == [0, 40, 80]
    record = shard.read(2)
    assert record.rgba.shape == (4, 4, 4) and record.coverage.tolist()[0] == [255, 0, 0, 0]
    scene = record.scene
    assert scene.elevation == 40.0 and scene.lift == 0.25 and np.allclose(scene.rotation, np.eye(3))
    assert shard.pool.shape == (7, 3)
    assert [control["name"] for control in shard.attributes["controls"]] == ["color", "light", "elevation"]


def test_downsampling_is_premultiplied(renders, controls):
    record = read_view(renders / "a" / "view_00002.json", 2, controls)
    assert record.rgba[0, 0].tolist() == [80, 80, 80, 128]
    assert record.rgba[0, 1, 3] == 0
    assert record.coverage.tolist() == [[128, 0], [128, 0]]


def test_a_resolution_that_does_not_divide_is_refused(renders, controls):
    with pytest.raises(ConfigError, match="divisor"):
        read_view(renders / "a" / "view_00002.json", 3, controls)


def test_no_views_is_an_error(renders, controls):
    (renders / "empty").mkdir()
    with pytest.raises(FileNotFoundError, match="found none"):
        make_shard([renders / "empty"], renders / "pool.npy", ShardConfig(), controls, renders / "out")


def test_settings_follow_the_order_of_the_controls(controls):
    vector = settings_vector(VALUES, controls)
    assert np.allclose(vector, [0.1, 0.2, 0.3, 0.0, 1.0, 0.5, 0.5])
    swapped = dict(reversed(controls.items()))
    assert np.allclose(settings_vector(VALUES, swapped), [0.5, 0.0, 1.0, 0.5, 0.1, 0.2, 0.3])
    assert vector.dtype == np.float32


def test_view_has_mirrored_settings(renders, controls):
    """Only the light, which comes from the other side there, knows left from right."""
    record = read_view(renders / "a" / "view_00002.json", 4, controls)
    assert np.allclose(record.settings, [0.1, 0.2, 0.3, 0.0, 1.0, 0.5, 0.5])
    assert np.allclose(record.mirrored_settings, [0.1, 0.2, 0.3, 0.0, 0.0, 0.5, 0.5])
