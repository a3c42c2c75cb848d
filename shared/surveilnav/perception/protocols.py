"""The interfaces of the three models of a ``PipelineBackend``: detector, segmenter, embedder.

Each processes a batch and returns the results in its order; the views of a batch don't influence each other. Each may raise
``PerceptionError``. None has to be thread-safe.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from surveilnav.geometry import Pinhole
from surveilnav.perception.boxes import Boxes
from surveilnav.perception.vocabulary import Vocabulary


@dataclass(frozen=True, slots=True, eq=False)
class RgbdView:
    """One registered RGB-D picture.

    Attributes:
        rgb: (height, width, 3) uint8.
        depth_m: (height, width) float32 [m], 0 where there is none.
        camera: intrinsics of both.
    """

    rgb: NDArray[np.uint8]
    depth_m: NDArray[np.float32]
    camera: Pinhole


@dataclass(frozen=True, slots=True, eq=False)
class ViewEmbedding:
    """Unit vectors of one view, float32: ``image`` (D,) of the whole picture, ``objects`` (N, D) of the requested boxes."""

    image: NDArray[np.float32]
    objects: NDArray[np.float32]


class Detector(Protocol):
    """Finds objects: boxes with a score for each word.

    Attributes:
        model: id of its model ("yolox-nano@695e750a").
        vocabulary: the classes that it always looks for; None: it looks for the words that it is given.
    """

    @property
    def model(self) -> str: ...
    @property
    def vocabulary(self) -> Vocabulary | None: ...

    def detect(self, images: Sequence[NDArray[np.uint8]], words: Sequence[Sequence[str]]) -> list[Boxes]:
        """The boxes in each picture (height, width, 3) uint8, one per object, in its pixels, best first.

        ``words``: what to look for in each picture. Detectors with a vocabulary ignore them.
        """
        ...


@runtime_checkable
class ChecksWords(Protocol):
    """A ``Detector`` without a vocabulary that still can't look for some words, such as those that are too long for it.

    The scores of such a word are zero. A mission for it is refused before it starts.
    """

    def refusal(self, word: str) -> str:
        """Why it can't look for a word, as a sentence for people; empty if it can. Thread-safe."""
        ...


class Segmenter(Protocol):
    """Finds which pixels of a box are the object. ``model``: id of its model."""

    @property
    def model(self) -> str: ...

    def segment(
        self, views: Sequence[RgbdView], boxes: Sequence[NDArray[np.float32]]
    ) -> list[list[NDArray[np.bool_] | None]]:
        """For each view, the masks of its boxes (N, 4) xyxy [pixels].

        A mask (rows, columns) covers the box rounded to whole pixels (``box_cells``). None stands for the whole box.
        """
        ...


class Embedder(Protocol):
    """Turns pictures, objects and texts into unit vectors of one space.

    Attributes:
        model: id of the space; vectors of two models can't be compared.
        dim: D of every vector.
    """

    @property
    def model(self) -> str: ...
    @property
    def dim(self) -> int: ...

    def embed_views(
        self, images: Sequence[NDArray[np.uint8]], boxes: Sequence[Boxes], rows: Sequence[NDArray[np.int64]]
    ) -> list[ViewEmbedding]:
        """For each picture (height, width, 3) uint8, its embedding and those of the given ``rows`` of its boxes."""
        ...

    def embed_texts(self, texts: Sequence[str]) -> NDArray[np.float32]:
        """(N, D) float32 embeddings of texts.

        Raises:
            TargetError: a text can't be embedded in this space.
        """
        ...
