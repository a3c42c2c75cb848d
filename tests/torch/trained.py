"""Tiny models that learn a small home by heart: what they are for is that the same load and run path finds things again."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from matplotlib.path import Path as MatplotlibPath
from numpy.typing import NDArray
from transformers.loss.loss_grounding_dino import GroundingDinoHungarianMatcher, GroundingDinoImageLoss
from transformers.models.grounding_dino.image_processing_pil_grounding_dino import GroundingDinoImageProcessorPil
from transformers.models.grounding_dino.modeling_grounding_dino import build_label_maps, build_text_mask

from surveilnav.geometry import Matrix4, Pinhole, camera_pose
from surveilnav.perception.detectors.spans import SpecialTokens, build_prompts
from surveilnav.robot_body import CAMERA_HEIGHT_M
from surveilnav.simulator.render.renderer import Renderer
from surveilnav.simulator.world.navigation import NavigationMap
from tests.torch import tiny

_LEAST_SHARE = 0.01  # of a picture: what is smaller isn't learnt
_WIDTH_PX, _HEIGHT_PX = 128, 96  # of the pictures that the tiny detector sees


@dataclass(frozen=True, slots=True, eq=False)
class Example:
    """One render: ``rgb`` (H, W, 3) uint8; ``boxes`` (N, 4) xyxy [pixels] of what shows; ``names``: N of the words."""

    rgb: NDArray[np.uint8]
    boxes: NDArray[np.float32]
    names: tuple[str, ...]


def examples(
    renderer: Renderer,
    navigation: NavigationMap,
    camera: Pinhole,
    words: Sequence[str],
    n: int,
    *,
    empty: int = 0,
    seed: int = 0,
) -> list[Example]:
    """``n`` views from random places of a robot, each of which shows one of the words at least, all words by turns; then
    ``empty`` ones that show none."""
    rng, out = np.random.default_rng(seed), []
    while len(out) < n + empty:
        point = navigation.random_point(rng, renderer.scene.floors[0].id)
        T = camera_pose((point[0], point[1], point[2] + CAMERA_HEIGHT_M), rng.uniform(-np.pi, np.pi), 0.0)
        example = _example(renderer, T, camera, words)
        if words[len(out) % len(words)] in example.names if len(out) < n else not example.names:
            out.append(example)
    return out


def _example(renderer: Renderer, T_world_camera: Matrix4, camera: Pinhole, words: Sequence[str]) -> Example:
    rendered = renderer.render(T_world_camera, camera)
    boxes, names = [], []
    for instance in renderer.scene.instances:
        shown = rendered.instance_ids == instance.id
        if instance.label in words and shown.mean() >= _LEAST_SHARE:
            rows, columns = np.flatnonzero(shown.any(axis=1)), np.flatnonzero(shown.any(axis=0))
            boxes.append((columns[0], rows[0], columns[-1] + 1, rows[-1] + 1))
            names.append(instance.label)
    return Example(rendered.rgb, np.array(boxes, np.float32).reshape(-1, 4), tuple(names))


def train_grounding_dino(folder: Path, shown: Sequence[Example], words: Sequence[str], steps: int = 400) -> Path:
    """A folder with a tiny Grounding DINO that has learnt where the words are in these pictures."""
    torch.manual_seed(0)
    tokenizer = tiny.bert_tokenizer(words)
    images = GroundingDinoImageProcessorPil(size={"shortest_edge": _HEIGHT_PX, "longest_edge": _WIDTH_PX})
    model = tiny.grounding_dino_model(len(tokenizer), auxiliary_loss=True).train()
    pixels = images([e.rgb for e in shown], return_tensors="pt")["pixel_values"]
    pieces = [tokenizer(word, add_special_tokens=False)["input_ids"] for word in words]
    (prompt,) = build_prompts(pieces, SpecialTokens(101, 102, 1012), 256)
    ids = torch.from_numpy(prompt.ids)[None]
    labels = [_label(example, words) for example in shown]
    optimizer = torch.optim.AdamW(model.parameters(), lr=1e-3, weight_decay=1e-4)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, 2e-3, total_steps=steps)
    rng = np.random.default_rng(0)
    for _ in range(steps):
        rows = rng.choice(len(shown), min(8, len(shown)), replace=False)
        out = model(pixel_values=pixels[rows], input_ids=ids.repeat(len(rows), 1), labels=[labels[i] for i in rows])
        optimizer.zero_grad()
        (out.loss + _proposal_loss(model, out, [labels[i] for i in rows], ids)).backward()
        torch.nn.utils.clip_grad_norm_(model.parameters(), 1.0)
        optimizer.step()
        schedule.step()
    return tiny.saved(model.eval(), folder, tokenizer, images)


def _proposal_loss(model: Any, out: Any, labels: list[dict[str, Any]], ids: torch.Tensor) -> torch.Tensor:
    """What the paper asks of the encoder's proposals: the same as of the decoder's boxes. The library's own loss cuts
    their gradient."""
    config = model.config
    matcher = GroundingDinoHungarianMatcher(config.class_cost, config.bbox_cost, config.giou_cost)
    criterion = GroundingDinoImageLoss(matcher, config.focal_alpha, ["labels", "boxes"])
    logits = out.enc_outputs_class
    many = ids.repeat(len(labels), 1)
    said = {
        "logits": logits,
        "pred_boxes": out.enc_outputs_coord_logits.sigmoid(),
        "label_maps": build_label_maps(logits, many),
        "text_mask": build_text_mask(logits, torch.ones_like(many)),
    }
    losses = criterion(said, labels)
    return 2 * losses["loss_ce"] + 5 * losses["loss_bbox"] + 2 * losses["loss_giou"]


def _label(example: Example, words: Sequence[str]) -> dict[str, Any]:
    height, width = example.rgb.shape[:2]
    xyxy = torch.from_numpy(example.boxes) / torch.tensor([width, height, width, height])
    boxes = torch.cat([(xyxy[:, :2] + xyxy[:, 2:]) / 2, xyxy[:, 2:] - xyxy[:, :2]], dim=1)
    return {
        "class_labels": torch.tensor([words.index(name) for name in example.names], dtype=torch.long),
        "boxes": boxes,
    }


def train_clip(folder: Path, shown: Sequence[tuple[NDArray[np.uint8], str]], steps: int = 400) -> Path:
    """A folder with a tiny CLIP that has learnt which of a few texts each picture goes with."""
    torch.manual_seed(0)
    tokenizer, images = tiny.clip_tokenizer(), tiny.clip_images()
    model = tiny.clip_model(len(tokenizer)).train()
    texts = sorted({text for _, text in shown})
    whole = {"do_center_crop": False, "size": {"height": 32, "width": 32}}
    pixels = images([rgb for rgb, _ in shown], return_tensors="pt", **whole)["pixel_values"]
    asked = tokenizer(texts, padding="max_length", max_length=77, return_tensors="pt")
    right = torch.tensor([texts.index(text) for _, text in shown])
    optimizer = torch.optim.AdamW(model.parameters(), lr=1e-3, weight_decay=0.05)
    rng = np.random.default_rng(0)
    for _ in range(steps):
        rows = torch.from_numpy(rng.choice(len(shown), min(32, len(shown)), replace=False))
        out = model(pixel_values=pixels[rows], input_ids=asked["input_ids"], attention_mask=asked["attention_mask"])
        optimizer.zero_grad()
        torch.nn.functional.cross_entropy(out.logits_per_image, right[rows]).backward()
        optimizer.step()
    return tiny.saved(model.eval(), folder, tokenizer, images)


def room_views(
    renderer: Renderer, navigation: NavigationMap, camera: Pinhole, room: str, n: int, seed: int = 0
) -> list[NDArray[np.uint8]]:
    """``n`` views (H, W, 3) from random places in a room towards its middle: not of a bare wall."""
    floor = renderer.scene.floors[0].id
    polygon = next(r.polygon_m for r in renderer.scene.rooms if r.name == room)
    outline, middle = MatplotlibPath(np.asarray(polygon)), np.mean(polygon, axis=0)
    rng, out = np.random.default_rng(seed), []
    while len(out) < n:
        x, y, z = navigation.random_point(rng, floor)
        if outline.contains_point((x, y)):
            yaw_rad = np.arctan2(middle[1] - y, middle[0] - x) + rng.uniform(-0.6, 0.6)
            T = camera_pose((x, y, z + CAMERA_HEIGHT_M), yaw_rad, 0.0)
            out.append(renderer.render(T, camera).rgb)
    return out
