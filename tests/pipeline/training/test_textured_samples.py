"""Training in colors of their own: through demodulation as inference applies it, from weights that lack conditions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from sphere_shards import CONTROLS, sphere_record

from z2p_core.config import TrainConfig, from_dict
from z2p_core.config.pipeline import NetworkConfig
from z2p_core.images import srgb_from_linear
from z2p_core.interfaces import PointColors
from z2p_core.shading.demodulation import apply_relative_radiance, radiance_factors
from z2p_core.shading.textured_light import neutral_albedo
from z2p_renderer.pipeline.inference.renderer import Renderer
from z2p_renderer.pipeline.rendering.textures import SeededTexture
from z2p_renderer.pipeline.training.augment import draw_training_cloud
from z2p_renderer.pipeline.training.dataset import CloudDataset, DatasetError
from z2p_renderer.pipeline.training.state import start_training
from z2p_renderer.pipeline.training.textured_samples import multiply_radiance
from z2p_renderer.pipeline.training.train import train
from z2p_renderer.plugins.gbuffers.none import NoGBuffer
from z2p_renderer.plugins.gbuffers.surfels import Surfels
from z2p_renderer.plugins.zbuffers.splats import SplatPyramid
from z2p_renderer.storage.models.checkpoints import load_weights
from z2p_renderer.storage.shards import write_shard

SIDE = 32
TEXTURE = {"name": "stripes", "seed": [3]}


@pytest.fixture(scope="module")
def shard(tmp_path_factory):
    """Four spheres, every other one with a texture by its own account."""
    rng = np.random.default_rng(0)
    pool = rng.normal(size=(2000, 3))
    pool = (0.8 * pool / np.linalg.norm(pool, axis=1, keepdims=True)).astype(np.float32)
    records = [replace(sphere_record(SIDE, rng), texture=texture) for texture in (None, TEXTURE) * 2]
    path = tmp_path_factory.mktemp("shards") / "spheres.h5"
    attributes = {"mesh": "spheres", "controls": CONTROLS, "resolution": SIDE, "textured": True}
    write_shard(path, records, pool, attributes)
    return path


def config_from(weights, **changes) -> TrainConfig:
    """A training that starts from weights and adds the condition."""
    network = replace(from_dict(NetworkConfig, load_weights(weights).card["network"]), conditions=("albedo",))
    base = TrainConfig(network=network, start=str(weights), batch=3, points=(200, 400), validation_share=0.25)
    return replace(base, **changes)


def test_training_multiplies_as_inference_does():
    rng = np.random.default_rng(0)
    image = rng.uniform(0, 1, (4, 20, 24)).astype(np.float32)
    image[3, :, 12:] = 1
    image[:3] *= image[3]
    relative = rng.uniform(0, 1.5, (4, 20, 24)).astype(np.float32)
    relative[3] = np.clip(relative[3] - 0.4, 0, 1)
    tensors = (torch.from_numpy(array)[None] for array in (image, radiance_factors(relative)))
    trained = multiply_radiance(*tensors)[0].numpy()
    apply_relative_radiance(image, relative[:3], relative[3])
    np.testing.assert_allclose(trained, image, atol=3e-3)


def test_textured_samples_are_in_their_neutral_color(shard, tiny_weights):
    data = CloudDataset([shard], config_from(tiny_weights), SplatPyramid(), Surfels())
    for place in data.training:
        record = data._record(place, SIDE)
        sample = data._sample(place, SIDE, np.random.default_rng(1))
        if record.texture is None:
            assert sample.factors is None and sample.record is record
            continue
        cloud = draw_training_cloud(data._pools[0], data.config, np.random.default_rng(1))
        neutral = neutral_albedo(SeededTexture("stripes", (3,)).albedo(cloud))
        np.testing.assert_allclose(sample.record.settings[:3], srgb_from_linear(neutral), atol=1e-4)
        np.testing.assert_allclose(sample.record.scene.material["Base Color"][:3], neutral, atol=1e-4)
        assert np.ptp(sample.factors) > 0.2


def test_new_conditions_have_no_effect_at_first(shard, tiny_weights):
    state = start_training([shard], config_from(tiny_weights), torch.device("cpu"), "float32")
    plain = replace(config_from(tiny_weights), network=replace(state.config.network, conditions=()))
    before = start_training([shard], plain, torch.device("cpu"), "float32")
    batch, without = state.data.batch(0), before.data.batch(0)
    assert batch.buffers.shape[1] == without.buffers.shape[1] + 3 and batch.factors is not None
    with torch.no_grad():
        drawn = state.network.eval()(batch.buffers, state.encodings[SIDE], batch.settings)
        expected = before.network.eval()(batch.buffers[:, :-3], before.encodings[SIDE], batch.settings)
    torch.testing.assert_close(drawn, expected, rtol=1e-4, atol=1e-4)


def test_trained_weights_record_their_conditions_and_draw(shard, tiny_weights, tmp_path):
    config = config_from(tiny_weights, steps=3, warmup=1, cropped=True, mirror=True, reuse=2, validate_every=3)
    weights = train([shard], config, tmp_path, threads=1, precision="float32")
    card = load_weights(weights).card
    assert card["conditions"] == [{"name": "albedo", "version": "1"}]
    renderer, cloud = Renderer(weights, engine="torch"), np.random.default_rng(0).normal(size=(300, 3))
    cloud = (0.8 * cloud / np.linalg.norm(cloud, axis=1, keepdims=True)).astype(np.float32)
    one_color = np.full((300, 3), 0.2, np.float32)
    plain = renderer.render(cloud, {"color": (0.48453, 0.48453, 0.48453)}, 64, 64)
    colored = renderer.render(cloud, None, 64, 64, colors=PointColors(cloud, one_color))
    assert plain[..., 3].max() > 0 and np.abs(plain.astype(int) - colored).max() <= 2


def test_textures_need_a_gbuffer_that_draws_them(shard, tiny_weights):
    with pytest.raises(DatasetError, match="draws textures"):
        CloudDataset([shard], config_from(tiny_weights), SplatPyramid(), NoGBuffer())
