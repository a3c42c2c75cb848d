"""Embeddings of an oracle: the space of COCO's classes, and a direction of its own for every other word.

The first ``class_space.DIM`` axes are that space's, so that vectors of COCO's classes have the same cosines as there. On
the others, a word that isn't COCO's has a unit vector drawn by its hash: two such words have about nothing in common.
"""

from __future__ import annotations

import zlib
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from surveilnav.perception.embedders import class_space
from surveilnav.perception.prompts import word_in_prompt
from surveilnav.perception.vocabulary import COCO

MODEL = "name-space"
_WORD_DIM = 64
DIM = class_space.DIM + _WORD_DIM
#: Likeness of any view to a word that isn't seen in it: nothing is known of where such things stand.
_UNKNOWN = 0.1


def embed_object(word: str) -> NDArray[np.float32]:
    """(DIM,) of a thing that is called so."""
    if word not in COCO:
        return _own(word)
    return _wide(class_space.embed_object(np.eye(len(COCO), dtype=np.float32)[COCO.index(word)]))


def embed_image(words: Sequence[str]) -> NDArray[np.float32]:
    """(DIM,) of a view that shows things which are called so."""
    known = [np.eye(len(COCO), dtype=np.float32)[COCO.index(word)] for word in words if word in COCO]
    total = _wide(class_space.embed_image(known)).astype(np.float64)
    for word in sorted({word for word in words if word not in COCO}):
        total += _own(word)
    return np.asarray(total / np.linalg.norm(total), np.float32)


def embed_texts(texts: Sequence[str]) -> NDArray[np.float32]:
    """(N, DIM) of texts, each a word or "seems like there is a <word>"."""
    rows = [_text(word_in_prompt(text)) for text in texts]
    return np.array(rows, np.float32).reshape(len(rows), DIM)


def _text(word: str) -> NDArray[np.float32]:
    if word in COCO:
        return _wide(class_space.embed_texts([word])[0])
    text = _own(word)
    text[class_space.DIM - 1] = _UNKNOWN
    return text / np.linalg.norm(text)


def _own(word: str) -> NDArray[np.float32]:
    """(DIM,) the unit vector of a word that isn't COCO's."""
    drawn = np.random.default_rng(zlib.crc32(word.encode())).standard_normal(_WORD_DIM)
    return np.concatenate([np.zeros(class_space.DIM), drawn / np.linalg.norm(drawn)]).astype(np.float32)


def _wide(vector: NDArray[np.float32]) -> NDArray[np.float32]:
    return np.concatenate([vector, np.zeros(_WORD_DIM, np.float32)])
