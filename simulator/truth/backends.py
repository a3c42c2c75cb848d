"""The backends that are told what each pixel shows: ``oracle`` says it, ``simulated`` errs like a detector.

Both exist for simulation only; they get instance ids through a channel of their own that the real backends don't have.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import cache, partial

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from surveilnav.errors import PerceptionError
from surveilnav.geometry import Matrix4, Pinhole
from surveilnav.messages import ModelIds
from surveilnav.perception.backend import Backend, Stage, ViewTask
from surveilnav.perception.chances import chance_table
from surveilnav.perception.embedders import class_space
from surveilnav.perception.embedders.class_space import ClassSpace
from surveilnav.perception.segmenters.depth_in_box import find_floor, find_mask
from surveilnav.perception.sizes import WRONG_SIZE_FACTOR, extent_m, extents_of, is_plausible
from surveilnav.perception.vocabulary import COCO
from surveilnav.sensing.views import DetectedObject, TrueInstances, ViewPerception
from surveilnav.simulator.truth import name_space
from surveilnav.simulator.truth.error_model import (
    Draws,
    ErrorModel,
    Kind,
    Luck,
    error_model,
    hashed,
    showing,
    sights,
    uniforms,
)
from surveilnav.simulator.truth.visible import (
    Box,
    Candidates,
    Place,
    VisibleThing,
    candidates,
    measured,
    visible_things,
)
from surveilnav.words import canonical

_EXTENTS_M = extents_of(COCO)
_WEAKEST = 0.05  # weaker scores are noise, which real detectors leave out of a view's embedding too
_SAME_THING_IOU = 0.5
_NAMES = 4  # that are tried for one of which things are as large
_HAZE_M = 1.5
_HAZE = Luck(0.2, 0.5, 0.6, 2.0)


class Oracle(Backend):
    """Every visible instance that is called by a name of COCO's or by a prompt, exactly, with score 1."""

    name = "oracle"
    models = ModelIds(detector="instance-ids", segmenter="instance-ids", embedder=name_space.MODEL)
    embedding_dim = name_space.DIM
    needs_truth = True

    def __init__(self, why: str = "asked for by name: the renderer's own instance ids", min_pixels: int = 60) -> None:
        self.why, self._min_pixels = why, min_pixels
        self.stages = (Stage("detect", self._look),)

    @property
    def calibrated(self) -> bool:
        """It is told the truth, so every chance is 1."""
        return True

    def embed_texts(self, texts: Sequence[str]) -> NDArray[np.float32]:
        return name_space.embed_texts(texts)

    def _look(self, batch: Sequence[ViewTask]) -> None:
        for task in batch:
            words = tuple(dict.fromkeys((*COCO, *(canonical(prompt) for prompt in task.prompts))))
            truth = _required_truth(task.truth, task.view.depth_m, self.name)
            things = visible_things(truth, task.view.depth_m, self._min_pixels, words)
            detections = tuple(
                DetectedObject(t.label, 1.0, t.box_px, t.mask, name_space.embed_object(t.label), chance=1.0)
                for t in things
            )
            image = name_space.embed_image([thing.label for thing in things])
            task.result = ViewPerception(self.name, detections, image, self.models.embedder, words)


class PerfectDetector(Backend):
    """A backend as it would be with a perfect detector: it says what things are by the truth, and what they look like itself.

    Views have the backend's own embeddings. So has a thing, if the backend detected something in its place, whatever it called
    it; else its embedding is that of its name. Things of which the backend knows no name are left out.
    """

    name = Oracle.name
    needs_truth = True

    def __init__(self, looks: Backend) -> None:
        self._looks, self._oracle = looks, Oracle()
        self.why = f"{looks.name} as it would be with a perfect detector"
        self.models, self.vocabulary, self.embedding_dim = looks.models, looks.vocabulary, looks.embedding_dim
        self.stages = (Stage("detect", self._look),)

    @property
    def calibrated(self) -> bool:
        """It is told the truth, so every chance is 1."""
        return True

    def embed_texts(self, texts: Sequence[str]) -> NDArray[np.float32]:
        return self._looks.embed_texts(texts)

    def _look(self, batch: Sequence[ViewTask]) -> None:
        for task in batch:
            rgb, depth_m, camera = task.view.rgb, task.view.depth_m, task.view.camera
            shared = {"prompts": task.prompts, "key": task.key}
            own_truth = task.truth if self._looks.needs_truth else None
            own = self._looks.perceive(rgb, depth_m, camera, truth=own_truth, **shared)  # type: ignore[arg-type]
            told = self._oracle.perceive(rgb, depth_m, camera, truth=task.truth, **shared)  # type: ignore[arg-type]
            named = [d for d in told.detections if not self._looks.refusal(d.label)]
            detections = tuple(replace(d, embedding=self._embedding(d, own.detections)) for d in named)
            task.result = replace(own, backend=self.name, detections=detections)

    def _embedding(self, thing: DetectedObject, own: Sequence[DetectedObject]) -> NDArray[np.float32]:
        """What a thing looks like (D,)."""
        there = max(own, key=lambda d: _iou(d.box_px, thing.box_px), default=None)
        if there is not None and _iou(there.box_px, thing.box_px) >= _SAME_THING_IOU:
            return there.embedding
        return np.asarray(self._looks.embed_texts([thing.label])[0], np.float32)


class Simulated(Backend):
    """The renderer's instance ids through an error model: misses, confusions, loose boxes, false positives.

    Its masks are what depth says in its boxes, as the masks of the detector that it imitates.
    What it errs depends on ``seed``, the view's ``key``, and where the view was taken from (``error_model``).
    ``harder``: a worse detector than the measured one (negative: a better one), in standard deviations of luck by which
    true things are harder to find and to name, and false alarms easier to give.
    """

    name = "simulated"
    models = ModelIds(detector="error-model", segmenter="error-model", embedder=ClassSpace.model)
    vocabulary = COCO
    embedding_dim = class_space.DIM
    needs_truth = True

    def __init__(
        self, why: str = "asked for by name", seed: int = 0, model: ErrorModel | None = None, harder: float = 0.0
    ) -> None:
        self.why, self._seed, self._model, self._harder = why, seed, model or error_model(), harder
        self._scene: tuple[dict[int, str], dict[int, str], int] = ({}, {}, 0)
        self.chances = chance_table("compact")  # that is what it imitates
        self.stages = (Stage("detect", self._look), Stage("calibrate", self.assign_chances))

    def _look(self, batch: Sequence[ViewTask]) -> None:
        for task in batch:
            task.result = self._seen(task)

    def _seen(self, task: ViewTask) -> ViewPerception:
        depth_m, camera, key = task.view.depth_m, task.view.camera, task.key
        truth = _required_truth(task.truth, depth_m, self.name)
        labels, scene = self._scene_of(truth.labels)
        truth = replace(truth, labels=labels)
        is_camera = any(isinstance(part, str) and part.startswith("camera/") for part in key)
        view = hashed(scene, key)
        detections, weak = [], []
        shown: dict[str, float] = {}
        floor = cache(partial(find_floor, depth_m, camera))  # views without detections don't ask
        for c in candidates(truth, depth_m, camera, is_camera, self._model.min_size_rad):
            shown |= showing(c.labels, c.x) if c.kind != "place" else {}
            for detected, scores in self._found(c, scene, view, depth_m, camera, floor):
                weak.append(scores)
                if detected is not None:
                    detections.append(detected)
        detections.sort(key=lambda d: -d.score)
        clear = 1.0 - np.prod([1.0 - scores for scores in weak], axis=0) if weak else np.zeros(len(COCO), np.float32)
        presence = np.maximum(clear, self._haze(scene, view, truth.T_world_camera, shown, is_camera))
        return ViewPerception(
            self.name, tuple(detections), class_space.embed_image([presence]), ClassSpace.model, tuple(COCO)
        )

    def embed_texts(self, texts: Sequence[str]) -> NDArray[np.float32]:
        return class_space.embed_texts(texts)

    def _haze(
        self, scene: int, view: int, T_world_camera: Matrix4 | None, shown: dict[str, float], is_camera: bool
    ) -> NDArray[np.float32]:
        """(80,) what weak scores seem to show of each class: it goes by what else shows (ovens seem to be where cabinets
        are), and is much the same in like views from about the same place."""
        T = np.eye(4) if T_world_camera is None else T_world_camera
        scene = hashed(scene, np.floor(T[:3, 3] / _HAZE_M).astype(int).tolist())
        n = len(self._model.haze)
        draws = Draws(scene, view, np.arange(n, dtype=np.uint64), np.tile(T[:3, 2], (n, 1)), np.ones(n))
        haze = np.zeros(len(COCO), np.float32)
        for (label, of), luck in zip(self._model.haze.items(), draws.luck(_HAZE, 5).tolist(), strict=True):
            share = float(ndtr(of.more(shown, is_camera) + of.luck * luck))
            haze[COCO.index(label)] = _quantile(of.quantiles, share)
        return haze

    def _scene_of(self, labels: dict[int, str]) -> tuple[dict[int, str], int]:
        """The labels that its figures are for, and a seed that sets the luck of one building's instances apart from
        another's."""
        if self._scene[0] is not labels:
            known = measured(labels)
            self._scene = labels, known, hashed(self._seed, sorted(known.items()))
        return self._scene[1], self._scene[2]

    def _found(
        self,
        c: Candidates,
        scene: int,
        view: int,
        depth_m: NDArray[np.float32],
        camera: Pinhole,
        floor: Callable[[], NDArray[np.bool_] | None],
    ) -> Iterator[tuple[DetectedObject | None, NDArray[np.float32]]]:
        """Detection (None: nothing is reported) and class scores of what is found among candidates of one kind."""
        kind = self._model.kinds[c.kind]
        draws = Draws(scene, view, c.ids, c.direction, c.range_m)
        easier = -self._harder if c.kind == "thing" else self._harder
        ease = kind.ease(c.x, c.labels) + draws.luck(kind.luck, 0) + easier
        right = np.zeros(len(ease), bool)
        if kind.own:
            right = kind.own_ease(c.x, c.labels) + draws.luck(kind.own_luck, 1) + easier > 0
        scores = np.where(right, kind.score(ease, True), kind.score(ease, False))
        once, always = uniforms(view, c.ids, 4, 2), uniforms(scene, c.ids, 40)
        sight_of = sights(c.x)
        for i in np.flatnonzero(scores >= _WEAKEST).tolist():
            label, sight, score = c.labels[i], sight_of[i], float(scores[i])
            reported = ease[i] > 0 and score >= self._model.min_score
            box, mask, fits = None, None, True
            if right[i]:
                said, of = label, "right"
                if reported:
                    box = _box(c.shown[i], _one_of(kind.boxes[of], once[i, 1]), depth_m, camera)
                    mask = find_mask(depth_m, box, floor())
            else:  # nothing tells what a false alarm's object is but depth in its box, and its size what it isn't
                names, of = self._names(kind, c, i, sight, scene, view), "wrong"
                said = names[0]
                for name in names if reported else ():
                    box = _box(c.shown[i], _one_of(kind.boxes.get(name, kind.boxes[of]), always[i, 0]), depth_m, camera)
                    mask = find_mask(depth_m, box, floor())
                    fits = _fits(name, *_size_of(box, mask, depth_m, camera))
                    if fits:
                        said = name
                        break
            all_scores = _all_scores(said, score, _quantile(kind.certainty[of], once[i, 0]), kind.rest(label, sight))
            detected = None
            if not fits:
                all_scores *= WRONG_SIZE_FACTOR
            elif box is not None and min(box[2] - box[0], box[3] - box[1]) >= 2:
                detected = DetectedObject(said, score, box, mask, class_space.embed_object(all_scores))
            yield detected, all_scores

    def _names(self, kind: Kind, c: Candidates, i: int, sight: str, scene: int, view: int) -> list[str]:
        """What a thing is wrongly called, and what else if that doesn't fit: mostly the same from everywhere."""
        id_ = c.ids[i : i + 1]
        of = scene if uniforms(view, id_, 2)[0, 0] < kind.name_kept else view
        return kind.called(c.labels[i], sight, uniforms(of, id_, 6, len(COCO))[0])[:_NAMES]


def _iou(a: Box, b: Box) -> float:
    """Intersection over union of two boxes."""
    width, height = min(a[2], b[2]) - max(a[0], b[0]), min(a[3], b[3]) - max(a[1], b[1])
    shared = max(0.0, width) * max(0.0, height)
    areas = [(box[2] - box[0]) * (box[3] - box[1]) for box in (a, b)]
    return shared / max(sum(areas) - shared, 1e-9)


def _one_of(boxes: Sequence[Sequence[float]], luck: float) -> Sequence[float]:
    return boxes[int(luck * len(boxes))]


def _quantile(values: Sequence[float], share: float) -> float:
    at = share * (len(values) - 1)
    low = min(int(at), len(values) - 2)
    return values[low] + (at - low) * (values[low + 1] - values[low]) if len(values) > 1 else values[0]


def _all_scores(said: str, score: float, certainty: float, rest: NDArray[np.float64]) -> NDArray[np.float32]:
    """(80,) class scores of which one has a share of ``certainty``, the others what ``rest`` says."""
    rest[COCO.index(said)] = 0.0
    out = rest * (score * (1 / certainty - 1) / max(rest.sum(), 1e-9))
    out = np.minimum(out, score)
    out[COCO.index(said)] = score
    return np.asarray(out, np.float32)


def _box(shown: VisibleThing | Place, loose: Sequence[float], depth_m: NDArray[np.float32], camera: Pinhole) -> Box:
    """The box of a detection that is as loose as a measured one."""
    height, width = depth_m.shape
    if isinstance(shown, Place):
        half = np.array([loose[0], loose[1]]) * camera.fx_px / shown.range_m / 2
        corners = np.array([*(shown.center_px - half), *(shown.center_px + half)])
    else:
        x0, y0, x1, y1 = shown.box_px
        corners = np.array([x0, y0, x0, y0]) + np.array(loose) * np.array([x1 - x0, y1 - y0, x1 - x0, y1 - y0])
    x0, y0, x1, y1 = (float(v) for v in np.clip(corners, 0, [width, height, width, height]))
    return x0, y0, x1, y1


def _size_of(
    box: Box, mask: NDArray[np.bool_] | None, depth_m: NDArray[np.float32], camera: Pinhole
) -> tuple[float | None, bool]:
    """How large [m] what a mask shows is, None if depth doesn't tell, and whether the picture's edge cuts it."""
    height, width = depth_m.shape
    cut = box[0] < 1 or box[1] < 1 or box[2] > width - 1 or box[3] > height - 1
    return extent_m(depth_m, camera, box, mask) if mask is not None else None, cut


def _fits(name: str, size_m: float | None, cut: bool) -> bool:
    """Whether something is as large as things of a class, as far as depth tells."""
    return size_m is None or is_plausible(_EXTENTS_M, name, size_m, cut)


def _required_truth(truth: TrueInstances | None, depth_m: NDArray[np.float32], name: str) -> TrueInstances:
    if truth is None:
        raise PerceptionError(f"the backend {name!r} needs the simulator's instance ids of the view, and got none")
    if truth.ids.shape != depth_m.shape:
        raise PerceptionError(f"instance ids of {truth.ids.shape} don't fit a view of {depth_m.shape}")
    return truth
