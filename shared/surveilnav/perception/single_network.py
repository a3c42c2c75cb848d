"""The backend ``compact``: one network that detects, segments and embeds.

The network has two embeddings of each class: what a view looks like that shows the class or its usual surroundings, and what
an object of the class looks like. A vector of the backend's space has 2 D numbers: a view's embedding has its D numbers in
the first half, an object's in the second, and a text's in both. The cosine of a view or an object with a text is therefore
the network's own cosine, times 1 / sqrt(2).
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
from surveilnav.perception.detectors.compact import CompactNetwork, NetworkOutput
from surveilnav.perception.prompts import word_in_prompt
from surveilnav.perception.protocols import RgbdView
from surveilnav.perception.vocabulary import Vocabulary
from surveilnav.sensing.views import DetectedObject, ViewPerception, box_cells

#: Number of classes that are suggested for a kind of room.
_MAX_RELATED = 5

#: Objects with a lower score aren't reported.
MIN_SCORE = 0.25


@dataclass(frozen=True, slots=True, eq=False)
class FoundThing:
    """An object in a view.

    Attributes:
        row: its row among the boxes.
        place: the place of the network's output grid that detected it.
        label, score, box_px, mask: see ``DetectedObject``.
    """

    row: int
    place: int
    label: str
    score: float
    box_px: tuple[float, float, float, float]
    mask: NDArray[np.bool_] | None


def find_things(network: CompactNetwork, output: NetworkOutput, view: RgbdView) -> tuple[Boxes, list[FoundThing]]:
    """All boxes in the network's output for a view, and, with their masks, the objects whose score suffices."""
    height, width = view.rgb.shape[:2]
    boxes, places = network.boxes(output, height, width)
    labels, things = boxes.labels, []
    for row in np.flatnonzero(boxes.best_scores >= MIN_SCORE).tolist():
        x0, y0, x1, y1 = boxes.xyxy[row].tolist()
        place = int(places[row])
        mask = output.mask(place, box_cells((x0, y0, x1, y1), width, height))
        shown = mask if mask.any() else None
        things.append(FoundThing(row, place, labels[row], float(boxes.best_scores[row]), (x0, y0, x1, y1), shown))
    return boxes, things


class SingleNetworkBackend(Backend):
    """See the module's docstring. The arguments are attributes of ``Backend``; ``model``: the id of the network."""

    def __init__(
        self, name: str, why: str, network: CompactNetwork, model: str, chances: ChanceTable | None = None
    ) -> None:
        self.name, self.why, self._network, self.chances = name, why, network, chances
        self.models = ModelIds(model, model, model)
        self._classes = Vocabulary(name, network.classes, meanings=network.meanings, akin=_classes_near_rooms(network))
        self.vocabulary = self._classes
        self._n = network.class_vectors.shape[1]
        self.embedding_dim = 2 * self._n
        self.stages = (Stage("look", self._look), *([Stage("calibrate", self.assign_chances)] if chances else []))

    def embed_texts(self, texts: Sequence[str]) -> NDArray[np.float32]:
        rows = [self._classes.index(self._classes.resolve_name(word_in_prompt(text))) for text in texts]
        near, what = self._network.near_vectors[rows], self._network.class_vectors[rows]
        return np.asarray(np.concatenate([near, what], axis=1) / np.sqrt(2.0), np.float32)

    def _look(self, batch: Sequence[ViewTask]) -> None:
        for task in batch:
            task.result = self._seen(task)

    def _seen(self, task: ViewTask) -> ViewPerception:
        output = self._network.run(task.view)
        _, things = find_things(self._network, output, task.view)
        detections = []
        for thing in things:
            vector = np.concatenate([np.zeros(self._n, np.float32), output.embeddings[thing.place]])
            detections.append(DetectedObject(thing.label, thing.score, thing.box_px, thing.mask, vector))
        image = np.concatenate([output.image, np.zeros(self._n, np.float32)])
        task.searched_words = tuple(self._classes)
        model = self.models.embedder
        return ViewPerception(self.name, tuple(detections), image, model, task.searched_words)


def _classes_near_rooms(network: CompactNetwork) -> dict[str, list[str]]:
    """By kind of room, the classes whose usual surroundings look most like it."""
    things, rooms = np.split(network.near_vectors, [len(network.classes)])
    likeness = dict(zip(network.rooms, rooms @ things.T, strict=True))
    best = {room: np.argsort(-row, kind="stable")[:_MAX_RELATED].tolist() for room, row in likeness.items()}
    return {room: [network.classes[i] for i in order if likeness[room][i] > 0] for room, order in best.items()}
