"""The contract: every key of the bus, what it carries, who owns it, how fresh it must be.

Key strings appear nowhere else. ``docs/understand/contract.md`` is generated from this file by ``make docs``.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any, Literal

from surveilnav import messages as m
from surveilnav.messages.base import Message

VERSION = 1
ROOT = f"surveilnav/{VERSION}"
LIVELINESS = "@surveilnav/" + str(VERSION) + "/{building}/{kind}/{id}"
#: Liveliness token of one process, by which two of one name notice each other. ``zid``: its session.
INSTANCE = "@surveilnav/" + str(VERSION) + "/{building}/{kind}/{id}/{zid}"
#: Liveliness token of the router. A node that speaks another contract notices by it that it can't work here.
ROUTER = "@surveilnav/router/{contract}/{release}"

#: Highest first. A query and its answer have the same priority.
Priority = Literal["control", "data", "maps", "bulk"]
#: What happens to a message for which a link has no room.
WhenFull = Literal["wait", "leave out"]
#: Only large messages may be left out, none that was acknowledged: who lacks a frame or an observation asks for it until it was
#: processed or a newer one has replaced it, and queries for maps are repeated.
WHEN_FULL: dict[Priority, WhenFull] = {"control": "wait", "data": "wait", "maps": "leave out", "bulk": "leave out"}
_FIELD = re.compile(r"\{(\w+)\}")
#: Pattern of an id, which can stand in a key; ``ID_PATTERN`` matches a whole string.
ID = r"[A-Za-z0-9][A-Za-z0-9_.-]{0,63}"
ID_PATTERN = f"^{ID}$"
_ID = re.compile(ID)


@dataclass(frozen=True, slots=True)
class Stream:
    """One row of the contract.

    Attributes:
        name: the stream's name in reports.
        key: its key below ``ROOT``, with fields in braces.
        message: type of what is published or answered.
        owner: who publishes or answers.
        kind: whether the key is published, queried, or both.
        rate_hz: rate of publication; None: on change.
        max_age_ms: age at which a message is stale; also the default time limit of a query.
        priority: decides which message goes first, and whether it may be left out (``when_full``).
        carries: description for people.
        request: type of the message in a query; None: queries carry none.
        payload: whether raw bytes travel beside the message, which is then Zenoh's attachment.
        merge: makes one message of that which is known of a key and a newer one that is only a part; None: the newer one counts.
        allows_wildcard: whether a query with a request may go to all owners. Otherwise it must name one, so that no command
            moves every robot.
    """

    name: str
    key: str
    message: type[Message]
    owner: str
    kind: Literal["put", "query", "put+query"]
    rate_hz: float | None
    max_age_ms: int
    priority: Priority
    carries: str
    request: type[Message] | None = None
    payload: bool = False
    allows_wildcard: bool = False
    merge: Callable[[Any, Any], Any] | None = None

    @property
    def fields(self) -> tuple[str, ...]:
        """The names of the fields in the key, in order."""
        return tuple(_FIELD.findall(self.key))

    def key_for(self, **ids: object) -> str:
        """The key with these ids. Fields that are left out become the wildcard ``*``.

        Raises:
            ValueError: an id has characters that can't stand in a key, or names no field.
        """
        unknown = set(ids) - set(self.fields)
        if unknown:
            raise ValueError(f"{self.name} has no field {sorted(unknown)}; it has {self.fields}")

        def put(match: re.Match[str]) -> str:
            value = str(ids.get(match.group(1), "*"))
            if value != "*" and not _ID.fullmatch(value):
                raise ValueError(f"an id has letters, digits, '_', '.', '-' (at most 64), got {value!r}")
            return value

        return f"{ROOT}/{_FIELD.sub(put, self.key)}"

    def ids_of(self, key: str) -> dict[str, str] | None:
        """The ids in a key by field; None if the key isn't this stream's."""
        match = _pattern(self.key).fullmatch(key)
        return match.groupdict() if match else None

    @property
    def when_full(self) -> WhenFull:
        """What happens to a message for which a link has no room."""
        return WHEN_FULL[self.priority]

    @property
    def schema(self) -> str:
        """The schema string of the message, which travels in Zenoh's encoding."""
        return schema_of(self.message)


@cache  # one for each stream
def _pattern(key: str) -> re.Pattern[str]:
    return re.compile(re.escape(ROOT + "/") + re.sub(r"\\\{(\w+)\\\}", rf"(?P<\1>{ID})", re.escape(key)))


def schema_of(message: type[Message]) -> str:
    """The schema string of a message type. A change that old readers can't read raises ``VERSION``, which is part of it."""
    return f"surveilnav.{message.__name__}/{VERSION}.0"


CAMERA_INFO = Stream(
    "camera_info",
    "{building}/{floor}/camera/{camera}/info",
    m.CameraInfo,
    "camera_node",
    "put+query",
    None,
    10_000,
    "data",
    "place, intrinsics, views, mounting offset, tier",
)
CAMERA_FRAME = Stream(
    "camera_frame",
    "{building}/{floor}/camera/{camera}/frame/{view}",
    m.FrameHeader,
    "camera_node",
    "put",
    None,
    10_000,
    "bulk",
    "RGB-D of one view, while somebody listens",
    payload=True,
)
CAMERA_SUMMARY = Stream(
    "camera_summary",
    "{building}/{floor}/camera/{camera}/summary",
    m.CameraSummary,
    "camera_node",
    "put",
    0.2,
    15_000,
    "data",
    "labels and confidences last seen, at most 512 bytes: for choosing the floor",
)
CAMERA_REQUEST = Stream(
    "camera_request",
    "{building}/{floor}/camera/{camera}/request",
    m.Ack,
    "camera_node",
    "query",
    None,
    5_000,
    "control",
    "send views again (no payload), or in an order; a viewer's thumbnail (a JPEG); pause, resume",
    request=m.CameraRequest,
    payload=True,
)
ROBOT_OBSERVATION = Stream(
    "robot_observation",
    "{building}/robot/{robot}/observation",
    m.Observation,
    "robot_node",
    "put+query",
    None,
    2_000,
    "bulk",
    "RGB-D, pose and sequence number after an action; the newest one for who asks",
    payload=True,
)
ROBOT_STATUS = Stream(
    "robot_status",
    "{building}/robot/{robot}/status",
    m.RobotStatus,
    "robot_node",
    "put+query",
    1.0,
    3_000,
    "data",
    "state, floor, pose",
)
ROBOT_COMMAND = Stream(
    "robot_command",
    "{building}/robot/{robot}/command",
    m.CommandReply,
    "robot_node",
    "query",
    None,
    2_000,
    "control",
    "one action, the sequence number it expects, a deadline",
    request=m.Command,
)
ROBOT_HALT = Stream(
    "robot_halt",
    "{building}/robot/{robot}/halt",
    m.HaltReply,
    "robot_node",
    "query",
    None,
    2_000,
    "control",
    "stop at once and stay, or be released: one robot or all",
    request=m.Halt,
    allows_wildcard=True,
)
PASSAGE_STATE = Stream(
    "passage_state",
    "{building}/passage/{floor}/{passage}",
    m.PassageState,
    "a bridge to doors and lifts",
    "put",
    None,
    10_000,
    "control",
    "whether robots can pass a door or a lift: on change, and every few seconds",
)
FLOOR_AREAS = Stream(
    "floor_areas",
    "{building}/areas/{floor}",
    m.FloorAreas,
    "planner",
    "put+query",
    None,
    15_000,
    "data",
    "keepout zones, doors and lifts of a floor, and which passages are said to be open or closed",
)
PERCEPTION_INFER = Stream(
    "perception_infer",
    "{building}/perception/{worker}/infer",
    m.InferReply,
    "perception",
    "query",
    None,
    30_000,
    "data",
    "a picture in, detections and embeddings out",
    request=m.InferRequest,
)
PERCEPTION_TEXT = Stream(
    "perception_text",
    "{building}/perception/{worker}/text",
    m.TextReply,
    "perception",
    "query",
    None,
    30_000,
    "data",
    "texts in, embeddings out",
    request=m.InferRequest,
)
PERCEPTION_LOAD = Stream(
    "perception_load",
    "{building}/perception/{worker}/load",
    m.WorkerLoad,
    "perception",
    "put+query",
    1.0,
    3_000,
    "data",
    "queue and latency of a worker, and which backend runs",
    merge=m.WorkerLoad.merged,
)
FLOOR_MAPS = Stream(
    "floor_maps",
    "{building}/floor_maps/{floor}",
    m.FloorMapsHeader,
    "fusion",
    "query",
    None,
    5_000,
    "maps",
    "all that a planner decides on, of one moment: layers (value: parameter target=...) and objects; with epoch=... and "
    "since=REVISION only what has changed",
    payload=True,
)
MAP_LAYER = Stream(
    "map_layer",
    "{building}/map/{floor}/{layer}",
    m.LayerHeader,
    "fusion",
    "query",
    None,
    5_000,
    "maps",
    "occupancy, explored, frontier, value (parameter target=...), cloud, provenance of the cloud",
    payload=True,
)
MAP_REVISION = Stream(
    "map_revision",
    "{building}/map_revision/{floor}",
    m.Revision,
    "fusion",
    "put+query",
    None,
    5_000,
    "data",
    "the observations and frames that the maps of a floor have processed: they hold them, or refused them for good",
)
OBJECTS = Stream(
    "objects",
    "{building}/objects/{floor}",
    m.ObjectList,
    "fusion",
    "query",
    None,
    5_000,
    "data",
    "objects and what last happened to them; object=ID: one, with all that ever did; history=all: all, with all; "
    "text=WORDS: with how well each fits; detail=brief: without points and events",
)
CAMERA_SEARCH = Stream(
    "camera_search",
    "{building}/camera_search/{fusion}",
    m.CameraSearchReport,
    "fusion",
    "query",
    None,
    60_000,
    "data",
    "look for something with all cameras of a floor, or of all; the answer comes when every view was looked at, or in time",
    request=m.CameraSearch,
    allows_wildcard=True,
)
VIEW_PICTURE = Stream(
    "view_picture",
    "{building}/view_picture/{floor}",
    m.ViewPicture,
    "fusion",
    "query",
    None,
    5_000,
    "maps",
    "a picture that the maps took (parameters source, view, seq), for as long as fusion keeps it; a JPEG",
    payload=True,
)
FORGET_PICTURES = Stream(
    "forget_pictures",
    "{building}/forget_pictures/{keeper}",
    m.PicturesForgotten,
    "fusion",
    "query",
    None,
    5_000,
    "control",
    "forget past pictures: all who keep any",
    request=m.ForgetPictures,
    allows_wildcard=True,
)
REMOVE_FROM_MAPS = Stream(
    "remove_from_maps",
    "{building}/remove_from_maps/{fusion}",
    m.MapRemoval,
    "fusion",
    "query",
    None,
    5_000,
    "control",
    "take what a camera or a robot has contributed out of the maps; answered once it is certain to happen",
    request=m.RemoveFromMaps,
    allows_wildcard=True,
)
MAP_REMOVALS = Stream(
    "map_removals",
    "{building}/map_removals/{fusion}",
    m.MapRemovals,
    "fusion",
    "put+query",
    None,
    10_000,
    "data",
    "what was taken out of the maps, and how far that is",
)
VIEW_LOG = Stream(
    "view_log",
    "{building}/view_log",
    m.LoggedView,
    "fusion",
    "query",
    None,
    5_000,
    "maps",
    "the next view that went into the maps after one (after=NUMBER), with what perception said of it; fusion=ID: of that fusion",
    payload=True,
)
MAP_SNAPSHOT = Stream(
    "map_snapshot",
    "{building}/map_snapshot",
    m.MapSnapshot,
    "fusion",
    "query",
    None,
    10_000,
    "maps",
    "all maps after the newest view, in pieces (number=, offset=); only=digest: what they come to; fusion=ID: of that fusion",
    payload=True,
)
MISSION_GOAL = Stream(
    "mission_goal",
    "{building}/mission/{mission}/goal",
    m.MissionAck,
    "planner",
    "query",
    None,
    5_000,
    "control",
    "submit a mission",
    request=m.MissionGoal,
)
MISSION_CANCEL = Stream(
    "mission_cancel",
    "{building}/mission/{mission}/cancel",
    m.MissionAck,
    "planner",
    "query",
    None,
    5_000,
    "control",
    "cancel a mission",
    request=m.MissionCancel,
)
MISSION_PAUSE = Stream(
    "mission_pause",
    "{building}/mission/{mission}/pause",
    m.MissionAck,
    "planner",
    "query",
    None,
    5_000,
    "control",
    "pause a mission, or have it go on",
    request=m.MissionPause,
)
MISSION_STATUS = Stream(
    "mission_status",
    "{building}/mission/{mission}/status",
    m.MissionStatus,
    "planner",
    "put+query",
    None,
    5_000,
    "data",
    "state, feedback, name of the error",
)
MISSION_PLAN = Stream(
    "mission_plan",
    "{building}/mission/{mission}/plan",
    m.Plan,
    "planner",
    "put+query",
    None,
    5_000,
    "data",
    "waypoint, path, candidates",
)
TRAFFIC = Stream(
    "traffic",
    "{building}/traffic/{node}",
    m.TrafficReport,
    "every node",
    "put+query",
    1.0,
    60_000,
    "data",
    "bytes per key, of the keys that have changed, and on the wire; at most at this rate, seldom while little is sent",
    merge=m.TrafficReport.merged,
)
RECORDER_STATUS = Stream(
    "recorder_status",
    "{building}/recorder/{recorder}/status",
    m.RecorderStatus,
    "recorder",
    "put+query",
    1.0,
    5_000,
    "data",
    "which missions are being recorded, and what is wrong",
)
RECORDINGS = Stream(
    "recordings",
    "{building}/recorder/{recorder}/recordings",
    m.RecordingList,
    "recorder",
    "query",
    None,
    5_000,
    "data",
    "the recordings that are kept",
)
RECORDING_READ = Stream(
    "recording_read",
    "{building}/recorder/{recorder}/read",
    m.RecordingPart,
    "recorder",
    "query",
    None,
    5_000,
    "maps",
    "a stretch of a recording",
    request=m.RecordingPart,
    payload=True,
)
RECORDING_DELETE = Stream(
    "recording_delete",
    "{building}/recorder/{recorder}/delete",
    m.Ack,
    "recorder",
    "query",
    None,
    5_000,
    "control",
    "delete a recording for good",
    request=m.RecordingRemoval,
)
REPLAY = Stream(
    "replay",
    "{building}/replay/{player}",
    m.ReplayStatus,
    "surveilnav replay",
    "put+query",
    2.0,
    5_000,
    "data",
    "where a recording is that is shown again",
)
REPLAY_CONTROL = Stream(
    "replay_control",
    "{building}/replay/{player}/control",
    m.ReplayStatus,
    "surveilnav replay",
    "query",
    None,
    5_000,
    "control",
    "have a replay play, pause, go to a moment, or change its speed",
    request=m.ReplayControl,
)
SERVICES = Stream(
    "services",
    "{building}/services/{supervisor}",
    m.ServiceList,
    "surveilnav up",
    "put",
    1.0,
    3_000,
    "data",
    "the processes that are kept running, how often each was started again, and why",
)
TRUTH = Stream(
    "truth",
    "{building}/truth/{source}/{view}",
    m.Truth,
    "simulator nodes",
    "query",
    None,
    2_000,
    "bulk",
    "simulation only: instance ids of a view (parameter seq), for the backends oracle and simulated",
    payload=True,
)
JUDGED = Stream(
    "judged",
    "{building}/truth/{source}/judged/{mission}",
    m.Judged,
    "simulator nodes",
    "put+query",
    None,
    10_000,
    "data",
    "simulation only, for the gateway alone: whether the robot stopped where it should",
)

#: Streams that exist only in simulation. They don't count as traffic, and fusion and planner never receive them.
SIMULATION: tuple[Stream, ...] = (TRUTH, JUDGED)
STREAMS: tuple[Stream, ...] = tuple(v for v in list(globals().values()) if isinstance(v, Stream))


def markdown() -> str:
    """The page docs/understand/contract.md."""
    lines = [
        "# The contract",
        "",
        "Generated from `shared/surveilnav/contract.py` by `make docs`; don't edit.",
        f"Every key lies below `{ROOT}/`. Liveliness tokens: `{LIVELINESS}`, and `{INSTANCE}` by which two "
        f"processes of one name notice each other. The router's own: `{ROUTER}`, with its `VERSION` of this contract and its "
        "release: a node that speaks another contract ends with an error.",
        "",
        "| stream | key | kind | owner | message (request) | rate | stale after | priority | link full | carries |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for s in STREAMS:
        request = f" ({s.request.__name__})" if s.request else ""
        rate = f"{s.rate_hz:g} Hz" if s.rate_hz else "on change"
        raw = "; raw payload, message as attachment" if s.payload else ""
        lines.append(
            f"| {s.name} | `{s.key}` | {s.kind} | {s.owner} | {s.message.__name__}{request} | {rate} "
            f"| {s.max_age_ms / 1000:g} s | {s.priority} | {s.when_full} | {s.carries}{raw} |"
        )
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    print(markdown(), end="")
