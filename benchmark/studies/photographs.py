"""What the detectors see in photographs that Python packages carry: a picture with boxes, and a table.

    pip install --no-deps scikit-image
    python -m surveilnav.benchmark.studies.photographs --picture docs/images/photographs.jpg    # the table goes to stdout

What a photograph shows was written down by eye, as COCO's class names. A name counts as right if the photograph shows
such a thing, wherever its box is: there are no true boxes. ``compact`` is beside COCO's detectors, also on what it has no
name for; photographs have no depth, so it has none either.
"""

from __future__ import annotations

import argparse
import importlib.util
import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from surveilnav.errors import ConfigError
from surveilnav.geometry import Pinhole
from surveilnav.perception import models
from surveilnav.perception.boxes import Boxes, merge_overlapping
from surveilnav.perception.detectors.coco import load
from surveilnav.perception.detectors.compact import CompactNetwork
from surveilnav.perception.detectors.onnx_file import open_session
from surveilnav.perception.protocols import RgbdView
from surveilnav.perception.runtime import Runtime

CELL_PX = (300, 230)
SAME_THING_IOU = 0.5
LEAST_SCORE = 0.4
JPEG_QUALITY = 74
_COMPACT = "compact"
_HFOV_RAD = 1.0  # a photograph doesn't tell
Picture = NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class Photograph:
    """A photograph in a package. ``shows``: by eye; ``drawn``: whether its licence lets a copy be published."""

    name: str
    package: str
    file: str
    shows: tuple[str, ...]
    licence: str
    drawn: bool = True


PHOTOGRAPHS = (
    Photograph("astronaut", "skimage", "data/astronaut.png", ("person",), "public domain, NASA"),
    Photograph("photographer", "skimage", "data/camera.png", ("person",), "CC0, Lav Varshney"),
    Photograph(
        "admiral", "matplotlib", "mpl-data/sample_data/grace_hopper.jpg", ("person", "tie"), "public domain, US Navy"
    ),
    Photograph("cat", "skimage", "data/chelsea.png", ("cat",), "CC0, Stefan van der Walt"),
    Photograph("coffee", "skimage", "data/coffee.png", ("cup", "dining table", "spoon"), "CC0, Rachel Michetti"),
    Photograph("dahlia", "sklearn", "datasets/images/flower.jpg", (), "CC BY 2.0, flickr.com/photos/vultilion"),
    Photograph("pagoda", "sklearn", "datasets/images/china.jpg", (), "CC BY 2.0, flickr.com/photos/danielbuechele"),
    Photograph(
        "garage",
        "skimage",
        "data/motorcycle_left.png",
        ("bench", "bicycle", "motorcycle"),
        "not stated (Middlebury 2014): not drawn",
        drawn=False,
    ),
)


def read(photograph: Photograph) -> Picture:
    """A photograph, (height, width, 3) uint8 RGB. ConfigError: its package isn't installed, or lacks it."""
    found = importlib.util.find_spec(photograph.package)
    folders = found.submodule_search_locations if found else None
    for folder in folders or ():
        picture = cv2.imread(str(Path(folder) / photograph.file), cv2.IMREAD_COLOR)
        if picture is not None:
            return np.asarray(picture[..., ::-1], np.uint8)
    raise ConfigError(
        f"the photograph {photograph.name} should be {photograph.file} of the package {photograph.package}, but isn't "
        "there. `pip install --no-deps scikit-image` in a scratch environment has those of skimage."
    )


def detectors_here() -> list[str]:
    """The detectors that lie whole on this machine."""
    seen = {name: models.survey(name) for name in (*models.COCO_DETECTORS, _COMPACT)}
    return [name for name, what in seen.items() if what.path and not what.fault]


def boxes_of(name: str, pictures: Iterable[Picture]) -> list[Boxes]:
    """One box per thing of at least ``LEAST_SCORE``, for each picture."""
    path, runtime = models.find(name, download=False), Runtime("cpu")
    if name == _COMPACT:
        network = CompactNetwork(open_session(path, runtime))
        found = [network.detect(_without_depth(picture)) for picture in pictures]
    else:
        detector = load(path, models.family(name), runtime)
        found = [merge_overlapping(detector.detect(picture), SAME_THING_IOU) for picture in pictures]
    return [boxes.select(boxes.best_scores >= LEAST_SCORE) for boxes in found]


def _without_depth(picture: Picture) -> RgbdView:
    height, width = picture.shape[:2]
    return RgbdView(picture, np.zeros((height, width), np.float32), Pinhole.from_hfov(width, height, _HFOV_RAD))


def named(boxes: Boxes) -> list[tuple[str, float]]:
    """Class names with their best scores, the best first."""
    best: dict[str, float] = {}
    for scores in boxes.scores:
        label = boxes.words[int(scores.argmax())]
        best[label] = max(best.get(label, 0.0), float(scores.max()))
    return sorted(best.items(), key=lambda item: -item[1])


def drawn(picture: Picture, boxes: Boxes, title: str) -> Picture:
    """A cell of the picture: the photograph with its boxes, and who found them."""
    scale = min(CELL_PX[0] / picture.shape[1], CELL_PX[1] / picture.shape[0])
    size = round(picture.shape[1] * scale), round(picture.shape[0] * scale)
    small = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
    for xyxy, scores in zip(boxes.xyxy, boxes.scores, strict=True):
        a, b = (tuple(int(v) for v in corner) for corner in (xyxy * scale).reshape(2, 2))
        cv2.rectangle(small, a, b, (255, 220, 0), 2)
        text = f"{boxes.words[int(scores.argmax())]} {scores.max():.2f}"
        _write(small, text, (max(a[0], 0) + 3, min(max(a[1], 0) + 14, size[1] - 24)), 0.42)
    _write(small, title, (4, size[1] - 6), 0.38)
    cell = np.full((CELL_PX[1], CELL_PX[0], 3), 255, np.uint8)
    top, left = (CELL_PX[1] - size[1]) // 2, (CELL_PX[0] - size[0]) // 2
    cell[top : top + size[1], left : left + size[0]] = small
    return cell


def _write(picture: Picture, text: str, at: tuple[int, int], size: float) -> None:
    """White letters on black, which are read on any ground. ``at``: (x, y) of their lower left corner [pixels]."""
    (width, height), below = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, size, 1)
    cv2.rectangle(picture, (at[0] - 2, at[1] - height - 2), (at[0] + width + 2, at[1] + below), (0, 0, 0), -1)
    cv2.putText(picture, text, at, cv2.FONT_HERSHEY_SIMPLEX, size, (255, 255, 255), 1, cv2.LINE_AA)


def page(found: dict[str, list[Boxes]], photographs: Sequence[Photograph] = PHOTOGRAPHS) -> str:
    """The table of what each detector named, the count of right and wrong names, and the licences."""
    lines = ["| photograph | shows | " + " | ".join(found) + " |", "|---" * (len(found) + 2) + "|"]
    for i, photograph in enumerate(photographs):
        cells = [
            ", ".join(f"{label} {score:.2f}" for label, score in named(boxes[i])) or "–" for boxes in found.values()
        ]
        lines.append(
            f"| {photograph.name} | {', '.join(photograph.shows) or 'nothing of COCO'} | {' | '.join(cells)} |"
        )
    counts = [_counted(boxes, photographs) for boxes in found.values()]
    of = sum(len(photograph.shows) for photograph in photographs)
    lines.append(f"| **right names, of {of}** | | " + " | ".join(f"**{right}**" for right, _ in counts) + " |")
    lines.append("| **wrong names** | | " + " | ".join(f"**{wrong}**" for _, wrong in counts) + " |")
    lines += ["", "| photograph | package | licence |", "|---|---|---|"]
    lines += [f"| {p.name} | {p.package}, `{p.file}` | {p.licence} |" for p in photographs]
    return "\n".join(lines)


def _counted(boxes: Sequence[Boxes], photographs: Sequence[Photograph]) -> tuple[int, int]:
    """How many names are of something that the photograph shows, and how many aren't."""
    said = [({label for label, _ in named(b)}, set(p.shows)) for b, p in zip(boxes, photographs, strict=True)]
    return sum(len(names & shows) for names, shows in said), sum(len(names - shows) for names, shows in said)


def main() -> None:
    """Looks at all photographs with all detectors; the table goes to stdout."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--picture", type=Path, help="where the picture with boxes goes")
    args = parser.parse_args()
    names = detectors_here()
    if not names:
        raise ConfigError("no detector is on this machine: `surveilnav models pull yolox-nano` fetches one")
    pictures = [read(photograph) for photograph in PHOTOGRAPHS]
    found = {name: boxes_of(name, pictures) for name in names}
    print(page(found))
    if args.picture:
        rows = [
            np.hstack([drawn(pictures[i], found[name][i], f"{photograph.name}: {name}") for name in names])
            for i, photograph in enumerate(PHOTOGRAPHS)
            if photograph.drawn
        ]
        cv2.imwrite(str(args.picture), np.vstack(rows)[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])


if __name__ == "__main__":
    try:
        main()
    except ConfigError as error:
        sys.exit(f"error: {error}")
