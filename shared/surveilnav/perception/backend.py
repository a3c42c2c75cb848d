"""The interface of a perception backend: the stages that a view passes through, one after the other."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from surveilnav.errors import TargetError
from surveilnav.geometry import Pinhole
from surveilnav.messages import ModelIds as ModelIds
from surveilnav.perception.boxes import Boxes
from surveilnav.perception.chances import ChanceTable, with_chances
from surveilnav.perception.protocols import RgbdView
from surveilnav.perception.vocabulary import Vocabulary
from surveilnav.sensing.views import TrueInstances, ViewPerception


@dataclass(slots=True, eq=False)
class ViewTask:
    """One view on its way through the stages: the input, and what the stages have found so far.

    Attributes:
        view: the picture.
        prompts: words that an open-vocabulary detector should look for; closed-set detectors ignore them.
        truth: which instance each pixel shows; only for backends that need it.
        key: (source, view, seq) of the view. A backend that draws random numbers seeds them by it, and a source that begins
            with "camera/" is a surveillance camera.
        searched_words: set by the detector: the words that it looked for; empty if detection was skipped.
        boxes: set by the detector, with the scores of all words.
        rows: set by the segmenter: the rows of ``boxes`` that are reported. ``masks``: their masks.
        result: set by the last stage.
    """

    view: RgbdView
    prompts: Sequence[str] = ()
    truth: TrueInstances | None = None
    key: tuple[object, ...] = ()
    boxes: Boxes = field(default_factory=Boxes.empty)
    rows: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    masks: list[NDArray[np.bool_] | None] = field(default_factory=list)
    searched_words: tuple[str, ...] = ()
    result: ViewPerception | None = None


@dataclass(frozen=True, slots=True)
class Stage:
    """One step of a backend. ``run`` processes a batch in place, or raises PerceptionError."""

    name: str
    run: Callable[[Sequence[ViewTask]], None]


class Backend(ABC):
    """Detects, segments and embeds the objects of a view. Not thread-safe.

    Attributes:
        name: the backend's name in messages and reports.
        why: a sentence for people: what runs, and why it was chosen.
        models: ids of the models that it runs.
        vocabulary: the classes that it can detect; None: any word.
        needs_prompts: it detects only what the prompts name, and its embeddings don't depend on what it detects.
        embedding_dim: D of every embedding.
        best_batch: batch size with which it is fastest.
        needs_truth: it must be told which instance each pixel shows (simulation only).
        chances: calibration of its scores; None: it isn't calibrated.
        stages: the stages of a view, in order. The views of a batch don't influence each other.
    """

    name: str
    why: str
    models: ModelIds = ModelIds()
    vocabulary: Vocabulary | None = None
    needs_prompts: bool = False
    embedding_dim: int
    best_batch: int = 1
    needs_truth: bool = False
    chances: ChanceTable | None = None
    stages: tuple[Stage, ...]

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
        """Runs all stages on one view; the arguments are fields of ``ViewTask`` and ``RgbdView``.

        Raises:
            PerceptionError: the backend can't answer.
        """
        task = ViewTask(RgbdView(rgb, depth_m, camera), prompts, truth, key)
        for stage in self.stages:
            stage.run([task])
        assert task.result is not None, f"the last stage of {self.name} gives no answer"
        return task.result

    @property
    def calibrated(self) -> bool:
        """Whether its detections have a calibrated probability (``DetectedObject.chance``); else only a score."""
        return self.chances is not None

    def assign_chances(self, batch: Sequence[ViewTask]) -> None:
        """The last stage of a calibrated backend: sets the calibrated probability of each detection."""
        assert self.chances is not None, f"{self.name} isn't calibrated"
        for task in batch:
            assert task.result is not None, f"{self.name} has no result to calibrate"
            is_camera = bool(task.key) and str(task.key[0]).startswith("camera/")
            task.result = with_chances(
                task.result, task.view.depth_m, task.view.camera, self.chances, is_camera=is_camera
            )

    def refusal(self, word: str) -> str:
        """Why it can't look for a word, as a sentence for people; empty if it can."""
        if self.vocabulary is None:
            return ""
        try:
            self.vocabulary.resolve_name(word)
        except TargetError as error:
            return str(error)
        return ""

    def find_name(self, word: str) -> str:
        """The class that a word means in its vocabulary, such as "tv" for "Fernseher" with COCO's classes.

        Empty if it means none, or if the backend can look for any word.
        """
        return "" if self.vocabulary is None else self.vocabulary.find_name(word)

    @abstractmethod
    def embed_texts(self, texts: Sequence[str]) -> NDArray[np.float32]:
        """Unit embeddings (N, D) float32 of texts.

        Raises:
            TargetError: a text that this backend can't embed.
        """
