"""FLIP in torch against the package that measures it, and its gradients."""

import numpy as np
import pytest
import torch

from z2p_core.quality import flip_loss as module
from z2p_core.quality.flip_loss import flip

flip_evaluator = pytest.importorskip("flip_evaluator")


def pictures_of(side: int = 75, offset: float = 0.0) -> tuple[torch.Tensor, torch.Tensor]:
    """Two colourful pictures (1, 3, side, side + 21) of smooth ground, a disc and some noise, one a little off."""
    generator = torch.Generator().manual_seed(0)
    y, x = torch.meshgrid(torch.linspace(-1, 1, side), torch.linspace(-1, 1, side + 21), indexing="ij")
    ground = torch.stack([0.5 + 0.4 * x, 0.5 - 0.3 * y, 0.6 + 0.3 * x * y])
    ours, theirs = (torch.where(((x - a) ** 2 + y**2 < 0.3)[None], torch.tensor([0.9, 0.2, 0.1]).view(3, 1, 1), ground)
                    for a in (0.0, offset))  # fmt: skip
    ours = (ours + 0.05 * torch.randn(ours.shape, generator=generator)).clamp(0, 1)
    return ours[None], theirs.clamp(0, 1)[None]


@pytest.mark.parametrize("offset", [0.0, 0.05, 0.4])
def test_flip_loss_matches_the_metric(offset, monkeypatch):
    from z2p_core.quality.metrics import flip_map

    ours, theirs = pictures_of(offset=offset)
    measured = flip_map(*(picture[0].permute(1, 2, 0).numpy() for picture in (ours, theirs)))
    np.testing.assert_allclose(flip(ours, theirs)[0, 0].numpy(), measured, atol=0.03)
    monkeypatch.setattr(module, "COLOR_EPSILON", 1e-5)
    monkeypatch.setattr(module, "FEATURE_EPSILON", 1e-7)
    np.testing.assert_allclose(flip(ours, theirs)[0, 0].numpy(), measured, atol=2e-3)


def test_opposite_colours_have_the_metrics_error():
    from z2p_core.quality.metrics import flip_map

    colors = [torch.tensor(color).view(1, 3, 1, 1).expand(1, 3, 24, 24) for color in ((0.0, 1, 0), (0.0, 0, 1))]
    measured = flip_map(*(picture[0].permute(1, 2, 0).contiguous().numpy() for picture in colors))
    np.testing.assert_allclose(flip(*colors)[0, 0].numpy(), measured, atol=0.01)


def test_gradients_are_finite_everywhere_and_lead_downwards():
    ours, theirs = pictures_of(offset=0.1)
    for start in (theirs.clone(), torch.zeros_like(theirs), torch.ones_like(theirs)):
        picture = start.requires_grad_()
        flip(picture, theirs).mean().backward()
        assert picture.grad is not None and picture.grad.isfinite().all()
    picture = ours.clone().requires_grad_()
    before = flip(picture, theirs).mean()
    before.backward()
    assert flip(ours - 0.01 * picture.grad.sign(), theirs).mean() < before - 0.005


def test_equal_images_have_no_error_and_batches_are_independent():
    ours, theirs = pictures_of(offset=0.2)
    assert flip(theirs, theirs).max() < 1e-5
    both = flip(torch.cat([ours, theirs]), torch.cat([theirs, theirs]))
    torch.testing.assert_close(both[:1], flip(ours, theirs), rtol=1e-4, atol=1e-6)
    assert both.shape == (2, 1, 75, 96)
