"""Training batches: fresh clouds, the same for the same seed and step, whatever happened before."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from sphere_shards import CONTROLS, sphere_record, sphere_shard

from z2p_core.camera import Camera
from z2p_core.config import TrainConfig
from z2p_core.shading.channels import RADIANCE_RGB, GBufferChannel
from z2p_renderer.pipeline.training.augment import draw_training_cloud
from z2p_renderer.pipeline.training.dataset import CloudDataset, DatasetError
from z2p_renderer.plugins.gbuffers.surfels import Surfels
from z2p_renderer.plugins.zbuffers.paper import PaperZBuffer
from z2p_renderer.storage.shards import ShardError, write_shard

CONFIG = TrainConfig(batch=4, points=(100, 400), validation_share=0.2)


@pytest.fixture(scope="module")
def shards(tmp_path_factory):
    folder = tmp_path_factory.mktemp("shards")
    return [sphere_shard(folder / f"{seed}.h5", 8, 32, seed) for seed in range(2)]


def pictures(shards, config=CONFIG):
    return CloudDataset(shards, config, PaperZBuffer(), Surfels())


def assert_equal(first, second):
    for name in ("buffers", "settings", "target", "coverage"):
        torch.testing.assert_close(getattr(first, name), getattr(second, name), rtol=0, atol=0)


def test_shapes_types_and_premultiplied_targets(shards):
    batch = pictures(shards).batch(0)
    assert batch.buffers.shape == (4, 11, 32, 32) and batch.settings.shape == (4, 7)
    assert batch.target.shape == (4, 4, 32, 32) and batch.coverage.shape == (4, 1, 32, 32)
    assert all(tensor.dtype == torch.float32 for tensor in vars(batch).values() if tensor is not None)
    assert batch.target.min() >= 0 and batch.target.max() <= 1 and batch.buffers[:, 0].max() > 0.1
    assert (batch.target[:, :3] <= batch.target[:, 3:]).all()


def test_zbuffer_lies_over_the_target(shards):
    batch = pictures(shards, replace(CONFIG, points=(4000, 4000))).batch(0)
    drawn, seen = batch.buffers[:, 0] > 0, batch.target[:, 3] > 0
    assert (drawn & seen).sum() == seen.sum()  # the splats also cover a rim of two pixels around it
    assert drawn.sum() < 2.5 * seen.sum()


@pytest.mark.parametrize("reuse", [1, 3])
def test_a_batch_depends_on_its_number_alone(shards, reuse, monkeypatch):
    config = replace(CONFIG, reuse=reuse)
    in_order, out_of_order = pictures(shards, config), pictures(shards, config)
    monkeypatch.setattr("z2p_renderer.pipeline.training.dataset.RECORD_CACHE_BYTES", 0)
    monkeypatch.setattr("z2p_renderer.pipeline.training.dataset.BUFFER_CACHE_BYTES", 0)
    no_cache = pictures(shards, config)
    batches = [in_order.batch(step) for step in range(6)]
    for step in (5, 0, 3):
        assert_equal(out_of_order.batch(step), batches[step])
        assert_equal(no_cache.batch(step), batches[step])
    with in_order.batches(2, 6) as ahead:
        for step, batch in enumerate(ahead, start=2):
            assert_equal(batch, batches[step])
        assert step == 5
    assert not torch.equal(pictures(shards, replace(config, seed=1)).batch(0).buffers, batches[0].buffers)


def test_each_record_appears_once_per_epoch_with_a_new_cloud(shards):
    data = pictures(shards, replace(CONFIG, batch=13))  # 16 records, 3 held out
    assert len(data.validation) == 3 and len(data.training) == 13
    assert not set(data.validation) & set(data.training)
    first, second = data.batch(0), data.batch(1)
    rows = [{tuple(row.tolist()) for row in batch.settings} for batch in (first, second)]
    assert rows[0] == rows[1] and len(rows[0]) == 13
    assert not torch.equal(first.settings, second.settings)
    match = [int((second.settings == row).all(1).nonzero()) for row in first.settings]
    assert not any(torch.equal(first.buffers[i], second.buffers[j]) for i, j in enumerate(match))


def test_a_render_keeps_its_cloud_for_the_epochs_it_is_reused(shards):
    data = pictures(shards, replace(CONFIG, batch=13, reuse=2))
    first, second, third = (data.batch(step) for step in range(3))
    for other, kept in ((second, True), (third, False)):
        match = [int((other.settings == row).all(1).nonzero()) for row in first.settings]
        assert all(torch.equal(first.buffers[i], other.buffers[j]) == kept for i, j in enumerate(match))


def test_repeated_sides_share_their_epochs(shards):
    """Of three turns at a side each has the records that the turns before have left, with clouds of their own."""
    data = pictures(shards, replace(CONFIG, batch=5, resolutions=(16, 16, 32)))
    batches = [data.batch(step) for step in (0, 1, 3, 4)]  # 13 records are an epoch of the smaller side
    seen = [tuple(row.tolist()) for batch in batches for row in batch.settings]
    assert len(set(seen[:13])) == 13 and set(seen[13:]) <= set(seen[:13])
    buffers = torch.cat([batch.buffers for batch in batches])
    first = seen.index(seen[13])
    assert not torch.equal(buffers[13], buffers[first])  # an epoch later the cloud is another one
    assert [len(data.batch(step).settings) for step in (0, 1, 2)] == [5, 5, 1]


def test_validation_data_are_fixed(shards):
    assert_equal(pictures(shards).validation_batch([0, 2]), pictures(shards).validation_batch([0, 2]))
    np.testing.assert_array_equal(
        pictures(shards).validation_batch([2]).buffers[0], pictures(shards).validation_batch([0, 2]).buffers[1]
    )


def test_prefetching_threads_end_and_pass_on_errors(shards):
    import threading

    data = pictures(shards)
    with pytest.raises(KeyboardInterrupt), data.batches(0, 100) as ahead:
        next(ahead)
        raise KeyboardInterrupt
    assert not [thread for thread in threading.enumerate() if thread.name.startswith("batches")]
    data._record_cache.clear()
    data.training = [(0, 99)] * len(data.training)
    with pytest.raises(IndexError), data.batches(0, 3) as ahead:
        next(ahead)


def test_cloud_sizes_are_log_uniform_and_noise_is_in_range():
    pool = np.random.default_rng(0).random((2000, 3), dtype=np.float32)
    before = pool.copy()
    sizes = []
    for seed in range(200):
        cloud = draw_training_cloud(pool, replace(CONFIG, points=(100, 10_000)), np.random.default_rng(seed))
        assert len(np.unique(cloud, axis=0)) == len(cloud) and cloud.dtype == np.float32
        sizes.append(len(cloud))
    assert min(sizes) >= 100 and max(sizes) <= 2000
    assert abs(np.mean(np.array(sizes) < np.sqrt(100 * 2000)) - 0.5) < 0.1

    for noise, bound in (("uniform", 0.1), ("gaussian", 0.6)):
        config = replace(CONFIG, points=(2000, 2000), noise=noise, noise_scale=0.1)
        shifts = []
        for seed in range(20):
            clean = draw_training_cloud(pool, replace(config, noise="none"), np.random.default_rng(seed))
            shifts.append(np.abs(draw_training_cloud(pool, config, np.random.default_rng(seed)) - clean).max())
        assert min(shifts) > 0 and max(shifts) <= bound + 1e-6 and np.std(shifts) > 0.01
    np.testing.assert_array_equal(pool, before)


def test_rotation_and_lift_are_applied(tmp_path):
    record = sphere_record(32, np.random.default_rng(0))
    pool = np.random.default_rng(0).uniform(-0.5, 0.5, (300, 3)).astype(np.float32)
    records = [replace(record, scene=replace(record.scene, lift=0.3))] * 3
    attributes = {"mesh": "a", "controls": CONTROLS, "resolution": 32}
    write_shard(tmp_path / "a.h5", records, pool, attributes)
    batch = pictures([tmp_path / "a.h5"], replace(CONFIG, points=(300, 300), batch=1)).batch(0)
    turned = pool @ np.array(record.scene.rotation, np.float32).T
    world, camera = turned + np.array([0, 0, 0.3], np.float32), Camera(32, 32, record.scene.elevation)
    np.testing.assert_allclose(batch.buffers[0, 0].numpy(), PaperZBuffer().draw(world, camera)[0], rtol=1e-4)
    resting = replace(record.scene, floor=float(turned[:, 2].min()))  # the floor does not rise with the object
    np.testing.assert_allclose(batch.buffers[0, 1:].numpy(), Surfels().draw(world, camera, resting), atol=1e-3)


def test_shards_of_different_configs_are_refused(shards, tmp_path):
    other = sphere_shard(tmp_path / "other.h5", 2, 16)
    with pytest.raises(DatasetError, match="differ in resolution"):
        pictures([shards[0], other])
    with pytest.raises(DatasetError, match="got none"):
        pictures([])
    with pytest.raises(DatasetError, match="two records or more"):
        pictures([sphere_shard(tmp_path / "one.h5", 1, 16)])
    with pytest.raises(DatasetError, match="noise: expected one of none, uniform, gaussian, got 'salt'"):
        pictures(shards, replace(CONFIG, noise="salt"))
    with pytest.raises(ShardError, match="no such shard"):
        pictures([tmp_path / "absent.h5"])


def test_elevation_is_fixed_only_where_it_is_no_control(shards, tmp_path):
    assert pictures(shards).fixed_elevation is None
    rng = np.random.default_rng(0)
    pool = rng.random((50, 3), dtype=np.float32)
    attributes = {"mesh": "a", "controls": [{"name": "color", "version": "1", "size": 7}], "resolution": 16}
    records = [sphere_record(16, rng) for _ in range(3)]
    write_shard(tmp_path / "moving.h5", records, pool, attributes)
    level = [replace(record, scene=replace(record.scene, elevation=25.0)) for record in records]
    write_shard(tmp_path / "fixed.h5", level, pool, attributes)
    with pytest.raises(DatasetError, match="one elevation"):
        _ = pictures([tmp_path / "moving.h5"]).fixed_elevation
    assert pictures([tmp_path / "fixed.h5"]).fixed_elevation == 25.0


def test_sides_alternate_at_equal_cost(shards):
    config = replace(CONFIG, resolutions=(16, 32), batch=4, points=(3000, 3000))
    data = pictures(shards, config)
    small, large = data.batch(0), data.batch(1)
    assert small.target.shape == (4, 4, 16, 16) and large.target.shape == (1, 4, 32, 32)
    assert data.validation_batch([0]).target.shape[-1] == 16
    for batch in (small, large):  # the z-buffer is drawn at that side, not resized
        assert ((batch.buffers[:, 0] > 0) & (batch.coverage[:, 0] > 0.9)).sum() > 0.9 * (batch.coverage > 0.9).sum()
    alone = pictures(shards, replace(config, resolutions=(16,)))
    assert_equal(alone.batch(1), data.batch(2))
    with pytest.raises(DatasetError, match="divisors of the shards' 32, got 24"):
        pictures(shards, replace(CONFIG, resolutions=(24,)))


def test_mirrored_samples_are_those_of_a_mirrored_scene(shards):
    """The synthetic spheres are alike in a mirror, so a sample must lie over its target either way."""
    plain, data = pictures(shards, replace(CONFIG, points=(4000, 4000))), pictures(
        shards, replace(CONFIG, points=(4000, 4000), mirror=True, batch=13)
    )
    batch = data.batch(0)
    targets = {tuple(plain._record(place, 32).rgba.ravel()) for place in plain.training}
    flipped = [tuple(np.flip(plain._record(place, 32).rgba, 1).ravel()) for place in plain.training]
    assert not targets & set(flipped)
    features = batch.buffers[:, -len(GBufferChannel) :]
    seen, drawn = batch.target[:, 3] > 0, features[:, GBufferChannel.COVERAGE] > 0.5
    assert (drawn & seen).sum() > 0.9 * seen.sum()
    grey = features[:, RADIANCE_RGB].mean(1)  # the G-buffer's own light agrees with the target's, mirrored or not
    lit = batch.target[:, :3].mean(1)
    for one in range(13):
        inside = drawn[one] & seen[one]
        assert np.corrcoef(grey[one][inside].numpy(), lit[one][inside].numpy())[0, 1] > 0.5
    azimuths = {round(float(data._record(place, 32).settings[4]), 4) for place in data.training}
    turned = sum(round(float(azimuth), 4) not in azimuths for azimuth in batch.settings[:, 4])
    assert 2 <= turned <= 11
