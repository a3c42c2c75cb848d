"""Is a thing as large as things of its class are? Depth knows, and a radiator is no toilet."""

from __future__ import annotations

from collections.abc import Mapping

import msgspec
import numpy as np
from numpy.typing import NDArray

from surveilnav.geometry import Pinhole
from surveilnav.perception.vocabulary import Vocabulary
from surveilnav.sensing.views import box_cells


class PerceptionPriors(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """``extent_m``: by class, the smallest and the largest extent [m] along the camera's axes that something of it shows;
    generous, because views are partial and boxes loose. Ordinary furniture, not fitted to any building."""

    extent_m: dict[str, tuple[float, float]]


def extents_of(vocabulary: Vocabulary) -> Mapping[str, tuple[float, float]]:
    """What a vocabulary knows of its classes' sizes: the smallest and the largest extent [m] by name."""
    return vocabulary.priors("perception", PerceptionPriors).extent_m


#: What the score of a thing is multiplied with whose size isn't its class's.
WRONG_SIZE = 0.4


def extent_m(
    depth_m: NDArray[np.float32], camera: Pinhole, box_px: tuple[float, ...], mask: NDArray[np.bool_]
) -> float | None:
    """The largest of width, height and depth [m] of the masked pixels of a box, without the outermost 3 %."""
    x0, y0, x1, y1 = box_cells((box_px[0], box_px[1], box_px[2], box_px[3]), camera.width_px, camera.height_px)
    step = max(1, int(np.sqrt(mask.size / 5000)))
    z = depth_m[y0:y1:step, x0:x1:step]
    chosen = mask[::step, ::step] & (z > 0)
    if chosen.sum() < 10:
        return None
    points = camera.rays()[y0:y1:step, x0:x1:step][chosen] * z[chosen][:, None]
    low, high = np.quantile(points, [0.03, 0.97], axis=0)
    return float((high - low).max())


def plausible(extents_m: Mapping[str, tuple[float, float]], label: str, size_m: float, cut: bool) -> bool:
    """Whether a thing of that class may be that large, by ``extents_of`` its vocabulary; a class unknown there may be any.

    ``cut``: the picture's edge hides the rest of it.
    """
    smallest, largest = extents_m.get(label, (0.0, np.inf))
    return bool((cut or size_m >= smallest) and size_m <= largest)
