"""The three parts of perception: what finds things, what cuts them out, what turns them into vectors.

Each takes a batch and answers in its order; what it says of one view doesn't depend on the others of its batch. Any
of them may raise ``PerceptionError``: it can't answer. One instance serves one thread at a time.
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
    """One registered picture: ``rgb`` (height, width, 3) uint8, ``depth_m`` (height, width) float32 [m], 0 where there is
    none, ``camera`` the intrinsics of both."""

    rgb: NDArray[np.uint8]
    depth_m: NDArray[np.float32]
    camera: Pinhole


@dataclass(frozen=True, slots=True, eq=False)
class ViewEmbedding:
    """Unit vectors of one view: ``image`` (D,) of the whole picture, ``objects`` (N, D) of the boxes asked for; float32."""

    image: NDArray[np.float32]
    objects: NDArray[np.float32]


class Detector(Protocol):
    """Pictures and words in, boxes with a score for each word out.

    Attributes:
        model: its model's id ("yolox-nano@695e750a").
        vocabulary: the words that it knows, whatever it is asked for; None: any word.
    """

    @property
    def model(self) -> str: ...
    @property
    def vocabulary(self) -> Vocabulary | None: ...

    def detect(self, images: Sequence[NDArray[np.uint8]], words: Sequence[Sequence[str]]) -> list[Boxes]:
        """Boxes of each picture (height, width, 3) uint8, one a thing, in its pixels, the best first.

        ``words``: what to look for in each picture; a detector with a vocabulary reports that instead.
        """
        ...


@runtime_checkable
class ChecksWords(Protocol):
    """A ``Detector`` that can't look for every word, though no vocabulary says so: its texts have a length.

    It leaves such a word's column zero. A mission is told before it starts.
    """

    def refusal(self, word: str) -> str:
        """Why it can't look for a word; empty: it can. Any thread may ask."""
        ...


class Segmenter(Protocol):
    """Pictures and boxes in, masks out. ``model``: its model's id."""

    @property
    def model(self) -> str: ...

    def segment(
        self, views: Sequence[RgbdView], boxes: Sequence[NDArray[np.float32]]
    ) -> list[list[NDArray[np.bool_] | None]]:
        """Of each view and each of its boxes (N, 4) xyxy [pixels], the mask of the box's cells (``box_cells``), or None:
        the whole box."""
        ...


class Embedder(Protocol):
    """Pictures, their boxes and texts in, unit vectors of one space out.

    Attributes:
        model: the id of the space: vectors of two models can't be compared.
        dim: D of every vector.
    """

    @property
    def model(self) -> str: ...
    @property
    def dim(self) -> int: ...

    def embed_views(
        self, images: Sequence[NDArray[np.uint8]], boxes: Sequence[Boxes], rows: Sequence[NDArray[np.int64]]
    ) -> list[ViewEmbedding]:
        """Of each picture (height, width, 3) uint8 the vector of the whole, and those of the ``rows`` of its boxes."""
        ...

    def embed_texts(self, texts: Sequence[str]) -> NDArray[np.float32]:
        """(N, D) float32 of texts.

        Raises:
            TargetError: a text that this space has no place for.
        """
        ...
