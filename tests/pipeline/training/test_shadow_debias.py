"""What noise adds to a render's shade is not learnt, and all else of the render is."""

from dataclasses import replace

import pytest
import torch
from sphere_shards import sphere_shard

from z2p_core.config import TrainConfig
from z2p_renderer.pipeline.training.dataset import CloudDataset
from z2p_renderer.pipeline.training.shadow_debias import RELATIVE_BIASES, SHADOW_ALPHAS, remove_shadow_bias
from z2p_renderer.plugins.gbuffers.surfels import Surfels
from z2p_renderer.plugins.zbuffers.splats import SplatPyramid
from z2p_renderer.storage.shards import Shard

HAZE = 0.0025


def picture_of(alpha):
    """Premultiplied pictures (1, 4, 1, N) of a colour with these alphas (N,)."""
    return torch.stack([0.5 * alpha, 0.2 * alpha, 0.1 * alpha, alpha])[None, :, None]


def test_shadow_loses_the_bias_of_its_alpha():
    shade = torch.tensor(SHADOW_ALPHAS)
    left = remove_shadow_bias(picture_of(shade), torch.zeros(1, 1, 1, len(SHADOW_ALPHAS)), HAZE)
    torch.testing.assert_close(shade - left[0, 3, 0], HAZE * torch.tensor(RELATIVE_BIASES))
    assert torch.equal(left[:, :3], picture_of(shade)[:, :3])


def test_debiasing_keeps_order_and_stays_nonnegative():
    shade = torch.linspace(0, 1, 100_001)
    left = remove_shadow_bias(picture_of(shade), torch.zeros(1, 1, 1, len(shade)), HAZE)[0, 3, 0]
    assert left.min() == 0 and (left.diff() > 0).all()
    assert remove_shadow_bias(picture_of(shade), torch.zeros(1, 1, 1, len(shade)), 1.0).min() == 0


@pytest.mark.parametrize("share", [0.25, 0.999, 1.0])
def test_debiasing_leaves_the_object_unchanged(share):
    shade = torch.full((1,), 0.01)
    alpha = share + (1 - share) * shade
    left = remove_shadow_bias(picture_of(alpha), torch.full((1, 1, 1, 1), share), HAZE)[0, 3, 0]
    torch.testing.assert_close(alpha - left, (1 - share) * torch.tensor([HAZE]), atol=1e-6, rtol=1e-2)


def shaded(read, shard, row):
    """A record of the synthetic spheres, which cast no shadow, with faint shade on all of the floor."""
    record = read(shard, row)
    rgba = record.rgba.copy()
    rgba[record.coverage == 0, 3] = 3
    return replace(record, rgba=rgba)


def test_config_haze_is_removed_from_targets(tmp_path, monkeypatch):
    monkeypatch.setattr(Shard, "read", lambda shard, row, read=Shard.read: shaded(read, shard, row))
    shards = [sphere_shard(tmp_path / "a.h5", 8, 64, 0)]
    config = TrainConfig(batch=4, resolutions=(64,), points=(300, 300), validation_share=0.25)
    hazy, clear = (
        CloudDataset(shards, replace(config, haze=haze), SplatPyramid(), Surfels()) for haze in (0.0, HAZE)
    )
    for name, argument in (("batch", 0), ("validation_batch", (0, 1))):
        kept, left = (getattr(data, name)(argument) for data in (hazy, clear))
        assert torch.equal(remove_shadow_bias(kept.target, kept.coverage, HAZE), left.target)
        assert not torch.equal(kept.target, left.target)
