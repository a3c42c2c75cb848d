"""The network ``compact`` under ONNX Runtime: boxes, masks and embeddings from a picture and its depth."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache

import cv2
import msgspec
import numpy as np
import onnxruntime
from numpy.typing import NDArray

from surveilnav.errors import PerceptionError
from surveilnav.perception.boxes import Boxes, merge_overlapping_rows
from surveilnav.perception.detectors.depth_channels import N_CHANNELS, depth_channels
from surveilnav.perception.detectors.guided_mask import guided_mask
from surveilnav.perception.detectors.onnx_file import SCORE_FLOOR
from surveilnav.perception.protocols import RgbdView
from surveilnav.sensing.packing import MAX_NAMES
from surveilnav.words import canonical

Floats = NDArray[np.float32]

STRIDES = (8, 16, 32)
MASK_STRIDE = 4
#: Length of the input's longer side, also for large pictures, which show smaller objects (training/detector/README.md).
_SIDE_PX, _SIDE_OF_LARGE_PX, _LARGE_PX = 320, 416, 1000
#: Boxes with at least this IoU are one object, as for the COCO detectors.
_SAME_THING_IOU = 0.6
#: Only this many of the best boxes are compared with each other.
_MAX_BOXES = 300
#: Boxes with a shorter side, in pixels of the picture, are dropped.
_MIN_SIDE_PX = 4.0
_GREY = 114


@dataclass(frozen=True, slots=True, eq=False)
class NetworkOutput:
    """The network's output for one picture, at the L places of its output grid.

    Attributes:
        scores: (L, C) for C classes.
        xyxy: (L, 4) boxes [pixels of the picture].
        coefficients: (L, K) of the mask prototypes.
        embeddings: (L, D) of objects.
        prototypes: (K, H / 4, W / 4) mask prototypes, for a letterboxed picture of height H and width W.
        image: (D,) embedding of the picture.
        near: (C + R,) how likely each class or kind of room is near.
        ratio: size of the letterboxed picture over that of the picture.
        depth_m: (height, width) of the picture.
    """

    scores: Floats
    xyxy: Floats
    coefficients: Floats
    embeddings: Floats
    prototypes: Floats
    image: Floats
    near: Floats
    ratio: float
    depth_m: Floats

    def mask(self, place: int, cells: tuple[int, int, int, int]) -> NDArray[np.bool_]:
        """Mask (y1 - y0, x1 - x0) of the object detected at a place, in ``cells`` (x0, y0, x1, y1) [pixels of the picture]."""
        k, h, w = self.prototypes.shape
        logits = (self.coefficients[place] @ self.prototypes.reshape(k, -1)).reshape(h, w).astype(np.float32)
        return guided_mask(logits, self.depth_m, cells, self.ratio / MASK_STRIDE)


class CompactNetwork:
    """The network in an ONNX file that ``training.detector.export`` wrote.

    Args:
        session: the opened file.
        side_px: length of the input's longer side, a multiple of 32; None: 320, and 416 for large pictures.

    Attributes:
        classes, rooms: names of its C classes and R kinds of rooms.
        meanings: by other words, the class that each means.
        class_vectors: (C, D) embeddings of objects of each class.
        near_vectors: (C + R, D) embeddings of pictures that show a class or its usual surroundings, or a kind of room.

    Raises:
        PerceptionError: the file is no such network.
    """

    name = "compact"

    def __init__(self, session: onnxruntime.InferenceSession, side_px: int | None = None) -> None:
        self._session, self._side = session, side_px
        for what, wanted, there in (
            ("output", self._outputs, session.get_outputs()),
            ("input", ("picture", "depth"), session.get_inputs()),
        ):
            found = {one.name for one in there}
            if missing := [name for name in wanted if name not in found]:
                raise PerceptionError(
                    f"compact: the file has no {what} {', '.join(missing)}; it has {', '.join(sorted(found))}"
                )
        metadata = _parse_metadata(session.get_modelmeta().custom_metadata_map)
        self.classes, self.rooms, self.meanings = tuple(metadata.classes), tuple(metadata.rooms), metadata.meanings
        self.class_vectors = np.array(metadata.class_vectors, np.float32)
        self.near_vectors = np.array(metadata.near_vectors, np.float32)

    def detect(self, view: RgbdView) -> Boxes:
        """Boxes in a view, one per object, in its pixels, best first."""
        return self.boxes(self.run(view), view.rgb.shape[0], view.rgb.shape[1])[0]

    def boxes(self, output: NetworkOutput, height: int, width: int) -> tuple[Boxes, NDArray[np.int64]]:
        """Boxes in pixels of the picture, one per object, best first; and the place (N,) that detected each."""
        likely = np.flatnonzero(output.scores.max(axis=1) >= SCORE_FLOOR)
        scores = np.where(output.scores[likely] >= SCORE_FLOOR, output.scores[likely], np.float32(0.0))
        kept, rows = merge_overlapping_rows(
            Boxes(output.xyxy[likely], scores, self.classes), _SAME_THING_IOU, max_boxes=_MAX_BOXES
        )
        inside = np.clip(kept.xyxy, 0, np.array([width, height, width, height], np.float32))
        large = np.flatnonzero((inside[:, 2:] - inside[:, :2]).min(axis=1, initial=np.inf) >= _MIN_SIDE_PX)
        return Boxes(inside[large], kept.scores[large], self.classes), likely[rows[large]]

    def run(self, view: RgbdView) -> NetworkOutput:
        """Runs the network on a view. It also works without depth, though less well."""
        large = max(view.rgb.shape[:2]) >= _LARGE_PX
        box, ratio = letterboxed(view.rgb, self._side or (_SIDE_OF_LARGE_PX if large else _SIDE_PX))
        inputs = {"picture": box[None], "depth": _letterboxed_depth(view, ratio, *box.shape[:2])[None]}
        out = dict(zip(self._outputs, self._session.run(self._outputs, inputs), strict=True))
        points = place_centres(*box.shape[:2])
        ltrb = out["ltrb"]
        xyxy = np.concatenate([points - ltrb[:, :2], points + ltrb[:, 2:]], axis=1) / ratio
        return NetworkOutput(
            out["scores"],
            xyxy.astype(np.float32),
            out["coefficients"],
            out["embeddings"],
            out["prototypes"],
            out["image"],
            out["near"],
            ratio,
            view.depth_m,
        )

    _outputs = ("scores", "ltrb", "coefficients", "embeddings", "prototypes", "image", "near")


class _Metadata(msgspec.Struct, frozen=True):
    """The metadata of a file; each entry is JSON."""

    classes: list[str]
    rooms: list[str]
    class_vectors: list[list[float]]
    near_vectors: list[list[float]]
    meanings: dict[str, str] = {}


def _parse_metadata(entries: Mapping[str, str]) -> _Metadata:
    """Decodes the metadata. Raises PerceptionError if an entry is missing, or they don't fit each other."""
    try:
        values = {key: msgspec.json.decode(entries[key]) for key in _Metadata.__struct_fields__ if key in entries}
        metadata = msgspec.convert(values, _Metadata)
    except msgspec.MsgspecError as error:
        raise PerceptionError(f"compact: the file's metadata can't be read: {error}") from error
    if (
        not metadata.classes
        or len(metadata.classes) > MAX_NAMES
        or [canonical(c) for c in metadata.classes] != metadata.classes
    ):
        raise PerceptionError(
            f"compact: expected 1 to {MAX_NAMES} classes, spelled as words are, got {metadata.classes[:20]}"
        )
    if len(set(metadata.classes)) != len(metadata.classes):
        raise PerceptionError("compact: two of the file's classes have one name")
    n, rows = (
        len(metadata.class_vectors[0]) if metadata.class_vectors else 0,
        (metadata.class_vectors, metadata.near_vectors),
    )
    wanted = len(metadata.classes), len(metadata.classes) + len(metadata.rooms)
    if n == 0 or tuple(map(len, rows)) != wanted or any(len(row) != n for table in rows for row in table):
        raise PerceptionError(f"compact: expected {wanted[0]} and {wanted[1]} vectors of one length, got others")
    return metadata


def letterboxed(rgb: NDArray[np.uint8], side_px: int) -> tuple[NDArray[np.uint8], float]:
    """A picture scaled to a longer side of ``side_px`` and padded to multiples of 32 on the right and below; and its scale."""
    height, width = rgb.shape[:2]
    ratio = side_px / max(height, width)
    size = round(width * ratio), round(height * ratio)
    full = -(-size[1] // 32) * 32, -(-size[0] // 32) * 32
    out = np.full((*full, 3), _GREY, np.uint8)
    out[: size[1], : size[0]] = cv2.resize(rgb, size, interpolation=cv2.INTER_AREA if ratio < 1 else cv2.INTER_LINEAR)
    return out, ratio


def _letterboxed_depth(view: RgbdView, ratio: float, height: int, width: int) -> Floats:
    """(height / 2, width / 2, ``N_CHANNELS``) depth channels, aligned with the ``letterboxed`` picture of height x width."""
    out = np.zeros((height // 2, width // 2, N_CHANNELS), np.float32)
    rows, columns = (max(1, round(side * ratio / 2)) for side in view.depth_m.shape)
    out[:rows, :columns] = depth_channels(view.depth_m, view.camera, columns, rows)
    return out


@lru_cache(maxsize=8)
def place_centres(height_px: int, width_px: int) -> Floats:
    """(L, 2) centres (x, y) [pixels] of the places of the output grid, stride 8 first, row by row. Shared: don't write to it."""
    grids = []
    for stride in STRIDES:
        rows, columns = height_px // stride, width_px // stride
        grids.append(
            (np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), axis=-1).reshape(-1, 2) + 0.5) * stride
        )
    return np.concatenate(grids).astype(np.float32)
