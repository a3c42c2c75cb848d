"""``compact`` under ONNX Runtime: a picture and its depth in; boxes, masks and vectors out. Needs no PyTorch."""

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
from surveilnav.perception.detectors.onnx_file import LOWEST
from surveilnav.perception.protocols import RgbdView
from surveilnav.sensing.packing import MAX_NAMES
from surveilnav.words import canonical

Floats = NDArray[np.float32]

STRIDES = (8, 16, 32)
MASK_STRIDE = 4
#: The longer side of what it sees; of large pictures, where more pixels find more (training/detector/README.md).
_SIDE_PX, _SIDE_OF_LARGE_PX, _LARGE_PX = 320, 416, 1000
#: Boxes that overlap so much are one thing, as for the COCO detectors.
_SAME_THING_IOU = 0.6
#: More boxes than this aren't compared with each other.
_MAX_BOXES = 300
#: Of the picture; smaller boxes are specks.
_SMALLEST_PX = 4.0
_GREY = 114


@dataclass(frozen=True, slots=True, eq=False)
class Answer:
    """All that the network says of one picture at L places.

    ``scores`` (L, C); ``xyxy`` (L, 4) [pixels of the picture]; ``coefficients`` (L, K); ``embeddings`` (L, D);
    ``prototypes`` (K, H / 4, W / 4) of the letterbox; ``image`` (D,); ``near`` (C + R,); ``ratio``: letterbox / picture;
    ``depth_m`` (height, width) of the picture.
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
        """(y1 - y0, x1 - x0) the mask of a place in ``cells`` (x0, y0, x1, y1) [pixels of the picture]."""
        k, h, w = self.prototypes.shape
        logits = (self.coefficients[place] @ self.prototypes.reshape(k, -1)).reshape(h, w).astype(np.float32)
        return guided_mask(logits, self.depth_m, cells, self.ratio / MASK_STRIDE)


class CompactNetwork:
    """The network in an ONNX file (``training.detector.export``).

    ``side_px``: the longer side of what it sees of a picture, a multiple of 32; None: 320, and of large pictures, in which
    things are small, 416.

    Attributes:
        classes, rooms: C names of things, R of kinds of rooms.
        meanings: by another word, the class that it means.
        class_vectors: (C, D) what each class looks like; ``near_vectors``: (C + R, D) what shows where each is near.

    Raises:
        PerceptionError: the file is none of its kind.
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
        said = _said(session.get_modelmeta().custom_metadata_map)
        self.classes, self.rooms, self.meanings = tuple(said.classes), tuple(said.rooms), said.meanings
        self.class_vectors = np.array(said.class_vectors, np.float32)
        self.near_vectors = np.array(said.near_vectors, np.float32)

    def detect(self, view: RgbdView) -> Boxes:
        """Boxes of a view in its pixels, one a thing, the best first."""
        return self.things(self.answer(view), view.rgb.shape[0], view.rgb.shape[1])[0]

    def things(self, answer: Answer, height: int, width: int) -> tuple[Boxes, NDArray[np.int64]]:
        """(boxes in pixels of the picture, one a thing, the best first; the place that speaks for each)."""
        likely = np.flatnonzero(answer.scores.max(axis=1) >= LOWEST)
        scores = np.where(answer.scores[likely] >= LOWEST, answer.scores[likely], np.float32(0.0))
        kept, rows = merge_overlapping_rows(
            Boxes(answer.xyxy[likely], scores, self.classes), _SAME_THING_IOU, most=_MOST
        )
        inside = np.clip(kept.xyxy, 0, np.array([width, height, width, height], np.float32))
        large = np.flatnonzero((inside[:, 2:] - inside[:, :2]).min(axis=1, initial=np.inf) >= _SMALLEST_PX)
        return Boxes(inside[large], kept.scores[large], self.classes), likely[rows[large]]

    def answer(self, view: RgbdView) -> Answer:
        """Everything it says of a view. Without depth it says less."""
        large = max(view.rgb.shape[:2]) >= _LARGE_PX
        box, ratio = letterboxed(view.rgb, self._side or (_SIDE_OF_LARGE_PX if large else _SIDE_PX))
        seen = {"picture": box[None], "depth": _letterboxed_depth(view, ratio, *box.shape[:2])[None]}
        out = dict(zip(self._outputs, self._session.run(self._outputs, seen), strict=True))
        points = places(*box.shape[:2])
        ltrb = out["ltrb"]
        xyxy = np.concatenate([points - ltrb[:, :2], points + ltrb[:, 2:]], axis=1) / ratio
        return Answer(
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


class _Said(msgspec.Struct, frozen=True):
    """What a file says of itself; each entry of its metadata is JSON."""

    classes: list[str]
    rooms: list[str]
    class_vectors: list[list[float]]
    near_vectors: list[list[float]]
    meanings: dict[str, str] = {}


def _said(metadata: Mapping[str, str]) -> _Said:
    """What a file's metadata say. PerceptionError: they don't fit each other, or one is missing."""
    try:
        entries = {key: msgspec.json.decode(metadata[key]) for key in _Said.__struct_fields__ if key in metadata}
        said = msgspec.convert(entries, _Said)
    except msgspec.MsgspecError as error:
        raise PerceptionError(f"compact: the file's metadata can't be read: {error}") from error
    if not said.classes or len(said.classes) > MAX_NAMES or [canonical(c) for c in said.classes] != said.classes:
        raise PerceptionError(
            f"compact: expected 1 to {MAX_NAMES} classes, spelled as words are, got {said.classes[:20]}"
        )
    if len(set(said.classes)) != len(said.classes):
        raise PerceptionError("compact: two of the file's classes have one name")
    n, rows = len(said.class_vectors[0]) if said.class_vectors else 0, (said.class_vectors, said.near_vectors)
    wanted = len(said.classes), len(said.classes) + len(said.rooms)
    if n == 0 or tuple(map(len, rows)) != wanted or any(len(row) != n for table in rows for row in table):
        raise PerceptionError(f"compact: expected {wanted[0]} and {wanted[1]} vectors of one length, got others")
    return said


def letterboxed(rgb: NDArray[np.uint8], side_px: int) -> tuple[NDArray[np.uint8], float]:
    """(picture reduced to a longer side of ``side_px`` and filled up to multiples of 32, its scale)."""
    height, width = rgb.shape[:2]
    ratio = side_px / max(height, width)
    size = round(width * ratio), round(height * ratio)
    full = -(-size[1] // 32) * 32, -(-size[0] // 32) * 32
    out = np.full((*full, 3), _GREY, np.uint8)
    out[: size[1], : size[0]] = cv2.resize(rgb, size, interpolation=cv2.INTER_AREA if ratio < 1 else cv2.INTER_LINEAR)
    return out, ratio


def _letterboxed_depth(view: RgbdView, ratio: float, height: int, width: int) -> Floats:
    """(height / 2, width / 2, ``N_CHANNELS``) of a view's depth, where ``letterboxed`` puts its picture."""
    out = np.zeros((height // 2, width // 2, N_CHANNELS), np.float32)
    rows, columns = (max(1, round(side * ratio / 2)) for side in view.depth_m.shape)
    out[:rows, :columns] = depth_channels(view.depth_m, view.camera, columns, rows)
    return out


@lru_cache(maxsize=8)
def places(height_px: int, width_px: int) -> Floats:
    """(L, 2) centres (x, y) [pixels] of all places, stride 8 first, row by row. Shared: don't write to it."""
    grids = []
    for stride in STRIDES:
        rows, columns = height_px // stride, width_px // stride
        grids.append(
            (np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), axis=-1).reshape(-1, 2) + 0.5) * stride
        )
    return np.concatenate(grids).astype(np.float32)
