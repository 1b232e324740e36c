"""The networks: Eq. 2 by hand, any image size, independent batch elements, gradients everywhere."""

from dataclasses import replace

import pytest
import torch

from z2p_core.config import NetworkConfig
from z2p_core.network.unet import AdaIN, Modulation, build_network

FAST = NetworkConfig(widths=(16, 24, 32, 48), fine=0, refine=16, mapping=16)
INPUT = replace(FAST, conditioning="input")
FINE = replace(FAST, fine=8, refine=0)
PAPER = NetworkConfig(kind="adain_unet", widths=(8, 12, 16), unshuffle=1, mapping=16, zbuffer="paper")


def network_of(config, seed=0):
    torch.manual_seed(seed)
    network = build_network(config, 3, 5, 7)
    with torch.no_grad():  # residual branches start at 0: make every layer count
        for parameter in network.parameters():
            parameter += 0.05 * torch.randn_like(parameter)
    return network


def inputs_of(config, batch, height, width):
    generator = torch.Generator().manual_seed(1)
    u = config.unshuffle
    return (
        torch.rand(batch, 3, height, width, generator=generator),
        torch.rand(5, -(-height // u), -(-width // u), generator=generator),
        torch.rand(batch, 7, generator=generator),
    )


def test_adain_is_eq2():
    torch.manual_seed(0)
    layer, x, w = AdaIN(6, 9), torch.randn(2, 6, 8, 5) * 3 + 1, torch.randn(2, 9)
    layer.affine.bias.data.normal_()
    gamma, beta = layer.affine(w).chunk(2, dim=1)
    result = layer(x, w)
    for picture in range(2):
        for channel in range(6):
            plane = x[picture, channel]
            normal = (plane - plane.mean()) / plane.std(correction=0)
            by_hand = (1 + gamma[picture, channel]) * normal + beta[picture, channel]
            torch.testing.assert_close(result[picture, channel], by_hand, rtol=1e-4, atol=1e-4)


def test_modulation_without_normalization_is_affine():
    layer, x, w = Modulation(4, 9), torch.randn(2, 4, 3, 3), torch.randn(2, 9)
    gamma, beta = layer.affine(w)[:, :, None, None].chunk(2, dim=1)
    torch.testing.assert_close(layer(x, w), (1 + gamma) * x + beta)


@pytest.mark.parametrize("config", [FAST, INPUT, FINE, PAPER], ids=["fast", "input", "fine", "paper"])
@pytest.mark.parametrize("size", [(64, 64), (75, 100), (32, 33)])
def test_any_size_gives_an_image_in_range(config, size):
    network = network_of(config).eval()
    picture = network(*inputs_of(config, 2, *size))
    assert picture.shape == (2, 4, *size) and picture.dtype == torch.float32
    assert picture.min() >= 0 and picture.max() <= 1 and picture.std() > 0


@pytest.mark.parametrize("config", [FAST, INPUT, FINE, PAPER], ids=["fast", "input", "fine", "paper"])
def test_batch_elements_are_independent(config):
    network = network_of(config).train()
    zbuffer, encoding, settings = inputs_of(config, 3, 64, 64)
    together = network(zbuffer, encoding, settings)
    alone = network(zbuffer[1:2], encoding, settings[1:2])
    torch.testing.assert_close(together[1:2], alone, rtol=1e-3, atol=1e-4)
    assert not torch.allclose(together[0], together[1], atol=1e-3)


@pytest.mark.parametrize("config", [FAST, INPUT, FINE, PAPER], ids=["fast", "input", "fine", "paper"])
def test_every_weight_gets_a_finite_gradient(config):
    network = network_of(config).train()
    network(*inputs_of(config, 2, 64, 64)).square().sum().backward()
    for name, parameter in network.named_parameters():
        assert parameter.grad is not None and parameter.grad.isfinite().all(), name
        assert parameter.grad.abs().sum() > 0, name


@pytest.mark.parametrize("config", [FAST, INPUT, FINE, PAPER], ids=["fast", "input", "fine", "paper"])
def test_zbuffer_encoding_and_settings_all_matter(config):
    network = network_of(config).eval()
    network.train()  # unclamped
    inputs = inputs_of(config, 1, 64, 64)
    picture = network(*inputs)
    for place in range(3):
        changed = list(inputs)
        changed[place] = 1 - changed[place]
        assert not torch.allclose(network(*changed), picture, atol=1e-4)


def test_training_output_keeps_gradients_outside_the_range():
    network = network_of(FAST).train()
    network.head.bias.data.fill_(5.0)
    picture = network(*inputs_of(FAST, 1, 64, 64))
    assert picture.max() > 1
    assert network.eval()(*inputs_of(FAST, 1, 64, 64)).max() == 1


def test_final_convolutions_start_at_zero_and_reach_two_pixels():
    torch.manual_seed(0)
    network = build_network(FAST, 3, 0, 7).eval()
    without = build_network(replace(FAST, refine=0), 3, 0, 7).eval()
    without.load_state_dict({name: x for name, x in network.state_dict().items() if name in without.state_dict()})
    buffers, settings = torch.rand(1, 3, 64, 64), torch.rand(1, 7)
    nothing = torch.zeros(0, 16, 16)
    torch.testing.assert_close(network(buffers, nothing, settings), without(buffers, nothing, settings))
    torch.nn.init.normal_(network.touch.weight)
    picture = torch.rand(1, 4, 64, 64)
    changed = buffers.clone()
    changed[..., 20, 30] += 1
    rows, columns = (network.refine(picture, buffers) != network.refine(picture, changed))[0].any(0).nonzero().T
    assert (rows.min(), rows.max(), columns.min(), columns.max()) == (18, 22, 28, 32)


def test_sharpen_starts_at_zero_and_reads_around_its_blocks():
    torch.manual_seed(0)
    fine = network_of(FINE).sharpen
    torch.nn.init.zeros_(fine.leave.weight)
    torch.nn.init.zeros_(fine.leave.bias)
    blocks, buffers = torch.rand(1, 16, 32, 32), torch.rand(1, 3, 64, 64)
    torch.testing.assert_close(fine(blocks, buffers), blocks)
    torch.nn.init.normal_(fine.leave.weight)
    changed = buffers.clone()
    changed[..., 20, 30] += 1
    rows, columns = (fine(blocks, buffers) != fine(blocks, changed))[0].any(0).nonzero().T
    assert (rows.min(), rows.max(), columns.min(), columns.max()) == (8, 11, 13, 16)


def test_a_network_without_encoding():
    network = build_network(FAST, 1, 0, 2).eval()
    assert network(torch.rand(1, 1, 40, 40), torch.zeros(0, 10, 10), torch.rand(1, 2)).shape == (1, 4, 40, 40)


def test_settings_as_input_channels_affect_every_pixel():
    network = network_of(INPUT).train()
    assert not any(isinstance(layer, Modulation) for layer in network.modules()) and network.mapping is None
    zbuffer, encoding, settings = inputs_of(INPUT, 1, 64, 64)
    settings.requires_grad_()
    picture = network(zbuffer, encoding, settings)
    picture.sum().backward()
    assert (settings.grad.abs() > 0).all()
    with torch.no_grad():
        assert ((network(zbuffer, encoding, 1 - settings) - picture).abs().amax(1) > 1e-5).all()


def test_a_uniform_input_has_finite_gradients():
    network = network_of(PAPER).train()
    network(torch.zeros(1, 3, 32, 32), torch.zeros(5, 32, 32), torch.zeros(1, 7)).sum().backward()
    assert all(parameter.grad.isfinite().all() for parameter in network.parameters())


def test_unknown_kind_and_impossible_shapes():
    with pytest.raises(ValueError, match=r"unknown network 'unet'; known: unshuffle_unet, adain_unet"):
        build_network(NetworkConfig(kind="unet"), 1, 0, 7)
    with pytest.raises(ValueError, match="expected unshuffle = 1, got 4"):
        build_network(NetworkConfig(kind="adain_unet"), 1, 0, 7)
    with pytest.raises(ValueError, match="conditioning: expected adain or input, got 'film'"):
        build_network(NetworkConfig(conditioning="film"), 1, 0, 7)
    with pytest.raises(ValueError, match="adain_unet: conditioning: expected adain, got 'input'"):
        build_network(replace(PAPER, conditioning="input"), 1, 0, 7)
    with pytest.raises(ValueError, match="fine needs an unshuffle that 2 divides, got 3"):
        build_network(replace(FINE, unshuffle=3), 1, 0, 7)
    with pytest.raises(ValueError, match="two or more widths"):
        build_network(NetworkConfig(widths=(8,)), 1, 0, 7)
