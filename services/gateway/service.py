"""The gateway's side of the bus: it remembers what is put, asks for the rest, and turns it into resources.

Calls block for as long as the contract says that an answer may take: run them on threads.
"""

from __future__ import annotations

import hashlib
import threading
import time
import uuid
from collections import OrderedDict
from typing import Any

from services.gateway.core import layers, resources
from services.gateway.core.problems import Problem, refusal
from services.gateway.core.traffic import sum_traffic
from surveilnav import contract
from surveilnav.bus import Node, Received, Refused, Unanswered, clock_ns
from surveilnav.categories import canonical
from surveilnav.contract import Stream
from surveilnav.errors import WireError
from surveilnav.messages import CameraRequest, MissionAck, MissionCancel, MissionGoal, MissionStatus

ROOT = "/api/v1"
#: How long a list of what is put on change is believed before it is asked for again.
REFRESH_S = 5.0
_CACHE_ITEMS = 64
_REMEMBERED_KEYS = 10_000
KINDS = ("camera", "robot", "perception", "fusion", "planner")


class Memory:
    """The newest message of every key of a stream, also of owners that are gone.

    What is put on change may have been put before the gateway was there, or by an owner that came later than
    it: such streams are asked again every ``REFRESH_S``.
    """

    def __init__(self, node: Node, stream: Stream, capacity: int = 20_000) -> None:
        self._node, self._stream, self._capacity = node, stream, capacity
        self._table = node.table(stream)
        self._asked: dict[str, Received[Any]] = {}
        self._asked_at = time.monotonic()
        self._lock = threading.Lock()

    def rows(self) -> list[Received[Any]]:
        with self._lock:
            if self._stream.rate_hz is None and time.monotonic() - self._asked_at > REFRESH_S:
                for row in self._node.ask_all(self._stream, timeout_s=1.0):
                    if row.key in self._asked or len(self._asked) < self._capacity:
                        self._asked[row.key] = row
                self._asked_at = time.monotonic()
            merged = dict(self._asked)
        for row in self._table.rows():
            known = merged.get(row.key)
            if known is None or known.message.stamp_ns <= row.message.stamp_ns:
                merged[row.key] = row
        return [merged[key] for key in sorted(merged)]

    def newest(self, field: str) -> dict[str, Received[Any]]:
        """The newest row by one id of its key, in the order of the ids. A message that names another isn't believed."""
        found: dict[str, Received[Any]] = {}
        for row in sorted(self.rows(), key=lambda r: r.received_ns):
            if getattr(row.message, field) == row.ids[field]:
                found[row.ids[field]] = row
        return dict(sorted(found.items()))


class Backend:
    """Everything that the web side may ask for. Raises ``Problem`` for what can't be had."""

    def __init__(self, node: Node) -> None:
        self.node = node
        self._missions = Memory(node, contract.MISSION_STATUS)
        self._cameras = Memory(node, contract.CAMERA_INFO)
        self._summaries = Memory(node, contract.CAMERA_SUMMARY)
        self._robots = Memory(node, contract.ROBOT_STATUS)
        self._loads = Memory(node, contract.PERCEPTION_LOAD)
        self._revisions = Memory(node, contract.MAP_REVISION)
        self._traffic = Memory(node, contract.TRAFFIC)
        self._pictures: OrderedDict[tuple[Any, ...], tuple[layers.Picture, int]] = OrderedDict()
        self._submitted: OrderedDict[str, tuple[resources.NewMission, resources.Mission]] = OrderedDict()
        self._pictures_lock, self._submit_lock = threading.Lock(), threading.Lock()
        for kind in KINDS:
            node.alive(kind)  # the first call starts watching

    # --- missions -------------------------------------------------------------------------------------------------

    def submit(self, goal: resources.NewMission, idempotency_key: str | None) -> resources.Mission:
        """Hands a goal to the planner. The same key with the same goal is one mission, also across restarts."""
        if idempotency_key is None:
            return self._submit(f"m-{uuid.uuid4().hex[:12]}", goal)
        with self._submit_lock:  # two requests with one key must not both ask
            if known := self._submitted.get(idempotency_key):
                return self._repeated(goal, known[0] == goal, known[1])
            id = "m-" + hashlib.sha256(f"{self.node.building}\0{idempotency_key}".encode()).hexdigest()[:16]
            if row := self._missions.newest("mission").get(id):  # a gateway before this one took it
                return self._repeated(goal, canonical(row.message.target) == canonical(goal.target), self._mission(row))
            mission = self._submit(id, goal)
            self._submitted[idempotency_key] = goal, mission
            if len(self._submitted) > _REMEMBERED_KEYS:
                self._submitted.popitem(last=False)
            return mission

    def _repeated(self, goal: resources.NewMission, same: bool, mission: resources.Mission) -> resources.Mission:
        if same:
            return mission
        raise Problem(
            422,
            "idempotency_key_reused",
            f"this Idempotency-Key belongs to mission {mission.id} for another goal ({mission.target!r}); "
            f"send a new key for {goal.target!r}",
        )

    def _submit(self, id: str, goal: resources.NewMission) -> resources.Mission:
        message = MissionGoal(
            stamp_ns=clock_ns(), mission=id, target=goal.target, robot=goal.robot or "", max_steps=goal.max_steps
        )
        ack: MissionAck = self._ask("planner", contract.MISSION_GOAL, message, mission=id).message
        if not ack.accepted:
            raise refusal(ack.error, ack.message)
        return resources.mission_from_ack(ack, goal, clock_ns())

    def missions(self) -> list[resources.Mission]:
        """Newest first."""
        rows = self._missions.newest("mission").values()
        return [self._mission(r) for r in sorted(rows, key=lambda r: (-r.message.started_ns, r.ids["mission"]))]

    def mission(self, id: str) -> resources.Mission:
        row = self._missions.newest("mission").get(id)
        if row is None:  # accepted a moment ago, or before this gateway was there
            row = self._ask_known("mission", id, "planner", contract.MISSION_STATUS, mission=id)
        return self._mission(row)

    def cancel(self, id: str, reason: str) -> resources.Mission:
        message = MissionCancel(stamp_ns=clock_ns(), mission=id, reason=reason)
        ack: MissionAck = self._ask("planner", contract.MISSION_CANCEL, message, mission=id).message
        if not ack.accepted:
            if ack.state in resources.FINISHED and not ack.error:
                raise Problem(409, "finished", f"mission {id} is {ack.state} already")
            raise refusal(ack.error, ack.message)
        return self.mission(id).model_copy(update={"state": ack.state})

    def plan(self, id: str) -> resources.MissionPlan:
        row = self._ask_known("plan of mission", id, "planner", contract.MISSION_PLAN, mission=id)
        return resources.plan(row.message, row.received_ns, self._alive("planner"))

    def _mission(self, row: Received[MissionStatus]) -> resources.Mission:
        return resources.mission(row.message, row.received_ns, self._alive("planner"))

    # --- cameras and robots ---------------------------------------------------------------------------------------

    def cameras(self) -> list[resources.Camera]:
        uses = {u.camera: u for r in self._revisions.rows() for u in r.message.cameras}
        summaries = self._summaries.newest("camera")
        alive = self.node.alive("camera")
        found = []
        for id, row in self._cameras.newest("camera").items():
            summary = summaries.get(id)
            seen_ns = max(row.received_ns, summary.received_ns if summary else 0)
            labels = summary.message.labels if summary else {}
            found.append(resources.camera(row.message, uses.get(id), labels, seen_ns, id in alive, ROOT))
        return found

    def camera(self, id: str) -> resources.Camera:
        for camera in self.cameras():
            if camera.id == id:
                return camera
        raise Problem(
            404, "unknown_camera", f"no camera {id!r} has announced itself; {ROOT}/cameras lists those that have"
        )

    def thumbnail(self, id: str, view: int) -> bytes:
        """A JPEG that the camera makes for this viewer: counted as viewer traffic, no invocation."""
        camera = self.camera(id)
        views = sorted(v.view for v in camera.views)
        if view not in views:
            raise Problem(404, "unknown_view", f"camera {id} has the views {', '.join(map(str, views))}, not {view}")
        request = CameraRequest(stamp_ns=clock_ns(), action="thumbnail", views=[view])
        row = self._ask(f"camera {id}", contract.CAMERA_REQUEST, request, floor=camera.floor, camera=id)
        if not row.payload.startswith(b"\xff\xd8"):
            raise Problem(502, "bad_picture", f"camera {id} answered with {len(row.payload)} bytes that are no JPEG")
        return row.payload

    def robots(self) -> list[resources.Robot]:
        alive = self.node.alive("robot")
        busy = {
            r.message.robot: r.message.mission
            for r in self._missions.rows()
            if r.message.state not in resources.FINISHED
        }
        return [
            resources.robot(
                row.message, busy.get(id), row.received_ns, id not in alive or self._old(row, contract.ROBOT_STATUS)
            )
            for id, row in self._robots.newest("robot").items()
        ]

    def workers(self) -> list[resources.Worker]:
        alive = self.node.alive("perception")
        return [
            resources.worker(row.message, row.received_ns, id not in alive or self._old(row, contract.PERCEPTION_LOAD))
            for id, row in self._loads.newest("worker").items()
        ]

    # --- maps -----------------------------------------------------------------------------------------------------

    def floors(self) -> list[resources.Floor]:
        revisions = self._revisions.newest("floor")
        cameras, robots = self.cameras(), self.robots()
        names = set(revisions) | {c.floor for c in cameras} | {r.floor for r in robots}
        return [
            resources.floor(
                name,
                revisions[name].message if name in revisions else None,
                [r.id for r in robots if r.floor == name],
                [c.id for c in cameras if c.floor == name],
                revisions[name].received_ns if name in revisions else None,
                self._alive("fusion"),
                ROOT,
            )
            for name in sorted(names)
        ]

    def layer(self, floor: str, layer: str, target: str) -> tuple[layers.Picture, int]:
        """The picture of a layer, and the revision that it shows. Asked of fusion only if the floor's maps changed."""
        if layer not in layers.COLOURS:
            raise Problem(404, "unknown_layer", f"no picture of {layer!r}; layers: {', '.join(layers.COLOURS)}")
        if layer == "value":
            target = target or self._searched(floor)
        else:
            target = ""
        revision = self._revisions.newest("floor").get(floor)
        key = (floor, layer, target, revision.message.stamp_ns if revision else 0)
        with self._pictures_lock:
            if revision and key in self._pictures:
                self._pictures.move_to_end(key)
                return self._pictures[key]
        parameters = {"target": target} if target else None
        row = self._ask_known(
            "floor", floor, "fusion", contract.MAP_LAYER, parameters=parameters, floor=floor, layer=layer
        )
        try:
            picture = layers.render(layer, row.message.grid, layers.unpack_layer(row.message, row.payload))
        except WireError as error:
            raise Problem(502, "bad_layer", f"fusion sent a {layer} layer that can't be read: {error}") from error
        result = picture, row.message.revision
        if revision and row.message.revision == revision.message.revision:
            with self._pictures_lock:
                self._pictures[key] = result
                if len(self._pictures) > _CACHE_ITEMS:
                    self._pictures.popitem(last=False)
        return result

    def _searched(self, floor: str) -> str:
        """The target of the newest mission, preferably one on this floor: whose values a person wants to see."""
        missions = sorted(self.missions(), key=lambda m: m.floor != floor)
        if not missions:
            raise Problem(422, "no_target", "the value layer belongs to a target: add ?target=..., or submit a mission")
        return missions[0].target

    def objects(self, floor: str | None, label: str | None) -> list[resources.Object]:
        if floor is None:
            rows = self.node.ask_all(contract.OBJECTS)
            if not rows and not self._alive("fusion"):
                raise _absent("fusion")
        else:
            rows = [self._ask_known("floor", floor, "fusion", contract.OBJECTS, floor=floor)]
        wanted = None if label is None else canonical(label)
        records = [r for row in rows for r in row.message.objects if wanted is None or r.label == wanted]
        return [resources.object_(r) for r in sorted(records, key=lambda r: (r.floor, -r.last_seen_ns, r.id))]

    # --- the whole ------------------------------------------------------------------------------------------------

    def traffic(self) -> resources.Traffic:
        rows = {f"{r.message.kind}/{r.message.node}": r for r in self._traffic.rows()}
        heard = {name: (row.received_ns, self._old(row, contract.TRAFFIC)) for name, row in rows.items()}
        return resources.traffic(sum_traffic(r.message for r in rows.values()), heard)

    def readiness(self) -> resources.Readiness:
        return resources.readiness(self.node.routers(), {kind: self.node.alive(kind) for kind, _ in resources.NEEDED})

    def _alive(self, kind: str) -> bool:
        return bool(self.node.alive(kind))

    def _old(self, row: Received[Any], stream: Stream) -> bool:
        return row.age_s * 1000 > stream.max_age_ms

    def _ask(self, who: str, stream: Stream, request: Any = None, **options: Any) -> Received[Any]:
        try:
            return self.node.ask(stream, request, **options)
        except Refused as error:
            raise refusal(error.name, str(error)) from error
        except Unanswered as error:
            if error.timed_out:
                raise Problem(504, "timeout", f"{who} didn't answer in time; try again") from error
            raise _absent(who) from error

    def _ask_known(self, what: str, id: str, who: str, stream: Stream, **options: Any) -> Received[Any]:
        """Asks about something that may not exist: if its owner is there, a refusal or nobody in charge means 404."""
        try:
            return self._ask(who, stream, **options)
        except Problem as problem:
            if problem.status == 409 or (problem.name == "absent" and self._alive(who)):
                detail = f"no {what} {id!r}" + (f": {problem.detail}" if problem.status == 409 else "")
                raise Problem(404, "not_found", detail) from problem
            raise


def _absent(who: str) -> Problem:
    hint = f"; start one with `python -m services.{who}`" if who in ("planner", "fusion", "perception") else ""
    return Problem(503, "absent", f"no {who} is there{hint}")
