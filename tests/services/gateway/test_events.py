"""``/events`` over a real bus and a real socket: cut off at random, never read, resumed after a restart."""

from __future__ import annotations

import json
import random
import socket
import threading
from contextlib import ExitStack
from itertools import count

import httpx
import msgspec
import pytest

from surveilnav import contract
from surveilnav import messages as m
from surveilnav.bus import Node, clock_ns
from surveilnav.geometry import Pose, base_pose
from surveilnav.services.gateway.stream_sources import StreamSource
from surveilnav.services.gateway.streams import EventStream
from tests.services.gateway.streams import ReceivedEvent, blocks, within
from tests.waiting import until

URL = "/api/v1/events"


class Listener:
    """A client on a thread, that stays connected until ``stop``."""

    def __init__(self, client: httpx.Client) -> None:
        self.told: list[ReceivedEvent] = []
        self._client = client
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()
        until(lambda: self.told, "no stream")

    def _run(self) -> None:
        with self._client.stream("GET", URL) as answer:
            assert answer.headers["content-type"].startswith("text/event-stream")
            for told in blocks(answer.iter_text()):
                self.told.append(told)
                if self._stop.is_set():
                    return

    def stop(self) -> None:
        self._stop.set()

    def heard(self, kind: str, id: str) -> list[str]:
        return [t.data["what"] for t in list(self.told) if t.kind == kind and t.data["id"] == id]


@pytest.fixture
def listener(client):
    listener = Listener(client)
    yield listener
    listener.stop()


_MISSIONS = count()


def mission(**facts) -> m.MissionStatus:
    known = {
        "stamp_ns": clock_ns(),
        "mission": f"e-{next(_MISSIONS)}",
        "target": "tv",
        "robot": "r1",
        "state": "active",
        "phase": "exploring",
        "step": 1,
        "max_steps": 9,
        "path_m": 1.0,
    }
    return m.MissionStatus(**(known | facts))


def test_who_comes_first_is_told_to_read_the_state(listener):
    first = listener.told[0]
    assert (first.kind, first.data["why"]) == ("reset", "you come for the first time")
    assert first.id


def test_missions_tell_of_every_state_and_phase(listener, building):
    status = mission(state="queued", phase="queued")
    for facts in ({}, {"state": "active"}, {"phase": "approaching"}, {"step": 2}, {"state": "done", "found": True}):
        status = msgspec.structs.replace(status, stamp_ns=clock_ns(), **facts)
        building.put_status(status)
    until(lambda: "done" in listener.heard("mission", status.mission), lambda: listener.told)
    assert listener.heard("mission", status.mission) == ["queued", "active", "phase", "done"]
    last = next(t for t in listener.told if t.data.get("what") == "done")
    assert (last.data["target"], last.data["found"]) == ("tv", True)


def test_a_camera_that_comes_and_goes(listener, building):
    def info() -> m.CameraInfo:
        return msgspec.structs.replace(building.info, camera="c7", stamp_ns=clock_ns())

    for what in ("new", "back"):
        with Node("camera", "c7", building.settings) as node:
            publisher = node.publisher(contract.CAMERA_INFO, floor="0", camera="c7")
            publisher.put(info())
            until(lambda: what in listener.heard("camera", "c7"), lambda: listener.told)  # noqa: B023
        until(lambda: listener.heard("camera", "c7")[-1] == "offline", lambda: listener.told)


def test_robots_and_processes(listener, building):
    pose = Pose.from_matrix(base_pose((0.5, 0.25, 0.0), 1.0))
    robot = building.node("robot", "r7")
    publisher = robot.publisher(contract.ROBOT_STATUS, robot="r7")
    until(lambda: publisher.matched)
    states = iter(["ready", "moving"])
    state = next(states)

    def heard(what: str) -> bool:
        publisher.put(m.RobotStatus(stamp_ns=clock_ns(), robot="r7", floor="0", seq=3, state=state, T_world_base=pose))
        return what in listener.heard("robot", "r7")

    until(lambda: heard("new"), lambda: listener.told)
    state = next(states)
    until(lambda: heard("moving"), lambda: listener.told)
    up = building.node("cli", "up-events")
    services = up.publisher(contract.SERVICES, supervisor="up-events")
    until(lambda: services.matched)
    told = m.ServiceState("thing", True)
    for changed, what in ((told, []), (msgspec.structs.replace(told, running=False, why="SIGKILL"), ["ended"])):
        services.put(m.ServiceList(stamp_ns=clock_ns(), supervisor="up-events", services=[changed]))
        until(lambda: listener.heard("service", "thing") == what, lambda: listener.told)  # noqa: B023


def test_objects_that_are_decided(listener, building):
    building.put_revision()
    until(lambda: any(p.get("detail") == "brief" for p in building.objects_asked), "fusion was never asked")
    building.object_status = "rejected"
    try:
        building.put_revision()
        until(lambda: "rejected" in listener.heard("object", "0"), lambda: listener.told)
    finally:
        building.object_status = "confirmed"


def test_a_client_cut_off_a_hundred_times_misses_nothing(client, building):
    """Events come all the while; the client reads some bytes, is gone, and goes on from its last id."""
    chance, put, enough = random.Random(4), [], threading.Event()
    with client.stream("GET", URL) as answer:
        last_id = next(blocks(answer.iter_text())).id

    def happen() -> None:
        while not (last := enough.is_set()):
            status = mission(mission=f"cut-{len(put)}")
            put.append(status.mission)
            building.put_status(status)
            enough.wait(0.01)
        assert last

    producer = threading.Thread(target=happen, daemon=True)
    producer.start()
    got: list[ReceivedEvent] = []
    for cut in range(101):
        if cut == 100:
            enough.set()
            producer.join()
        budget = chance.randint(1, 4000) if cut < 100 else 10**9
        with client.stream("GET", URL, headers={"Last-Event-ID": last_id}) as answer:
            for told in blocks(within(budget, answer.iter_text())):
                assert told.kind != "reset", told
                got.append(told)
                last_id = told.id
                if cut == 100 and told.data["id"] == put[-1]:
                    break
    numbers = [int(t.id.rpartition("-")[2]) for t in got]
    assert numbers == list(range(numbers[0], numbers[0] + len(numbers)))  # nothing twice, nothing left out
    assert [t.data["id"] for t in got if t.data["id"].startswith("cut-")] == put
    assert len(put) > 100


def test_another_run_of_the_gateway_tells_to_read_anew(router, start_gateway, client):
    with client.stream("GET", URL) as answer:
        last_id = next(blocks(answer.iter_text())).id
    with ExitStack() as stack:
        url, _ = start_gateway(router, stack)
        with httpx.stream("GET", url + URL, headers={"Last-Event-ID": last_id}) as answer:
            first = next(blocks(answer.iter_text()))
    assert (first.kind, first.data["why"]) == ("reset", "the gateway was started anew since your last event")


def test_a_stream_doesnt_keep_the_gateway_from_ending(router, start_gateway):
    with ExitStack() as stack:
        url, gateway = start_gateway(router, stack)
        with httpx.stream("GET", url + URL) as answer:
            chunks = answer.iter_text()
            next(chunks)
            stack.close()  # joins the server's thread
            assert "".join(chunks) == ""
        assert gateway.events.n_streams == 0


def test_who_never_reads_is_dropped(router, start_gateway, monkeypatch):
    monkeypatch.setattr(EventStream, "__init__", lambda self, events, last: _init(self, events, last, stalled_s=0.3))
    with ExitStack() as stack:
        url, gateway = start_gateway(router, stack)
        host, port = url.removeprefix("http://").split(":")
        deaf = stack.enter_context(socket.socket())
        deaf.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        deaf.connect((host, int(port)))
        deaf.sendall(f"GET {URL} HTTP/1.1\r\nHost: {host}\r\n\r\n".encode())
        until(lambda: gateway.events.n_streams == 1, "no stream")

        def dropped() -> bool:
            for _ in range(50):
                gateway.events.publish("mission", json.dumps({"id": "x", "what": "y" * 2000}))
            return gateway.events.n_streams == 0

        until(dropped, "a client that never reads is kept", timeout_s=20)
        assert httpx.get(f"{url}/healthz").status_code == 200


_init = EventStream.__init__


def test_a_quiet_stream_says_where_it_is(client, monkeypatch):
    """What an id alone on a line does: the client comes back with it, and proxies see that the stream lives."""
    monkeypatch.setattr(StreamSource, "beat_s", 0.0)
    with client.stream("GET", URL) as answer:
        lines = answer.iter_lines()
        until(lambda: next(lines) == "", "no first event")
        beats = [line for line in (next(lines) for _ in range(20)) if line.startswith("id: ")]
    assert beats


@pytest.mark.parametrize("last_id", ["x" * 201, "nonsense", "-1", "0-0; drop"])
def test_any_last_event_id_is_answered(client, last_id):
    with client.stream("GET", URL, headers={"Last-Event-ID": last_id}) as answer:
        if len(last_id) > 200:
            assert answer.status_code == 422
        else:
            assert next(blocks(answer.iter_text())).kind == "reset"


def test_more_streams_than_fit_are_refused(client, monkeypatch):
    monkeypatch.setattr("surveilnav.services.gateway.stream_sources._MAX_STREAMS", 0)
    answer = client.get(URL)
    assert (answer.status_code, answer.headers["retry-after"]) == (503, "10")
    assert answer.json()["type"].endswith(":too_many_streams")
