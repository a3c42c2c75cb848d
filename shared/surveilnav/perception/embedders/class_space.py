"""Embeddings computed from the class scores of a COCO detector, in the place of CLIP's.

The space has one axis for each of COCO's 80 classes and one for "nothing detected". Vectors have unit length and no negative
component.

- The embedding of an object is the square root of its normalised class scores. The cosine of two objects is the
  Bhattacharyya coefficient of their class distributions.
- The embedding of an image holds, for each class, the probability that at least one of its detections is real,
  1 - prod(1 - score), and a constant on the last axis, which is all that remains for an empty view.
- The embedding of a text that names class c holds, for each class k, the probability that c stands where k is seen,
  P(c | k) = sum over kinds of room r of P(c | r) P(r | k), and on the last axis P(c). The cosine of a view with "seems
  like there is a tv" is therefore high if a tv is seen, medium if a couch is, low if a toilet is, and in between if nothing
  is detected. The probabilities are those of data/coco/rooms.json.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from surveilnav.perception.boxes import Boxes
from surveilnav.perception.prompts import word_in_prompt
from surveilnav.perception.protocols import ViewEmbedding
from surveilnav.perception.vocabulary import COCO

DIM = len(COCO) + 1
_NOTHING = len(COCO)
#: P(class in room) for the weights 0, 1, 2 of data/coco/rooms.json ("never", "sometimes", "usually").
_PRESENCE = np.array([0.02, 0.3, 0.9])
#: Weight of seeing what usually stands near the target; seeing the target itself has weight 1.
_NEARNESS = 0.35
#: Weight of "nothing detected" in an image, before normalisation.
_BASE = 0.3


class ClassSpace:
    """An ``Embedder`` that uses the scores of a COCO detector, not the picture."""

    model = "coco-class-space"
    dim = DIM

    def embed_views(
        self, images: Sequence[NDArray[np.uint8]], boxes: Sequence[Boxes], rows: Sequence[NDArray[np.int64]]
    ) -> list[ViewEmbedding]:
        """See ``Embedder.embed_views``. All boxes count for the view's embedding, weak ones included."""
        return [
            ViewEmbedding(
                embed_image(b.scores), np.array([embed_object(b.scores[i]) for i in r], np.float32).reshape(-1, DIM)
            )
            for b, r in zip(boxes, rows, strict=True)
        ]

    def embed_texts(self, texts: Sequence[str]) -> NDArray[np.float32]:
        return embed_texts(texts)


def embed_object(class_scores: NDArray[np.floating]) -> NDArray[np.float32]:
    """The embedding (DIM,) of an object with class scores (80,)."""
    scores = np.clip(np.asarray(class_scores, dtype=np.float32), 0.0, None)
    total = float(scores.sum())
    embedding = np.zeros(DIM, dtype=np.float32)
    if total > 0:
        embedding[:_NOTHING] = np.sqrt(scores / total)
    else:
        embedding[_NOTHING] = 1.0
    return embedding / np.linalg.norm(embedding)


def embed_image(class_scores: Iterable[NDArray[np.floating]]) -> NDArray[np.float32]:
    """The embedding (DIM,) of a view from the class scores (80,) of all its boxes."""
    absent = np.ones(_NOTHING, dtype=np.float32)
    for scores in class_scores:
        absent *= 1.0 - np.clip(scores, 0.0, 1.0)
    embedding = np.append(1.0 - absent, np.float32(_BASE)).astype(np.float32)
    return embedding / np.linalg.norm(embedding)


def presence(image_embedding: NDArray[np.floating]) -> NDArray[np.float32]:
    """For each class (80,), the probability that an object of it is in a view with embedding (DIM,)."""
    return np.asarray(_BASE * image_embedding[:_NOTHING] / image_embedding[_NOTHING], np.float32)


def embed_texts(texts: Sequence[str]) -> NDArray[np.float32]:
    """Embeddings (N, DIM) of texts, each a class name or "seems like there is a <class>".

    Raises:
        TargetError: a text names none of COCO's classes.
    """
    rows = [_relevance()[COCO.index(class_named(text))] for text in texts]
    return np.array(rows, dtype=np.float32).reshape(len(rows), DIM)


def class_named(text: str) -> str:
    """The class that a prompt or a plain name names. Raises TargetError if it names none."""
    return COCO.resolve_name(word_in_prompt(text))


@lru_cache(maxsize=1)
def _relevance() -> NDArray[np.float32]:
    """(80, DIM) text embeddings of all classes."""
    rooms = COCO.rooms()
    known = [COCO.index(name) for name in rooms]
    p_class_in_room = _PRESENCE[np.array(list(rooms.values()))]  # (K, R)
    p_room_given_class = p_class_in_room / p_class_in_room.sum(axis=1, keepdims=True)
    relevance = np.zeros((len(COCO), DIM))
    relevance[np.ix_(known, known)] = _NEARNESS * p_class_in_room @ p_room_given_class.T  # P(c | k) at [c, k]
    relevance[known, _NOTHING] = _NEARNESS * p_class_in_room.mean(axis=1)
    relevance[np.arange(len(COCO)), np.arange(len(COCO))] = 1.0
    unit = relevance / np.linalg.norm(relevance, axis=1, keepdims=True)
    return np.asarray(unit, dtype=np.float32)
