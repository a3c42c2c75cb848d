"""The resources of the REST interface, and how each is made from messages.

Every resource has ``last_seen`` (UTC, when this gateway last heard of it; null: never) and ``stale``: its owner
isn't there any more or, for what is put at a rate, it is older than the contract allows. Lengths are metres,
angles radians, positions in the world frame. Numbers that aren't finite become null: remote data can hold anything.
"""

from surveilnav.services.gateway.core.resources.base import ROOT, GrowingItems, Items
from surveilnav.services.gateway.core.resources.building import Building
from surveilnav.services.gateway.core.resources.camera import Camera, CameraCone, CameraLook, PictureKeeper
from surveilnav.services.gateway.core.resources.floor import Floor
from surveilnav.services.gateway.core.resources.layer import Layer
from surveilnav.services.gateway.core.resources.mission import Mission, MissionPlan, NewMission
from surveilnav.services.gateway.core.resources.object import Object
from surveilnav.services.gateway.core.resources.readiness import NEEDED, Readiness
from surveilnav.services.gateway.core.resources.recording import Recorder, Recording, Replay, ReplayChange
from surveilnav.services.gateway.core.resources.robot import Robot, RobotHalt, Target, Worker
from surveilnav.services.gateway.core.resources.service import Service
from surveilnav.services.gateway.core.resources.traffic import MissionTraffic, Traffic

__all__ = [
    "NEEDED",
    "ROOT",
    "Building",
    "Camera",
    "CameraCone",
    "CameraLook",
    "Floor",
    "GrowingItems",
    "Items",
    "Layer",
    "Mission",
    "MissionPlan",
    "MissionTraffic",
    "NewMission",
    "Object",
    "PictureKeeper",
    "Readiness",
    "Recorder",
    "Recording",
    "Replay",
    "ReplayChange",
    "Robot",
    "RobotHalt",
    "Service",
    "Target",
    "Traffic",
    "Worker",
]
