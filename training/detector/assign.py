"""Assigns each object to the places that shall predict it: task-aligned assignment (TOOD, Feng et al. 2021).

A place inside an object's box is rated by how well it predicts the object already: score^a * IoU^b. The best few places of each
object are assigned to it. A place among the best of several objects is assigned to the one that it overlaps most. An object
without a place inside its box gets the nearest place.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

_A, _B = 0.5, 4.0
_MAX_PLACES = 10
_EPS = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class Targets:
    """The true objects in a batch of B pictures.

    Pictures have different numbers of objects, so the rows of each are filled up to G, the largest number in the batch.

    Attributes:
        boxes: (B, G, 4) corners x0, y0, x1, y1 [pixels].
        labels: (B, G) int64, the number of the object's class.
        real: (B, G) bool, whether the row is an object; False: it only fills up.
    """

    boxes: Tensor
    labels: Tensor
    real: Tensor


@dataclass(frozen=True, slots=True, eq=False)
class Assigned:
    """Which place is assigned to which object.

    Attributes:
        positive: (B, L) bool, whether the place has an object.
        owner: (B, L) int64, the number of that object, below G; meaningless where not ``positive``.
        quality: (B, L) 0-1, the score that the place should give to the object's class; 0 where not ``positive``.
        best: (B, G) int64, the place that predicts each object best.
    """

    positive: Tensor
    owner: Tensor
    quality: Tensor
    best: Tensor


def pairwise_iou(a: Tensor, b: Tensor) -> Tensor:
    """(B, G, L) of boxes (B, G, 4) and (B, L, 4)."""
    low = torch.maximum(a[:, :, None, :2], b[:, None, :, :2])
    high = torch.minimum(a[:, :, None, 2:], b[:, None, :, 2:])
    common = (high - low).clamp(min=0).prod(-1)
    area_a, area_b = ((x[..., 2:] - x[..., :2]).clamp(min=0).prod(-1) for x in (a, b))
    return common / (area_a[:, :, None] + area_b[:, None, :] - common + _EPS)


@torch.no_grad()
def assign(logits: Tensor, boxes: Tensor, points: Tensor, targets: Targets) -> Assigned:
    """Assigns the places of one batch of predictions.

    Args:
        logits: (B, L, C). boxes: (B, L, 4) that the places predict. points: (L, 2) of the places.
    """
    B, L = logits.shape[:2]
    G = targets.boxes.shape[1]
    if G == 0:
        nothing = torch.zeros((B, L), device=logits.device)
        return Assigned(
            nothing.bool(), nothing.long(), nothing, torch.zeros((B, 0), dtype=torch.long, device=logits.device)
        )
    iou = pairwise_iou(targets.boxes, boxes)
    scores = logits.sigmoid().transpose(1, 2).gather(1, targets.labels[:, :, None].expand(B, G, L))
    fit = scores.pow(_A) * iou.pow(_B)
    allowed = _candidates(targets, points)
    chosen = _best_few(torch.where(allowed, fit + _EPS, torch.zeros_like(fit))) & allowed
    several = chosen.sum(dim=1, keepdim=True) > 1
    favourite = torch.where(chosen, iou, torch.full_like(iou, -1.0)).argmax(dim=1, keepdim=True)
    mine = torch.arange(G, device=iou.device)[None, :, None] == favourite
    chosen &= mine | ~several
    positive, owner = chosen.any(dim=1), chosen.float().argmax(dim=1)
    fit, iou = fit * chosen, iou * chosen
    # The best place of an object should score its IoU, the others in proportion.
    share = fit / (fit.amax(dim=2, keepdim=True) + _EPS) * iou.amax(dim=2, keepdim=True)
    return Assigned(positive, owner, share.amax(dim=1), (fit + chosen * _EPS).argmax(dim=2))


def _candidates(targets: Targets, points: Tensor) -> Tensor:
    """(B, G, L) bool: places inside the box of a real object; of one that holds none, the place nearest to its middle."""
    boxes = targets.boxes[:, :, None, :]
    inside = torch.minimum(points - boxes[..., :2], boxes[..., 2:] - points).amin(-1) > 0
    middle = (targets.boxes[..., :2] + targets.boxes[..., 2:]) / 2
    away = (points[None, None] - middle[:, :, None]).square().sum(-1)
    nearest = torch.zeros_like(inside).scatter_(2, away.argmin(dim=2, keepdim=True), True)
    return torch.where(inside.any(dim=2, keepdim=True), inside, nearest) & targets.real[:, :, None]


def _best_few(fit: Tensor) -> Tensor:
    """(B, G, L) bool: the ``_MAX_PLACES`` highest of each row."""
    top = fit.topk(min(_MAX_PLACES, fit.shape[2]), dim=2).indices
    return torch.zeros_like(fit, dtype=torch.bool).scatter_(2, top, True)
