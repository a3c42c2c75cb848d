"""How far one router, one fusion and one gateway go: cameras that only say what they see, and cameras that are invoked.

    python -m tests.bench.bench_scale [--sessions 100 1000] [--light 100 300] [--invoked 16 64 200]

``sessions``: the router alone, with so many bare sessions that are present and publish a summary every five seconds.

``light``: so many cameras, each with a bus session of its own, describe themselves, report their traffic and publish a summary
every five seconds, as a building's cameras do while no robot is near; nobody asks for a picture. ``invoked``: so many cameras of
one floor are invoked at once, because a robot stands there, and each sends the picture of its view. Perception answers at once
that it sees nothing, so that fusion and the bus are measured.

Router, fusion, planner and gateway are processes of their own, as in a building. What they cost is their processor time, which
other load changes little. The cameras run on the same machine and share its processors with them: waiting is due to them, too.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import re
import shutil
import subprocess
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Mapping

import httpx
import numpy as np

from surveilnav.bus import Answer, BusSettings, Node, Publisher, Received, clock_ns
from surveilnav.bus.router import free_port
from surveilnav.contract import (
    CAMERA_REQUEST,
    CAMERA_SUMMARY,
    MAP_REVISION,
    PERCEPTION_INFER,
    PERCEPTION_LOAD,
    ROBOT_OBSERVATION,
    ROBOT_STATUS,
    TRAFFIC,
)
from surveilnav.geometry import Pose, base_pose, camera_pose
from surveilnav.messages import CameraSummary, InferReply, Observation, RobotStatus, WorkerLoad
from surveilnav.messages.base import Message
from surveilnav.sensing.packing import encode_rgbd, pack_embedding
from tests.measured_processes import MeasuredProcess, cpu_s, processes
from tests.still_cameras import LENS, RANGE_M, SUMMARY_S, cameras, room_from_inside, run_sessions

_FLOORS = 10
_PATIENCE_S = 240.0


@contextlib.contextmanager
def system(bus: BusSettings, port: int, folder: str) -> Iterator[dict[str, MeasuredProcess]]:
    """Router, fusion, planner and gateway."""
    environment = {
        "SURVEILNAV_BUS__ROUTER": bus.router,
        "SURVEILNAV_BUS__BUILDING": bus.building,
        "SURVEILNAV_BUS__LOG_LEVEL": os.environ.get("SURVEILNAV_BUS__LOG_LEVEL", "error"),
        "SURVEILNAV_FUSION__STORE": f"{folder}/fusion.sqlite",
        "SURVEILNAV_PLANNER__STORE": f"{folder}/planner.sqlite",
        "SURVEILNAV_GATEWAY__PORT": str(port),
    }
    commands = {
        "router": ["surveilnav.bus.router", "--listen", bus.router],
        "fusion": ["surveilnav.services.fusion"],
        "planner": ["surveilnav.services.planner"],
        "gateway": ["surveilnav.services.gateway"],
    }
    with processes(commands, environment, folder) as services:
        yield services


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


class SummaryTimes:
    """How long each camera's summary takes to a subscriber [s]."""

    def __init__(self, node: Node) -> None:
        self.times_s: list[float] = []
        node.subscribe(CAMERA_SUMMARY, self._record)

    def _record(self, received: Received[CameraSummary]) -> None:
        self.times_s.append((received.received_ns - received.message.stamp_ns) / 1e9)


def router_bytes(bus: BusSettings) -> int:
    """What the router has received and sent, by the kernel's count on its sockets; 0 without the program ``ss``."""
    if shutil.which("ss") is None:
        return 0
    command = ["ss", "-tinHO", "state", "established", "sport", "=", f":{bus.router_port}"]
    text = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    return sum(int(n) for n in re.findall(r"bytes_(?:sent|received):(\d+)", text))


def messages(node: Node) -> int:
    """How many messages fusion, planner and gateway have received."""
    reports = [node.ask(TRAFFIC, node=f"{name}-{name}").message for name in ("fusion", "planner", "gateway")]
    return sum(row.messages for report in reports for row in report.rows if row.direction == "delivered")


def measure_sessions(n: int, seconds: float) -> str:
    """A row of the table of bare sessions."""
    with tempfile.TemporaryDirectory() as folder:
        bus = BusSettings(router=f"tcp/127.0.0.1:{free_port()}", building="scale", connect_timeout_s=60)
        commands = {"router": ["surveilnav.bus.router", "--listen", bus.router]}
        with (
            processes(commands, {}, folder) as services,
            Node("test", "bench", bus, alive=False) as node,
        ):
            node.alive("camera")  # the first call begins to follow presence
            router, began_s = services["router"], time.monotonic()
            with cameras(n, _FLOORS, bus, 0.1, run_sessions) as pids:
                up_s = time.monotonic() - began_s
                time.sleep(SUMMARY_S)
                n_alive, summaries = len(node.alive("camera")), SummaryTimes(node)
                spent_s, cameras_s, n_bytes = router.cpu_s(), sum(map(cpu_s, pids)), router_bytes(bus)
                began_s = time.monotonic()
                time.sleep(seconds)
                took_s = time.monotonic() - began_s
                share, cameras_share = (router.cpu_s() - spent_s) / took_s, (sum(map(cpu_s, pids)) - cameras_s) / took_s
                kb_s, memory = (router_bytes(bus) - n_bytes) / took_s / 1000, router.memory_mib()
                n_after = len(node.alive("camera"))
    median, p99 = 1000 * np.percentile(summaries.times_s, [50, 99])
    return (
        f"| {n} | {up_s:.0f} s | {n_alive}, {n_after} | {100 * share:.0f} %, {memory:.0f} MiB "
        f"| {len(summaries.times_s) / took_s:.0f} | {kb_s:.0f} kB | {median:.1f} ms, {p99:.0f} ms "
        f"| {100 * cameras_share:.0f} %, {os.getloadavg()[0]:.0f} |"
    )


def measure_light(n: int, seconds: float) -> str:
    """A row of the table of cameras that only say what they see."""
    with tempfile.TemporaryDirectory() as folder:
        bus = BusSettings(router=f"tcp/127.0.0.1:{free_port()}", building="scale", connect_timeout_s=60)
        port = free_port()
        with (
            system(bus, port, folder) as services,
            httpx.Client(base_url=f"http://127.0.0.1:{port}", timeout=30) as client,
            Node("test", "bench", bus, alive=False) as node,
        ):
            began_s = time.monotonic()
            with cameras(n, _FLOORS, bus, step_s=1.0) as pids:
                up_s = time.monotonic() - began_s
                known_s = wait_for(lambda: len(answers(client)) == n, f"{n} cameras in the gateway's list")
                time.sleep(SUMMARY_S)
                summaries = SummaryTimes(node)
                spent_s = {name: s.cpu_s() for name, s in services.items()}
                cameras_s, n_bytes, n_messages = sum(map(cpu_s, pids)), router_bytes(bus), messages(node)
                began_s, times_s = time.monotonic(), []
                while time.monotonic() - began_s < seconds:
                    asked_s = time.monotonic()
                    assert client.get("/api/v1/cameras", params={"limit": 50}).status_code == 200
                    times_s.append(time.monotonic() - asked_s)
                    time.sleep(0.5)
                took_s = time.monotonic() - began_s
                shares = {name: (s.cpu_s() - spent_s[name]) / took_s for name, s in services.items()}
                rate, kb_s = (messages(node) - n_messages) / took_s, (router_bytes(bus) - n_bytes) / took_s / 1000
                memory = {name: s.memory_mib() for name, s in services.items()}
                cameras_share = (sum(map(cpu_s, pids)) - cameras_s) / took_s
                listed = len(answers(client))
    costs = " | ".join(f"{100 * shares[name]:.0f} %, {memory[name]:.0f} MiB" for name in services)
    median, p99 = 1000 * np.percentile(summaries.times_s, [50, 99])
    page_ms = 1000 * float(np.median(times_s))
    return (
        f"| {n} | {up_s:.0f} s | {known_s:.1f} s, {listed} | {costs} | {rate:.0f} | {kb_s:.0f} kB "
        f"| {median:.0f} ms, {p99:.0f} ms | {page_ms:.0f} ms | {100 * cameras_share:.0f} %, {os.getloadavg()[0]:.0f} |"
    )


def measure_invoked(n: int) -> str:
    """A row of the table of cameras that are all invoked."""
    with tempfile.TemporaryDirectory() as folder:
        bus = BusSettings(router=f"tcp/127.0.0.1:{free_port()}", building="scale", connect_timeout_s=60)
        with system(bus, free_port(), folder) as services, cameras(n, 1, bus), contextlib.ExitStack() as stack:
            node = stack.enter_context(Node("perception", "w", bus))
            serve_perception(node)
            robot = stack.enter_context(Node("robot", "r", bus))
            revisions = robot.table(MAP_REVISION)

            def processed() -> int:
                row = revisions.get(floor="0")
                return sum(c.views_processed for c in row.message.cameras) if row else 0

            before_s = {name: s.cpu_s() for name, s in services.items()}
            observe(robot)
            first_s = wait_for(lambda: processed() > 0, "the first camera's view")
            all_s = first_s + wait_for(lambda: processed() >= n, f"{n} views")
            spent_s = {name: s.cpu_s() - before_s[name] for name, s in services.items()}
            memory = {name: s.memory_mib() for name, s in services.items()}
            report = robot.ask(TRAFFIC, node="fusion-fusion").message
            requests = [row for row in report.rows if CAMERA_REQUEST.ids_of(row.key)]
            again = sum(row.messages for row in requests if row.direction == "offered")
    costs = " | ".join(f"{1000 * spent_s[name] / n:.0f} ms | {memory[name]:.0f} MiB" for name in ("router", "fusion"))
    return f"| {n} | {first_s:.1f} s | {all_s:.1f} s | {n / all_s:.1f} | {costs} | {again} | {os.getloadavg()[0]:.0f} |"


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
    payload, image, depth = encode_rgbd(rgb, depth_m, depth_range_m=RANGE_M)
    publisher.put(
        Observation(
            stamp_ns=clock_ns(),
            source="robot/r",
            view=0,
            seq=1,
            floor="0",
            camera=LENS,
            T_world_camera=Pose.from_matrix(T),
            mounting_offset_m=0.88,
            depth_range_m=RANGE_M,
            image=image,
            depth=depth,
            T_world_base=pose,
        ),
        payload,
    )


_SESSIONS = (
    "| sessions | all started | present, and at the end | router | summaries a second | bytes a second "
    "| a summary, median, 99 % | the sessions, load |\n" + "|---" * 8 + "|"
)
_LIGHT = (
    "| cameras | all started | all listed after | router | fusion | planner | gateway | messages a second "
    "| bytes a second | a summary, median, 99 % | a page of 50 cameras | the cameras, load |\n" + "|---" * 12 + "|"
)
_INVOKED = (
    "| invoked | first view in the maps | all | views a second | router, per view | | fusion, per view | | asked again | load |\n"
    "|---|---|---|---|---|---|---|---|---|---|"
)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sessions", type=int, nargs="*", default=[100, 1000])
    parser.add_argument("--light", type=int, nargs="*", default=[100, 300])
    parser.add_argument("--invoked", type=int, nargs="*", default=[16, 64, 200])
    parser.add_argument("--seconds", type=float, default=20.0)
    args = parser.parse_args()
    tables: Mapping[str, tuple[list[int], Callable[[int], str]]] = {
        _SESSIONS: (args.sessions, lambda n: measure_sessions(n, args.seconds)),
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
