"""What the trainings of all networks share: the rate's schedule, which weights decay, the running mean of weights."""

from __future__ import annotations

import math
from typing import Any

import torch
from torch import nn


def cosine_rate(step: int, *, steps: int, rate: float, warm_up: int, last: float) -> float:
    """The learning rate at a step: it rises to ``rate`` in ``warm_up`` steps, and falls by half a cosine to ``last`` of that."""
    if step < warm_up:
        return rate * (step + 1) / warm_up
    share = (step - warm_up) / max(1, steps - warm_up)
    return rate * (last + (1 - last) * 0.5 * (1 + math.cos(math.pi * share)))


def weight_groups(network: nn.Module, decay: float) -> list[dict[str, Any]]:
    """Weights of convolutions decay, biases and scales don't."""
    heavy = [p for p in network.parameters() if p.ndim > 1]
    light = [p for p in network.parameters() if p.ndim <= 1]
    return [{"params": heavy, "weight_decay": decay}, {"params": light, "weight_decay": 0.0}]


@torch.no_grad()
def blend(mean: nn.Module, network: nn.Module, keeps: float) -> None:
    """Moves ``mean`` towards ``network``: an exponential mean of weights and of batch norms' statistics."""
    for kept, new in zip(mean.state_dict().values(), network.state_dict().values(), strict=True):
        if kept.dtype.is_floating_point:
            kept.lerp_(new.to(kept.dtype), 1.0 - keeps)
        else:
            kept.copy_(new)


def n_parameters(network: nn.Module) -> int:
    return sum(p.numel() for p in network.parameters())
