"""Each loss term on synthetic images whose loss is known."""

import math

import pytest
import torch

from z2p_core.config import LossConfig
from z2p_core.quality.losses import ssim, total_loss, visible_difference

TERMS = ("color_l2", "magnitude_l1", "alpha_l1", "color_l1", "ssim", "gradient_l1", "visible", "flip")
NOTHING = dict.fromkeys((*TERMS, "foreground"), 0.0)


def only(**weights):
    return LossConfig(**(NOTHING | weights))


def flat(red, green, blue, alpha, side=16):
    pixel = torch.tensor([red, green, blue, alpha], dtype=torch.float32)
    return pixel.view(1, 4, 1, 1).expand(1, 4, side, side).clone()


NO_OBJECT = torch.zeros(1, 1, 16, 16)


def loss_of(prediction, target, coverage=NO_OBJECT, **weights):
    return total_loss(prediction, target, coverage, only(**weights))[0].item()


def test_color_l2_l1_and_alpha_by_hand():
    prediction, target = flat(0.5, 0.25, 0.0, 0.75), flat(0.0, 0.25, 0.25, 0.5)
    assert loss_of(prediction, target, color_l2=1.0) == pytest.approx((0.25 + 0 + 0.0625) / 3)
    assert loss_of(prediction, target, color_l1=1.0) == pytest.approx((0.5 + 0 + 0.25) / 3)
    assert loss_of(prediction, target, alpha_l1=2.0) == pytest.approx(2 * 0.25)


def test_magnitude_compares_lengths_not_directions():
    assert loss_of(flat(0.6, 0.0, 0.8, 1), flat(0.0, 1.0, 0.0, 1), magnitude_l1=1.0) == pytest.approx(0, abs=1e-6)
    assert loss_of(flat(0.3, 0.0, 0.4, 1), flat(0.0, 1.0, 0.0, 1), magnitude_l1=1.0) == pytest.approx(0.5, abs=1e-5)


def test_gradient_sees_edges_but_not_offsets():
    target, step = flat(0, 0, 0, 0), flat(0, 0, 0, 0)
    step[:, 0, :, 8:] = 1.0  # one edge in one of four channels
    assert loss_of(step, target, gradient_l1=1.0) == pytest.approx((1 / 15 / 4 + 0) / 2)
    assert loss_of(flat(0.5, 0.5, 0.5, 0.5), target, gradient_l1=1.0) == 0


def test_ssim_of_flat_pictures_is_known():
    a, b, c1 = 0.25, 0.75, 0.01**2
    first, second = torch.full((1, 1, 20, 16), a), torch.full((1, 1, 20, 16), b)
    by_hand = (2 * a * b + c1) / (a**2 + b**2 + c1)
    result = ssim(first, second)
    assert result.shape == (1, 1, 10, 6)
    torch.testing.assert_close(result, torch.full_like(result, by_hand), rtol=1e-3, atol=1e-3)
    with pytest.raises(ValueError, match="11 pixels a side or more, got 8"):
        ssim(first[..., :8], second[..., :8])


def test_ssim_equals_kornia_inside_the_border():
    metrics = pytest.importorskip("kornia.metrics")
    first, second = torch.rand(2, 1, 40, 30), torch.rand(2, 1, 40, 30)
    theirs = metrics.ssim(first, second, window_size=11, padding="valid")
    torch.testing.assert_close(ssim(first, second), theirs, rtol=1e-3, atol=1e-4)


def test_ssim_term_is_zero_for_equal_pictures_and_grows():
    generator = torch.Generator().manual_seed(0)
    target = torch.rand(1, 4, 32, 32, generator=generator)
    noise = torch.randn(1, 4, 32, 32, generator=generator)
    coverage = torch.zeros(1, 1, 32, 32)
    losses = [loss_of(target + k * noise, target, coverage, ssim=1.0) for k in (0.0, 0.05, 0.2)]
    assert losses[0] == pytest.approx(0, abs=1e-4) and 0.001 < losses[1] < losses[2]


def test_visible_difference_is_a_power_law_after_a_blur():
    target = flat(0.5, 0.5, 0.5, 1)
    small, large = (loss_of(flat(v, v, v, 1), target, visible=1.0) for v in (0.6, 0.9))
    assert small == pytest.approx(0.1**0.7, rel=0.15) and large == pytest.approx(0.4**0.7, rel=0.1)
    checkered = target.clone()
    checkered[:, :3] += 0.1 * (torch.arange(16)[:, None] + torch.arange(16)).remainder(2).mul(2).sub(1)
    assert loss_of(checkered, target, visible=1.0) < 0.05 * small
    assert loss_of(target, target, visible=1.0) == pytest.approx(0, abs=1e-6)
    assert loss_of(flat(0.25, 0.25, 0.25, 0.5), flat(0.75, 0.75, 0.75, 1), visible=1.0) == pytest.approx(0, abs=1e-6)


def test_visible_difference_ranks_as_flip():
    metrics = pytest.importorskip("z2p_core.quality.metrics")
    pytest.importorskip("flip_evaluator")
    generator = torch.Generator().manual_seed(0)
    target = torch.rand(1, 3, 6, 6, generator=generator).repeat_interleave(12, 2).repeat_interleave(12, 3)
    others = [0.9 * target + 0.05, target + 0.02, target + 0.15 * torch.randn(target.shape, generator=generator)]
    others = [x.clamp(0, 1) for x in others]
    ours = [visible_difference(x, target).mean().item() for x in others]
    theirs = [metrics.flip_map(*(y[0].permute(1, 2, 0).numpy() for y in (x, target))).mean() for x in others]
    assert sorted(range(3), key=ours.__getitem__) == sorted(range(3), key=theirs.__getitem__)


def test_foreground_weighs_color_errors_on_the_object():
    coverage = NO_OBJECT.clone()
    coverage[..., :4] = 1.0  # a quarter of the picture
    prediction, target = flat(0.3, 0.3, 0.3, 1), flat(0.0, 0.0, 0.0, 1)
    assert loss_of(prediction, target, coverage, color_l1=1.0, foreground=2.0) == pytest.approx(0.3 * (1 + 2 / 4))
    assert loss_of(flat(0, 0, 0, 0.5), target, coverage, alpha_l1=1.0, foreground=2.0) == pytest.approx(0.5)


def test_masked_averages_color_over_the_object_alone():
    coverage = NO_OBJECT.clone()
    coverage[..., :4] = 0.5
    prediction, target = flat(0.2, 0.2, 0.2, 1), flat(0.2, 0.2, 0.2, 1)
    prediction[..., :4] += 0.3
    prediction[..., 8:] += 0.7  # off the object: no matter
    assert loss_of(prediction, target, coverage, color_l1=1.0, masked=True) == pytest.approx(0.3, abs=1e-6)
    assert loss_of(prediction, target, NO_OBJECT, color_l1=1.0, masked=True) == 0


def test_total_is_the_weighted_sum_of_the_terms_named():
    generator = torch.Generator().manual_seed(0)
    prediction, target = torch.rand(2, 4, 24, 24, generator=generator), torch.rand(2, 4, 24, 24, generator=generator)
    coverage = torch.rand(2, 1, 24, 24, generator=generator)
    weights = {"color_l2": 0.1, "magnitude_l1": 0.2, "alpha_l1": 0.3, "color_l1": 0.4, "ssim": 0.5, "gradient_l1": 0.6,
               "visible": 0.7}  # fmt: skip
    total, terms = total_loss(prediction, target, coverage, LossConfig(**weights))
    assert list(terms) == list(weights) and not any(term.requires_grad for term in terms.values())
    assert total.item() == pytest.approx(sum(weights[name] * term.item() for name, term in terms.items()), rel=1e-5)
    assert list(total_loss(prediction, target, coverage, only(alpha_l1=1.0))[1]) == ["alpha_l1"]
    with pytest.raises(ValueError, match="weight above 0"):
        total_loss(prediction, target, coverage, only())


def test_gradients_are_finite_on_black_and_equal_pictures():
    config = LossConfig(color_l2=1, magnitude_l1=1, alpha_l1=1, color_l1=1, ssim=1, gradient_l1=1, visible=1)
    for target in (flat(0, 0, 0, 0), flat(0.2, 0.4, 0.6, 1)):
        prediction = flat(0, 0, 0, 0).requires_grad_()
        total, _ = total_loss(prediction, target, NO_OBJECT, config)
        total.backward()
        assert prediction.grad.isfinite().all() and math.isfinite(total.item())


def test_flip_uses_every_fourth_image():
    generator = torch.Generator().manual_seed(0)
    target = torch.rand(5, 4, 32, 32, generator=generator)
    coverage, prediction = torch.zeros(5, 1, 32, 32), target.clone()
    prediction[1:4] = 0
    assert loss_of(prediction, target, coverage, flip=1.0) == pytest.approx(0, abs=1e-5)
    prediction[4] = 0
    assert loss_of(prediction, target, coverage, flip=1.0) > 0.05
