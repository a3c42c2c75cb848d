"""What every backend of perception can do: the stages that a view passes through, one after the other."""

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
    """One view on its way through the stages: what was asked, and what is known so far.

    Attributes:
        view: the picture.
        prompts: words that an open-vocabulary detector should look for; closed-set ones ignore them.
        truth: what each pixel shows; only for backends that need it.
        key: names the view (source, view, seq): what a backend draws by chance depends on nothing else, and a source that
            begins with "camera/" is a camera's.
        searched_words: after detecting, the words that were looked for; none if detecting was left out.
        boxes: after detecting, with all words' scores.
        rows: after segmenting, which of the boxes are reported; ``masks``: theirs.
        result: the answer, after the last stage.
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
    """One step of a backend. ``run`` takes a batch and writes its results into it; PerceptionError: it can't."""

    name: str
    run: Callable[[Sequence[ViewTask]], None]


class Backend(ABC):
    """Detects, segments and embeds; one instance serves one thread at a time.

    Attributes:
        name: the backend's name in messages and reports.
        why: one sentence for people: what runs, and why this one.
        models: ids of the models that it runs.
        vocabulary: the words that it knows; None: any.
        needs_prompts: it finds nothing but what it is asked for; its embeddings don't depend on what it finds.
        embedding_dim: D of every embedding.
        best_batch: so many views it looks at together faster than one after the other.
        needs_truth: it must be told what each pixel shows (simulation only).
        chances: how likely its detections are what it calls them; None: it isn't calibrated.
        stages: what a view passes through, in order; views of a batch don't depend on each other.
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
        """What is seen in one view; the arguments are ``ViewTask``'s and ``RgbdView``'s.

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
        """Whether its detections have chances."""
        return self.chances is not None

    def judge(self, batch: Sequence[ViewTask]) -> None:
        """The last stage of a calibrated backend: gives each detection its chance."""
        assert self.chances is not None, f"{self.name} isn't calibrated"
        for task in batch:
            assert task.result is not None, f"nothing was seen before {self.name} judges it"
            is_camera = bool(task.key) and str(task.key[0]).startswith("camera/")
            task.result = with_chances(
                task.result, task.view.depth_m, task.view.camera, self.chances, is_camera=is_camera
            )

    def refusal(self, word: str) -> str:
        """Why it can't look for a word; empty: it can."""
        if self.vocabulary is None:
            return ""
        try:
            self.vocabulary.resolve_name(word)
        except TargetError as error:
            return str(error)
        return ""

    def find_name(self, word: str) -> str:
        """The name that its vocabulary has for a word; empty: none, or it knows any word.

        "Fernseher" is "tv" for a detector of COCO's classes.
        """
        return "" if self.vocabulary is None else self.vocabulary.find_name(word)

    @abstractmethod
    def embed_texts(self, texts: Sequence[str]) -> NDArray[np.float32]:
        """Unit embeddings (N, D) float32 of texts.

        Raises:
            TargetError: a text that this backend can't embed.
        """
