"""What fusion knows of classes by name; the numbers stand in the library's ``data/coco/priors.json``."""

from __future__ import annotations

import msgspec

from surveilnav.perception.vocabulary import COCO


class SizePrior(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Bounds on what was seen of an object of a class. An object's box is axis-aligned.

    Least extents are about half of the smallest that is sold, since views are partial: a crib is 1.2 m long, a loveseat
    1.2 m wide, a toilet 0.35 m wide. Largest extents are two side by side. Least heights and thicknesses lie below those
    of all but a few in a hundred true objects of training buildings, and above those of every other false one. Tops are
    chosen the other way round: half of the false chairs and toilets reach higher than 98 of 100 true ones (pictures,
    lamps, wall cupboards). Half of the false tvs are bulkier than 95 of 100 true ones (cupboards).

    Attributes:
        extent_min_m, extent_max_m: of the longer horizontal side.
        height_min_m: of the vertical side.
        thickness_min_m: of the shortest of all three sides.
        top_max_m: how high above the floor it reaches at most.
        volume_max_m3: of its box.
    """

    extent_min_m: float = 0.0
    extent_max_m: float = float("inf")
    height_min_m: float = 0.0
    thickness_min_m: float = 0.0
    top_max_m: float = float("inf")
    volume_max_m3: float = float("inf")


class FusionPriors(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """By class name; what isn't named has the value that ``config`` says, or any size.

    Attributes:
        min_confidence: from which an object is confirmed. Above it, most objects of a fitting size are true, in searches
            of training buildings.
        margin: how many times the confidence in any other class it must have. What is most of all a couch is one, 14 of
            15 times. What is taken for a bed and now and then for a couch is a couch, 7 of 12 times; none of 34 beds is.
        min_sightings: near robot detections and camera views that it takes. Much looks like a bed at first: with six, 4 of
            5 are true, not 3.
        recall: share of plain near views in which detectors see a thing of the class.
        size: bounds on its size; anything goes for other classes.
    """

    min_confidence: dict[str, float]
    margin: dict[str, float]
    min_sightings: dict[str, int]
    recall: dict[str, float]
    size: dict[str, SizePrior]


PRIORS = COCO.priors("fusion", FusionPriors)
