"""Furniture drawn by chance, for training only: many shapes of each goal, where the libraries have two or three.

A network that saw one toilet learns that toilet. These pieces are crude, but no two are alike.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from surveilnav.simulator.world.assembly import Mesh
from training.detector.furniture.beds import bed
from training.detector.furniture.drawing import Drawing
from training.detector.furniture.plants import plant
from training.detector.furniture.seats import chair, couch
from training.detector.furniture.toilets import toilet
from training.detector.furniture.tvs import tv

_MAKERS: dict[str, Callable[[Drawing], None]] = {
    "bed": bed,
    "couch": couch,
    "chair": chair,
    "toilet": toilet,
    "tv": tv,
    "potted plant": plant,
}

#: The classes that pieces are drawn of.
DRAWN: tuple[str, ...] = tuple(_MAKERS)


def drawn_piece(kind: str, size_m: tuple[float, float, float], rng: np.random.Generator) -> Mesh:
    """A piece of one of ``DRAWN`` that about fills a box of width, depth and height ``size_m``, in its local frame."""
    drawing = Drawing(size_m, rng)
    _MAKERS[kind](drawing)
    return drawing.mesh.mesh()
