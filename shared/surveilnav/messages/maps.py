"""The joint map as others may see it."""

from __future__ import annotations

from typing import Literal

import msgspec

from surveilnav.geometry import Grid
from surveilnav.messages.base import Message

LayerName = Literal["occupancy", "explored", "frontier", "value", "cloud", "provenance"]
LAYERS: tuple[str, ...] = ("occupancy", "explored", "frontier", "value", "cloud", "provenance")


class LayerHeader(Message, frozen=True, kw_only=True):
    """Describes one map layer; the payload is a zstd-compressed, row-major array.

    occupancy, explored, frontier: uint8 (0 or 1) on ``grid``; value: float32 on ``grid``, NaN where
    unknown, for ``target``, without the views that another embedding model looked at (``views_left_out``); cloud: (N, 6)
    float32 of x, y, z [m, world] and r, g, b [0-1]; provenance: (N, 3) int64, a line for each of the cloud's points at
    the same revision: index into ``source_sets``, first and last seen [ns].
    """

    floor: str
    layer: LayerName
    revision: int
    grid: Grid
    dtype: Literal["uint8", "float32", "int64"]
    shape: tuple[int, ...]
    target: str = ""
    views_left_out: int = 0
    source_sets: list[list[str]] = []


class ViewPicture(Message, frozen=True, kw_only=True):
    """Names a picture that the maps took; the payload is its JPEG."""

    source: str
    view: int
    seq: int


class CameraUse(msgspec.Struct, frozen=True):
    """A camera that the floor rule activated: how many of its views fusion has processed, of how many.

    A picture is processed once the maps hold it or have refused it for good: nobody needs to wait for it any more.
    """

    camera: str
    views_processed: int
    views: int


class Revision(Message, frozen=True, kw_only=True):
    """What the maps of a floor have processed: newest robot observations by robot, and the cameras' views.

    ``pending_views`` counts frames of active cameras that are still on their way into the maps.
    ``floor_z_m`` is the altitude of the floor.
    """

    floor: str
    revision: int
    floor_z_m: float
    robots: dict[str, int]
    cameras: list[CameraUse]
    pending_views: int
    perception_ok: bool = True
    message: str = ""


class ObjectEvent(msgspec.Struct, frozen=True):
    """One line in an object's history: which source said what, when, where in its picture, and what came of it."""

    stamp_ns: int
    source: str
    view: int
    seq: int
    label: str
    score: float
    what: Literal["created", "matched", "merged", "confirmed", "rejected", "flipped", "not_seen"]
    note: str = ""
    box_px: tuple[float, float, float, float] | None = None


class ObjectRecord(msgspec.Struct, frozen=True, kw_only=True):
    """One object of the joint map.

    ``confidence`` is the maximum over robot and surveillance, ``label`` the class of that maximum.
    ``center_m``, ``size_m``: axis-aligned box in the world [m]. ``points``: (N, 3) float32 bytes of at most
    256 of its points [m, world]. ``seen_from``: mean of the horizontal unit vectors (x, y) from the object to those who
    detected it: long where it was seen from one side only, (0, 0) where unknown or from all around. ``relevance``: cosine
    of its embedding and that of the text asked for; None where none was, or where another model looked at it.
    """

    id: int
    floor: str
    label: str
    status: Literal["candidate", "confirmed", "rejected"]
    confidence: float
    confidence_robot: float
    confidence_surveillance: float
    label_robot: str
    label_surveillance: str
    n_detections: int
    n_points: int
    center_m: tuple[float, float, float]
    size_m: tuple[float, float, float]
    first_seen_ns: int
    last_seen_ns: int
    sources: list[str]
    reason: str
    points: bytes = b""
    history: list[ObjectEvent] = []
    label_scores: dict[str, float] = {}
    seen_from: tuple[float, float] = (0.0, 0.0)
    relevance: float | None = None


class ObjectList(Message, frozen=True, kw_only=True):
    """All objects of a floor at a revision."""

    floor: str
    revision: int
    objects: list[ObjectRecord]
