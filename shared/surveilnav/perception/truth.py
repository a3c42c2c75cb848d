"""The backends that are told what each pixel shows: ``oracle`` says it, ``simulated`` errs like a detector.

Both exist for simulation only; they get instance ids through a channel of their own that the real backends don't have.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from surveilnav.categories import COCO, canonical
from surveilnav.errors import PerceptionError
from surveilnav.geometry import Pinhole
from surveilnav.perception import closed_set
from surveilnav.sensing.views import Detected, TrueInstances, ViewPerception, box_cells


@dataclass(frozen=True, slots=True, eq=False)
class VisibleThing:
    """What can be seen of one instance: class, box, its pixels inside the box's cells, and their median depth [m]."""

    label: str
    box_px: tuple[float, float, float, float]
    mask: NDArray[np.bool_]
    n_pixels: int
    range_m: float


def visible_things(truth: TrueInstances, depth_m: NDArray[np.float32], min_pixels: int) -> list[VisibleThing]:
    """The instances of COCO's classes that show at least ``min_pixels`` pixels with depth, by id."""
    things = []
    for id_, place in enumerate(ndimage.find_objects(truth.ids.astype(np.int32)), start=1):
        label = canonical(truth.labels.get(id_, ""))
        if place is None or label not in COCO:
            continue
        rows, cols = place
        mask = truth.ids[place] == id_
        seen = mask & (depth_m[place] > 0)
        n = int(seen.sum())
        if n < min_pixels:
            continue
        box = (float(cols.start), float(rows.start), float(cols.stop), float(rows.stop))
        things.append(VisibleThing(label, box, mask, n, float(np.median(depth_m[place][seen]))))
    return things


class Oracle:
    """Every visible instance of a COCO class, exactly, with score 1."""

    name = "oracle"
    embedding_dim = closed_set.DIM
    needs_truth = True

    def __init__(self, why: str = "asked for by name: the renderer's own instance ids", min_pixels: int = 60) -> None:
        self.why, self._min_pixels = why, min_pixels

    def perceive(
        self,
        rgb: NDArray[np.uint8],
        depth_m: NDArray[np.float32],
        camera: Pinhole,
        *,
        prompts: Sequence[str] = (),
        truth: TrueInstances | None = None,
        key: tuple[object, ...] = (),
    ) -> ViewPerception:
        things = visible_things(_told(truth, depth_m, self.name), depth_m, self._min_pixels)
        scores = [_one_hot(thing.label, 1.0) for thing in things]
        detections = tuple(
            Detected(t.label, 1.0, t.box_px, t.mask, closed_set.embed_object(s))
            for t, s in zip(things, scores, strict=True)
        )
        return ViewPerception(self.name, detections, closed_set.embed_image(scores))

    def embed_texts(self, texts: Sequence[str]) -> NDArray[np.float32]:
        return closed_set.embed_texts(texts)


class Simulated:
    """The renderer's instance ids through an error model: misses, confusions, loose boxes, false positives.

    The tables stand in data/simulated_errors.json, which says where they come from. What is drawn depends on
    ``seed`` and ``key`` alone.
    """

    name = "simulated"
    embedding_dim = closed_set.DIM
    needs_truth = True

    def __init__(self, why: str = "asked for by name", seed: int = 0) -> None:
        self.why, self._seed = why, seed

    def perceive(
        self,
        rgb: NDArray[np.uint8],
        depth_m: NDArray[np.float32],
        camera: Pinhole,
        *,
        prompts: Sequence[str] = (),
        truth: TrueInstances | None = None,
        key: tuple[object, ...] = (),
    ) -> ViewPerception:
        told = _told(truth, depth_m, self.name)
        errors = error_model()
        rng = np.random.default_rng(_seed_of(self._seed, key))
        found = [self._draw(thing, rng, errors, depth_m.shape) for thing in visible_things(told, depth_m, 100)]
        found += self._false_positives(rng, errors, depth_m, camera)
        seen = [f for f in found if f is not None]
        detections = tuple(d for d, _ in seen if d.score >= errors["min_score"])
        return ViewPerception(self.name, detections, closed_set.embed_image([s for _, s in seen]))

    def embed_texts(self, texts: Sequence[str]) -> NDArray[np.float32]:
        return closed_set.embed_texts(texts)

    def _draw(
        self, thing: VisibleThing, rng: np.random.Generator, errors: dict, shape: tuple[int, ...]
    ) -> tuple[Detected, NDArray[np.float32]] | None:
        """The detection of a visible thing, or None if it is missed. Draws the same number of times either way."""
        luck, confused, jitter = rng.random(), rng.random(), rng.normal(size=4)
        low, high = errors["true_scores"]
        score = float(low + (high - low) * rng.beta(2.0, 2.0))
        row = int(np.searchsorted(errors["range_edges_m"], thing.range_m))
        col = int(np.searchsorted(errors["side_edges_px"], np.sqrt(thing.n_pixels)))
        if luck >= errors["recall"][row][col]:
            return None
        label, scores = thing.label, _one_hot(thing.label, score)
        cumulative = 0.0
        for other, share in errors["confusions"].get(thing.label, {}).items():
            cumulative += share
            if confused < cumulative:
                scores = _one_hot(other, 0.8 * score) + _one_hot(label, 0.5 * score)
                label, score = other, 0.8 * score
                break
        x0, y0, x1, y1 = thing.box_px
        size = np.array([x1 - x0, y1 - y0, x1 - x0, y1 - y0])
        box = np.array(thing.box_px) + np.clip(jitter, -2, 2) * errors["box_jitter"] * size
        box = np.clip(box, 0, [shape[1], shape[0], shape[1], shape[0]])
        if min(box[2] - box[0], box[3] - box[1]) < 3:
            box = np.array(thing.box_px)
        new_box = (float(box[0]), float(box[1]), float(box[2]), float(box[3]))
        mask = mask_within(thing, new_box, shape)
        return Detected(label, score, new_box, mask, closed_set.embed_object(scores)), scores

    def _false_positives(
        self, rng: np.random.Generator, errors: dict, depth_m: NDArray[np.float32], camera: Pinhole
    ) -> list[tuple[Detected, NDArray[np.float32]]]:
        out = []
        labels = list(errors["false_positives"]["labels"])
        shares = np.array(list(errors["false_positives"]["labels"].values()), dtype=float)
        low, high = errors["false_positives"]["scores"]
        for _ in range(int(rng.poisson(errors["false_positives"]["per_view"]))):
            label = labels[int(rng.choice(len(labels), p=shares / shares.sum()))]
            score = float(low + (high - low) * rng.beta(1.0, 2.5))
            side = np.exp(rng.uniform(np.log(0.06), np.log(0.35), 2)) * camera.height_px
            corner = rng.random(2) * np.array([camera.width_px - side[0], camera.height_px - side[1]])
            box = (float(corner[0]), float(corner[1]), float(corner[0] + side[0]), float(corner[1] + side[1]))
            scores = _one_hot(label, score)
            out.append((Detected(label, score, box, None, closed_set.embed_object(scores)), scores))
        return out


@lru_cache(maxsize=1)
def error_model() -> dict:
    """data/simulated_errors.json."""
    model: dict = json.loads((Path(__file__).parent / "data" / "simulated_errors.json").read_text(encoding="utf-8"))
    return model


def _seed_of(seed: int, key: tuple[object, ...]) -> int:
    return int.from_bytes(hashlib.sha256(repr((seed, key)).encode()).digest()[:8], "little")


def _one_hot(label: str, score: float) -> NDArray[np.float32]:
    scores = np.zeros(len(COCO), np.float32)
    scores[COCO.index(label)] = score
    return scores


def mask_within(
    thing: VisibleThing, box: tuple[float, float, float, float], shape: tuple[int, ...]
) -> NDArray[np.bool_]:
    """The thing's pixels inside another box."""
    x0, y0, x1, y1 = box_cells(box, shape[1], shape[0])
    left, top = int(thing.box_px[0]), int(thing.box_px[1])
    mask = np.zeros((y1 - y0, x1 - x0), bool)
    a0, b0 = max(x0, left), max(y0, top)
    a1, b1 = min(x1, left + thing.mask.shape[1]), min(y1, top + thing.mask.shape[0])
    if a0 < a1 and b0 < b1:
        mask[b0 - y0 : b1 - y0, a0 - x0 : a1 - x0] = thing.mask[b0 - top : b1 - top, a0 - left : a1 - left]
    return mask


def _told(truth: TrueInstances | None, depth_m: NDArray[np.float32], name: str) -> TrueInstances:
    if truth is None:
        raise PerceptionError(f"the backend {name!r} needs the simulator's instance ids of the view, and got none")
    if truth.ids.shape != depth_m.shape:
        raise PerceptionError(f"instance ids of {truth.ids.shape} don't fit a view of {depth_m.shape}")
    return truth
