"""The names of things: the 80 classes of COCO in today's spelling, and the targets of the benchmark."""

from __future__ import annotations

from difflib import get_close_matches

from surveilnav.errors import TargetError

#: COCO's 80 classes in the order that its detectors number them.
COCO: tuple[str, ...] = (
    "person", "bicycle", "car", "motorcycle", "airplane", "bus", "train", "truck", "boat", "traffic light",
    "fire hydrant", "stop sign", "parking meter", "bench", "bird", "cat", "dog", "horse", "sheep", "cow",
    "elephant", "bear", "zebra", "giraffe", "backpack", "umbrella", "handbag", "tie", "suitcase", "frisbee",
    "skis", "snowboard", "sports ball", "kite", "baseball bat", "baseball glove", "skateboard", "surfboard",
    "tennis racket", "bottle", "wine glass", "cup", "fork", "knife", "spoon", "bowl", "banana", "apple",
    "sandwich", "orange", "broccoli", "carrot", "hot dog", "pizza", "donut", "cake", "chair", "couch",
    "potted plant", "bed", "dining table", "toilet", "tv", "laptop", "mouse", "remote", "keyboard",
    "cell phone", "microwave", "oven", "toaster", "sink", "refrigerator", "book", "clock", "vase", "scissors",
    "teddy bear", "hair drier", "toothbrush",
)  # fmt: skip

#: The six categories of HM3D ObjectNav.
TARGETS: tuple[str, ...] = ("bed", "couch", "chair", "toilet", "tv", "potted plant")

_SYNONYMS = {
    "sofa": "couch", "plant": "potted plant", "pottedplant": "potted plant", "television": "tv", "tv_monitor": "tv",
    "tvmonitor": "tv", "tv monitor": "tv", "diningtable": "dining table", "table": "dining table", "fridge": "refrigerator",
    "wc": "toilet", "motorbike": "motorcycle", "aeroplane": "airplane",
}  # fmt: skip


def canonical(name: str) -> str:
    """The one spelling of a class: lower case, single spaces, synonyms folded ("Sofa" -> "couch")."""
    folded = " ".join(name.strip().lower().replace("_", " ").replace("-", " ").split())
    return _SYNONYMS.get(folded, folded)


def closed_set_target(name: str) -> str:
    """``canonical(name)`` if it is one of COCO's classes.

    Raises:
        TargetError: the name isn't one; the message lists the six usual ones and the nearest spelling.
    """
    target = canonical(name)
    if target in COCO:
        return target
    near = get_close_matches(target, COCO, n=1)
    hint = f"; did you mean {near[0]!r}?" if near else "."
    raise TargetError(
        f"{name!r} is not a class that this detector knows{hint} "
        f"Usual targets: {', '.join(TARGETS)}. Any of COCO's 80 classes can be named."
    )
