"""Batches for training: views drawn, decoded and varied anew at every step, the same for the same seed and step.

A step's views are all of one kind, so that a batch has one size. Varying: mirror, zoom, crop, clutter that hides, colour,
gamma, blur, noise, JPEG. Boxes are taken from the varied ids, so that they are exact after every crop.
"""

from __future__ import annotations

import math
import multiprocessing
from collections import Counter, deque
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from dataclasses import dataclass

import cv2
import numpy as np
import torch
from numpy.typing import NDArray

from surveilnav.geometry import Pinhole
from surveilnav.perception.detectors.depth_channels import depth_channels
from training.detector.assign import Targets
from training.detector.losses import Batch
from training.detector.pack import Pack
from training.detector.poses import Kind
from training.detector.views import TrainingView, visible_boxes

#: (width, height) of batches; multiples of 32. Training begins with small ones, which cost half: pieces of pictures, not
#: small pictures, since things must be as large as they are in use.
CANVAS: dict[Kind, tuple[int, int]] = {"robot": (320, 256), "camera": (320, 320)}
SMALL_CANVAS: dict[Kind, tuple[int, int]] = {"robot": (192, 160), "camera": (224, 224)}
_ROBOT_SHARE = 0.5
#: Of a picture that would fill the large canvas; on a small canvas whole things should show now and then.
_ZOOM, _SMALL_ZOOM = (0.75, 1.6), (0.55, 1.5)
_GREY = 114
#: Chances of each way of varying.
_CLUTTER, _BLUR, _NOISE, _JPEG = 0.3, 0.15, 0.3, 0.3
#: So often there is no depth at all, as with photographs.
_NO_DEPTH = 0.05
_AHEAD = 3
#: A class that more of the views show isn't drawn more often.
_COMMON, _MAX_REPEATS = 0.5, 5.0


@dataclass(frozen=True, slots=True, eq=False)
class Example:
    """One varied view: ``rgb`` (H, W, 3) uint8, ``depth`` (H / 2, W / 2, 7) as ``depth_channels`` has it, ``ids`` (H, W) uint8,
    ``boxes`` (N, 4) float32, ``labels`` (N,) int64 of the objects 1 to N of ``ids``; ``near`` (C,) bool, ``room`` as in
    ``TrainingView``."""

    rgb: NDArray[np.uint8]
    depth: NDArray[np.float32]
    ids: NDArray[np.uint8]
    boxes: NDArray[np.float32]
    labels: NDArray[np.int64]
    near: NDArray[np.bool_]
    room: int


class Views:
    """All views of some packs, drawn by seed and step. Those of the first ``small_steps`` steps come on small canvases.

    A view with a rare class is drawn more often (repeat factors, Gupta et al. 2019): chairs show in half of the views,
    toilets in one of twenty, and a network calls everything a chair before it has seen enough of others.
    """

    def __init__(self, packs: Sequence[Pack], seed: int = 0, small_steps: int = 0) -> None:
        self._packs, self._seed, self._small_steps = packs, seed, small_steps
        self._rows: dict[Kind, list[tuple[int, int]]] = {"robot": [], "camera": []}
        for p, pack in enumerate(packs):
            for i, view in enumerate(pack.views):
                self._rows[view.kind].append((p, i))
        repeats = repeat_factors([pack.views[i].labels for pack in packs for i in range(len(pack.views))])
        of_label = np.array([repeats.get(label, 1.0) for label in range(1 + max(repeats, default=0))])
        self._weights: dict[Kind, NDArray[np.float64]] = {
            kind: np.cumsum([of_label[packs[p].views[i].labels].max(initial=1.0) for p, i in rows])
            for kind, rows in self._rows.items()
        }

    def __len__(self) -> int:
        return sum(map(len, self._rows.values()))

    def batch(self, step: int, size: int) -> Batch:
        rng = np.random.default_rng([self._seed, step])
        kinds: list[Kind] = [kind for kind in ("robot", "camera") if self._rows[kind]]
        kind = kinds[0] if len(kinds) == 1 or rng.random() < _ROBOT_SHARE else kinds[1]
        rows, weights = self._rows[kind], self._weights[kind]
        chosen = [rows[i] for i in np.searchsorted(weights, rng.random(size) * weights[-1], side="right")]
        canvas = (SMALL_CANVAS if step < self._small_steps else CANVAS)[kind]
        return collate([varied(self._packs[p].view(i), canvas, rng) for p, i in chosen])

    def batches(self, first: int, last: int, size: int, workers: int = 1) -> Iterator[Batch]:
        """The batches of steps ``first`` to ``last`` - 1, made ahead: on one thread, or by several processes."""
        with _pool(self, workers) as pool:
            make = self.batch if workers <= 1 else _batch_of_worker
            waiting: deque[Future[Batch]] = deque()
            for step in range(first, last):
                while len(waiting) < _AHEAD * workers and step + len(waiting) < last:
                    waiting.append(pool.submit(make, step + len(waiting), size))
                yield waiting.popleft().result()


def repeat_factors(labels: Sequence[Sequence[int]]) -> dict[int, float]:
    """By class, how often a view that shows it is drawn for one that shows none rarer: sqrt(t / share of views with it), 1
    where the share is above ``_COMMON``. ``labels``: of each view's objects."""
    often = Counter(label for shown in labels for label in set(shown))
    return {label: min(_MAX_REPEATS, max(1.0, math.sqrt(_COMMON * len(labels) / n))) for label, n in often.items()}


def _pool(views: Views, workers: int) -> Executor:
    if workers <= 1:
        return ThreadPoolExecutor(1)
    return ProcessPoolExecutor(workers, multiprocessing.get_context("spawn"), _begin_worker, (views,))


_OF_WORKER: list[Views] = []


def _begin_worker(views: Views) -> None:
    """A process takes the views once; OpenCV's own threads would only get into the others' way."""
    cv2.setNumThreads(0)
    torch.set_num_threads(1)
    _OF_WORKER[:] = [views]


def _batch_of_worker(step: int, size: int) -> Batch:
    return _OF_WORKER[0].batch(step, size)


def varied(view: TrainingView, canvas: tuple[int, int], rng: np.random.Generator) -> Example:
    """A view as it is never seen again, on a canvas of (width, height)."""
    shot = _framed(view, canvas, rng)
    if rng.random() < _CLUTTER:
        _clutter(shot, rng)
    depth = shot.channels() * np.float32(rng.random() >= _NO_DEPTH)
    rgb = _recoloured(shot.rgb, rng)
    boxes, labels, ids = _objects(shot.ids, view.labels)
    return Example(_spoilt(rgb, rng), depth, ids, boxes, labels, view.near, view.room)


def plain(view: TrainingView, canvas: tuple[int, int]) -> Example:
    """A view as it is, at the top left of the canvas, reduced if it is larger."""
    height, width = view.ids.shape
    zoom = min(1.0, canvas[0] / width, canvas[1] / height)
    shot = _warped(view, canvas, np.array([[zoom, 0, 0], [0, zoom, 0]], np.float64), _GREY)
    boxes, labels, ids = _objects(shot.ids, view.labels)
    return Example(shot.rgb, shot.channels(), ids, boxes, labels, view.near, view.room)


@dataclass(frozen=True, slots=True, eq=False)
class _Shot:
    """A view on its canvas: ``rgb`` (H, W, 3), ``ids`` and ``depth_m`` (H, W), and the lens that it would have."""

    rgb: NDArray[np.uint8]
    ids: NDArray[np.uint8]
    depth_m: NDArray[np.float32]
    lens: Pinhole

    def channels(self) -> NDArray[np.float32]:
        return depth_channels(self.depth_m, self.lens, self.lens.width_px // 2, self.lens.height_px // 2)


def _framed(view: TrainingView, canvas: tuple[int, int], rng: np.random.Generator) -> _Shot:
    """Mirrored or not, zoomed, and shifted so that picture and canvas overlap as far as they can."""
    height, width = view.ids.shape
    full = CANVAS[view.kind]
    zoom = full[0] / width * float(np.exp(rng.uniform(*np.log(_ZOOM if canvas == full else _SMALL_ZOOM))))
    shift = [
        rng.uniform(min(0.0, room), max(0.0, room)) for room in (canvas[0] - zoom * width, canvas[1] - zoom * height)
    ]
    move = np.array([[zoom, 0, shift[0]], [0, zoom, shift[1]]], np.float64)
    if rng.random() < 0.5:
        move[0] = [-zoom, 0, shift[0] + zoom * (width - 1)]
    return _warped(view, canvas, move, int(rng.integers(60, 180)))


def _warped(view: TrainingView, canvas: tuple[int, int], move: NDArray[np.float64], grey: int) -> _Shot:
    rgb = view.rgb
    if abs(move[0, 0]) < 0.8:  # what is reduced by samples alone gets jagged
        rgb = cv2.GaussianBlur(rgb, (0, 0), 0.4 / abs(float(move[0, 0]))).astype(np.uint8)
    moved = cv2.warpAffine(rgb, move, canvas, flags=cv2.INTER_LINEAR, borderValue=(grey, grey, grey))
    ids = cv2.warpAffine(view.ids, move, canvas, flags=cv2.INTER_NEAREST, borderValue=0)
    depth = cv2.warpAffine(view.depth_m, move, canvas, flags=cv2.INTER_NEAREST, borderValue=0)
    height, width = view.ids.shape
    was = Pinhole.from_hfov(width, height, view.hfov_rad)
    zoom = float(move[1, 1])
    lens = Pinhole(
        *canvas,
        was.fx_px * zoom,
        was.fy_px * zoom,
        float(move[0, 0]) * was.cx_px + float(move[0, 2]),
        zoom * was.cy_px + float(move[1, 2]),
    )
    return _Shot(moved.astype(np.uint8), ids.astype(np.uint8), depth.astype(np.float32), lens)


def _clutter(shot: _Shot, rng: np.random.Generator) -> None:
    """Some ellipses and boxes of one colour with stripes hide parts, in place, from half their distance or more."""
    rgb, ids, depth_m = shot.rgb, shot.ids, shot.depth_m
    height, width = ids.shape
    for _ in range(rng.integers(1, 4)):
        size = rng.uniform(0.03, 0.2, 2) * (width, height)
        middle = (int(rng.integers(width)), int(rng.integers(height)))
        angle = float(rng.uniform(0, 180))
        hidden = np.zeros_like(ids)
        if rng.random() < 0.5:
            cv2.ellipse(hidden, middle, (int(size[0]) + 1, int(size[1]) + 1), angle, 0, 360, 1, -1)
        else:
            corners = cv2.boxPoints((middle, (2 * float(size[0]), 2 * float(size[1])), angle))
            cv2.fillConvexPoly(hidden, corners.astype(np.int32), 1)
        where = hidden > 0
        stripes = rng.uniform(0, 40) * np.sin(np.arange(width) / rng.uniform(1, 8))
        colour = rng.uniform(0, 255, 3) + stripes[np.nonzero(where)[1], None]
        rgb[where], ids[where] = np.clip(colour, 0, 255).astype(np.uint8), 0
        behind = depth_m[where]
        if (behind > 0).any():
            depth_m[where] = rng.uniform(0.5, 0.95) * behind[behind > 0].min()


def _recoloured(rgb: NDArray[np.uint8], rng: np.random.Generator) -> NDArray[np.uint8]:
    """Another exposure, white balance, contrast, gamma and saturation."""
    x = np.linspace(0, 1, 256)
    gamma, gain = np.exp(rng.normal(0, 0.25)), np.exp(rng.normal(0, 0.2))
    tint, lift = np.exp(rng.normal(0, 0.07, 3)), rng.normal(0, 0.05)
    table = np.clip(255 * (lift + gain * tint[None, :] * x[:, None] ** gamma), 0, 255).astype(np.uint8)
    out = np.stack([table[:, k][rgb[..., k]] for k in range(3)], axis=-1)
    grey = cv2.cvtColor(out, cv2.COLOR_RGB2GRAY)[..., None].repeat(3, axis=2)
    share = float(np.clip(rng.normal(1.0, 0.3), 0.0, 1.6))
    mixed: NDArray[np.uint8] = cv2.addWeighted(out, share, grey, 1.0 - share, 0.0).astype(np.uint8)
    return mixed


def _spoilt(rgb: NDArray[np.uint8], rng: np.random.Generator) -> NDArray[np.uint8]:
    """Blur, noise and JPEG, each at times."""
    blurs, noises, packs = rng.random(3) < (_BLUR, _NOISE, _JPEG)
    if blurs:
        rgb = cv2.GaussianBlur(rgb, (0, 0), float(rng.uniform(0.4, 1.5))).astype(np.uint8)
    if noises:
        coarse = rng.normal(0, rng.uniform(2, 10), rgb.shape).astype(np.float32)
        rgb = np.clip(rgb + coarse, 0, 255).astype(np.uint8)
    if packs:
        _, data = cv2.imencode(".jpg", rgb, [cv2.IMWRITE_JPEG_QUALITY, int(rng.integers(40, 90))])
        decoded = cv2.imdecode(data, cv2.IMREAD_COLOR)
        assert decoded is not None
        rgb = decoded.astype(np.uint8)
    return rgb


def _objects(
    ids: NDArray[np.uint8], labels: NDArray[np.int64]
) -> tuple[NDArray[np.float32], NDArray[np.int64], NDArray[np.uint8]]:
    """(boxes, labels, ids renumbered) of the objects that still show enough."""
    found = list(visible_boxes(ids, len(labels)))
    numbers = [number for number, _, _ in found]
    table = np.zeros(256, np.uint8)
    table[numbers] = np.arange(1, len(found) + 1)
    boxes = np.array([box for _, _, box in found], np.float32).reshape(-1, 4)
    return boxes, labels[[number - 1 for number in numbers]].astype(np.int64), table[ids]


def collate(examples: Sequence[Example]) -> Batch:
    """One batch of examples of one size."""
    most = max((len(e.labels) for e in examples), default=0)
    boxes = np.zeros((len(examples), most, 4), np.float32)
    labels = np.zeros((len(examples), most), np.int64)
    real = np.zeros((len(examples), most), bool)
    for b, e in enumerate(examples):
        n = len(e.labels)
        boxes[b, :n], labels[b, :n], real[b, :n] = e.boxes, e.labels, True
    pictures = torch.from_numpy(np.stack([e.rgb for e in examples])).permute(0, 3, 1, 2)  # channels last, in memory
    depth = torch.from_numpy(np.stack([e.depth for e in examples])).permute(0, 3, 1, 2)
    ids = np.stack([e.ids[2::4, 2::4] for e in examples])
    return Batch(
        pictures,
        depth,
        torch.from_numpy(ids),
        Targets(torch.from_numpy(boxes), torch.from_numpy(labels), torch.from_numpy(real)),
        torch.from_numpy(np.stack([e.near for e in examples]).astype(np.float32)),
        torch.tensor([e.room for e in examples]),
    )
