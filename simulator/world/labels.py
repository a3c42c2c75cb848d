"""What a detector would call a piece of furniture, by the names that people gave it.

COCO's spelling. Armchairs, office chairs and stools are "chair" (COCO's annotators count stools so); only what is named
sofa, couch, settee or loveseat is "couch"; flowers in a vase are "potted plant", as COCO's annotators have it; a low
table, desk or bedside table isn't a "dining table". The words, in 19 languages, are the library's (``surveilnav.nouns``).
"""

from __future__ import annotations

import re

from surveilnav.nouns import thing_named, things
from surveilnav.perception.vocabulary import COCO
from surveilnav.words import canonical

#: The six categories of HM3D ObjectNav, the benchmark's targets.
TARGETS: tuple[str, ...] = ("bed", "couch", "chair", "toilet", "tv", "potted plant")

#: COCO's classes that the words name, and the kinds of furniture that COCO has no class for: what a detector takes such
#: a piece for depends on what it is.
_CLASSES = things() & frozenset(COCO)
KINDS = things() - _CLASSES

#: A "table" lower or smaller than this is none to dine at, a plant higher than this is a tree [m].
_MIN_TABLE_HEIGHT_M, _MIN_TABLE_SIDE_M, _MAX_PLANT_HEIGHT_M = 0.55, 0.6, 2.5


def naming_text(catalog_id: str, name: str) -> str:
    """Returns the text that says what a piece is: its catalogue id if that names a thing, else its name.

    The id ("eTeks#bedsideTable") comes first: a translation leaves it as it was. What stands before the "#" is the author.
    A bare shape ("eTeks#texturableBox") stands for whatever it is called: a carpet, a shelf.
    """
    own = catalog_id.rpartition("#")[2]
    return own if thing_named(own) not in (None, "", "box") else name


def label_of(name: str, size_m: tuple[float, float, float], language: str = "") -> str:
    """The class of a piece of that name and size (width, depth, height), or "".

    ``language``: code of the one that is meant where several have a word ("Bank"), see ``nouns.detect_language``.
    """
    label = thing_named(name, language) or ""
    is_small_table = size_m[2] < _MIN_TABLE_HEIGHT_M or max(size_m[:2]) < _MIN_TABLE_SIDE_M
    if (label == "dining table" and is_small_table) or (label == "potted plant" and size_m[2] > _MAX_PLANT_HEIGHT_M):
        return ""
    return label if label in _CLASSES else ""


def furniture_of(name: str) -> str:
    """The kind of a piece of furniture that COCO has no class for, or ""."""
    thing = thing_named(name) or ""
    if thing == "dining table":  # asked for where it is too small for one
        return "other table"
    return thing if thing in KINDS else ""


def plain_name(name: str) -> str:
    """A name without numbering and underscores: "Sofa_Chair.003" -> "sofa chair"."""
    words = re.sub(r"([a-z])([A-Z])", r"\1 \2", name)
    words = re.sub(r"[_.\-\s]+", " ", re.sub(r"\d+", " ", words))
    return words.strip().lower()


def word_for(name: str, label: str) -> str:
    """What people call a piece: its class, else its kind of furniture, else its own name ("Samovar 2" -> "samovar")."""
    word = label or furniture_of(name) or canonical(plain_name(name))
    # A plant that is a tree is no potted plant by its name, either.
    return word if label or word not in _CLASSES else ""


#: Labels of the parts of a building.
PARTS = frozenset({"wall", "floor", "ceiling", "door", "window", "stairs"})

#: Kinds of furniture that have parametric pieces of their own, for models that can't be had.
_STAND_INS = {"bathtub": "bathtub", "bookcase": "bookshelf", "lamp": "lamp", "rug": "rug"}


def stand_in_of(name: str, label: str) -> str:
    """The parametric piece that stands in for one of that name and class."""
    return label or _STAND_INS.get(furniture_of(name), "cabinet")
