"""``compact`` in the words of COCO's classes: what the backend ``simulated`` imitates, whose model is of those words."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from surveilnav.messages import ModelIds
from surveilnav.perception import models
from surveilnav.perception.backend import Backend, Stage, ViewTask
from surveilnav.perception.detectors.compact import CompactNetwork
from surveilnav.perception.detectors.onnx_file import open_session
from surveilnav.perception.embedders import class_space
from surveilnav.perception.embedders.class_space import ClassSpace
from surveilnav.perception.names import BackendName
from surveilnav.perception.runtime import Runtime
from surveilnav.perception.single_network import find_things
from surveilnav.perception.vocabulary import COCO
from surveilnav.sensing.views import DetectedObject, ViewPerception


class InCocoWords(Backend):
    """Finds what ``compact`` finds; leaves out what it calls by a name that COCO doesn't have, such as a desk."""

    embedding_dim = class_space.DIM
    vocabulary = COCO

    def __init__(self) -> None:
        path = models.find(BackendName.COMPACT, download=False)
        self._network = CompactNetwork(open_session(path, Runtime()))
        model = models.model_id(BackendName.COMPACT, path)
        self.name = self.why = f"{model} in COCO's words"
        self.models = ModelIds(f"{model}-in-coco-words", model, ClassSpace.model)
        self.stages = (Stage("look", self._look),)
        names = [COCO.exact_name(word) for word in self._network.classes]
        #: (columns of the network's classes, their columns among COCO's)
        self._shared = np.array([(i, COCO.index(name)) for i, name in enumerate(names) if name]).T

    def embed_texts(self, texts: Sequence[str]) -> NDArray[np.float32]:
        return class_space.embed_texts(texts)

    def _look(self, batch: Sequence[ViewTask]) -> None:
        for task in batch:
            task.result = self._seen(task)

    def _seen(self, task: ViewTask) -> ViewPerception:
        boxes, things = find_things(self._network, self._network.run(task.view), task.view)
        own, coco = self._shared
        scores = np.zeros((len(boxes), len(COCO)), np.float32)
        scores[:, coco] = boxes.scores[:, own]
        detections = tuple(
            DetectedObject(label, thing.score, thing.box_px, thing.mask, class_space.embed_object(scores[thing.row]))
            for thing in things
            if (label := COCO.exact_name(thing.label))
        )
        return ViewPerception(self.name, detections, class_space.embed_image(scores), ClassSpace.model, tuple(COCO))
