"""Packed views: a file a building, whole or not there (``surveilnav.storage``).

Parts: a table in JSON, then for each view its picture (WebP), its ids (WebP without loss) and its depth (as sensors send it).
Depth is noisy, so it takes ten times what the rest takes.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import msgspec
import numpy as np
from numpy.typing import NDArray

from surveilnav.errors import PerceptionError
from surveilnav.sensing.depth_codec import decode_depth, encode_depth
from surveilnav.storage import read_parts, write_parts
from training.detector.poses import Kind
from training.detector.views import DEPTH_RANGE_M, TrainingView

_FORMAT = b"surveilnav training views 3"
SUFFIX = ".views"
_LOSSLESS = 101  # as OpenCV has it


class PackedView(msgspec.Struct, frozen=True):
    """One row of a file's table: the fields of ``TrainingView`` without its pictures."""

    kind: Kind
    light: str
    hfov_rad: float
    boxes: list[tuple[float, float, float, float]]
    labels: list[int]
    areas: list[int]
    near: list[int]
    room: int


class _Table(msgspec.Struct, frozen=True):
    scene: str
    classes: list[str]
    rooms: list[str]
    views: list[PackedView]


def write_pack(
    path: Path,
    scene: str,
    views: Iterable[TrainingView],
    classes: Sequence[str],
    rooms: Sequence[str],
    quality: int = 75,
) -> int:
    """Writes a building's views; returns the bytes of the file. ``quality``: of pictures, 1-100."""
    rows, parts = [], []
    for view in views:
        rows.append(_row(view))
        parts += [
            encoded(view.rgb[..., ::-1], quality),
            encoded(view.ids, _LOSSLESS),
            encode_depth(view.depth_m, DEPTH_RANGE_M[view.kind]),
        ]
    table = _Table(scene, list(classes), list(rooms), rows)
    return write_parts(path, _FORMAT, [msgspec.json.encode(table), *parts])


def _row(view: TrainingView) -> PackedView:
    boxes = [(b[0], b[1], b[2], b[3]) for b in view.boxes.tolist()]
    return PackedView(
        view.kind,
        view.light,
        view.hfov_rad,
        boxes,
        view.labels.tolist(),
        view.areas.tolist(),
        np.flatnonzero(view.near).tolist(),
        view.room,
    )


def encoded(picture: NDArray[np.uint8], quality: int = _LOSSLESS) -> bytes:
    """WebP of (H, W) or, blue first, (H, W, 3)."""
    done, data = cv2.imencode(".webp", np.ascontiguousarray(picture), [cv2.IMWRITE_WEBP_QUALITY, quality])
    assert done
    return data.tobytes()


@dataclass(frozen=True, slots=True, eq=False)
class Pack:
    """The views of one building, still encoded. ``pictures``, ``ids``, ``depths``: as many as rows of ``views``."""

    scene: str
    classes: tuple[str, ...]
    views: tuple[PackedView, ...]
    pictures: tuple[bytes, ...]
    ids: tuple[bytes, ...]
    depths: tuple[bytes, ...]

    def view(self, i: int) -> TrainingView:
        """View ``i``, decoded."""
        row = self.views[i]
        rgb = cv2.imdecode(np.frombuffer(self.pictures[i], np.uint8), cv2.IMREAD_COLOR)
        ids = cv2.imdecode(np.frombuffer(self.ids[i], np.uint8), cv2.IMREAD_GRAYSCALE)
        assert rgb is not None
        assert ids is not None
        near = np.zeros(len(self.classes), bool)
        near[row.near] = True
        boxes = np.array(row.boxes, np.float32).reshape(-1, 4)
        labels, areas = np.array(row.labels, np.int64), np.array(row.areas, np.int64)
        depth_m = decode_depth(self.depths[i], rgb.shape[1], rgb.shape[0], DEPTH_RANGE_M[row.kind])
        return TrainingView(
            row.kind,
            row.light,
            row.hfov_rad,
            np.ascontiguousarray(rgb[..., ::-1]).astype(np.uint8),
            depth_m,
            ids.astype(np.uint8),
            boxes,
            labels,
            areas,
            near,
            row.room,
        )


def read_pack(path: Path) -> Pack | None:
    """The pack in a file; None if it isn't there or is damaged (then it is deleted, to be made anew)."""
    parts = read_parts(path, _FORMAT)
    if parts is None:
        return None
    table = msgspec.json.decode(parts[0], type=_Table)
    pictures, ids, depths = (tuple(parts[1 + k :: 3]) for k in range(3))
    return Pack(table.scene, tuple(table.classes), tuple(table.views), pictures, ids, depths)


def read_packs(folder: Path, classes: Sequence[str]) -> list[Pack]:
    """All packs of a folder, by name.

    Raises:
        PerceptionError: there is none, or one is of other classes.
    """
    packs = [pack for path in sorted(folder.glob(f"*{SUFFIX}")) if (pack := read_pack(path)) is not None]
    if not packs:
        raise PerceptionError(
            f"{folder} holds no file *{SUFFIX}: make them with python -m training.detector.make_views"
        )
    for pack in packs:
        if pack.classes != tuple(classes):
            raise PerceptionError(
                f"{folder}/{pack.scene}{SUFFIX} has other classes than data/classes.json: make it anew"
            )
    return packs
