"""Models that look at pixels: which there are, where they lie, and that they are what they should be.

``find("yolox-nano")`` gives a checked file or folder; ``pull`` fetches one; ``model_id`` says which weights it has.
"""

from surveilnav.perception.models.card import Card, card_of
from surveilnav.perception.models.catalogue import CATALOGUE, COCO_DETECTORS, Model, model_called
from surveilnav.perception.models.find import Seen, family, find, is_here, model_id, survey
from surveilnav.perception.models.pull import pull
from surveilnav.perception.models.small import small_weights

__all__ = [
    "CATALOGUE",
    "COCO_DETECTORS",
    "Card",
    "Model",
    "Seen",
    "card_of",
    "family",
    "find",
    "is_here",
    "model_called",
    "model_id",
    "pull",
    "small_weights",
    "survey",
]
