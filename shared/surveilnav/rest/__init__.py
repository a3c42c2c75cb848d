"""The resources of the REST interface, each defined once: the gateway answers with them, its OpenAPI document describes
them, and the client returns them.

Lengths are metres, angles radians, times UTC, positions in the world frame. A ``Resource`` has ``last_seen`` (when the
gateway last heard of it) and ``stale`` (its owner is gone, or it is older than the contract allows). Numbers that aren't
finite are null: remote data can hold anything. These models need pydantic and nothing else.
"""

from surveilnav.rest.base import ID_PATTERN, ROOT, GrowingItems, Items, Resource
from surveilnav.rest.building import Area, Building, Floor, FloorCamera, Layer, Object, ObjectEvent
from surveilnav.rest.cameras import AccessRecord, Camera, CameraCone, CameraStream, CameraView, PictureKeeper
from surveilnav.rest.missions import FINISHED_STATES, Mission, MissionPlan, MissionTraffic, NewMission, Place
from surveilnav.rest.recordings import Recorder, Recording, Replay, ReplayChange
from surveilnav.rest.removals import NewRemoval, Removal
from surveilnav.rest.robots import FrameCorrection, Robot, RobotHalt, StageTimes, Target, Worker
from surveilnav.rest.session import NewSession, Session
from surveilnav.rest.sightings import SearchedCamera, SearchedRoom, Sighting, Sightings, SightingsRequest
from surveilnav.rest.streams import LIVE_RESOURCES, Event, LiveState, StreamData, Tile, TileState
from surveilnav.rest.system import (
    LinkTraffic,
    NodeTraffic,
    Readiness,
    Service,
    SourceTraffic,
    Traffic,
    TrafficOverTime,
    TrafficPoint,
    TrafficStep,
)

__all__ = [
    "AccessRecord",
    "Area",
    "Building",
    "Camera",
    "CameraCone",
    "CameraStream",
    "CameraView",
    "Event",
    "FINISHED_STATES",
    "Floor",
    "FloorCamera",
    "FrameCorrection",
    "GrowingItems",
    "ID_PATTERN",
    "Items",
    "LIVE_RESOURCES",
    "Layer",
    "LinkTraffic",
    "LiveState",
    "Mission",
    "MissionPlan",
    "MissionTraffic",
    "NewMission",
    "NewRemoval",
    "NewSession",
    "NodeTraffic",
    "Object",
    "ObjectEvent",
    "PictureKeeper",
    "Place",
    "ROOT",
    "Readiness",
    "Recorder",
    "Recording",
    "Removal",
    "Replay",
    "ReplayChange",
    "Resource",
    "Robot",
    "RobotHalt",
    "SearchedCamera",
    "SearchedRoom",
    "Service",
    "Session",
    "Sighting",
    "Sightings",
    "SightingsRequest",
    "SourceTraffic",
    "StageTimes",
    "StreamData",
    "Target",
    "Tile",
    "TileState",
    "Traffic",
    "TrafficOverTime",
    "TrafficPoint",
    "TrafficStep",
    "Worker",
]
