"""What a prediction costs: scores, boxes, masks, and the prediction for the whole picture."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor, nn

from training.detector.assign import Assigned, Targets, assign
from training.detector.network import Predictions, boxes_of

#: Weights of the parts.
WEIGHTS = {"score": 1.0, "box": 2.5, "mask": 1.0, "near": 0.5, "room": 0.25}
#: Masks cost memory: so many objects of a batch are looked at.
_MAX_MASKS = 96
_MASK_STRIDE = 4


@dataclass(frozen=True, slots=True, eq=False)
class Batch:
    """B pictures and what they show.

    Attributes:
        pictures: (B, 3, H, W) uint8.
        depth: (B, ``N_CHANNELS``, H / 2, W / 2) float32, as ``depth_channels`` has it.
        ids: (B, H / 4, W / 4) uint8 of objects at the masks' resolution, 0: nothing, g + 1: object g of the picture.
        targets: the objects.
        near: (B, C) float32 0 or 1 of classes that show or stand near. room: (B,) int64 kind of room, -1: unknown.
    """

    pictures: Tensor
    depth: Tensor
    ids: Tensor
    targets: Targets
    near: Tensor
    room: Tensor


def losses(predicted: Predictions, points: Tensor, batch: Batch) -> dict[str, Tensor]:
    """The parts of the loss by name, unweighted. ``points``: (L, 2) places of the pictures."""
    boxes = boxes_of(predicted.ltrb, points)
    assigned = assign(predicted.logits, boxes, points, batch.targets)
    total = assigned.quality.sum().clamp(min=1.0)
    wanted = (
        batch.targets.boxes.gather(1, assigned.owner[..., None].expand(-1, -1, 4)) if assigned.best.shape[1] else boxes
    )
    at = assigned.positive
    box = ((1 - giou(boxes[at], wanted[at])) * assigned.quality[at]).sum() / total
    near, room = surroundings_loss(predicted.near, batch)
    return {
        "score": score_loss(predicted.logits, assigned, batch.targets) / total,
        "box": box,
        "mask": mask_loss(predicted, assigned, batch),
        "near": near,
        "room": room,
    }


def score_loss(logits: Tensor, assigned: Assigned, targets: Targets) -> Tensor:
    """Quality focal loss (Li et al. 2020): the score of the right class should be the box's quality, all others 0."""
    wanted = torch.zeros_like(logits)
    if assigned.best.shape[1]:
        label = targets.labels.gather(1, assigned.owner)
        wanted.scatter_(2, label[..., None], (assigned.quality * assigned.positive)[..., None])
    far = (wanted - logits.sigmoid()).abs().square()
    return (nn.functional.binary_cross_entropy_with_logits(logits, wanted, reduction="none") * far.detach()).sum()


def giou(a: Tensor, b: Tensor) -> Tensor:
    """(N,) generalised IoU (Rezatofighi et al. 2019) of boxes (N, 4) and (N, 4)."""
    low, high = torch.maximum(a[:, :2], b[:, :2]), torch.minimum(a[:, 2:], b[:, 2:])
    common = (high - low).clamp(min=0).prod(-1)
    union = (a[:, 2:] - a[:, :2]).clamp(min=0).prod(-1) + (b[:, 2:] - b[:, :2]).clamp(min=0).prod(-1) - common
    around = (torch.maximum(a[:, 2:], b[:, 2:]) - torch.minimum(a[:, :2], b[:, :2])).clamp(min=0).prod(-1)
    return common / (union + 1e-7) - (around - union) / (around + 1e-7)


def mask_loss(predicted: Predictions, assigned: Assigned, batch: Batch) -> Tensor:
    """Dice and cross entropy of each object's mask inside its box, by its best place (YOLACT)."""
    picture, thing = torch.nonzero(batch.targets.real, as_tuple=True)
    if not len(picture):
        return predicted.prototypes.sum() * 0.0
    if len(picture) > _MAX_MASKS:
        some = torch.linspace(0, len(picture) - 1, _MAX_MASKS, device=picture.device).long()
        picture, thing = picture[some], thing[some]
    place = assigned.best[picture, thing]
    logits = torch.einsum("nk,nkhw->nhw", predicted.coefficients[picture, place], predicted.prototypes[picture])
    wanted = (batch.ids[picture] == (thing + 1)[:, None, None]).float()
    inside = in_boxes(batch.targets.boxes[picture, thing] / _MASK_STRIDE, *wanted.shape[1:])
    each = nn.functional.binary_cross_entropy_with_logits(logits, wanted, reduction="none") * inside
    entropy = each.sum((1, 2)) / inside.sum((1, 2)).clamp(min=1.0)
    p = logits.sigmoid() * inside
    dice = 1 - (2 * (p * wanted).sum((1, 2)) + 1) / (p.sum((1, 2)) + wanted.sum((1, 2)) + 1)
    return (entropy + dice).mean()


def in_boxes(boxes: Tensor, height: int, width: int) -> Tensor:
    """(N, height, width) float32: 1 where a cell's middle lies in a box (N, 4) [cells]."""
    x = torch.arange(width, device=boxes.device) + 0.5
    y = torch.arange(height, device=boxes.device) + 0.5
    across = (x >= boxes[:, 0:1]) & (x <= boxes[:, 2:3])
    along = (y >= boxes[:, 1:2]) & (y <= boxes[:, 3:4])
    return (along[:, :, None] & across[:, None, :]).float()


def surroundings_loss(logits: Tensor, batch: Batch) -> tuple[Tensor, Tensor]:
    """(classes that show or stand near, kind of the room where it is known)."""
    n = batch.near.shape[1]
    near = nn.functional.binary_cross_entropy_with_logits(logits[:, :n], batch.near)
    known = batch.room >= 0
    room = nn.functional.cross_entropy(logits[known, n:], batch.room[known]) if known.any() else logits.sum() * 0.0
    return near * 4.0, room
