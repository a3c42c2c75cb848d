"""What a node's or an annotation's name says about its class."""

from __future__ import annotations

import json
import re
from importlib import resources

from surveilnav.nouns import thing_or_whole
from surveilnav.perception.vocabulary import COCO
from surveilnav.simulator.world.labels import label_of, plain_name
from surveilnav.words import canonical

#: Structure by the name alone ("Wall.003", "Floor of Kitchen"); "floor lamp" is none.
_STRUCTURE = re.compile(
    r"^(?:inner |outer |exterior |interior )?(wall|floor|ceiling|door|window|stair)(?:s|case|way)?(?: of .*)?$"
)
#: Raw names of HM3D by class: "goals" and "parts" of the building.
_HM3D: dict[str, dict[str, list[str]]] = json.loads(
    resources.files("surveilnav.simulator.meshes").joinpath("data/hm3d_names.json").read_text("utf-8")
)
_HM3D_LABEL = {name: label for kind in ("goals", "parts") for label, names in _HM3D[kind].items() for name in names}


def label_of_node(name: str, size_m: tuple[float, float, float]) -> str:
    """The class of a node by its name and its box, "wall" and the like included; "" for none."""
    plain = plain_name(name)
    structure = _STRUCTURE.match(plain)
    if structure:
        return "stairs" if structure[1] == "stair" else structure[1]
    return label_of(name, size_m)


def whole_of_node(name: str, size_m: tuple[float, float, float]) -> str:
    """The class of a node, or of the thing that it is a part of by its name: "Bed_2" and "Bed_pillow" -> "bed"."""
    whole = thing_or_whole(name) or ""
    return label_of_node(name, size_m) or (whole if whole in COCO else "")


def label_of_extra(value: object) -> str | None:
    """The word that a file states itself, any one: canonical; None if nothing is stated."""
    return canonical(value) if isinstance(value, str) else None


def label_of_hm3d(name: str) -> str:
    """The class of one of HM3D's raw names."""
    folded = " ".join(name.strip().lower().replace("_", " ").split())
    if folded in _HM3D_LABEL:
        return _HM3D_LABEL[folded]
    # The six follow Habitat's table alone; of COCO's other classes the plain names count.
    other = canonical(folded)
    return other if other in COCO and other not in _HM3D["goals"] else ""
