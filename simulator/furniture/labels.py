"""What a detector would call a piece of furniture, by the names that people gave it.

COCO's spelling. Armchairs, office chairs and stools are "chair" (COCO's annotators count stools so); only what is named
sofa, couch, settee or loveseat is "couch"; flowers in a vase are "potted plant", as COCO's annotators have it; a low
table, desk or bedside table isn't a "dining table".
"""

from __future__ import annotations

import re

from surveilnav.words import canonical

#: The six categories of HM3D ObjectNav, the benchmark's targets.
TARGETS: tuple[str, ...] = ("bed", "couch", "chair", "toilet", "tv", "potted plant")

#: In order: the first that matches decides. "" means: known, and not a class.
_RULES: tuple[tuple[str, str], ...] = (
    (r"bedside|bed ?sheet|bedspread|bathmat|doormat|flower ?bed", ""),
    (r"opened? .*sofa|sofa ?bed|day ?bed|futon$|\bbeds?\b|\bcrib\b|\bcot\b|bed\d|(bunk|loft) ?bed", "bed"),
    (r"sofa|couch|settee|loveseat|canap", "couch"),
    (r"bar ?chair|bar ?stool", "chair"),
    (r"wheelchair|puff|ottoman$|bean ?bag", ""),
    (r"arm ?chair|chair|fauteuil|\bseat\b", "chair"),
    (r"piano bench|footstool", ""),
    (r"stool", "chair"),
    (r"\bbench\b|\bbank\b", "bench"),
    (r"toilet ?(brush|paper|roll|tissue|dispenser)|tissue", ""),
    (r"toilet|\bwc\b|water closet", "toilet"),
    (r"remote", "remote"),
    (r"(tv|television) ?(stand|cabinet|table|bench)", ""),
    (r"\btv\b|television|flat ?screen|flattv", "tv"),
    (r"vase ?lamp|christmas|(maple|palm|coconut) tree|bush|hedge", ""),
    (r"plant|ficus|yucca|cactus|bonsai|bamboo|orchid|spathi|flowers|tulip|lily|fern", "potted plant"),
    (r"chest freezer", ""),
    (r"fridge|refrigerator", "refrigerator"),
    (r"microwave", "microwave"),
    (r"oven|cooker|stove|range$", "oven"),
    (r"toaster", "toaster"),
    (r"wash ?basin|\bsink\b|vanity|lavabo|lavatory", "sink"),
    (r"laptop|ibook|notebook", "laptop"),
    (r"cell ?phone|mobile phone|iphone|smartphone", "cell phone"),
    (r"keyboard$", "keyboard"),
    (r"^book$|^books$", "book"),
    (r"clock", "clock"),
    (r"\bvase\b", "vase"),
    (r"teddy", "teddy bear"),
    (r"(coffee|side|bar|pool|dressing|changing|technical|kid|child|tennis|football|tv|desk) ?\w* ?table", ""),
    (r"table ?(fan|tennis|football|lamp)", ""),
    (r"dining table|\btable\b", "dining table"),
    (r"\bcat\b", "cat"), (r"\bdog\b(?! house)|bulldog", "dog"), (r"^horse$", "horse"),
    (r"bicycle|^bike$", "bicycle"), (r"motorbike|motorcycle|scooter", "motorcycle"), (r"\bcar\b$|sedan|suv$", "car"),
    (r"suitcase", "suitcase"), (r"backpack", "backpack"), (r"handbag", "handbag"), (r"^umbrella$", "umbrella"),
    (r"fire hydrant", "fire hydrant"), (r"skateboard", "skateboard"), (r"tennis racket", "tennis racket"),
    (r"bottle", "bottle"), (r"\bcup\b|mug$", "cup"), (r"^bowl", "bowl"), (r"scissors", "scissors"),
    (r"\b(fe)?male\b|^boy$|^girl$", "person"),
)  # fmt: skip

_CLASSES = frozenset(label for _, label in _RULES if label)
_COMPILED = tuple((re.compile(pattern, re.IGNORECASE), label) for pattern, label in _RULES)

#: A "table" lower or smaller than this is none to dine at, a plant higher than this is a tree [m].
_MIN_TABLE_HEIGHT_M, _MIN_TABLE_SIDE_M, _MAX_PLANT_HEIGHT_M = 0.55, 0.6, 2.5


def label_of(name: str, size_m: tuple[float, float, float]) -> str:
    """The class of a piece of that name and size (width, depth, height), or ""."""
    for pattern, label in _COMPILED:
        if pattern.search(name):
            if label == "dining table" and (size_m[2] < _MIN_TABLE_HEIGHT_M or max(size_m[:2]) < _MIN_TABLE_SIDE_M):
                return ""
            if label == "potted plant" and size_m[2] > _MAX_PLANT_HEIGHT_M:
                return ""
            return label
    return ""


#: Furniture that COCO has no class for: what a detector takes it for depends on what it is.
_FURNITURE: tuple[tuple[str, str], ...] = (
    ("rug", r"carpet|\brug\b|mat\b"),
    ("lamp", r"lamp|light|chandelier"),
    ("bathtub", r"bath ?tub|\bbath\b|fittedbath|jacuzzi"),
    ("shower", r"shower"),
    ("bidet", r"bidet|urinal"),
    ("washing machine", r"washing ?machine|\bwasher|dryer"),
    ("dishwasher", r"dish ?washer"),
    ("wardrobe", r"wardrobe|closet|armoire"),
    ("bookcase", r"book|shel(f|ves)"),
    ("bedside table", r"bedside|night ?stand"),
    ("tv stand", r"(tv|television) ?(stand|cabinet|table|bench)"),
    ("desk", r"desk"),
    ("other table", r"table\b"),
    ("pouffe", r"puff|pouf|ottoman|bean ?bag|footstool"),
    ("chest", r"chest|drawer|dresser|sideboard|buffet|commode"),
    ("cabinet", r"cabinet|cupboard|worktop|kitchen|hood"),
    ("mirror", r"mirror"),
    ("picture", r"picture|painting|poster|frame"),
    ("curtain", r"curtain|blind|drape"),
    ("radiator", r"radiator|heater|boiler"),
    ("piano", r"piano"),
    ("fireplace", r"fireplace|chimney"),
    ("box", r"\bbox\b|cylinder|\bcube\b"),
)  # fmt: skip
#: Their kinds, as ``furniture_of`` names them.
KINDS = frozenset(kind for kind, _ in _FURNITURE)
_COMPILED_FURNITURE = tuple((kind, re.compile(pattern, re.IGNORECASE)) for kind, pattern in _FURNITURE)


def furniture_of(name: str) -> str:
    """The kind of a piece of furniture that COCO has no class for, or ""."""
    return next((kind for kind, pattern in _COMPILED_FURNITURE if pattern.search(name)), "")


def plain_name(name: str) -> str:
    """A name without numbering and underscores: "Sofa_Chair.003" -> "sofa chair"."""
    words = re.sub(r"([a-z])([A-Z])", r"\1 \2", name)
    words = re.sub(r"[_.\-\s]+", " ", re.sub(r"\d+", " ", words))
    return words.strip().lower()


def word_for(name: str, label: str) -> str:
    """What people call a piece: its class, else its kind of furniture, else its own name ("Samovar 2" -> "samovar")."""
    word = label or furniture_of(name) or canonical(plain_name(name))
    return (
        word if label or word not in _CLASSES else ""
    )  # a plant that is a tree is no potted plant by its name, either


#: Labels of the parts of a building.
PARTS = frozenset({"wall", "floor", "ceiling", "door", "window", "stairs"})

#: Kinds of furniture that have parametric pieces of their own, for models that can't be had.
_STAND_INS = {"bathtub": "bathtub", "bookcase": "bookshelf", "lamp": "lamp", "rug": "rug"}


def stand_in_of(name: str, label: str) -> str:
    """The parametric piece that stands in for one of that name and class."""
    return label or _STAND_INS.get(furniture_of(name), "cabinet")
