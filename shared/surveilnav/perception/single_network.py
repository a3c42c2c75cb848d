"""The backend of one network that finds, cuts out and embeds: ``compact``.

The embedding space has two halves of D. A view's vector lies in the first, an object's in the second, and a text's in both: the
network has a vector for what shows or stands near, and one for what a thing is. So cosines of views and objects with a text
are the network's own, times 1 / sqrt(2).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from surveilnav.messages import ModelIds
from surveilnav.perception.backend import Backend, Stage, ViewTask
from surveilnav.perception.boxes import Boxes
from surveilnav.perception.chances import ChanceTable
from surveilnav.perception.detectors.compact import Answer, CompactNetwork
from surveilnav.perception.prompts import named
from surveilnav.perception.protocols import RgbdView
from surveilnav.perception.vocabulary import Vocabulary
from surveilnav.sensing.views import DetectedObject, ViewPerception, box_cells

#: So many classes are said to be nearest to a kind of room.
_MOST_AKIN = 5

#: Weaker things are kept out of the answer.
MIN_SCORE = 0.25


@dataclass(frozen=True, slots=True, eq=False)
class FoundThing:
    """A thing of a view: its ``row`` among the boxes, the ``place`` that speaks for it, and what ``DetectedObject`` holds of it."""

    row: int
    place: int
    label: str
    score: float
    box_px: tuple[float, float, float, float]
    mask: NDArray[np.bool_] | None


def find_things(network: CompactNetwork, answer: Answer, view: RgbdView) -> tuple[Boxes, list[FoundThing]]:
    """All boxes of what the network says of a view, weak ones included, and those that are sure enough, cut out."""
    height, width = view.rgb.shape[:2]
    boxes, places = network.things(answer, height, width)
    labels, things = boxes.labels, []
    for row in np.flatnonzero(boxes.best_scores >= MIN_SCORE).tolist():
        x0, y0, x1, y1 = boxes.xyxy[row].tolist()
        place = int(places[row])
        mask = answer.mask(place, box_cells((x0, y0, x1, y1), width, height))
        shown = mask if mask.any() else None
        things.append(FoundThing(row, place, labels[row], float(boxes.best_scores[row]), (x0, y0, x1, y1), shown))
    return boxes, things


class SingleNetworkBackend(Backend):
    """See the module's docstring."""

    def __init__(
        self, name: str, why: str, network: CompactNetwork, model: str, chances: ChanceTable | None = None
    ) -> None:
        self.name, self.why, self._network, self.chances = name, why, network, chances
        self.models = ModelIds(model, model, model)
        self._classes = Vocabulary(name, network.classes, meanings=network.meanings, akin=_akin(network))
        self.vocabulary = self._classes
        self._n = network.class_vectors.shape[1]
        self.embedding_dim = 2 * self._n
        self.stages = (Stage("look", self._look), *([Stage("judge", self.judge)] if chances else []))

    def embed_texts(self, texts: Sequence[str]) -> NDArray[np.float32]:
        rows = [self._classes.index(self._classes.resolve_name(named(text))) for text in texts]
        near, what = self._network.near_vectors[rows], self._network.class_vectors[rows]
        return np.asarray(np.concatenate([near, what], axis=1) / np.sqrt(2.0), np.float32)

    def _look(self, batch: Sequence[ViewTask]) -> None:
        for task in batch:
            task.result = self._seen(task)

    def _seen(self, task: ViewTask) -> ViewPerception:
        answer = self._network.answer(task.view)
        _, things = find_things(self._network, answer, task.view)
        detections = []
        for thing in things:
            vector = np.concatenate([np.zeros(self._n, np.float32), answer.embeddings[thing.place]])
            detections.append(DetectedObject(thing.label, thing.score, thing.box_px, thing.mask, vector))
        image = np.concatenate([answer.image, np.zeros(self._n, np.float32)])
        task.searched_words = tuple(self._classes)
        model = self.models.embedder
        return ViewPerception(self.name, tuple(detections), image, model, task.searched_words)


def _akin(network: CompactNetwork) -> dict[str, list[str]]:
    """By kind of room, the classes whose surroundings look most like it: what it is near in meaning."""
    things, rooms = np.split(network.near_vectors, [len(network.classes)])
    likeness = dict(zip(network.rooms, rooms @ things.T, strict=True))
    best = {room: np.argsort(-row, kind="stable")[:_MOST_AKIN].tolist() for room, row in likeness.items()}
    return {room: [network.classes[i] for i in order if likeness[room][i] > 0] for room, order in best.items()}
