"""The resources of the REST interface, and how each is made from messages.

Every resource has ``last_seen`` (UTC, when this gateway last heard of it; null: never) and ``stale``: its owner
isn't there any more or, for what is put at a rate, it is older than the contract allows. Lengths are metres,
angles radians, positions in the world frame. Numbers that aren't finite become null: remote data can hold anything.
"""

from services.gateway.core.resources.base import ROOT, Items, Resource
from services.gateway.core.resources.camera import Camera, CameraView
from services.gateway.core.resources.floor import Floor, FloorCamera
from services.gateway.core.resources.mission import Mission, MissionPlan, NewMission, Place
from services.gateway.core.resources.object import Object, ObjectEvent
from services.gateway.core.resources.readiness import NEEDED, Readiness
from services.gateway.core.resources.robot import Robot, Worker
from services.gateway.core.resources.traffic import NodeTraffic, SourceTraffic, Traffic

__all__ = [
    "NEEDED", "ROOT", "Camera", "CameraView", "Floor", "FloorCamera", "Items", "Mission", "MissionPlan", "NewMission",
    "NodeTraffic", "Object", "ObjectEvent", "Place", "Readiness", "Resource", "Robot", "SourceTraffic", "Traffic", "Worker",
]  # fmt: skip
