"""How far one router, one fusion and one gateway go: cameras that only say what they see, and cameras that are invoked.

    python -m tests.bench.bench_scale [--light 100 300 1000] [--invoked 16 64 200]

``light``: so many cameras, each with a bus session of its own, describe themselves, report their traffic and publish a summary
every five seconds, as a building's cameras do while no robot is near; nobody asks for a picture. ``invoked``: so many cameras of
one floor are invoked at once, because a robot stands there, and each sends the picture of its view. Perception answers at once
that it sees nothing, so that fusion and the bus are measured.

Router, fusion and gateway are processes of their own, as in a building. The cameras run on the same machine and share its
processors with them.
"""

from __future__ import annotations

import argparse
import contextlib
import math
import multiprocessing
import os
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from multiprocessing.synchronize import Event

import httpx
import numpy as np

from surveilnav.bus import Answer, BusSettings, Node, Publisher, clock_ns
from surveilnav.bus.router import free_port
from surveilnav.contract import (
    CAMERA_SUMMARY,
    MAP_REVISION,
    PERCEPTION_INFER,
    PERCEPTION_LOAD,
    ROBOT_OBSERVATION,
    ROBOT_STATUS,
)
from surveilnav.geometry import Pinhole, Pose, base_pose, camera_pose
from surveilnav.messages import CameraSummary, InferReply, Observation, RobotStatus, StreamStatus, WorkerLoad
from surveilnav.messages.base import Message
from surveilnav.sensing.packing import encode_rgbd, pack_embedding
from surveilnav.services.camera_node.config import CameraSettings
from surveilnav.services.camera_node.service import CameraService
from surveilnav.services.camera_node.sources.source import Picture, Place

_PER_PROCESS = 50
_FLOORS = 10
_SUMMARY_S = 5.0
_LENS = Pinhole.from_hfov(640, 480, math.radians(90))
_RANGE_M = (0.1, 10.0)
_HEIGHT_M = 2.4
_PATIENCE_S = 240.0


class StillSource:
    """A camera that looks down on an empty floor of 6 x 6 m between walls, with a little noise of its own."""

    tier = "jpeg+depth"
    intrinsics, depth_range_m = _LENS, _RANGE_M

    def __init__(self, number: int, floor: str) -> None:
        x_m, y_m = 6.0 * (number % 15), 6.0 * (number // 15 % 15)
        self.place = Place(f"c{number}", floor, (x_m, y_m, _HEIGHT_M), _HEIGHT_M)
        self._T = camera_pose((x_m, y_m, _HEIGHT_M), 0.0, -0.6)
        self.views = [Pose.from_matrix(self._T)]
        self.stream = StreamStatus()
        self._seed = number

    def version(self, view: int) -> int:
        return 1

    def content(self, view: int) -> str:
        return str(self._seed)

    def latest(self, view: int) -> Picture:
        return Picture(1, *room_from_inside(self._T, self.place.position_m, self._seed))


def room_from_inside(T: np.ndarray, at_m: tuple[float, float, float], seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Colour and depth of a room of 6 x 6 x 3 m around a place."""
    rays = _LENS.rays() @ T[:3, :3].T.astype(np.float32)
    low = np.array([at_m[0] - 3.0, at_m[1] - 3.0, 0.0]) - T[:3, 3]
    high = np.array([at_m[0] + 3.0, at_m[1] + 3.0, 3.0]) - T[:3, 3]
    with np.errstate(divide="ignore"):
        depth_m = np.where(rays > 0, high / rays, low / rays).min(axis=-1)
    rng = np.random.default_rng(seed)
    rgb = np.repeat(rng.integers(60, 200, (48, 64, 3), np.uint8), 10, axis=0).repeat(10, axis=1)
    return rgb, (depth_m * (1 + 0.005 * rng.standard_normal(depth_m.shape))).astype(np.float32)


def run_cameras(numbers: range, n_floors: int, bus: BusSettings, ready: Event, stop: Event) -> None:
    """Cameras in one process, each with a session of its own, until ``stop``."""
    with contextlib.ExitStack() as stack:
        cameras = []
        for number in numbers:
            source = StillSource(number, str(number % n_floors))
            node = stack.enter_context(Node("camera", source.place.name, bus))
            ids = {"floor": source.place.floor, "camera": source.place.name}
            cameras.append((CameraService(node, source, CameraSettings()), node.publisher(CAMERA_SUMMARY, **ids), ids))
        ready.set()
        next_summary_s = time.monotonic()
        while not stop.wait(0.1):
            for service, summary, ids in cameras:
                service.step()
                if time.monotonic() >= next_summary_s:
                    summary.put(CameraSummary(stamp_ns=clock_ns(), labels={"chair": 0.5, "tv": 0.7}, **ids))
            if time.monotonic() >= next_summary_s:
                next_summary_s += _SUMMARY_S


@contextlib.contextmanager
def cameras(n: int, n_floors: int, bus: BusSettings) -> Iterator[None]:
    context = multiprocessing.get_context("spawn")
    stop, processes = context.Event(), []
    for first in range(0, n, _PER_PROCESS):
        ready = context.Event()
        numbers = range(first, min(first + _PER_PROCESS, n))
        processes.append(context.Process(target=run_cameras, args=(numbers, n_floors, bus, ready, stop)))
        processes[-1].start()
        if not ready.wait(_PATIENCE_S):
            raise SystemExit(f"cameras {numbers} didn't start within {_PATIENCE_S:.0f} s")
    try:
        yield
    finally:
        stop.set()
        for process in processes:
            process.join(30)
            process.kill()


@dataclass(frozen=True)
class Service:
    """A process of the system, whose cost is read from /proc."""

    name: str
    process: subprocess.Popen[bytes]

    def cpu_s(self) -> float:
        with open(f"/proc/{self.process.pid}/stat") as f:
            fields = f.read().rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

    def memory_mib(self) -> float:
        with open(f"/proc/{self.process.pid}/status") as f:
            return next(int(line.split()[1]) for line in f if line.startswith("VmRSS")) / 1024


@contextlib.contextmanager
def system(bus: BusSettings, port: int, folder: str) -> Iterator[dict[str, Service]]:
    """Router, fusion and gateway."""
    environment = os.environ | {
        "SURVEILNAV_BUS__ROUTER": bus.router,
        "SURVEILNAV_BUS__BUILDING": bus.building,
        "SURVEILNAV_BUS__LOG_LEVEL": os.environ.get("SURVEILNAV_BUS__LOG_LEVEL", "error"),
        "SURVEILNAV_FUSION__STORE": f"{folder}/fusion.sqlite",
        "SURVEILNAV_GATEWAY__PORT": str(port),
    }
    commands = {
        "router": ["surveilnav.bus.router", "--listen", bus.router],
        "fusion": ["surveilnav.services.fusion"],
        "gateway": ["surveilnav.services.gateway"],
    }
    services: dict[str, Service] = {}
    try:
        for name, command in commands.items():
            services[name] = Service(
                name, subprocess.Popen([sys.executable, "-m", *command], env=environment, cwd=folder)
            )
            time.sleep(2.0)
        yield services
    finally:
        for service in reversed(services.values()):
            service.process.terminate()
            with contextlib.suppress(subprocess.TimeoutExpired):
                service.process.wait(20)
            service.process.kill()


def wait_for(what: Callable[[], bool], name: str) -> float:
    """Waits until something is so; how long that took [s]."""
    began_s = time.monotonic()
    while not what():
        if time.monotonic() - began_s > _PATIENCE_S:
            raise SystemExit(f"{name}: not within {_PATIENCE_S:.0f} s")
        time.sleep(0.2)
    return time.monotonic() - began_s


def answers(client: httpx.Client) -> list[dict[str, object]]:
    """The cameras that the gateway lists; none while it doesn't answer."""
    items: list[dict[str, object]] = []
    cursor = ""
    while True:
        try:
            answer = client.get("/api/v1/cameras", params={"limit": 500} | ({"cursor": cursor} if cursor else {}))
        except httpx.HTTPError:
            return []
        if answer.status_code != 200:
            return []
        page = answer.json()
        items += page["items"]
        cursor = page.get("next_cursor") or ""
        if not cursor:
            return items


def measure_light(n: int, seconds: float) -> str:
    """A row of the table of cameras that only say what they see."""
    with tempfile.TemporaryDirectory() as folder:
        bus = BusSettings(router=f"tcp/127.0.0.1:{free_port()}", building="scale", connect_timeout_s=30)
        port = free_port()
        with (
            system(bus, port, folder) as services,
            httpx.Client(base_url=f"http://127.0.0.1:{port}", timeout=30) as client,
        ):
            began_s = time.monotonic()
            with cameras(n, _FLOORS, bus):
                up_s = time.monotonic() - began_s
                known_s = wait_for(lambda: len(answers(client)) == n, f"{n} cameras in the gateway's list")
                time.sleep(_SUMMARY_S)
                cpu_s = {name: s.cpu_s() for name, s in services.items()}
                began_s, times_s = time.monotonic(), []
                while time.monotonic() - began_s < seconds:
                    asked_s = time.monotonic()
                    assert client.get("/api/v1/cameras", params={"limit": 50}).status_code == 200
                    times_s.append(time.monotonic() - asked_s)
                    time.sleep(0.5)
                took_s = time.monotonic() - began_s
                shares = {name: (s.cpu_s() - cpu_s[name]) / took_s for name, s in services.items()}
                memory = {name: s.memory_mib() for name, s in services.items()}
    costs = " | ".join(f"{100 * shares[name]:.0f} % | {memory[name]:.0f} MiB" for name in services)
    return f"| {n} | {up_s:.0f} s | {known_s:.1f} s | {costs} | {1000 * float(np.median(times_s)):.0f} ms |"


def measure_invoked(n: int) -> str:
    """A row of the table of cameras that are all invoked."""
    with tempfile.TemporaryDirectory() as folder:
        bus = BusSettings(router=f"tcp/127.0.0.1:{free_port()}", building="scale", connect_timeout_s=30)
        with system(bus, free_port(), folder) as services, cameras(n, 1, bus), contextlib.ExitStack() as stack:
            node = stack.enter_context(Node("perception", "w", bus))
            serve_perception(node)
            robot = stack.enter_context(Node("robot", "r", bus))
            revisions = robot.table(MAP_REVISION)

            def processed() -> int:
                row = revisions.get(floor="0")
                return sum(c.views_processed for c in row.message.cameras) if row else 0

            cpu_s = {name: s.cpu_s() for name, s in services.items()}
            observe(robot)
            first_s = wait_for(lambda: processed() > 0, "the first camera's view")
            all_s = first_s + wait_for(lambda: processed() >= n, f"{n} views")
            spent_s = {name: s.cpu_s() - cpu_s[name] for name, s in services.items()}
            memory = {name: s.memory_mib() for name, s in services.items()}
    costs = " | ".join(f"{1000 * spent_s[name] / n:.0f} ms | {memory[name]:.0f} MiB" for name in ("router", "fusion"))
    return f"| {n} | {first_s:.1f} s | {all_s:.1f} s | {n / all_s:.1f} | {costs} |"


def repeat(node: Node, publisher: Publisher, message: Callable[[], Message]) -> None:
    """Publishes a state once a second until the node ends."""

    def run() -> None:
        while not node.stopping.wait(1.0):
            publisher.put(message())

    publisher.put(message())
    threading.Thread(target=run, daemon=True).start()


def serve_perception(node: Node) -> None:
    """A worker that sees nothing, at once."""
    embedding = pack_embedding(np.eye(1, 512, dtype=np.float32)[0])

    def load() -> WorkerLoad:
        return WorkerLoad(stamp_ns=clock_ns(), worker="w", backend="none", why="", queued=0, capacity=4, latency_ms=1.0)

    def infer(request: object) -> Answer:
        m = request.message  # type: ignore[attr-defined]
        return Answer(
            InferReply(
                stamp_ns=clock_ns(),
                worker="w",
                backend="none",
                source=m.source,
                view=m.view,
                seq=m.seq,
                detections=[],
                image_embedding=embedding,
            )
        )

    node.serve(PERCEPTION_LOAD, lambda _: Answer(load()), worker="w")
    node.serve(PERCEPTION_INFER, infer, worker="w", workers=2)
    repeat(node, node.publisher(PERCEPTION_LOAD, worker="w"), load)


def observe(node: Node) -> None:
    """A robot stands in the middle of the first room and looks."""
    pose, T = Pose.from_matrix(base_pose((0, 0, 0), 0)), camera_pose((0.0, 0.0, 0.88), 0.0, -0.2)

    def status() -> RobotStatus:
        return RobotStatus(stamp_ns=clock_ns(), robot="r", floor="0", seq=1, state="ready", T_world_base=pose)

    node.serve(ROBOT_STATUS, lambda _: Answer(status()), robot="r")
    repeat(node, node.publisher(ROBOT_STATUS, robot="r"), status)
    publisher = node.publisher(ROBOT_OBSERVATION, robot="r")
    wait_for(lambda: publisher.matched, "somebody who listens to the robot")
    rgb, depth_m = room_from_inside(T, (0.0, 0.0, 0.0), 0)
    payload, image, depth = encode_rgbd(rgb, depth_m, depth_range_m=_RANGE_M)
    publisher.put(
        Observation(
            stamp_ns=clock_ns(),
            source="robot/r",
            view=0,
            seq=1,
            floor="0",
            camera=_LENS,
            T_world_camera=Pose.from_matrix(T),
            mounting_offset_m=0.88,
            depth_range_m=_RANGE_M,
            image=image,
            depth=depth,
            T_world_base=pose,
        ),
        payload,
    )


_LIGHT = (
    "| cameras | all started | all listed after | router | | fusion | | gateway | | a page of 50 cameras |\n"
    "|---|---|---|---|---|---|---|---|---|---|"
)
_INVOKED = (
    "| invoked | first view in the maps | all | views a second | router, per view | | fusion, per view | |\n"
    "|---|---|---|---|---|---|---|---|"
)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--light", type=int, nargs="*", default=[100, 300, 1000])
    parser.add_argument("--invoked", type=int, nargs="*", default=[16, 64, 200])
    parser.add_argument("--seconds", type=float, default=20.0)
    args = parser.parse_args()
    tables: Mapping[str, tuple[list[int], Callable[[int], str]]] = {
        _LIGHT: (args.light, lambda n: measure_light(n, args.seconds)),
        _INVOKED: (args.invoked, measure_invoked),
    }
    for header, (numbers, measure) in tables.items():
        if numbers:
            print(header, flush=True)
        for n in numbers:
            print(measure(n), flush=True)


if __name__ == "__main__":
    main()
