"""A building of fakes on a real bus: planner, fusion, a camera, a robot and a perception worker as plain nodes."""

from __future__ import annotations

import itertools
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing

import cv2
import httpx
import msgspec
import numpy as np
import pytest
import structlog

from surveilnav import contract
from surveilnav import messages as m
from surveilnav.bus import Answer, BusSettings, Node, Refused, Request, clock_ns
from surveilnav.bus.router import free_port, open_router
from surveilnav.geometry import Grid, Pinhole, Pose, base_pose, camera_pose
from surveilnav.sensing.packing import pack_array
from surveilnav.services.gateway.__main__ import listen, web_server
from surveilnav.services.gateway.authentication import Authentication
from surveilnav.services.gateway.config import GatewaySettings
from surveilnav.services.gateway.service import Gateway
from tests.waiting import until

GRID = Grid(-1.0, -2.0, 0.5, 12, 16)
#: What perception calls what some words name.
OWN_NAMES = {"Fernseher": "tv"}


class FakeBuilding:
    """Everything that the gateway talks to. Its state is plain attributes: tests change them."""

    def __init__(self, router: str) -> None:
        self.settings = BusSettings(router=router)
        self.stack = ExitStack()
        self.goals: list[m.MissionGoal] = []
        self.missions: dict[str, m.MissionStatus] = {}
        self.layers_asked: list[tuple[str, dict[str, str]]] = []
        self.grid = GRID
        self.thumbnails = 0
        self.widths_px: list[int] = []
        self.broken_layer = False
        self.revision = 1
        self.object_status = "confirmed"
        self.objects_asked: list[dict[str, str]] = []
        self.planner, self.fusion = self.node("planner", "p1"), self.node("fusion", "f1")
        self.camera, self.robot, self.worker = (
            self.node("camera", "c1"),
            self.node("robot", "r1"),
            self.node("perception", "w1"),
        )
        self._planner()
        self._fusion()
        self._sources()

    def node(self, kind: str, id: str) -> Node:
        return self.stack.enter_context(Node(kind, id, self.settings))

    # --- planner --------------------------------------------------------------------------------------------------

    def _planner(self) -> None:
        self.status = {}
        self.planner.serve(contract.MISSION_GOAL, self._goal)
        self.planner.serve(contract.MISSION_CANCEL, self._cancel)
        self.planner.serve(contract.MISSION_PAUSE, self._pause)
        self.planner.serve(contract.MISSION_STATUS, self._status)
        self.planner.serve(contract.MISSION_PLAN, self._plan)

    def put_status(self, status: m.MissionStatus) -> None:
        self.missions[status.mission] = status
        if status.mission not in self.status:
            self.status[status.mission] = self.planner.publisher(contract.MISSION_STATUS, mission=status.mission)
        self.status[status.mission].put(status)

    def _goal(self, request: Request) -> Answer:
        goal: m.MissionGoal = request.message
        self.goals.append(goal)
        error = {"unicorn": "bad_target", "Blumentopf 🌱": "bad_target", "busy robot": "no_free_robot"}.get(
            goal.target, ""
        )
        if goal.target == "explode":
            raise RuntimeError("a bug in the planner")
        if error:
            return Answer(
                m.MissionAck(
                    stamp_ns=clock_ns(),
                    mission=goal.mission,
                    accepted=False,
                    state="failed",
                    error=error,
                    message=f"{goal.target!r} can't be searched: {error}",
                )
            )
        self.put_status(
            m.MissionStatus(
                stamp_ns=clock_ns(),
                mission=goal.mission,
                target=OWN_NAMES.get(goal.target, goal.target),
                asked=goal.target if goal.target in OWN_NAMES else "",
                robot="r1",
                state="queued",
                phase="waiting",
                step=0,
                max_steps=goal.max_steps,
                path_m=0.0,
                started_ns=clock_ns(),
            )
        )
        return Answer(
            m.MissionAck(
                stamp_ns=clock_ns(),
                mission=goal.mission,
                accepted=True,
                state="queued",
                robot="r1",
                target=OWN_NAMES.get(goal.target, goal.target),
            )
        )

    def _known(self, request: Request) -> m.MissionStatus:
        try:
            return self.missions[request.ids["mission"]]
        except KeyError:
            raise Refused("unknown_mission", f"no mission {request.ids.get('mission')!r}") from None

    def _cancel(self, request: Request) -> Answer:
        status = self._known(request)
        if status.state in m.FINISHED_STATES:
            return Answer(m.MissionAck(stamp_ns=clock_ns(), mission=status.mission, accepted=False, state=status.state))
        return Answer(m.MissionAck(stamp_ns=clock_ns(), mission=status.mission, accepted=True, state="cancelled"))

    def _pause(self, request: Request) -> Answer:
        status = self._known(request)
        if status.state in m.FINISHED_STATES:
            return Answer(m.MissionAck(stamp_ns=clock_ns(), mission=status.mission, accepted=False, state=status.state))
        if not request.message.paused and self.halted:
            ack = m.MissionAck(
                stamp_ns=clock_ns(),
                mission=status.mission,
                accepted=False,
                state="failed",
                error="robot_halted",
                message="robot 'r1' is halted: release it first",
            )
            return Answer(ack)
        state = "paused" if request.message.paused else "active"
        self.put_status(
            msgspec.structs.replace(status, stamp_ns=clock_ns(), state=state, message=request.message.reason)
        )
        return Answer(m.MissionAck(stamp_ns=clock_ns(), mission=status.mission, accepted=True, state=state))

    def _status(self, request: Request) -> Answer | list[Answer]:
        if "mission" in request.ids:
            return Answer(self._known(request))
        return [Answer(s, ids={"mission": id}) for id, s in self.missions.items()]

    def _plan(self, request: Request) -> Answer:
        status = self._known(request)
        waypoint = m.Candidate("frontier", 3.0, 1.0, 0.4, True, "nearest with value")
        return Answer(
            m.Plan(
                stamp_ns=clock_ns(),
                mission=status.mission,
                robot="r1",
                floor="0",
                step=7,
                seq=7,
                action="move_forward",
                waypoint=waypoint,
                path_m=[(0.0, 0.0), (1.5, 0.2), (float("nan"), 1.0)],
                candidates=[waypoint],
                why="to a frontier, 3.0 m",
            )
        )

    # --- fusion ---------------------------------------------------------------------------------------------------

    def _fusion(self) -> None:
        self._revision = self.fusion.publisher(contract.MAP_REVISION, floor="0")
        self.fusion.serve(contract.MAP_LAYER, self._layer)
        self.removals: list[m.MapRemoval] = []
        self.frames: list[m.RobotFrameProblem] = []
        self._removals = self.fusion.publisher(contract.MAP_REMOVALS, fusion="f1")
        self.fusion.serve(contract.REMOVE_FROM_MAPS, self._remove, fusion="f1")
        self.fusion.serve(contract.MAP_REMOVALS, lambda _: Answer(self._told_removals()), fusion="f1")
        self.fusion.serve(contract.FORGET_PICTURES, self._forget, keeper="f1")
        self.fusion.serve(contract.OBJECTS, self._objects)
        self.fusion.serve(contract.VIEW_PICTURE, self._picture)
        self.fusion.serve(contract.MAP_REVISION, lambda _: Answer(self._held(), ids={"floor": "0"}))

    def _remove(self, request: Request) -> Answer:
        wanted: m.RemoveFromMaps = request.message
        if wanted.source not in ("camera/c1", "robot/r1"):
            raise Refused("unknown_source", f"the maps hold no views of {wanted.source}")
        if self.removals and self.removals[-1].state == "running":
            raise Refused("busy", "camera/c1 is still being removed: try again")
        removal = m.MapRemoval(
            stamp_ns=clock_ns(),
            id=len(self.removals) + 1,
            source=wanted.source,
            since_ns=wanted.since_ns,
            until_ns=wanted.until_ns,
            way="replay",
            state="running",
            views_done=3,
            views_total=12,
        )
        self.put_removal(removal)
        return Answer(removal)

    def put_removal(self, removal: m.MapRemoval) -> None:
        """Publishes a removal, in place of the one with its id."""
        self.removals = [*(r for r in self.removals if r.id != removal.id), removal]
        self._removals.put(self._told_removals())

    def finish_removal(self, state: str = "done") -> None:
        message = "the maps were computed again" if state == "done" else "the log can't be replayed"
        ended = {"state": state, "message": message, "finished_ns": clock_ns()}
        self.put_removal(msgspec.structs.replace(self.removals[-1], **ended))

    def _told_removals(self) -> m.MapRemovals:
        return m.MapRemovals(stamp_ns=clock_ns(), removals=list(self.removals))

    def _held(self) -> m.Revision:
        return m.Revision(
            stamp_ns=self.revision,
            floor="0",
            revision=self.revision,
            floor_z_m=0.0,
            robots={"r1": 3},
            cameras=[m.CameraUse("c1", 2, 13)],
            pending_views=1,
            frames=self.frames,
        )

    def put_revision(self) -> None:
        self.revision += 1
        self._revision.put(self._held())

    def _picture(self, request: Request) -> Answer:
        asked = request.parameters
        if asked["seq"] != "1":
            raise Refused("unknown_picture", "it isn't kept (any more)")
        _, jpeg = cv2.imencode(".jpg", np.full((60, 80, 3), 90, np.uint8))
        named = m.ViewPicture(stamp_ns=clock_ns(), source=asked["source"], view=int(asked["view"]), seq=1)
        return Answer(named, b"no picture" if asked["view"] == "9" else jpeg.tobytes())

    def _layer(self, request: Request) -> Answer:
        floor, layer = request.ids["floor"], request.ids["layer"]
        self.layers_asked.append((layer, request.parameters))
        if floor != "0":
            raise Refused("unknown_floor", f"no floor {floor!r}; floors: 0")
        if layer == "cloud":
            cloud = np.random.default_rng(0).random((1000, 6), np.float32)
            header = m.LayerHeader(
                stamp_ns=clock_ns(),
                floor=floor,
                layer="cloud",
                revision=self.revision,
                grid=self.grid,
                dtype="float32",
                shape=cloud.shape,
            )
            return Answer(header, pack_array(cloud))
        cells = np.zeros(self.grid.shape, np.float32 if layer == "value" else np.uint8)
        cells[0, :4] = 1
        if layer == "value":
            cells[:] = np.nan
            cells[0, 0], cells[5, 5] = 0.2, 0.9
        header = m.LayerHeader(
            stamp_ns=clock_ns(),
            floor=floor,
            layer=layer,
            revision=self.revision,
            grid=self.grid,  # type: ignore[arg-type]
            dtype="float32" if layer == "value" else "uint8",
            shape=cells.shape,
            target=request.parameters.get("target", ""),
        )
        return Answer(header, b"not zstd" if self.broken_layer else pack_array(cells))

    def _objects(self, request: Request) -> Answer:
        if request.ids.get("floor", "0") != "0":
            raise Refused("unknown_floor", f"no floor {request.ids['floor']!r}")
        self.objects_asked.append(request.parameters)
        event = m.ObjectEvent(
            clock_ns(), "camera/c1", 3, 1, "couch", 0.8, "confirmed", "0.80 >= 0.5", (1.0, 2.0, 30.0, 40.0)
        )
        common = {
            "floor": "0",
            "status": self.object_status,
            "confidence": 0.8,
            "confidence_robot": float("nan"),
            "confidence_surveillance": 0.8,
            "label_robot": "",
            "n_detections": 2,
            "n_points": 100,
            "center_m": (1.0, 2.0, 0.4),
            "size_m": (2.0, 1.0, 0.8),
            "first_seen_ns": 1,
            "last_seen_ns": clock_ns(),
            "sources": ["camera/c1"],
            "reason": "seen twice",
            "history": [event],
        }
        objects = [
            m.ObjectRecord(id=i, label=label, label_surveillance=label, **common)
            for i, label in enumerate(("couch", "tv"))
        ]  # type: ignore[arg-type]
        if wanted := request.parameters.get("object"):
            objects = [o for o in objects if str(o.id) == wanted]
            if not objects:
                raise Refused("unknown_object", f"floor '0' has no object {wanted} (any more)")
        return Answer(m.ObjectList(stamp_ns=clock_ns(), floor="0", revision=1, objects=objects), ids={"floor": "0"})

    # --- camera, robot, perception --------------------------------------------------------------------------------

    def _sources(self) -> None:
        yaws = np.deg2rad(np.arange(0, 360, 30))
        views = [
            m.CameraViewInfo(i, Pose.from_matrix(camera_pose((2, 1, 1.8), yaw, -np.pi / 6)))
            for i, yaw in enumerate(yaws)
        ]
        views.append(m.CameraViewInfo(12, Pose.from_matrix(camera_pose((2, 1, 1.8), 0, -np.pi / 2))))
        self.info = m.CameraInfo(
            stamp_ns=clock_ns(),
            camera="c1",
            floor="0",
            position_m=(2.0, 1.0, 1.8),
            mounting_offset_m=1.8,
            intrinsics=Pinhole.from_hfov(1280, 1280, np.deg2rad(100)),
            views=views,
        )
        self.camera.serve(contract.CAMERA_INFO, lambda _: Answer(self.info), floor="0", camera="c1")
        self.camera.serve(contract.CAMERA_REQUEST, self._thumbnail, floor="0", camera="c1")
        self.halted, self.halt_reasons = False, []
        self.robot.serve(contract.ROBOT_HALT, self._halt, robot="r1")
        self._info = self.camera.publisher(contract.CAMERA_INFO, floor="0", camera="c1")
        self._summary = self.camera.publisher(contract.CAMERA_SUMMARY, floor="0", camera="c1")
        self._robot_status = self.robot.publisher(contract.ROBOT_STATUS, robot="r1")
        self.worker.serve(contract.PERCEPTION_TEXT, self._text, worker="w1")
        self._load = self.worker.publisher(contract.PERCEPTION_LOAD, worker="w1")

    def _text(self, request: Request) -> Answer:
        words = ["couch", "tv"]
        reply = m.TextReply(stamp_ns=clock_ns(), worker="w1", backend="simulated", embeddings=[b""], vocabulary=words)
        return Answer(reply)

    def _halt(self, request: Request) -> Answer:
        self.halted = request.message.halted
        self.halt_reasons.append(request.message.reason)
        return Answer(m.HaltReply(stamp_ns=clock_ns(), robot="r1", halted=self.halted))

    def put_sources(self) -> None:
        pose = Pose.from_matrix(base_pose((0.5, 0.25, 0.0), 1.0))
        self._summary.put(m.CameraSummary(stamp_ns=clock_ns(), camera="c1", floor="0", labels={"couch": 0.8}))
        self._robot_status.put(
            m.RobotStatus(stamp_ns=clock_ns(), robot="r1", floor="0", seq=3, state="ready", T_world_base=pose)
        )
        self._load.put(
            m.WorkerLoad(
                stamp_ns=clock_ns(),
                worker="w1",
                backend="simulated",
                why="no weights",
                queued=0,
                capacity=8,
                latency_ms=1.0,
                models=m.ModelIds(detector="d@1"),
                times={"queue": [0] * 20 + [3] + [0] * 53, "odd": [1]},
            )
        )

    def _forget(self, request: Request) -> Answer:
        return Answer(m.PicturesForgotten(stamp_ns=clock_ns(), keeper="f1", message="gone within seconds"))

    def _thumbnail(self, request: Request) -> Answer:
        if (action := request.message.action) != "thumbnail":
            assert action in ("pause", "resume")
            self.info = msgspec.structs.replace(self.info, stamp_ns=clock_ns(), paused=action == "pause")
            self._info.put(self.info)
            return Answer(m.Ack(stamp_ns=clock_ns()), b"")
        if self.info.paused:
            raise Refused("paused", "camera/c1 is paused")
        self.thumbnails += 1
        self.widths_px.append(request.message.width_px)
        _, jpeg = cv2.imencode(".jpg", np.full((48, 64, 3), 10 * request.message.views[0], np.uint8))
        return Answer(m.Ack(stamp_ns=clock_ns()), b"no picture" if request.message.views[0] == 11 else jpeg.tobytes())


@pytest.fixture(scope="module")
def log_apart_from_output() -> Iterator[None]:
    """The gateway runs in the process of the tests: what it logs must not come between the output of commands."""
    structlog.configure(logger_factory=structlog.PrintLoggerFactory(sys.__stderr__))
    yield
    structlog.reset_defaults()


@pytest.fixture(scope="session")
def start_gateway() -> Callable[[str, ExitStack], tuple[str, Gateway]]:
    return serve_gateway


@pytest.fixture(scope="module")
def router() -> Iterator[str]:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with open_router(endpoint):
        yield endpoint


_NUMBERS = itertools.count(1)


def serve_gateway(
    endpoint: str, stack: ExitStack, root_path: str = "", authentication: Authentication | None = None
) -> tuple[str, Gateway]:
    """A gateway as ``python -m surveilnav.services.gateway`` runs it, on a thread; its address."""
    sock = stack.enter_context(listen("127.0.0.1", 0))
    node = stack.enter_context(Node("gateway", f"gateway-{next(_NUMBERS)}", BusSettings(router=endpoint)))
    gateway = Gateway(node, GatewaySettings(root_path=root_path))
    server = web_server(gateway, GatewaySettings().names, root_path, authentication)
    thread = threading.Thread(target=server.run, kwargs={"sockets": [sock]}, daemon=True)
    thread.start()

    def stop() -> None:
        server.should_exit = True
        thread.join(10)

    stack.callback(stop)
    return f"http://127.0.0.1:{sock.getsockname()[1]}", gateway


@pytest.fixture(scope="module")
def building(router: str) -> Iterator[FakeBuilding]:
    building = FakeBuilding(router)
    with building.stack:
        yield building


@pytest.fixture(scope="module")
def served(router: str, building: FakeBuilding) -> Iterator[tuple[str, Gateway]]:
    with ExitStack() as stack:
        yield serve_gateway(router, stack)


@pytest.fixture(scope="module")
def gateway(served: tuple[str, Gateway], client: httpx.Client) -> Gateway:
    """The gateway that ``client`` talks to; it is ready."""
    return served[1]


@pytest.fixture(scope="module")
def client(served: tuple[str, Gateway], building: FakeBuilding) -> Iterator[httpx.Client]:
    with ExitStack() as stack:
        url, _ = served
        client = stack.enter_context(closing(httpx.Client(base_url=url, timeout=20)))
        building.put_sources()
        building.put_revision()
        until(lambda: client.get("/readyz").status_code == 200, "the gateway never became ready")
        yield client
