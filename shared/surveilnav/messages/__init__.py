"""All messages of the contract: frozen structs without behaviour, encoded as MessagePack.

Each message has ``stamp_ns``, the time of its sender's clock in nanoseconds since the epoch (simulated time in a benchmark).
"""

from surveilnav.messages.camera import CameraInfo, CameraRequest, CameraSummary, CameraViewInfo, SlotClaim
from surveilnav.messages.maps import (
    LAYERS,
    CameraUse,
    FloorMapsHeader,
    LayerHeader,
    LayerPart,
    ObjectEvent,
    ObjectList,
    ObjectRecord,
    Revision,
    ViewPicture,
)
from surveilnav.messages.mission import (
    Candidate,
    MissionAck,
    MissionCancel,
    MissionGoal,
    MissionPause,
    MissionStatus,
    Plan,
)
from surveilnav.messages.node import Ack, ErrorReply, ServiceList, ServiceState, TrafficReport, TrafficRow
from surveilnav.messages.perception import Detection, InferReply, InferRequest, ModelIds, TextReply, WorkerLoad
from surveilnav.messages.pictures import ForgetPictures, PicturesForgotten
from surveilnav.messages.recording import (
    FASTEST_REPLAY,
    SLOWEST_REPLAY,
    LoggedView,
    MapSnapshot,
    RecorderStatus,
    Recording,
    RecordingList,
    RecordingPart,
    RecordingRemoval,
    ReplayControl,
    ReplayStatus,
)
from surveilnav.messages.robot import ACTIONS, Command, CommandReply, Halt, HaltReply, Observation, RobotStatus, Stair
from surveilnav.messages.truth import Judged, Truth
from surveilnav.messages.view import CaptureClock, DepthSource, FrameHeader, PayloadPart
from surveilnav.mission_states import FINISHED_STATES

__all__ = [
    "ACTIONS",
    "LAYERS",
    "FASTEST_REPLAY",
    "FINISHED_STATES",
    "SLOWEST_REPLAY",
    "Ack",
    "CameraInfo",
    "CameraRequest",
    "CameraSummary",
    "CameraUse",
    "CameraViewInfo",
    "Candidate",
    "CaptureClock",
    "Command",
    "CommandReply",
    "DepthSource",
    "Detection",
    "ErrorReply",
    "ForgetPictures",
    "FrameHeader",
    "Halt",
    "HaltReply",
    "InferReply",
    "InferRequest",
    "Judged",
    "FloorMapsHeader",
    "LayerHeader",
    "LayerPart",
    "LoggedView",
    "MapSnapshot",
    "MissionAck",
    "MissionCancel",
    "MissionGoal",
    "MissionPause",
    "MissionStatus",
    "ModelIds",
    "ObjectEvent",
    "ObjectList",
    "ObjectRecord",
    "Observation",
    "PayloadPart",
    "PicturesForgotten",
    "Plan",
    "RecorderStatus",
    "Recording",
    "RecordingList",
    "RecordingPart",
    "RecordingRemoval",
    "ReplayControl",
    "ReplayStatus",
    "Revision",
    "RobotStatus",
    "ServiceList",
    "ServiceState",
    "SlotClaim",
    "Stair",
    "TextReply",
    "TrafficReport",
    "TrafficRow",
    "Truth",
    "ViewPicture",
    "WorkerLoad",
]
