"""The depth network: an encoder and decoder of separable convolutions (U-Net, Ronneberger et al. 2015).

It predicts the logarithm of the ratio of depth to reference depth, its uncertainty, and where the floor is visible.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import cast

import torch
from torch import Tensor, nn

from surveilnav.perception.depth.reference import N_CHANNELS

#: Sides of pictures are multiples of this; the output has half of their resolution.
STRIDE, OUTPUT_STRIDE = 32, 2
#: Logarithm of the least and the greatest uncertainty: 0.7 % and a factor of 2.7.
LOG_SIGMA = (-5.0, 0.0)
_LOG_RATIO = (-4.0, 1.5)


@dataclass(frozen=True, slots=True)
class Shape:
    """How large the network is.

    Attributes:
        stem, geometry_stem: channels at stride 2 of the picture and of the reference.
        channels, blocks: of the encoder at strides 4, 8, 16, 32.
        decoder: channels at strides 16, 8, 4.
        detail: channels at stride 4 that bring the stem's detail to the decoder.
    """

    stem: int = 16
    geometry_stem: int = 8
    channels: tuple[int, int, int, int] = (32, 64, 128, 192)
    blocks: tuple[int, int, int, int] = (1, 2, 3, 2)
    decoder: tuple[int, int, int] = (96, 64, 48)
    detail: int = 24


@dataclass(frozen=True, slots=True, eq=False)
class Predictions:
    """What the network predicts for B pictures of H x W pixels; all (B, H / 2, W / 2).

    Attributes:
        log_ratio: log of depth over reference depth, where it isn't the floor.
        log_sigma: log of the scale of its Laplace distribution.
        floor: logit of the chance that the pixel shows the floor.
    """

    log_ratio: Tensor
    log_sigma: Tensor
    floor: Tensor


def _convolution(
    n_in: int, n_out: int, kernel: int = 1, stride: int = 1, *, relu: bool = True, padding: int | None = None
) -> nn.Sequential:
    """Convolution, batch normalisation, ReLU. ``padding``: None: half of the kernel."""
    pad = kernel // 2 if padding is None else padding
    layers: list[nn.Module] = [nn.Conv2d(n_in, n_out, kernel, stride, pad, bias=False), nn.BatchNorm2d(n_out)]
    return nn.Sequential(*layers, nn.ReLU(inplace=True)) if relu else nn.Sequential(*layers)


def _separable(n_in: int, n_out: int, stride: int = 1, kernel: int = 3) -> nn.Module:
    depthwise = nn.Conv2d(n_in, n_in, kernel, stride, kernel // 2, groups=n_in, bias=False)
    return nn.Sequential(depthwise, _convolution(n_in, n_out))


class _Block(nn.Module):
    """A depthwise convolution, then pointwise ones to twice the channels and back, around a shortcut."""

    def __init__(self, n: int, kernel: int) -> None:
        super().__init__()
        last = _convolution(2 * n, n, relu=False)
        self.body = nn.Sequential(_separable(n, 2 * n, kernel=kernel), last)
        nn.init.zeros_(cast(nn.BatchNorm2d, last[1]).weight)

    def forward(self, x: Tensor) -> Tensor:
        return nn.functional.relu(x + self.body(x))


class DepthNet(nn.Module):
    """The whole network."""

    def __init__(self, shape: Shape | None = None) -> None:
        super().__init__()
        shape = shape or Shape()
        self.stem = _convolution(3, shape.stem, 3, 2)
        self.geometry_stem = _convolution(N_CHANNELS, shape.geometry_stem, 1)
        n_in, n_stem, self.stages = shape.stem + shape.geometry_stem, shape.stem + shape.geometry_stem, nn.ModuleList()
        for stage, (n, blocks) in enumerate(zip(shape.channels, shape.blocks, strict=True)):
            kernel = 5 if stage >= 2 else 3
            self.stages.append(nn.Sequential(_separable(n_in, n, 2), *(_Block(n, kernel) for _ in range(blocks))))
            n_in = n
        # The mean of the whole picture tells what kind of room it is, and how large.
        self.overview = nn.Sequential(nn.Linear(n_in, n_in), nn.ReLU(inplace=True), nn.Linear(n_in, n_in))
        self.detail = _convolution(n_stem, shape.detail, 2, 2, padding=0)
        skips = (shape.channels[2], shape.channels[1], shape.channels[0] + shape.detail)
        self.laterals, self.merges = nn.ModuleList(), nn.ModuleList()
        for n, skip in zip(shape.decoder, skips, strict=True):
            self.laterals.append(_convolution(n_in, n))
            self.merges.append(_separable(n + skip, n, kernel=3 if n == shape.decoder[-1] else 5))
            n_in = n
        # Each place at stride 4 predicts its four pixels at stride 2: convolutions at stride 2 would double the time.
        n_out = 3 * (4 // OUTPUT_STRIDE) ** 2
        self.head = nn.Sequential(_convolution(n_in, 2 * n_in), nn.Conv2d(2 * n_in, n_out, 1))
        last = cast(nn.Conv2d, self.head[1])
        nn.init.normal_(last.weight, std=0.01)
        with torch.no_grad():
            cast(Tensor, last.bias).copy_(torch.tensor([-0.3, -1.0, -1.0]).repeat_interleave(n_out // 3))

    def forward(self, pictures: Tensor, geometry: Tensor) -> Predictions:
        """Of pictures (B, 3, H, W), 0-1, and geometry (B, ``N_CHANNELS``, H / 2, W / 2) as ``reference_channels`` has it."""
        stem = torch.cat([self.stem(pictures - 0.5), self.geometry_stem(geometry)], 1)
        x, skips = stem, []
        for stage in self.stages:
            x = stage(x)
            skips.append(x)
        x = x + self.overview(x.mean(dim=(2, 3)))[:, :, None, None]
        skips[0] = torch.cat([skips[0], self.detail(stem)], 1)
        for lateral, merge, skip in zip(self.laterals, self.merges, reversed(skips[:3]), strict=True):
            x = nn.functional.interpolate(lateral(x), scale_factor=2.0)
            x = merge(torch.cat([x, skip], 1))
        out = nn.functional.pixel_shuffle(self.head(x).float(), 4 // OUTPUT_STRIDE)
        return Predictions(out[:, 0].clamp(*_LOG_RATIO), out[:, 1].clamp(*LOG_SIGMA), out[:, 2])
