"""What a node's or an annotation's name says about its class."""

from __future__ import annotations

import re

from surveilnav.nouns import whole_of
from surveilnav.perception.vocabulary import COCO
from surveilnav.simulator.world.labels import label_of, plain_name
from surveilnav.words import canonical

#: Structure by the name alone ("Wall.003", "Floor of Kitchen"); "floor lamp" is none.
_STRUCTURE = re.compile(
    r"^(?:inner |outer |exterior |interior )?(wall|floor|ceiling|door|window|stair)(?:s|case|way)?(?: of .*)?$"
)
#: Raw names of HM3D that Habitat's ObjectNav folds into its six categories (matterport_category_mappings.tsv: raw_category
#: to mpcat40), without the parts of things (headboard, toilet seat) and those that nobody would call so (dog bed,
#: whiteboard, bidet). As there, "wall tv" is none.
_HM3D: dict[str, tuple[str, ...]] = {
    "chair": (
        "chair",
        "chairs",
        "arm chair",
        "armchair",
        "bar chair",
        "barbers chair",
        "bean bag",
        "bean bag chair",
        "beanbag chair",
        "chaise",
        "computer chair",
        "couch chair",
        "desk chair",
        "dining chair",
        "easy chair",
        "easychair",
        "folding chair",
        "highchair",
        "lounge chair",
        "office chair",
        "patio chair",
        "recliner",
        "rocking chair",
        "round chair",
        "small chair",
        "sofa chair",
        "sofachair",
        "soft chair",
        "stacked chairs",
        "swivel chair",
        "wooden chair",
    ),
    "couch": ("couch", "sofa", "loveseat", "circular sofa", "l shape sofa", "long sofa", "sofa couch", "sofa set"),
    "bed": ("bed", "bedframe", "bed frame", "bedstead", "mattress", "massage bed", "tanning bed", "hammock"),
    "toilet": ("toilet", "toilet bowl", "commode"),
    "tv": ("tv", "t.v", "tv monitor", "television", "monitor", "computer monitor", "computer screen", "display"),
    "potted plant": ("plant", "plants", "potted plant", "flower", "flowers", "bush", "bushes", "tree", "trees"),
}
_HM3D_LABEL = {name: label for label, names in _HM3D.items() for name in names}
#: Parts of the building; frames of windows are none, or rooms would be lit twice through them.
_HM3D_PARTS: dict[str, tuple[str, ...]] = {
    "wall": ("wall",),
    "floor": ("floor",),
    "ceiling": ("ceiling",),
    "door": (
        "door",
        "doors",
        "closet door",
        "door frame",
        "doorframe",
        "doorway",
        "double door",
        "garage door",
        "glass door",
        "shower door",
        "sliding door",
    ),
    "window": ("window", "windows"),
    "stairs": ("stairs", "stair", "step", "steps", "stair step", "staircase", "stairway"),
}
_HM3D_STRUCTURE = {name: label for label, names in _HM3D_PARTS.items() for name in names}


def label_of_node(name: str, size_m: tuple[float, float, float]) -> str:
    """The class of a node by its name and its box, "wall" and the like included; "" for none."""
    plain = plain_name(name)
    structure = _STRUCTURE.match(plain)
    if structure:
        return "stairs" if structure[1] == "stair" else structure[1]
    return label_of(name, size_m)


def whole_of_node(name: str, size_m: tuple[float, float, float]) -> str:
    """The class of a node, or of the thing that it is a part of by its name: "Bed_2" and "Bed_pillow" -> "bed"."""
    whole = whole_of(name) or ""
    return label_of_node(name, size_m) or (whole if whole in COCO else "")


def label_of_extra(value: object) -> str | None:
    """The word that a file states itself, any one: canonical; None if nothing is stated."""
    return canonical(value) if isinstance(value, str) else None


def label_of_hm3d(name: str) -> str:
    """The class of one of HM3D's raw names."""
    folded = " ".join(name.strip().lower().replace("_", " ").split())
    label = _HM3D_LABEL.get(folded) or _HM3D_STRUCTURE.get(folded)
    if label is not None:
        return label
    # The six follow Habitat's table alone; of COCO's other classes the plain names count.
    other = canonical(folded)
    return other if other in COCO and other not in _HM3D else ""
