"""Messages of fusion about the joint maps."""

from __future__ import annotations

from typing import Literal

import msgspec

from surveilnav.geometry import Grid
from surveilnav.messages.base import Message

LayerName = Literal["occupancy", "explored", "frontier", "value", "cloud", "provenance"]
LAYERS: tuple[str, ...] = ("occupancy", "explored", "frontier", "value", "cloud", "provenance")


class LayerHeader(Message, frozen=True, kw_only=True):
    """Describes one map layer; the payload is a zstd-compressed, row-major array.

    Layers:
        occupancy: uint8 on ``grid``: 0 free or unknown, or one of the values in ``surveilnav.occupancy``.
        explored, frontier: uint8 on ``grid``, 0 or 1.
        value: float32 on ``grid`` for ``target``, NaN where unknown.
        cloud: (N, 6) float32, x, y, z [m, world] and r, g, b [0-1] of each point.
        provenance: (N, 3) int64, for each point of the cloud of the same revision: index into ``source_sets``, first and
            last time seen [ns].

    Attributes:
        views_left_out: number of views that don't count in the value layer, because another model embedded them.
        source_sets: sets of sources, to which the provenance refers.
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


class LayerPart(msgspec.Struct, frozen=True):
    """A layer among others in one payload: its name, type and shape, and how many bytes of the payload are its own."""

    layer: Literal["occupancy", "explored", "frontier", "value"]
    dtype: Literal["uint8", "float32"]
    shape: tuple[int, ...]
    n_bytes: int


class ViewPicture(Message, frozen=True, kw_only=True):
    """A picture of a view in the maps; the payload is its JPEG."""

    source: str
    view: int
    seq: int


class CameraUse(msgspec.Struct, frozen=True):
    """A camera that is invoked, and how many of its views fusion has processed.

    A view is processed when it is in the maps or was refused for good, so that nobody has to wait for it any more.
    ``quarantine``: why none of its views is believed; "" if they are.
    """

    camera: str
    views_processed: int
    views: int
    quarantine: str = ""


class RobotFrameProblem(msgspec.Struct, frozen=True):
    """A robot isn't where it says by what cameras have measured, so none of its views is believed while it is so.

    ``dx_m``, ``dy_m``, ``dyaw_rad``: how it must be moved and turned from where it says that it is, to be there.
    """

    robot: str
    message: str
    dx_m: float
    dy_m: float
    dyaw_rad: float


class Revision(Message, frozen=True, kw_only=True):
    """What the maps of a floor have processed.

    Attributes:
        revision: grows with each view that enters the maps.
        floor_z_m: altitude of the floor.
        robots: by robot, the sequence number of its newest processed observation.
        cameras: the invoked cameras.
        pending_views: frames of invoked cameras that aren't processed yet.
        perception_ok, message: whether perception works, and if not, why.
        frames: the robots of this floor that aren't where they say.
    """

    floor: str
    revision: int
    floor_z_m: float
    robots: dict[str, int]
    cameras: list[CameraUse]
    pending_views: int
    perception_ok: bool = True
    message: str = ""
    frames: list[RobotFrameProblem] = []


class ObjectEvent(msgspec.Struct, frozen=True):
    """One entry of an object's history: a detection in a view, and what followed from it (``what``, ``note``)."""

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

    Attributes:
        confidence, label: the larger of the robots' and the cameras' confidence, and its class.
        confidence_robot, label_robot: the same from robots' views only.
        confidence_surveillance, label_surveillance: the same from cameras' views only.
        center_m, size_m: its axis-aligned box in the world.
        sources: the sources that detected it.
        reason: why it has its status.
        points: (N, 3) float32 bytes of at most 256 of its points [m, world].
        position_sigma_m: standard deviation of its horizontal position as long as that is only estimated; 0 if it was measured.
        seen_from: mean of the horizontal unit vectors (x, y) from the object to its observers. It is long if the object was
            seen from one side only, and (0, 0) if that is unknown or it was seen from all around.
        relevance: cosine of its embedding and that of the requested text. None if no text was requested, or if another model
            embedded the object.
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
    position_sigma_m: float = 0.0
    seen_from: tuple[float, float] = (0.0, 0.0)
    relevance: float | None = None


class ObjectList(Message, frozen=True, kw_only=True):
    """All objects of a floor at a revision."""

    floor: str
    revision: int
    objects: list[ObjectRecord]


class Room(msgspec.Struct, frozen=True, kw_only=True):
    """A room of the building: its floor, its name for people, and its outline [m, world] as the corners of a polygon."""

    floor: str
    name: str
    outline_m: list[tuple[float, float]]


class RoomInView(msgspec.Struct, frozen=True, kw_only=True):
    """How much of a room's floor cameras see.

    Attributes:
        share: of the floor that no furniture stands on, the share that is in view of a camera (0-1).
        cameras: the cameras that see part of it, the one that sees most first.
    """

    floor: str
    name: str
    share: float
    cameras: list[str]


class CameraSearch(Message, frozen=True, kw_only=True):
    """Has all cameras of a floor, or of all floors, looked at for ``target``, with or without a robot there.

    Attributes:
        floor: empty: all floors.
        max_s: after this time the answer comes in any case.
        rooms: rooms of which the answer shall say how much of them cameras see.
    """

    target: str
    floor: str = ""
    max_s: float = 10.0
    rooms: list[Room] = []


class CameraSearchReport(Message, frozen=True, kw_only=True):
    """What came of a ``CameraSearch``. What was found is among the objects of the maps.

    Attributes:
        cameras: the cameras that were looked at, and how many of their views the maps hold.
        lacking: cameras of which not every view came in time, with the reason.
        complete: whether every view of every camera was looked at for the target.
        rooms: how much cameras see of the rooms that were asked about, on the floors that were searched.
    """

    target: str
    cameras: list[CameraUse]
    lacking: dict[str, str]
    complete: bool
    rooms: list[RoomInView] = []


class FloorMapsHeader(Message, frozen=True, kw_only=True):
    """The maps of a floor at one moment, or what changed in them since a revision that the asker has.

    The payload holds the arrays of ``layers``, one after the other, packed as in ``LayerHeader``; all lie on ``grid``. A
    layer that isn't among them is as it was at ``since``, and so is an object among ``object_ids`` but not ``objects``.

    Attributes:
        target: what the layer ``value`` belongs to.
        epoch: revisions of another epoch mean nothing here: fusion was restarted, or a removal has changed the maps.
        removals: how many removals (``RemoveFromMaps``) the maps reflect. When it changes, the objects have other ids.
        revision: of the floor's maps.
        since: the revision that the asker has; -1: everything is here.
        object_ids: of all objects of the floor, ascending.
        robots: the newest processed observation of each robot of the floor.
        pending_views: views of the floor's cameras that are still to come.
    """

    floor: str
    target: str
    epoch: str
    revision: int
    since: int
    grid: Grid
    layers: list[LayerPart]
    objects: list[ObjectRecord]
    object_ids: list[int]
    robots: dict[str, int]
    pending_views: int
    removals: int = 0
