"""Checks an object's size, measured in depth, against the usual sizes of its class."""

from __future__ import annotations

from collections.abc import Mapping

import msgspec
import numpy as np
from numpy.typing import NDArray

from surveilnav.geometry import Pinhole
from surveilnav.perception.vocabulary import Vocabulary
from surveilnav.sensing.views import box_cells


class PerceptionPriors(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What ``priors.json`` says to this module.

    Attributes:
        extent_m: by class, the smallest and the largest extent [m] of an object along the camera's axes. The ranges are
            generous, because views are partial and boxes loose. They are those of ordinary furniture, not fitted to any
            building.
    """

    extent_m: dict[str, tuple[float, float]]


def extents_of(vocabulary: Vocabulary) -> Mapping[str, tuple[float, float]]:
    """By class of a vocabulary, its smallest and largest extent [m]; classes of unknown size are missing."""
    return vocabulary.priors("perception", PerceptionPriors).extent_m


#: Factor on the score of an object whose size isn't plausible for its class.
WRONG_SIZE_FACTOR = 0.4


def extent_m(
    depth_m: NDArray[np.float32], camera: Pinhole, box_px: tuple[float, ...], mask: NDArray[np.bool_]
) -> float | None:
    """The largest of width, height and depth [m] of an object, without the outermost 3 % of its points.

    None if too few of its pixels have depth.

    Args:
        depth_m: (height, width) of the picture.
        box_px: (x0, y0, x1, y1).
        mask: of the box (``box_cells``).
    """
    x0, y0, x1, y1 = box_cells((box_px[0], box_px[1], box_px[2], box_px[3]), camera.width_px, camera.height_px)
    step = max(1, int(np.sqrt(mask.size / 5000)))
    z = depth_m[y0:y1:step, x0:x1:step]
    chosen = mask[::step, ::step] & (z > 0)
    if chosen.sum() < 10:
        return None
    points = camera.rays()[y0:y1:step, x0:x1:step][chosen] * z[chosen][:, None]
    low, high = np.quantile(points, [0.03, 0.97], axis=0)
    return float((high - low).max())


def is_plausible(extents_m: Mapping[str, tuple[float, float]], label: str, size_m: float, cut: bool) -> bool:
    """Whether an object of class ``label`` may have the extent ``size_m``. A class of unknown size may have any.

    Args:
        extents_m: see ``extents_of``.
        cut: the picture's edge cuts the object, so that it may be larger than it appears.
    """
    smallest, largest = extents_m.get(label, (0.0, np.inf))
    return bool((cut or size_m >= smallest) and size_m <= largest)
