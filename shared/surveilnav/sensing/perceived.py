"""What a camera's own perception saw in a view, in a few kilobytes: ``perceived-zstd``.

A worker's reply about a view of 1280 x 1280 with twenty detections takes 30 kB. Here masks are cells of ``divisor`` pixels
a side, embeddings small integers (cosines change by less than 0.002), boxes whole pixels, scores and chances steps of 1/254; all
of it compressed. It is read into the same ``InferReply`` that a worker sends, so that nobody else needs to know of it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import cv2
import msgspec
import numpy as np
import zstandard
from numpy.typing import NDArray

from surveilnav.errors import WireError
from surveilnav.geometry import Pinhole
from surveilnav.messages import Detection, FrameHeader, InferReply, ModelIds
from surveilnav.sensing import rle
from surveilnav.sensing.limits import MAX_DIVISOR, unzstd
from surveilnav.sensing.packing import MAX_EMBEDDING_DIM, pack_embedding
from surveilnav.sensing.replies import MAX_DETECTIONS
from surveilnav.sensing.views import DetectedObject, ViewPerception, box_cells

_MAX_BYTES: Final = 4 << 20
#: Masks of all detections together, in pictures.
_MAX_MASKS: Final = 32
_STEPS: Final = 254
_NO_CHANCE: Final = 255
#: Steps of an embedding's component up to the largest one. 127 would take a third more bytes.
_EMBEDDING_STEPS: Final = 31.0


class _Packed(msgspec.Struct, frozen=True, array_like=True):
    """``labels``: indices into ``words``, or words that aren't among them. ``masks``: run lengths of each detection's cells."""

    backend: str
    models: tuple[str, str, str]
    words: list[str]
    labels: list[int | str]
    scores: bytes
    chances: bytes
    boxes_px: bytes
    embeddings: bytes
    masks: list[list[int]]


def perceived_to_bytes(
    perception: ViewPerception, models: ModelIds, camera: Pinhole, *, divisor: int, masks: bool = True
) -> bytes:
    """Encodes what was seen in a view of ``camera``. Without ``masks``, each object fills its box."""
    found, index = perception.detections, {word: i for i, word in enumerate(perception.words)}
    vectors = np.stack([perception.image_embedding, *(d.embedding for d in found)])
    scaled = vectors / np.maximum(np.abs(vectors).max(axis=1, keepdims=True), 1e-9)
    packed = _Packed(
        perception.backend,
        (models.detector, models.segmenter, models.embedder),
        list(perception.words),
        [index.get(d.label, d.label) for d in found],
        bytes(_step(d.score) for d in found),
        bytes(_NO_CHANCE if d.chance is None else _step(d.chance) for d in found),
        np.array([box_cells(d.box_px, camera.width_px, camera.height_px) for d in found], "<u2").tobytes(),
        np.rint(scaled * _EMBEDDING_STEPS).astype(np.int8).tobytes(),
        [_packed_mask(d, camera, divisor) if masks else [] for d in found],
    )
    return zstandard.ZstdCompressor(level=19, write_checksum=True).compress(msgspec.msgpack.encode(packed))


def perceived_reply(header: FrameHeader, payload: bytes) -> InferReply | None:
    """What the camera saw in a frame, as a worker would have replied; None: the frame doesn't say.

    Raises:
        WireError: it can't be read. What it says is still to be checked, by ``perception_from_wire``.
    """
    part = header.perceived
    if part is None:
        return None
    begin = header.image.n_bytes + header.depth.n_bytes
    if part.encoding != "perceived-zstd" or min(header.image.n_bytes, header.depth.n_bytes, part.n_bytes) <= 0:
        raise WireError(f"expected a part perceived-zstd, got {part.encoding} of {part.n_bytes} bytes")
    if begin + part.n_bytes != len(payload):
        raise WireError(f"the payload has {len(payload)} bytes, its header says {begin + part.n_bytes}")
    packed = _unpacked(payload[begin:])
    return InferReply(
        stamp_ns=header.stamp_ns,
        worker=header.source,
        backend=packed.backend,
        source=header.source,
        view=header.view,
        seq=header.seq,
        detections=_detections(packed, header.camera, part.divisor),
        image_embedding=_embeddings(packed)[0],
        models=ModelIds(*packed.models),
        words=packed.words,
    )


def _unpacked(data: bytes) -> _Packed:
    n_bytes = _stated_size(data)
    if n_bytes > _MAX_BYTES:
        raise WireError(f"what a camera saw takes up to {_MAX_BYTES} bytes, got {n_bytes}")
    try:
        return msgspec.msgpack.decode(unzstd(data, n_bytes), type=_Packed)
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise WireError(f"what a camera saw can't be read: {error}") from None


def _stated_size(data: bytes) -> int:
    try:
        return int(zstandard.frame_content_size(data))
    except zstandard.ZstdError as error:
        raise WireError(f"what a camera saw can't be decompressed: {error}") from None


def _detections(packed: _Packed, camera: Pinhole, divisor: int) -> list[Detection]:
    n = len(packed.labels)
    if n > MAX_DETECTIONS:
        raise WireError(f"a view has up to {MAX_DETECTIONS} detections, got {n}")
    if not 1 <= divisor <= MAX_DIVISOR:
        raise WireError(f"a cell of a mask has 1 to {MAX_DIVISOR} pixels a side, got {divisor}")
    sizes = len(packed.scores), len(packed.chances), len(packed.boxes_px) // 8, len(packed.masks)
    if set(sizes) != {n} or len(packed.boxes_px) % 8:
        raise WireError(f"expected facts about {n} detections, got {sizes}")
    boxes = [tuple(map(int, box)) for box in np.frombuffer(packed.boxes_px, "<u2").reshape(n, 4)]
    area_px = sum(
        max(x1 - x0, 0) * max(y1 - y0, 0) for (x0, y0, x1, y1), mask in zip(boxes, packed.masks, strict=True) if mask
    )
    if area_px > _MAX_MASKS * camera.width_px * camera.height_px:
        raise WireError(f"the masks of a view cover it up to {_MAX_MASKS} times, got {area_px} pixels")
    embeddings = _embeddings(packed)[1:]
    return [
        Detection(
            label=_word(packed, packed.labels[i]),
            score=min(packed.scores[i], _STEPS) / _STEPS,
            box_px=(float(boxes[i][0]), float(boxes[i][1]), float(boxes[i][2]), float(boxes[i][3])),
            embedding=embeddings[i],
            mask=_unpacked_mask(packed.masks[i], boxes[i], camera, divisor),
            chance=None if packed.chances[i] == _NO_CHANCE else packed.chances[i] / _STEPS,
        )
        for i in range(n)
    ]


def _embeddings(packed: _Packed) -> list[bytes]:
    """The embedding of the picture, then those of the detections, as a worker sends them."""
    n = 1 + len(packed.labels)
    dim, rest = divmod(len(packed.embeddings), n)
    if rest or not 1 <= dim <= MAX_EMBEDDING_DIM:
        raise WireError(f"expected {n} embeddings of one length, got {len(packed.embeddings)} bytes")
    vectors = np.frombuffer(packed.embeddings, np.int8).reshape(n, dim).astype(np.float32)
    norms = np.linalg.norm(vectors, axis=1, keepdims=True)
    if not norms.all():
        raise WireError("an embedding has unit length, got one of 0")
    return [pack_embedding(v) for v in vectors / norms]


def _word(packed: _Packed, label: int | str) -> str:
    if isinstance(label, str):
        return label
    if not 0 <= label < len(packed.words):
        raise WireError(f"expected one of {len(packed.words)} words, got number {label}")
    return packed.words[label]


def _step(share: float) -> int:
    return round(min(max(share, 0.0), 1.0) * _STEPS)


def _cells_of(box: Sequence[int], divisor: int) -> tuple[int, int, int, int]:
    """The cells (x0, y0, x1, y1) that a box of whole pixels touches."""
    x0, y0, x1, y1 = box
    return x0 // divisor, y0 // divisor, math.ceil(x1 / divisor), math.ceil(y1 / divisor)


def _packed_mask(found: DetectedObject, camera: Pinhole, divisor: int) -> list[int]:
    """Run lengths of the cells of which at least half is in the mask; none if the mask is the whole box, or no cell is."""
    if found.mask is None or not found.mask.size:
        return []
    box = box_cells(found.box_px, camera.width_px, camera.height_px)
    x0, y0, x1, y1 = _cells_of(box, divisor)
    whole = np.zeros(((y1 - y0) * divisor, (x1 - x0) * divisor), np.float32)
    top, left = box[1] - y0 * divisor, box[0] - x0 * divisor
    whole[top : top + found.mask.shape[0], left : left + found.mask.shape[1]] = found.mask
    cells = cv2.resize(whole, (x1 - x0, y1 - y0), interpolation=cv2.INTER_AREA) >= 0.5
    return rle.encode(cells) if cells.any() else []


def _unpacked_mask(runs: list[int], box: Sequence[int], camera: Pinhole, divisor: int) -> list[int]:
    """The run lengths of the mask's pixels in its box."""
    if not runs:
        return []
    if not (0 <= box[0] < box[2] <= camera.width_px and 0 <= box[1] < box[3] <= camera.height_px):
        raise WireError(f"expected a box in a picture of {camera.width_px}x{camera.height_px}, got {box}")
    x0, y0, x1, y1 = _cells_of(box, divisor)
    cells: NDArray[np.bool_] = rle.decode(runs, x1 - x0, y1 - y0)
    pixels = np.repeat(np.repeat(cells, divisor, axis=0), divisor, axis=1)
    top, left = box[1] - y0 * divisor, box[0] - x0 * divisor
    return rle.encode(pixels[top : top + box[3] - box[1], left : left + box[2] - box[0]])
