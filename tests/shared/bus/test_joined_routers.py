"""Two routers that are joined to one bus: a camera on one, fusion on the other."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest
import zenoh

from surveilnav import messages as m
from surveilnav.bus import Answer, BusSettings, Node
from surveilnav.bus.router import free_port, open_router
from surveilnav.bus.tls import TlsFiles
from surveilnav.contract import CAMERA_FRAME, ROBOT_COMMAND, ROBOT_STATUS
from surveilnav.errors import BusError
from surveilnav.security.folder import ACCESS, CERTIFICATE, KEY, SecurityFolder
from surveilnav.security.identities import identity_from_name
from tests.waiting import until

NAMES = ("router", "fusion", "planner", "camera-c1", "robot-r1")


class Machines:
    """Two machines with a router each, ``here`` and ``there``, of which the second joins the first."""

    def __init__(self, folder: SecurityFolder | None = None) -> None:
        self._folder, self.protocol = folder, "tls" if folder else "tcp"
        self.endpoints = [f"{self.protocol}/127.0.0.1:{free_port()}" for _ in range(2)]

    def files(self, name: str) -> TlsFiles | None:
        if self._folder is None:
            return None
        folder = self._folder.identity_folder(name)
        return TlsFiles(folder / "ca.pem", folder / CERTIFICATE, folder / KEY)

    def router(self, k: int) -> zenoh.Session:
        access = self._folder.path / ACCESS if self._folder else None
        return open_router(self.endpoints[k], self.files("router"), access, self.endpoints[:k])

    def settings(self, k: int, name: str) -> BusSettings:
        files = self.files(name)
        tls = {"tls_ca": files.ca, "tls_certificate": files.certificate, "tls_key": files.key} if files else {}
        return BusSettings(router=self.endpoints[k], building="test", connect_timeout_s=10, **tls)

    @contextmanager
    def node(self, k: int, kind: str, id: str, name: str = "") -> Iterator[Node]:
        with Node(kind, id, self.settings(k, name or kind)) as node:
            yield node


def make_machines(protocol: str, path: Path) -> Machines:
    if protocol == "tcp":
        return Machines()
    identities = [identity_from_name(name) for name in NAMES]
    return Machines(SecurityFolder.create(path / "building", "test", identities, ("127.0.0.1",)))


@pytest.fixture(params=["tcp", "tls"])
def machines(request, tmp_path) -> Machines:
    return make_machines(request.param, tmp_path)


def command(planner: Node) -> list[m.CommandReply]:
    found = planner.ask_all(ROBOT_COMMAND, m.Command(stamp_ns=1, action="stop", seq_expected=0), robot="r1")
    return [received.message for received in found]


def test_a_robot_on_one_router_works_with_services_on_the_other(machines, status):
    obey = lambda _: Answer(m.CommandReply(stamp_ns=1, accepted=True, seq=7))  # noqa: E731
    with ExitStack() as stack:
        for k in (0, 1):
            stack.enter_context(machines.router(k))
        planner, fusion = (stack.enter_context(machines.node(0, kind, kind)) for kind in ("planner", "fusion"))
        robot = stack.enter_context(machines.node(1, "robot", "r1", "robot-r1"))
        camera = stack.enter_context(machines.node(1, "camera", "c1", "camera-c1"))
        # queries, presence and states
        robot.serve(ROBOT_COMMAND, obey, robot="r1")
        assert until(lambda: command(planner))[0].seq == 7
        until(lambda: planner.alive("robot") == {"r1"})
        seen, statuses = planner.table(ROBOT_STATUS), robot.publisher(ROBOT_STATUS, robot="r1")
        until(lambda: statuses.matched)
        statuses.put(status(3))
        until(lambda: (row := seen.get(robot="r1")) and row.message.seq == 3)
        # subscription is invocation also from the other machine
        frames = camera.publisher(CAMERA_FRAME, floor="0", camera="c1", view=0)
        assert not frames.matched
        slot = fusion.latest(CAMERA_FRAME, floor="0", camera="c1", view=0)
        until(lambda: frames.matched)
        frames._publisher.put(bytes(2 * 2**20))
        until(lambda: slot._sample is not None)
        slot.close()
        until(lambda: not frames.matched)


def test_a_name_is_taken_on_both_routers(machines):
    with (
        machines.router(0),
        machines.router(1),
        machines.node(0, "robot", "r1", "robot-r1"),
        machines.node(1, "camera", "c1", "camera-c1"),
        machines.node(0, "planner", "planner") as planner,
    ):
        until(lambda: planner.alive("camera") == {"c1"})
        with pytest.raises(BusError, match="a robot named 'r1' is on the bus already"):
            machines.node(1, "robot", "r1", "robot-r1").__enter__()


def test_routers_join_again(machines):
    """The second router comes first, and stays while the first one is restarted: so do its robots."""
    obey = lambda _: Answer(m.CommandReply(stamp_ns=1, accepted=True, seq=7))  # noqa: E731
    with machines.router(1), machines.node(1, "robot", "r1", "robot-r1") as robot:
        robot.serve(ROBOT_COMMAND, obey, robot="r1")
        for _ in range(2):
            with machines.router(0), machines.node(0, "planner", "planner") as planner:
                until(lambda planner=planner: command(planner), timeout_s=20.0)
                until(lambda planner=planner: planner.alive("robot") == {"r1"})


def test_the_rules_hold_across_routers(tmp_path):
    """What a camera puts for another doesn't pass its own router, so the other one never sees it."""
    machines = make_machines("tls", tmp_path)
    heard: list[str] = []
    with ExitStack() as stack:
        for k in (0, 1):
            stack.enter_context(machines.router(k))
        fusion, camera = (
            stack.enter_context(zenoh.open(zenoh.Config.from_json5(machines.settings(k, name).client_config())))
            for k, name in ((0, "fusion"), (1, "camera-c1"))
        )
        every = CAMERA_FRAME.key_for(building="test")
        fusion.declare_subscriber(every, lambda sample: heard.append(str(sample.key_expr)))
        own = CAMERA_FRAME.key_for(building="test", floor="0", camera="c1", view=0)

        def both() -> bool:
            camera.put(CAMERA_FRAME.key_for(building="test", floor="0", camera="c2", view=0), b"a picture")
            camera.put(own, b"a picture")
            return own in heard

        until(both, lambda: heard)
        time.sleep(0.3)
        assert set(heard) == {own}


@pytest.mark.parametrize(
    ("endpoint", "why"), [("elsewhere:7447", "--connect: expected tcp/HOST:PORT"), ("tls/host:7447", "all at tls/")]
)
def test_an_endpoint_that_can_not_be_joined_is_named(endpoint, why):
    with pytest.raises(BusError, match=why):
        open_router(f"tcp/127.0.0.1:{free_port()}", connect=[endpoint])
