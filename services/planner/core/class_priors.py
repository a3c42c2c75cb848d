"""What the planner knows of classes by name; the numbers stand in the library's ``data/coco/priors.json``."""

from __future__ import annotations

import msgspec

from surveilnav.perception.vocabulary import COCO


class PlannerPriors(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """By class name; what isn't named has the value that ``config`` says. Measured in searches of training buildings.

    Attributes:
        even_relevance: an object of this relevance is the target as often as not: chairs mostly are what they look like,
            beds are not.
        explore_chance: how likely exploring one frontier finds the target. Without cameras searches find one every 9 m of
            exploring (chair), 12 (potted plant), 23 (bed), 27 to 33 (tv, toilet, couch).
        floor_chance: how often a floor has a target that its cameras don't see, before the robot explored any of it.
    """

    even_relevance: dict[str, float]
    explore_chance: dict[str, float]
    floor_chance: dict[str, float]


PRIORS = COCO.priors("planner", PlannerPriors)
