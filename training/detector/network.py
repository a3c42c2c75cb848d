"""The network ``compact``: an anchor-free detector of depthwise-separable convolutions, with masks and embeddings.

It sees colour and depth. Depth joins at stride 2 (``surveilnav.perception.detectors.depth_channels``): a bed is told from a
chair by its size and height, whatever its colours.

What is taken from papers: residual blocks of one depthwise and two pointwise convolutions (ConvNeXt, Liu et al. 2022), a
feature pyramid (Lin et al. 2017), one head shared by three strides (FCOS, Tian et al. 2019), mask prototypes (YOLACT, Bolya
et al. 2019), class scores by the cosine with a vector per class. ReLU, since runtimes fold it into a convolution.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import cast

import torch
from torch import Tensor, nn

from surveilnav.perception.detectors.depth_channels import N_CHANNELS

STRIDES = (8, 16, 32)
#: A class is rare at a place: the score that an untrained network gives.
_PRIOR = 0.01
_FIRST_SIZE = 2.5  # of a box's sides around a place, in strides, before training


@dataclass(frozen=True, slots=True)
class Shape:
    """How large the network is.

    Attributes:
        stem, depth_stem, channels: channels at stride 2 of colour and of depth, and at strides 4, 8, 16, 32.
        blocks: residual blocks at strides 4, 8, 16, 32.
        neck: channels of the pyramid and of the head.
        head: depth of each of the head's two branches.
        prototypes: of masks.
        embedding: D of a box's and of a picture's vector.
    """

    stem: int = 16
    depth_stem: int = 8
    channels: tuple[int, int, int, int] = (32, 64, 128, 224)
    blocks: tuple[int, int, int, int] = (1, 2, 6, 3)
    neck: int = 80
    head: int = 2
    prototypes: int = 16
    embedding: int = 64


@dataclass(frozen=True, slots=True, eq=False)
class Predictions:
    """What the network predicts for B pictures of (H, W) pixels at L places: those of stride 8 first, row by row.

    Attributes:
        logits: (B, L, C) of classes.
        ltrb: (B, L, 4) distances from a place to the box's sides [pixels], above 0.
        coefficients: (B, L, K) of masks.
        embeddings: (B, L, D) unit vectors of places.
        prototypes: (B, K, H / 4, W / 4).
        image: (B, D) unit vectors of pictures.
        near: (B, C + R) logits of classes that show or stand in the room looked into, and of the room's kind.
    """

    logits: Tensor
    ltrb: Tensor
    coefficients: Tensor
    embeddings: Tensor
    prototypes: Tensor
    image: Tensor
    near: Tensor


def _convolution(n_in: int, n_out: int, kernel: int = 1, stride: int = 1, relu: bool = True) -> nn.Sequential:
    """Convolution, batch normalisation, ReLU."""
    layers: list[nn.Module] = [
        nn.Conv2d(n_in, n_out, kernel, stride, kernel // 2, bias=False),
        nn.BatchNorm2d(n_out),
    ]
    return nn.Sequential(*layers, nn.ReLU(inplace=True)) if relu else nn.Sequential(*layers)


def _depthwise(n: int, kernel: int = 3, stride: int = 1) -> nn.Module:
    """Each channel by itself. A pointwise convolution follows at once, whose norm is enough: a norm here would cost as much."""
    return nn.Conv2d(n, n, kernel, stride, kernel // 2, groups=n, bias=False)


def _separable(n_in: int, n_out: int, stride: int = 1, kernel: int = 3) -> nn.Module:
    return nn.Sequential(_depthwise(n_in, kernel, stride), _convolution(n_in, n_out))


class _Block(nn.Module):
    """Depthwise, then out to twice the channels and back, around a shortcut."""

    def __init__(self, n: int) -> None:
        super().__init__()
        last = _convolution(2 * n, n, relu=False)
        self.body = nn.Sequential(_depthwise(n), _convolution(n, 2 * n), last)
        nn.init.zeros_(last[1].weight)  # type: ignore[arg-type]

    def forward(self, x: Tensor) -> Tensor:
        return nn.functional.relu(x + self.body(x))


class Backbone(nn.Module):
    """Pictures (B, 3, H, W) and depth (B, ``N_CHANNELS``, H / 2, W / 2) to features at strides 4, 8, 16, 32."""

    def __init__(self, shape: Shape) -> None:
        super().__init__()
        self.stem = _convolution(3, shape.stem, 3, 2)
        self.depth_stem = _convolution(N_CHANNELS, shape.depth_stem, 3)
        n_in, self.stages = shape.stem + shape.depth_stem, nn.ModuleList()
        for n, blocks in zip(shape.channels, shape.blocks, strict=True):
            self.stages.append(nn.Sequential(_separable(n_in, n, 2), *(_Block(n) for _ in range(blocks))))
            n_in = n

    def forward(self, pictures: Tensor, depth: Tensor) -> list[Tensor]:
        x, out = torch.cat([self.stem(pictures), self.depth_stem(depth)], 1), []
        for stage in self.stages:
            x = stage(x)
            out.append(x)
        return out


class Pyramid(nn.Module):
    """Features at strides 8, 16, 32 to as many of one width, that know of each other: down, then up again."""

    def __init__(self, shape: Shape) -> None:
        super().__init__()
        n = shape.neck
        self.lateral = nn.ModuleList(_convolution(c, n) for c in shape.channels[1:])
        self.down = nn.ModuleList(_separable(n, n, kernel=5) for _ in range(2))
        self.shrink = nn.ModuleList(_separable(n, n, 2) for _ in range(2))
        self.up = nn.ModuleList(_separable(n, n, kernel=5) for _ in range(2))

    def forward(self, features: list[Tensor]) -> list[Tensor]:
        p3, p4, p5 = (lateral(x) for lateral, x in zip(self.lateral, features, strict=True))
        p4 = self.down[0](p4 + nn.functional.interpolate(p5, scale_factor=2.0))
        p3 = self.down[1](p3 + nn.functional.interpolate(p4, scale_factor=2.0))
        p4 = self.up[0](p4 + self.shrink[0](p3))
        p5 = self.up[1](p5 + self.shrink[1](p4))
        return [p3, p4, p5]


class Branch(nn.Module):
    """A branch of the head: separable convolutions that all strides share, with batch norms of their own for each stride.

    One norm for all would learn by each stride's statistics, and be used with their mean: that costs most of what was learnt
    (RTMDet, Lyu et al. 2022, separates them likewise).
    """

    def __init__(self, n: int, depth: int) -> None:
        super().__init__()
        self.convolutions = nn.ModuleList(
            nn.Sequential(_depthwise(n), nn.Conv2d(n, n, 1, bias=False)) for _ in range(depth)
        )
        self.norms = nn.ModuleList(nn.ModuleList(nn.BatchNorm2d(n) for _ in range(depth)) for _ in range(len(STRIDES)))

    def forward(self, x: Tensor, level: int) -> Tensor:
        """``level``: the number of the stride."""
        norms = cast(nn.ModuleList, self.norms[level])
        for convolution, norm in zip(self.convolutions, norms, strict=True):
            x = nn.functional.relu(norm(convolution(x)))
        return x


class CosineTable(nn.Module):
    """Logits of N rows: the cosine of a vector with each row's, scaled, and a bias a row."""

    def __init__(self, n: int, dim: int, bias: float) -> None:
        super().__init__()
        self.vectors = nn.Parameter(torch.randn(n, dim) / math.sqrt(dim))
        self.bias = nn.Parameter(torch.full((n,), bias))
        self.log_scale = nn.Parameter(torch.tensor(math.log(10.0)))

    def forward(self, unit: Tensor) -> Tensor:
        """(..., N) of unit vectors (..., D)."""
        return nn.functional.linear(
            unit, nn.functional.normalize(self.vectors, dim=1) * self.log_scale.exp(), self.bias
        )


class Compact(nn.Module):
    """The whole network. ``n_classes`` C, ``n_rooms`` R."""

    def __init__(self, n_classes: int, n_rooms: int, shape: Shape | None = None) -> None:
        super().__init__()
        shape = shape or Shape()
        n, K, D = shape.neck, shape.prototypes, shape.embedding
        self.backbone, self.pyramid = Backbone(shape), Pyramid(shape)
        self.what, self.where = Branch(n, shape.head), Branch(n, shape.head)
        self.embed = nn.Conv2d(n, D, 1)
        self.sides_and_mask = nn.Conv2d(n, 4 + K, 1)
        self.level_scale = nn.Parameter(torch.zeros(len(STRIDES)))
        self.mask_low = _separable(n, n // 2)
        self.mask_high = nn.Sequential(_separable(n // 2, n // 2), nn.Conv2d(n // 2, K, 1))
        self.picture = nn.Sequential(nn.Linear(shape.channels[-1], 2 * D), nn.ReLU(inplace=True), nn.Linear(2 * D, D))
        self.classes = CosineTable(n_classes, D, math.log(_PRIOR / (1 - _PRIOR)))
        self.surroundings = CosineTable(n_classes + n_rooms, D, -2.0)
        nn.init.normal_(self.sides_and_mask.weight, std=0.01)
        nn.init.zeros_(self.sides_and_mask.bias)  # type: ignore[arg-type]

    def forward(self, pictures: Tensor, depth: Tensor) -> Predictions:
        """Of pictures (B, 3, H, W), 0-1, and depth (B, ``N_CHANNELS``, H / 2, W / 2); H and W are multiples of 32."""
        features = self.backbone(pictures - 0.5, depth)
        levels = self.pyramid(features[1:])
        embeddings, ltrb, coefficients = [], [], []
        for level, (x, stride) in enumerate(zip(levels, STRIDES, strict=True)):
            embeddings.append(_rows(self.embed(self.what(x, level))))
            rows = _rows(self.sides_and_mask(self.where(x, level))).float()
            size = (rows[..., :4] + self.level_scale[level]).clamp(max=5.0).exp()
            ltrb.append(size * (_FIRST_SIZE * stride))
            coefficients.append(torch.tanh(rows[..., 4:]))
        unit = nn.functional.normalize(torch.cat(embeddings, 1).float(), dim=-1)
        image = nn.functional.normalize(self.picture(features[-1].mean(dim=(2, 3))).float(), dim=-1)
        prototypes = self.mask_high(nn.functional.interpolate(self.mask_low(levels[0]), scale_factor=2.0)).float()
        return Predictions(
            self.classes(unit).float(),
            torch.cat(ltrb, 1),
            torch.cat(coefficients, 1),
            unit,
            prototypes,
            image,
            self.surroundings(image).float(),
        )


def _rows(x: Tensor) -> Tensor:
    """(B, C, H, W) to (B, H * W, C)."""
    return x.flatten(2).transpose(1, 2)


def places(height_px: int, width_px: int, device: torch.device | None = None) -> tuple[Tensor, Tensor]:
    """(L, 2) centres (x, y) [pixels] of all places of a picture, and their strides (L,)."""
    points, strides = [], []
    for stride in STRIDES:
        y, x = torch.meshgrid(
            torch.arange(height_px // stride, device=device),
            torch.arange(width_px // stride, device=device),
            indexing="ij",
        )
        points.append((torch.stack([x, y], dim=-1).reshape(-1, 2) + 0.5) * stride)
        strides.append(torch.full((len(points[-1]),), float(stride), device=device))
    return torch.cat(points).float(), torch.cat(strides)


def boxes_of(ltrb: Tensor, points: Tensor) -> Tensor:
    """(..., L, 4) xyxy [pixels] of distances (..., L, 4) around points (L, 2)."""
    return torch.cat([points - ltrb[..., :2], points + ltrb[..., 2:]], dim=-1)
