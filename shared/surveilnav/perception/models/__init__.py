"""Models that look at pixels: which there are, where they are on this machine, and whether they are what they should be.

``find("yolox-nano")`` gives a checked file or folder; ``pull`` fetches one; ``model_id`` says which weights it has.
"""

from surveilnav.perception.models.card import Card, card_of
from surveilnav.perception.models.catalogue import CATALOGUE, COCO_DETECTORS, Model, model_called
from surveilnav.perception.models.find import LocalModel, family, find, is_here, model_id, small_weights, survey
from surveilnav.perception.models.pull import pull

__all__ = [
    "CATALOGUE",
    "COCO_DETECTORS",
    "Card",
    "LocalModel",
    "Model",
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
