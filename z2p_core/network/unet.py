"""The conditioned U-Nets: z-buffer, G-buffer and settings in, premultiplied sRGB and alpha out.

In reading order: `build_network`; the layers of conditioning (`MappingNetwork`, `Modulation`, `AdaIN`); `UNet`, what
both networks share; `UnshuffleUNet`, the fast network that ships, and its blocks; `AdainUNet`, the paper's network, and
its block. Settings either modulate features (`conditioning` "adain") or, for comparison, are constant channels of the
input ("input").

Sizes in the comments on shapes: B batch, C buffer channels (z-buffer and G-buffer), E channels of the positional
encoding, S settings, M width of the mapping network, u unshuffle factor, W a level's width; H, W the image's sides.

The names of layers are the keys of the state dict of every weights file, and so cannot change. In standard terms:

============================== =======================================================================================
key                            layer
============================== =======================================================================================
mapping.layers.{0,2,4}         mapping network, linear layers: settings to the style vector w
stem                           `UnshuffleUNet`: input projection (1x1), and the skip connection from input to output
encode.{level}                 encoder blocks, from the finest level on
shrink.{level}                 downsampling: 2x2 convolution with stride 2
bottom                         bottleneck blocks
grow.{level}                   upsampling: 1x1 convolution, then nearest neighbors; `AdainUNet`: transposed convolution
decode.{level}                 decoder blocks; listed from the finest level on, run from the coarsest on
*.first, *.second              3x3 convolutions of a block; a list of them in `ResidualBlocks`
*.modulate.{i}                 modulation between these two in `ResidualBlocks`
*.{first,second}_modulation    AdaIN after each of the two in `AdainConvolutions`
tint                           modulation of the decoder's output
*.affine                       linear layer of a modulation: w to a scale and a shift of each channel
head                           output projection: 3x3 convolution to cells of u x u pixels; `AdainUNet`: 1x1
sharpen.look                   `Sharpen`: strided convolution of the buffers
sharpen.reread                 `Sharpen`: convolution of the image's blocks
sharpen.leave                  `Sharpen`: output convolution of the residual
look, touch                    final convolutions at full resolution, in and out
============================== =======================================================================================
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from z2p_core.config import FINE_BLOCK, NetworkConfig
from z2p_core.network.tensor_shapes import network_config_fault

MIN_ADAIN_STRIDE = 16
"""Stride from which on the fast network normalizes (AdaIN). Finer levels are only modulated: their instance statistics
depend on how much of the image the object covers, and its shading would depend on that."""
ADAIN_EPSILON = 1e-5
"""Added to the variance in AdaIN."""
MAPPING_INIT_GAIN = 1.2
"""Standard deviation of the mapping network's initial weights times the square root of their fan-in. Larger than the
default, so that color and light have an effect from the first steps of training on."""
MODULATION_INIT_GAIN = 0.1
"""The same for the linear layers of modulations: they start close to the identity."""
OUTPUT_INIT_SCALE = 0.1
"""Factor on the initial weights of the output layers: training starts close to an empty image."""


def build_network(config: NetworkConfig, buffer_channels: int, encoder_channels: int, settings: int) -> nn.Module:
    """A freshly initialized network of `config.kind`.

    Args:
        config: Kind and sizes of the network.
        buffer_channels: C, of the z-buffer and the G-buffer together, at least 1.
        encoder_channels: E, of the positional encoding, 0 for none.
        settings: S, the length of the settings vector, at least 1.

    Returns:
        A module whose forward takes buffers (B, C, H, W) float32, encoding (E, H/u, W/u) or (B, E, H/u, W/u) float32
        with sides rounded up, and settings (B, S) float32 in [0, 1], for H, W >= 32. It returns (B, 4, H, W) float32:
        premultiplied sRGB and alpha, clamped to [0, 1] in evaluation mode. In training they are not, since a clamp
        would stop gradients.

    Raises:
        ValueError: An unknown kind, or sizes that its kind cannot have.
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
    """The style vector w (B, M) of settings (B, S) in [0, 1]: an MLP, shared by all layers (paper section 3.3)."""

    def __init__(self, settings: int, mapping: int) -> None:
        super().__init__()
        self.layers = nn.Sequential(
            nn.Linear(settings, mapping), nn.SiLU(), nn.Linear(mapping, mapping), nn.SiLU(), nn.Linear(mapping, mapping)
        )
        for layer in self.layers:
            if isinstance(layer, nn.Linear):
                nn.init.normal_(layer.weight, std=MAPPING_INIT_GAIN / layer.in_features**0.5)
                nn.init.zeros_(layer.bias)

    def forward(self, settings: Tensor) -> Tensor:
        return self.layers(settings * 2 - 1)


class Modulation(nn.Module):
    """gamma x + beta for each channel of x (B, W, H, W), with gamma = 1 + A_gamma w and beta = A_beta w, w (B, M)."""

    normalize = False

    def __init__(self, channels: int, mapping: int) -> None:
        super().__init__()
        self.affine = nn.Linear(mapping, 2 * channels)
        nn.init.normal_(self.affine.weight, std=MODULATION_INIT_GAIN / mapping**0.5)
        nn.init.zeros_(self.affine.bias)

    def forward(self, x: Tensor, w: Tensor) -> Tensor:
        scale, shift = self.affine(w).float()[:, :, None, None].chunk(2, dim=1)  # (B, W, 1, 1) each
        scale = scale + 1
        if self.normalize:
            variance, mean = torch.var_mean(x.float(), dim=(2, 3), correction=0, keepdim=True)
            scale = scale * torch.rsqrt(variance + ADAIN_EPSILON)
            shift = shift - mean * scale
        return torch.addcmul(shift.to(x.dtype), x, scale.to(x.dtype))


class AdaIN(Modulation):
    """gamma (x - mean) / std + beta, with the mean and std of each image and channel (paper Eq. 2)."""

    normalize = True


class Unmodulated(nn.Module):
    """The identity in place of a modulation, for networks that get the settings as input channels.

    It does not normalize either: that would remove constant channels, and so the settings.
    """

    def __init__(self, channels: int, mapping: int) -> None:
        super().__init__()

    def forward(self, x: Tensor, w: Tensor) -> Tensor:
        return x


def modulation(config: NetworkConfig, stride: int) -> type[Modulation | Unmodulated]:
    """The class of the layer that applies the settings in the fast network at a stride (pixels per feature)."""
    if config.conditioning == "input":
        return Unmodulated
    return AdaIN if stride >= MIN_ADAIN_STRIDE else Modulation


class UNet(nn.Module):
    """What both networks share: the mapping network, padding to multiples of the stride, and the output's range.

    Subclasses implement `draw`, and `refine` if they have layers at full resolution.
    """

    def __init__(self, config: NetworkConfig, settings: int) -> None:
        super().__init__()
        self.unshuffle = config.unshuffle
        self.stride = config.stride
        self.mapping = MappingNetwork(settings, config.mapping) if config.conditioning == "adain" else None

    def forward(self, buffers: Tensor, encoding: Tensor, settings: Tensor) -> Tensor:
        height, width = buffers.shape[-2:]
        w = self.mapping(settings) if self.mapping else settings  # (B, M), or (B, S), which no layer then reads
        right, below = -width % self.stride, -height % self.stride
        buffers = F.pad(buffers, (0, right, 0, below))  # 0 is the background of every buffer
        x = F.pixel_unshuffle(buffers, self.unshuffle) if self.unshuffle > 1 else buffers  # (B, C u u, H/u, W/u)
        encoding = encoding.expand(x.shape[0], *encoding.shape[-3:])  # not len(): the export traces shapes
        if int(encoding.shape[1]):
            missing = (0, x.shape[3] - encoding.shape[3], 0, x.shape[2] - encoding.shape[2])
            x = torch.cat([x, F.pad(encoding, missing, mode="replicate")], dim=1)
        if self.mapping is None:
            planes = (settings * 2 - 1)[:, :, None, None].expand(-1, -1, *x.shape[-2:])  # (B, S, H/u, W/u)
            x = torch.cat([x, planes.to(x.dtype)], dim=1)
        image = self.draw(x.contiguous(memory_format=torch.channels_last), buffers, w)
        image = self.refine(image, buffers)
        image = image[:, :, :height, :width].float()  # (B, 4, H, W)
        return image if self.training else image.clamp(0, 1)

    def draw(self, x: Tensor, buffers: Tensor, w: Tensor) -> Tensor:
        """Image (B, 4, H, W) from the joint input (B, C u u + E + S, H/u, W/u), the buffers (B, C, H, W) and w."""
        raise NotImplementedError

    def refine(self, image: Tensor, buffers: Tensor) -> Tensor:
        """The image (B, 4, H, W) after layers at full resolution, which also read the buffers (B, C, H, W)."""
        return image


class UnshuffleUNet(UNet):
    """The fast network: cells of u x u pixels as channels (pixel unshuffle), residual blocks, additive skips.

    The few channels of a cell cannot place an edge exactly. So the image is refined in smaller blocks (`Sharpen`), or
    by two thin convolutions at full resolution (`look`, `touch`).
    """

    def __init__(self, config: NetworkConfig, buffer_channels: int, encoder_channels: int, settings: int) -> None:
        super().__init__(config, settings)
        widths, cell = config.widths, config.unshuffle**2
        inputs = buffer_channels * cell + encoder_channels + (0 if self.mapping else settings)
        # The G-buffer is a rough image already: a skip connection lets its pixels through to the output.
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
        # Right before the last convolution, so that color can scale shading; never normalized (stride 1).
        self.tint = modulation(config, 1)(widths[0], config.mapping)
        self.head = nn.Conv2d(widths[0], 4 * cell, 3, padding=1)
        self.sharpen = Sharpen(config, buffer_channels) if config.fine else None
        self.look = nn.Conv2d(4 + buffer_channels, config.refine, 3, padding=1) if config.refine else None
        self.touch = nn.Conv2d(config.refine, 4, 3, padding=1) if config.refine else None
        with torch.no_grad():
            self.head.weight *= OUTPUT_INIT_SCALE
            self.stem.weight[widths[0] :] *= OUTPUT_INIT_SCALE
            if self.touch is not None:
                nn.init.zeros_(self.touch.weight)
                nn.init.zeros_(self.touch.bias)

    def draw(self, x: Tensor, buffers: Tensor, w: Tensor) -> Tensor:
        x, skipped = self.stem(x).split([self.head.in_channels, self.head.out_channels], dim=1)  # (B, W0, H/u, W/u)
        skips = []
        for encode, shrink in zip(self.encode, self.shrink, strict=True):
            x = encode(x, w)
            skips.append(x)
            x = shrink(x)  # (B, W+1, H/2, W/2) of the level
        x = self.bottom(x, w)
        for grow, decode in zip(reversed(self.grow), reversed(self.decode), strict=True):
            x = skips.pop() + F.interpolate(grow(x), scale_factor=2.0, mode="nearest")
            x = decode(x, w)
        cells = self.head(self.tint(F.relu(x), w)) + skipped  # (B, 4 u u, H/u, W/u)
        if self.sharpen is None:
            return F.pixel_shuffle(cells, self.unshuffle)
        blocks = F.pixel_shuffle(cells, self.unshuffle // FINE_BLOCK)  # (B, 16, H/2, W/2)
        return F.pixel_shuffle(self.sharpen(blocks, buffers), FINE_BLOCK)

    def refine(self, image: Tensor, buffers: Tensor) -> Tensor:
        conv_in, conv_out = self.look, self.touch
        if conv_in is None or conv_out is None:
            return image
        x = torch.cat([image, buffers.to(image.dtype)], dim=1)  # (B, 4 + C, H, W)
        return image + conv_out(F.relu(conv_in(x.contiguous(memory_format=torch.channels_last))))


class Sharpen(nn.Module):
    """Residual refinement of an image in blocks of 2 x 2 pixels (`FINE_BLOCK`), which starts as the identity.

    The blocks stay folded into channels: engines are fastest with many channels of few pixels.
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
        """Refined blocks (B, 16, H/2, W/2) of an image, from the blocks and the buffers (B, C, H, W)."""
        features: Tensor = self.look(buffers.to(blocks.dtype)) + self.reread(blocks)  # (B, fine, H/2, W/2)
        return blocks + self.leave(F.relu(features))


class ResidualBlocks(nn.Module):
    """`count` times x + conv(relu(modulate(conv(relu(x)), w))) of x (B, width, H, W); each starts as the identity."""

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
    """Two 3x3 convolutions, each followed by AdaIN and ReLU: (B, before, H, W) to (B, after, H, W)."""

    def __init__(self, before: int, after: int, mapping: int) -> None:
        super().__init__()
        self.first = nn.Conv2d(before, after, 3, padding=1, bias=False)  # AdaIN would remove a bias
        self.first_modulation = AdaIN(after, mapping)
        self.second = nn.Conv2d(after, after, 3, padding=1, bias=False)
        self.second_modulation = AdaIN(after, mapping)

    def forward(self, x: Tensor, w: Tensor) -> Tensor:
        x = F.relu(self.first_modulation(self.first(x), w))
        return F.relu(self.second_modulation(self.second(x), w))
