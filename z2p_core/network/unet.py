"""The conditioned U-Nets: z-buffer and settings in, premultiplied sRGB and alpha out. One file, in reading order.

B batch, C z-buffer channels, E encoding channels, S settings, M mapping, u unshuffle, W a level's width.

Settings either modulate features (`conditioning` "adain") or, for comparison, are constant channels of the input.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from z2p_core.config import FINE_BLOCK, NetworkConfig
from z2p_core.network.tensor_shapes import network_config_fault

NORMALISE_FROM = 16
"""Stride at which the fast network turns to AdaIN. Finer levels are modulated without normalising: instance statistics
there depend on how much of the picture the object covers, and would tie its shading to that."""
EPSILON = 1e-5


def build_network(config: NetworkConfig, buffer_channels: int, encoder_channels: int, settings: int) -> nn.Module:
    """Freshly initialised network of `config.kind`, for inputs of these numbers of channels and settings.

    Its forward takes (buffers (B, C, H, W) float32, encoding (E, H/u, W/u) or (B, E, H/u, W/u) float32 with sides
    rounded up, settings (B, S) float32 in [0, 1]) and gives (B, 4, H, W) float32: colour times alpha and alpha,
    clamped to [0, 1] in evaluation mode and free in training, where a clamp would stop gradients. H, W >= 32.

    Raises:
        ValueError: unknown kind, or a shape that its kind cannot have.
    """
    kinds: dict[str, Callable[..., UNet]] = {"unshuffle_unet": UnshuffleUNet, "adain_unet": AdainUNet}
    if fault := network_config_fault(config):
        raise ValueError(f"network: {fault}")
    if buffer_channels < 1 or encoder_channels < 0 or settings < 1:
        raise ValueError(
            f"network: expected a z-buffer channel and a setting at least, got {buffer_channels} z-buffer and "
            f"{encoder_channels} encoding channels and {settings} settings"
        )
    return kinds[config.kind](config, buffer_channels, encoder_channels, settings)


class MappingNetwork(nn.Module):
    """w (B, M) from the settings vector s (B, S): an MLP shared by all layers (paper section 3.3)."""

    def __init__(self, settings: int, mapping: int) -> None:
        super().__init__()
        self.layers = nn.Sequential(
            nn.Linear(settings, mapping), nn.SiLU(), nn.Linear(mapping, mapping), nn.SiLU(), nn.Linear(mapping, mapping)
        )
        for layer in self.layers:  # louder than by default, so that colour and light are heard from the first steps
            if isinstance(layer, nn.Linear):
                nn.init.normal_(layer.weight, std=1.2 / layer.in_features**0.5)
                nn.init.zeros_(layer.bias)

    def forward(self, settings: Tensor) -> Tensor:
        return self.layers(settings * 2 - 1)


class Modulation(nn.Module):
    """gamma x + beta for each channel, with gamma = 1 + A_gamma w and beta = A_beta w."""

    normalise = False

    def __init__(self, channels: int, mapping: int) -> None:
        super().__init__()
        self.affine = nn.Linear(mapping, 2 * channels)
        nn.init.normal_(self.affine.weight, std=0.1 / mapping**0.5)
        nn.init.zeros_(self.affine.bias)

    def forward(self, x: Tensor, w: Tensor) -> Tensor:
        scale, shift = self.affine(w).float()[:, :, None, None].chunk(2, dim=1)  # (B, W, 1, 1) each
        scale = scale + 1
        if self.normalise:
            variance, mean = torch.var_mean(x.float(), dim=(2, 3), correction=0, keepdim=True)
            scale = scale * torch.rsqrt(variance + EPSILON)
            shift = shift - mean * scale
        return torch.addcmul(shift.to(x.dtype), x, scale.to(x.dtype))


class AdaIN(Modulation):
    """gamma (x - mean) / std + beta, statistics of each picture and channel (paper Eq. 2)."""

    normalise = True


class Unmodulated(nn.Module):
    """Stands where a modulation would: x as it is, for settings that came with the input.

    It does not normalise either: instance statistics would take constant channels, and so the settings, away.
    """

    def __init__(self, channels: int, mapping: int) -> None:
        super().__init__()

    def forward(self, x: Tensor, w: Tensor) -> Tensor:
        return x


def modulation(config: NetworkConfig, stride: int) -> type[Modulation | Unmodulated]:
    """The layer that brings the settings into the fast network at a stride."""
    if config.conditioning == "input":
        return Unmodulated
    return AdaIN if stride >= NORMALISE_FROM else Modulation


class UNet(nn.Module):
    """What both networks share: the mapping, padding to a multiple of the stride, and the range of the output."""

    def __init__(self, config: NetworkConfig, settings: int) -> None:
        super().__init__()
        self.unshuffle = config.unshuffle
        self.stride = config.stride
        self.mapping = MappingNetwork(settings, config.mapping) if config.conditioning == "adain" else None

    def forward(self, buffers: Tensor, encoding: Tensor, settings: Tensor) -> Tensor:
        height, width = buffers.shape[-2:]
        w = self.mapping(settings) if self.mapping else settings  # (B, M), or (B, S) that no layer modulates with
        right, below = -width % self.stride, -height % self.stride
        buffers = F.pad(buffers, (0, right, 0, below))  # the background of a z-buffer is 0
        x = F.pixel_unshuffle(buffers, self.unshuffle) if self.unshuffle > 1 else buffers  # (B, C u u, H/u, W/u)
        encoding = encoding.expand(x.shape[0], *encoding.shape[-3:])  # not len(): the export follows shapes
        if int(encoding.shape[1]):
            missing = (0, x.shape[3] - encoding.shape[3], 0, x.shape[2] - encoding.shape[2])
            x = torch.cat([x, F.pad(encoding, missing, mode="replicate")], dim=1)
        if self.mapping is None:
            planes = (settings * 2 - 1)[:, :, None, None].expand(-1, -1, *x.shape[-2:])  # (B, S, H/u, W/u)
            x = torch.cat([x, planes.to(x.dtype)], dim=1)
        picture = self.draw(x.contiguous(memory_format=torch.channels_last), buffers, w)
        picture = self.refine(picture, buffers)
        picture = picture[:, :, :height, :width].float()  # (B, 4, H, W)
        return picture if self.training else picture.clamp(0, 1)

    def draw(self, x: Tensor, buffers: Tensor, w: Tensor) -> Tensor:
        """Picture (B, 4, H, W) at full resolution from the joined input at the finest level, and the buffers."""
        raise NotImplementedError

    def refine(self, picture: Tensor, buffers: Tensor) -> Tensor:
        """The picture (B, 4, H, W) once more, beside the buffers (B, C, H, W) that it was drawn from."""
        return picture


class UnshuffleUNet(UNet):
    """The fast network: pixel blocks folded into channels, residual blocks, additive skips, pixels unfolded again.

    A cell of pixels has few channels to say where an edge runs, so the picture is gone over once more in smaller
    blocks (`sharpen`), or with two thin convolutions on single pixels (`touch`).
    """

    def __init__(self, config: NetworkConfig, buffer_channels: int, encoder_channels: int, settings: int) -> None:
        super().__init__(config, settings)
        widths, cell = config.widths, config.unshuffle**2
        inputs = buffer_channels * cell + encoder_channels + (0 if self.mapping else settings)
        # The G-buffer is a picture already: beside what the network works on, let its pixels through to the output.
        self.stem = nn.Conv2d(inputs, widths[0] + 4 * cell, 1)
        self.encode, self.shrink = nn.ModuleList(), nn.ModuleList()
        self.grow, self.decode = nn.ModuleList(), nn.ModuleList()
        for level, (fine, coarse) in enumerate(pairwise(widths)):
            stride = config.unshuffle * 2**level
            self.encode.append(ResidualBlocks(1, fine, config, stride))
            self.shrink.append(nn.Conv2d(fine, coarse, 2, stride=2))
            self.grow.append(nn.Conv2d(coarse, fine, 1))
            self.decode.append(ResidualBlocks(2, fine, config, stride))
        self.bottom = ResidualBlocks(2, widths[-1], config, self.stride)
        # Straight before the last convolution, so that colour can multiply shading; never normalised.
        self.tint = modulation(config, 1)(widths[0], config.mapping)
        self.head = nn.Conv2d(widths[0], 4 * cell, 3, padding=1)
        self.sharpen = Sharpen(config, buffer_channels) if config.fine else None
        self.look = nn.Conv2d(4 + buffer_channels, config.refine, 3, padding=1) if config.refine else None
        self.touch = nn.Conv2d(config.refine, 4, 3, padding=1) if config.refine else None
        with torch.no_grad():
            self.head.weight *= 0.1  # start near an empty picture
            self.stem.weight[widths[0] :] *= 0.1
            if self.touch is not None:
                nn.init.zeros_(self.touch.weight)
                nn.init.zeros_(self.touch.bias)

    def draw(self, x: Tensor, buffers: Tensor, w: Tensor) -> Tensor:
        x, traced = self.stem(x).split([self.head.in_channels, self.head.out_channels], dim=1)  # (B, W0, H/u, W/u)
        skips = []
        for encode, shrink in zip(self.encode, self.shrink, strict=True):
            x = encode(x, w)
            skips.append(x)
            x = shrink(x)  # (B, W+1, H/2, W/2) of the level
        x = self.bottom(x, w)
        for grow, decode in zip(reversed(self.grow), reversed(self.decode), strict=True):
            x = skips.pop() + F.interpolate(grow(x), scale_factor=2.0, mode="nearest")
            x = decode(x, w)
        cells = self.head(self.tint(F.relu(x), w)) + traced  # (B, 4 u u, H/u, W/u)
        if self.sharpen is None:
            return F.pixel_shuffle(cells, self.unshuffle)
        blocks = F.pixel_shuffle(cells, self.unshuffle // FINE_BLOCK)  # (B, 16, H/2, W/2)
        return F.pixel_shuffle(self.sharpen(blocks, buffers), FINE_BLOCK)

    def refine(self, picture: Tensor, buffers: Tensor) -> Tensor:
        first, last = self.look, self.touch
        if first is None or last is None:
            return picture
        beside = torch.cat([picture, buffers.to(picture.dtype)], dim=1).contiguous(memory_format=torch.channels_last)
        return picture + last(F.relu(first(beside)))


class Sharpen(nn.Module):
    """Goes over a picture in blocks of `FINE_BLOCK` pixels, beside the buffers around them; starts as the identity.

    The blocks stay folded into channels: engines are at their best with many channels of few pixels.
    """

    def __init__(self, config: NetworkConfig, buffer_channels: int) -> None:
        super().__init__()
        side, blocks = FINE_BLOCK, 4 * FINE_BLOCK**2
        self.look = nn.Conv2d(buffer_channels, config.fine, 2 * side, stride=side, padding=side // 2)
        self.reread = nn.Conv2d(blocks, config.fine, 3, padding=1)
        self.leave = nn.Conv2d(config.fine, blocks, 3, padding=1)
        nn.init.zeros_(self.leave.weight)
        nn.init.zeros_(self.leave.bias)

    def forward(self, blocks: Tensor, buffers: Tensor) -> Tensor:
        """Blocks (B, 16, H/2, W/2) of a picture, mended, from them and the buffers (B, C, H, W)."""
        seen: Tensor = self.look(buffers.to(blocks.dtype)) + self.reread(blocks)
        return blocks + self.leave(F.relu(seen))


class ResidualBlocks(nn.Module):
    """`count` times x + conv(relu(modulate(conv(relu(x))))), each starting as the identity."""

    def __init__(self, count: int, width: int, config: NetworkConfig, stride: int) -> None:
        super().__init__()
        kind = modulation(config, stride)
        self.first = nn.ModuleList(nn.Conv2d(width, width, 3, padding=1) for _ in range(count))
        self.modulate = nn.ModuleList(kind(width, config.mapping) for _ in range(count))
        self.second = nn.ModuleList(nn.Conv2d(width, width, 3, padding=1) for _ in range(count))
        for convolution in self.second:
            nn.init.zeros_(convolution.weight)
            nn.init.zeros_(convolution.bias)

    def forward(self, x: Tensor, w: Tensor) -> Tensor:
        for first, modulate, second in zip(self.first, self.modulate, self.second, strict=True):
            x = x + second(F.relu(modulate(first(F.relu(x)), w)))
        return x


class AdainUNet(UNet):
    """The paper's network: a classic U-Net at full resolution, AdaIN after every convolution (section 3.3)."""

    def __init__(self, config: NetworkConfig, buffer_channels: int, encoder_channels: int, settings: int) -> None:
        super().__init__(config, settings)
        widths = config.widths
        inputs = (buffer_channels + encoder_channels, *widths[:-1])
        self.encode = nn.ModuleList(
            AdainConvolutions(before, after, config.mapping) for before, after in zip(inputs, widths, strict=True)
        )
        pairs = list(pairwise(widths))
        self.grow = nn.ModuleList(nn.ConvTranspose2d(coarse, fine, 2, stride=2) for fine, coarse in pairs)
        self.decode = nn.ModuleList(AdainConvolutions(2 * fine, fine, config.mapping) for fine, _ in pairs)
        self.head = nn.Conv2d(widths[0], 4, 1)

    def draw(self, x: Tensor, buffers: Tensor, w: Tensor) -> Tensor:
        skips: list[Tensor] = []
        for encode in self.encode:
            x = encode(F.max_pool2d(x, 2) if skips else x, w)  # (B, W, H, W), sides halved at each level
            skips.append(x)
        skips.pop()
        for grow, decode in zip(reversed(self.grow), reversed(self.decode), strict=True):
            x = decode(torch.cat([skips.pop(), grow(x)], dim=1), w)
        return self.head(x)


class AdainConvolutions(nn.Module):
    """Two 3x3 convolutions, each followed by AdaIN and ReLU."""

    def __init__(self, before: int, after: int, mapping: int) -> None:
        super().__init__()
        self.first = nn.Conv2d(before, after, 3, padding=1, bias=False)  # AdaIN would take a bias away again
        self.first_modulation = AdaIN(after, mapping)
        self.second = nn.Conv2d(after, after, 3, padding=1, bias=False)
        self.second_modulation = AdaIN(after, mapping)

    def forward(self, x: Tensor, w: Tensor) -> Tensor:
        x = F.relu(self.first_modulation(self.first(x), w))
        return F.relu(self.second_modulation(self.second(x), w))
