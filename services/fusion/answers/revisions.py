"""Revisions: what the maps of a floor have processed, told whenever that changes."""

from __future__ import annotations

import time
from collections.abc import Mapping

from surveilnav.bus import Answer, Node, Publisher, Refused, Request, clock_ns
from surveilnav.contract import MAP_REVISION
from surveilnav.messages import CameraUse, Revision
from surveilnav.services.fusion.core import MapConfig, active_cameras
from surveilnav.services.fusion.core.views.invocation import same_floor
from surveilnav.services.fusion.intake.perception import PerceptionClient
from surveilnav.services.fusion.intake.sources import InvokedCamera
from surveilnav.services.fusion.map_log.log import DurableMap
from surveilnav.services.fusion.robot_places import RobotPlaces

_HEARTBEAT_S = 1.0
_MAX_TROUBLES = 3  # named in a revision's message


class Revisions:
    """Makes, publishes and remembers the revision of each floor."""

    def __init__(
        self,
        node: Node,
        config: MapConfig,
        maps: DurableMap,
        perception: PerceptionClient,
        places: RobotPlaces,
        cameras: Mapping[str, InvokedCamera],
    ) -> None:
        """``cameras``: those invoked now, by name."""
        self._node, self._tau_z_m = node, config.tau_z_m
        self._maps, self._perception, self._places, self._cameras = maps, perception, places, cameras
        self._publishers: dict[str, Publisher] = {}
        self._said: dict[str, tuple[Revision, float]] = {}

    def publish(self) -> None:
        """Puts the revision of each floor when it changed, and now and then for those who came late."""
        now_s = time.monotonic()
        for floor, (z_m, number) in sorted(self._floors().items()):
            revision = self._revision(floor, z_m, number)
            said, at_s = self._said.get(floor, (None, -_HEARTBEAT_S))
            same = said is not None and _unstamped(said) == _unstamped(revision)
            if same and now_s - at_s < _HEARTBEAT_S:
                continue
            self._said[floor] = revision, now_s
            if floor not in self._publishers:
                self._publishers[floor] = self._node.publisher(MAP_REVISION, floor=floor)
            self._publishers[floor].put(revision)

    def answer(self, request: Request) -> list[Answer]:
        """The revisions last published, of one floor or of all."""
        floor = request.ids.get("floor")
        revisions = [said for said, _ in list(self._said.values()) if floor in (None, said.floor)]
        if not revisions and floor is not None:
            raise Refused("unknown_floor", f"nothing was seen yet of floor {floor!r}")
        return [Answer(said, ids={"floor": said.floor}) for said in revisions]

    def _floors(self) -> dict[str, tuple[float, int]]:
        """Altitude [m] and revision by floor: those of the maps, and where a robot stands and nothing was integrated."""
        joint = self._maps.joint
        with self._maps.lock:
            floors = {name: (z_m, joint.floor_revision(name)) for name, z_m in joint.floors.items()}
        for name, place in self._places.items():
            known = any(same_floor(place.z_m, z_m, self._tau_z_m) for z_m, _ in floors.values())
            if not known and name not in floors:
                floors[name] = place.z_m, 0
        return floors

    def _revision(self, floor: str, z_m: float, number: int) -> Revision:
        contents, perception = self._maps.contents, self._perception
        cameras, pending = self._camera_use(z_m)
        robots = {robot: last.seq for robot, last in sorted(contents.robots.items()) if last.floor == floor}
        here = {*(f"robot/{robot}" for robot in robots), *(f"camera/{use.camera}" for use in cameras)}
        troubles = [why for (source, _), why in sorted(contents.troubles.items()) if source in here]
        return Revision(
            stamp_ns=clock_ns(),
            floor=floor,
            revision=number,
            floor_z_m=z_m,
            robots=robots,
            cameras=cameras,
            pending_views=pending,
            perception_ok=not perception.problem,
            message="; ".join(filter(None, [perception.problem, self._maps.problem, *troubles[:_MAX_TROUBLES]])),
        )

    def _camera_use(self, floor_z_m: float) -> tuple[list[CameraUse], int]:
        """The invoked cameras of a floor (eq. 1), and how many of their views are still to come."""
        uses, pending = [], 0
        for name in active_cameras([floor_z_m], [c.info for c in self._cameras.values()], self._tau_z_m):
            camera = self._cameras[name]
            n_processed = len(self._maps.contents.views.get(name, set()) & set(camera.slots))
            uses.append(CameraUse(name, n_processed, len(camera.slots)))
            pending += 0 if camera.silent else len(camera.slots) - n_processed
        return uses, pending


def _unstamped(revision: Revision) -> tuple[object, ...]:
    r = revision
    return r.revision, r.robots, r.cameras, r.pending_views, r.perception_ok, r.message
