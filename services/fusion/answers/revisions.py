"""Publishes, for each floor, the revision of its maps and which views they have processed, whenever that changes."""

from __future__ import annotations

import time
from collections.abc import Collection

from surveilnav.bus import Answer, Node, Publisher, Refused, Request, clock_ns
from surveilnav.contract import MAP_REVISION
from surveilnav.messages import CameraUse, Revision, RobotFrameProblem
from surveilnav.services.fusion.building_maps import BuildingMaps
from surveilnav.services.fusion.core import active_cameras
from surveilnav.services.fusion.core.views.invocation import same_floor
from surveilnav.services.fusion.intake.intake import ViewIntake
from surveilnav.services.fusion.map_log.log import MapLog

#: An unchanged revision is published again before it counts as old.
_HEARTBEAT_S = MAP_REVISION.max_age_ms / 2500
_MAX_FAULTS = 3  # that a revision's message lists


class Revisions:
    """Publishes the revision of each floor and answers queries for the latest ones."""

    def __init__(self, node: Node, maps: BuildingMaps, intake: ViewIntake, log: MapLog) -> None:
        self._node, self._maps, self._intake, self._log = node, maps, intake, log
        self._tau_z_m = maps.joint.config.map.tau_z_m
        self._publishers: dict[str, Publisher] = {}
        self._published: dict[str, tuple[Revision, float]] = {}

    def publish(self) -> None:
        """Publishes the revision of each floor when it has changed, and from time to time for clients that join late."""
        now_s = time.monotonic()
        for floor, (z_m, number) in sorted(self._floors().items()):
            revision = self._revision(floor, z_m, number)
            last, at_s = self._published.get(floor, (None, -_HEARTBEAT_S))
            same = last is not None and _content(last) == _content(revision)
            if same and now_s - at_s < _HEARTBEAT_S:
                continue
            self._published[floor] = revision, now_s
            if floor not in self._publishers:
                self._publishers[floor] = self._node.publisher(MAP_REVISION, floor=floor)
            self._publishers[floor].put(revision)

    def pending_views(self, floor: str) -> int:
        """The number of views of a floor's cameras that are still to come, by its latest revision. Safe from any thread."""
        revision, _ = self._published.get(floor, (None, 0.0))
        return revision.pending_views if revision is not None else 0

    def answer(self, request: Request) -> list[Answer]:
        """The latest published revision of one floor or of all."""
        floor = request.ids.get("floor")
        revisions = [revision for revision, _ in list(self._published.values()) if floor in (None, revision.floor)]
        if not revisions and floor is not None:
            raise Refused("unknown_floor", f"nothing was seen yet of floor {floor!r}")
        return [Answer(revision, ids={"floor": revision.floor}) for revision in revisions]

    def _floors(self) -> dict[str, tuple[float, int]]:
        """Altitude [m] and revision of each floor of the maps, and of each where a robot is but nothing was integrated yet."""
        joint = self._maps.joint
        with self._maps.lock:
            floors = {name: (z_m, joint.floor_revision(name)) for name, z_m in joint.floors.items()}
        for name, position in self._intake.positions.items():
            known = any(same_floor(position.z_m, z_m, self._tau_z_m) for z_m, _ in floors.values())
            if not known and name not in floors:
                floors[name] = position.z_m, 0
        return floors

    def _revision(self, floor: str, z_m: float, number: int) -> Revision:
        processed, perception = self._maps.processed, self._intake.problem
        cameras, pending = self._camera_use(z_m)
        robots = {robot: last.seq for robot, last in sorted(processed.robots.items()) if last.floor == floor}
        here = {*(f"robot/{robot}" for robot in robots), *(f"camera/{use.camera}" for use in cameras)}
        faults = [why for (source, _), why in sorted(processed.faults.items()) if source in here]
        return Revision(
            stamp_ns=clock_ns(),
            floor=floor,
            revision=number,
            floor_z_m=z_m,
            robots=robots,
            cameras=cameras,
            pending_views=pending,
            perception_ok=not perception,
            message="; ".join(filter(None, [perception, self._log.problem, *faults[:_MAX_FAULTS]])),
            frames=self._frame_problems(robots),
        )

    def _frame_problems(self, robots: Collection[str]) -> list[RobotFrameProblem]:
        """Those of the robots that aren't where they say."""
        with self._maps.lock:
            problems = self._maps.joint.quarantine.frames.problems()
        named = [(robot, problems[f"robot/{robot}"]) for robot in robots if f"robot/{robot}" in problems]
        return [RobotFrameProblem(robot, p.why, p.dx_m, p.dy_m, p.dyaw_rad) for robot, p in named]

    def _camera_use(self, floor_z_m: float) -> tuple[list[CameraUse], int]:
        """The active cameras of a floor (eq. 1), and the number of their views that are still to come."""
        uses, pending = [], 0
        awaited = self._intake.pictures_awaited()
        with self._maps.lock:
            reasons = self._maps.joint.quarantine.reasons()
        for name in active_cameras([floor_z_m], [c.info for c in self._intake.cameras.values()], self._tau_z_m):
            camera = self._intake.cameras[name]
            n_processed = len(self._maps.processed.views_of(name) & set(camera.slots))
            uses.append(CameraUse(name, n_processed, len(camera.slots), reasons.get(f"camera/{name}", "")))
            pending += 0 if camera.is_silent else len(camera.slots) - n_processed
            pending += awaited.get(name, 0)
        return uses, pending


def _content(revision: Revision) -> tuple[object, ...]:
    """What is compared to decide whether a revision has changed: everything that may change but its stamp."""
    r = revision
    return r.revision, r.robots, r.cameras, r.pending_views, r.perception_ok, r.message, r.frames
