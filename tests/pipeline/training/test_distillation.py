"""Distillation: the target shares what finished weights draw of the same cloud at the shards' resolution."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from sphere_shards import sphere_shard

from z2p_core.config import NetworkConfig, TrainConfig
from z2p_renderer.pipeline.inference.loading import load_network
from z2p_renderer.pipeline.training.augment import mirror_record
from z2p_renderer.pipeline.training.dataset import CloudDataset, DatasetError
from z2p_renderer.pipeline.training.distillation import TeacherError
from z2p_renderer.pipeline.training.train import train
from z2p_renderer.plugins.gbuffers.surfels import Surfels
from z2p_renderer.plugins.zbuffers.splats import SplatPyramid
from z2p_renderer.storage.models.checkpoints import WeightsError, load_weights

CONFIG = TrainConfig(
    batch=4, resolutions=(32, 64), points=(300, 300), validation_share=0.2, reuse=2, mirror=True, teacher="regular"
)


@pytest.fixture(scope="module")
def shards(tmp_path_factory):
    folder = tmp_path_factory.mktemp("shards")
    return [sphere_shard(folder / f"{seed}.h5", 8, 64, seed) for seed in range(2)]


def pictures(shards, **fields):
    return CloudDataset(shards, replace(CONFIG, **fields), SplatPyramid(), Surfels())


@pytest.mark.slow
def test_target_blends_render_and_teacher(shards):
    render, half, distilled = (pictures(shards, teacher_share=share).batch(0).target for share in (0.0, 0.5, 1.0))
    torch.testing.assert_close(render, pictures(shards, teacher="").batch(0).target, atol=1e-6, rtol=0)
    torch.testing.assert_close(half, (render + distilled) / 2, atol=1e-6, rtol=0)
    assert (distilled - render).abs().mean() > 1e-3


def test_teacher_draws_the_same_cloud_larger_and_downsampled(shards, monkeypatch):
    clouds = []
    kept = Surfels.draw_into
    monkeypatch.setattr(Surfels, "draw_into", lambda self, *rest: (clouds.append(rest), kept(self, *rest))[1])
    data = pictures(shards, teacher_share=1.0, batch=1, mirror=False)
    batch = data.batch(0)
    (_, small, camera, _), (_, large, larger, scene) = clouds
    assert (camera.width, larger.width) == (32, 64)
    np.testing.assert_array_equal(small, large)

    loaded = load_network("regular")
    buffers = np.concatenate([loaded.zbuffer.draw(large, larger), loaded.gbuffer.draw(large, larger, scene)])
    with torch.no_grad():
        empty = torch.zeros(loaded.encoder.channels, 16, 16)
        drawn = loaded.network(torch.from_numpy(buffers)[None], empty, batch.settings)
    off = (batch.target[:, 3:] - torch.nn.functional.avg_pool2d(drawn[:, 3:], 2)).abs()
    assert off[batch.coverage > 0].mean() < 2 / 255  # a quicker engine, and bytes


def test_teacher_affects_object_pixels_alone(shards):
    distilled, render = (pictures(shards, teacher_share=1.0, teacher=name).batch(0) for name in ("regular", ""))
    floor = (render.coverage == 0).expand_as(render.target)
    assert torch.equal(distilled.target[floor], render.target[floor]) and floor.any()


def test_teacher_image_is_averaged_with_its_mirror_image(shards):
    """So a scene and its mirrored one have mirrored targets."""
    data = pictures(shards)
    rng = np.random.default_rng(0)
    record = data._record(data.training[0], 32)
    scene, cloud = replace(record.scene, floor=-1.0), rng.normal(size=(500, 3)).astype(np.float32) * 0.3
    one = data._teacher_image(data._teacher, cloud, scene, record, 32)
    turned = mirror_record(record)
    other = data._teacher_image(
        data._teacher, cloud * np.float32([-1, 1, 1]), replace(turned.scene, floor=-1.0), turned, 32
    )
    np.testing.assert_array_equal(one, other[:, ::-1])
    alone = data._teacher.picture(cloud, scene, record.settings, 32)
    assert np.abs(one / 255 - alone).max() > 1 / 255


def test_no_teacher_at_the_shards_own_resolution(shards):
    with_teacher, without = pictures(shards, teacher_share=1.0).batch(1), pictures(shards, teacher="").batch(1)
    assert with_teacher.target.shape[-1] == 64
    torch.testing.assert_close(with_teacher.target, without.target, atol=0, rtol=0)


@pytest.mark.slow
def test_a_batch_depends_on_its_number_alone(shards, monkeypatch):
    in_order = [batch for data in [pictures(shards)] for batch in map(data.batch, range(8))]
    monkeypatch.setattr("z2p_renderer.pipeline.training.dataset.BUFFER_CACHE_BYTES", 0)
    data = pictures(shards)
    for step in (6, 0, 4, 2):
        torch.testing.assert_close(data.batch(step).target, in_order[step].target, atol=0, rtol=0)


def test_validation_targets_are_renders_alone(shards):
    distilled, plain = (pictures(shards, teacher=name, teacher_share=1.0) for name in ("regular", ""))
    torch.testing.assert_close(
        distilled.validation_batch([0]).target, plain.validation_batch([0]).target, atol=0, rtol=0
    )


@pytest.mark.slow
def test_training_learns_from_the_teacher_and_its_card_names_it(shards, tmp_path):
    network = NetworkConfig(widths=(16, 24), mapping=16)
    config = replace(CONFIG, steps=2, resolutions=(32,), network=network)
    silent = lambda line: None  # noqa: E731
    alone = train(shards, replace(config, teacher=""), tmp_path / "alone", log=silent)
    distilled = train(shards, config, tmp_path / "distilled", log=silent)
    card = load_weights(distilled).card["training"]
    assert (card["teacher"], card["teacher_share"]) == ("regular", 0.5)
    assert load_weights(alone).digest != load_weights(distilled).digest


def test_weights_that_cannot_teach_are_refused(shards, tmp_path):
    with pytest.raises(DatasetError, match=r"teacher_share: expected a share from 0 to 1 of the target, got 1.5"):
        pictures(shards, teacher_share=1.5)
    with pytest.raises(WeightsError, match="unknown weights 'nobody'"):
        pictures(shards, teacher="nobody")
    with pytest.raises(TeacherError, match=r"teacher: expected weights whose controls are .*metallic"):
        pictures([sphere_shard(tmp_path / "metallic.h5", 2, 64, metallic=True)])
