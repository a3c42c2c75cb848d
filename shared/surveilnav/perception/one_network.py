"""The backend of one network that finds, cuts out and embeds: ``compact``.

The embedding space has two halves of D. A view's vector lies in the first, an object's in the second, and a text's in both: the
network has a vector for what shows or stands near, and one for what a thing is. So cosines of views and objects with a text
are the network's own, times 1 / sqrt(2).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from surveilnav.messages import ModelIds
from surveilnav.perception.backend import Backend, Stage, Work
from surveilnav.perception.chances import ChanceTable
from surveilnav.perception.detectors.compact import CompactNetwork
from surveilnav.perception.prompts import named
from surveilnav.perception.vocabulary import Vocabulary
from surveilnav.sensing.views import Detected, ViewPerception, box_cells

#: So many classes are said to be nearest to a kind of room.
_MOST_AKIN = 5

#: Weaker things are kept out of the answer.
MIN_SCORE = 0.25


class OneNetwork(Backend):
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
        rows = [self._classes.index(self._classes.known(named(text))) for text in texts]
        near, what = self._network.near_vectors[rows], self._network.class_vectors[rows]
        return np.asarray(np.concatenate([near, what], axis=1) / np.sqrt(2.0), np.float32)

    def _look(self, batch: Sequence[Work]) -> None:
        for work in batch:
            work.seen = self._seen(work)

    def _seen(self, work: Work) -> ViewPerception:
        height, width = work.view.rgb.shape[:2]
        answer = self._network.answer(work.view)
        boxes, places = self._network.things(answer, height, width)
        detections = []
        for row, label in enumerate(boxes.labels):
            score = float(boxes.best[row])
            if score < MIN_SCORE:
                continue
            x0, y0, x1, y1 = boxes.xyxy[row].tolist()
            mask = answer.mask(int(places[row]), box_cells((x0, y0, x1, y1), width, height))
            vector = np.concatenate([np.zeros(self._n, np.float32), answer.embeddings[places[row]]])
            detections.append(Detected(label, score, (x0, y0, x1, y1), mask if mask.any() else None, vector))
        image = np.concatenate([answer.image, np.zeros(self._n, np.float32)])
        work.looked_for = tuple(self._classes)
        model = self.models.embedder
        return ViewPerception(self.name, tuple(detections), image, model, work.looked_for)


def _akin(network: CompactNetwork) -> dict[str, list[str]]:
    """By kind of room, the classes whose surroundings look most like it: what it is near in meaning."""
    things, rooms = np.split(network.near_vectors, [len(network.classes)])
    likeness = dict(zip(network.rooms, rooms @ things.T, strict=True))
    best = {room: np.argsort(-row, kind="stable")[:_MOST_AKIN].tolist() for room, row in likeness.items()}
    return {room: [network.classes[i] for i in order if likeness[room][i] > 0] for room, order in best.items()}
