"""The live screen, its alerts and its lines: pure."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from typing import Any

import pytest

from surveilnav import rest
from surveilnav.cli.watching.alerts import Alerts
from surveilnav.cli.watching.lines import line_of
from surveilnav.cli.watching.screen import screen
from surveilnav.cli.watching.system_state import SystemState, _rates
from surveilnav.client import ServerEvent
from surveilnav.rest import examples

NOW = datetime(2026, 1, 31, 12, 0, 0, tzinfo=UTC)
LONG = "north-wing_" + "0123456789" * 5 + "abc"
MISSION = rest.Mission.model_validate(examples.MISSION)
CAMERA = rest.Camera.model_validate(examples.CAMERA)
ROBOT = rest.Robot.model_validate(examples.ROBOT)
BUILDING = rest.Building(id="studio", floors=["0"], cameras=1, robots=1, missions=1, ready=True, stale=False)
SERVICE = rest.Service(id="fusion", running=True, given_up=False, restarts=0, restarted=None, why=None, stale=False)
FLOOR = rest.Floor(
    id="0", z_m=0.0, revision=1, robots=[], cameras=[], invoked=[], perception_ok=True, layers={}, stale=False
)
WORKER = rest.Worker(
    id="w1",
    backend="compact",
    why="",
    queued=0,
    capacity=8,
    latency_ms=1.0,
    calibrated=True,
    ready=True,
    cached=0,
    models={},
    stages={},
    stale=False,
)


def but(resource: Any, **changed: Any) -> Any:
    return resource.model_copy(update=changed)


def source(id: str, offered: int) -> rest.SourceTraffic:
    return rest.SourceTraffic(
        id=id,
        node=f"camera/{id}",
        offered_bytes=offered,
        delivered_bytes=2 * offered,
        wire_sent_bytes=None,
        frame_bytes=0,
        frames=0,
        viewer_bytes=0,
        by_stream={},
        stale=False,
    )


def traffic(**offered: int) -> rest.Traffic:
    cameras = [source(id, n) for id, n in offered.items()]
    return rest.Traffic(
        offered_bytes=9,
        delivered_bytes=8,
        wire_sent_bytes=7,
        cameras=cameras,
        robots=[source("r1", 5)],
        nodes=[],
    )


def known(**changed: Any) -> SystemState:
    """A building with a mission under way."""
    usual: dict[str, Any] = {
        "missions": [MISSION],
        "plans": {MISSION.id: rest.MissionPlan.model_validate(examples.PLAN)},
        "robots": [ROBOT],
        "cameras": [CAMERA],
        "floors": [FLOOR],
        "buildings": [BUILDING],
        "services": [SERVICE],
        "perception": [WORKER],
        "traffic": traffic(**{"c0-1": 3_000_000}),
        "rates": {"camera/c0-1": 24_000.0},
    }
    return SystemState(**usual | changed)


def drawn(what: SystemState, *, width: int = 80, height: int = 24, events: tuple[str, ...] = ()) -> list[str]:
    alerts = Alerts().of(what, NOW)
    lines = screen(what, alerts, events, url="http://127.0.0.1:8080", now=NOW, width=width, height=height)
    return [line.plain for line in lines]


def test_it_says_why_the_robot_goes_where_it_goes():
    text = "\n".join(drawn(known()))
    assert "potted plant  active" in text
    assert "61/500  10.2 m  waypoint in 12 s" in text
    assert "to a frontier, 3.1 m (best value, 3.1 m), 1 other weighed" in text
    assert "● c0-1" in text
    assert "3.0 MB     6.0 MB          –    24 kB/s  camera/c0-1" in text


@pytest.mark.parametrize(("width", "height"), [(80, 24), (80, 6), (40, 24), (200, 60)])
def test_it_fits_any_terminal(width, height):
    crowd = known(
        missions=[but(MISSION, id=f"{i}{LONG}", message="so " * 99) for i in range(9)],
        robots=[but(ROBOT, id=f"{i}{LONG}") for i in range(9)],
        cameras=[but(CAMERA, id=f"{i}{LONG}", stale=i % 2 == 0) for i in range(40)],
        traffic=traffic(**{f"{i}{LONG}": i for i in range(40)}),
    )
    lines = drawn(crowd, width=width, height=height, events=tuple(f"event {i} {LONG * 3}" for i in range(300)))
    assert len(lines) <= height
    assert [line for line in lines if len(line) > width] == []
    assert "!" in lines[1], "alerts come first"


def test_the_newest_events_have_what_room_is_left():
    lines = drawn(known(), events=tuple(f"event {i}" for i in range(100)))
    assert len(lines) == 23 or len(lines) == 24
    assert lines[-1] == "event 99"


def test_nothing_yet_is_said_in_words():
    text = "\n".join(drawn(SystemState()))
    assert "none yet: surveilnav find TARGET" in text
    ended = known(missions=[but(MISSION, state="failed", error="not_found", message="all was seen")])
    assert "failed  61/500  10.2 m  not_found: all was seen" in "\n".join(drawn(ended))


@pytest.mark.parametrize(
    ("changed", "says"),
    [
        ({"cameras": [but(CAMERA, stale=True)]}, "camera c0-1 is offline"),
        ({"robots": [but(ROBOT, stale=True)]}, "robot r1 is silent"),
        ({"services": [but(SERVICE, running=False, why="SIGKILL")]}, "fusion has ended: SIGKILL"),
        (
            {"services": [but(SERVICE, given_up=True, restarts=8)]},
            "fusion was given up after 8 restarts: see its log",
        ),
        ({"perception": [but(WORKER, stale=True)]}, "perception worker w1 is silent"),
        (
            {"floors": [but(FLOOR, perception_ok=False, message="no worker")]},
            "perception is down for floor 0: no worker",
        ),
        ({"buildings": [but(BUILDING, ready=False)]}, "no mission can run in studio now"),
        ({"lost": NOW, "cameras": [but(CAMERA, stale=True)]}, "the gateway doesn't answer"),
    ],
)
def test_what_is_wrong_is_an_alert(changed, says):
    (found,) = Alerts().of(known(**changed), NOW)
    assert says in found[0]
    assert Alerts().of(known(), NOW) == []


def test_an_alert_says_since_when():
    alerts, later = Alerts(), NOW + timedelta(seconds=90)
    offline = known(cameras=[but(CAMERA, stale=True, last_seen=datetime(2026, 1, 31, 10, 0, 41, tzinfo=UTC))])
    assert alerts.of(offline, NOW)[0][1] == datetime(2026, 1, 31, 10, 0, 41, tzinfo=UTC)
    ended = known(services=[but(SERVICE, running=False)])
    assert [since for _, since in (*alerts.of(ended, NOW), *alerts.of(ended, later))] == [NOW, NOW]
    assert alerts.of(known(), later) == []
    assert alerts.of(ended, later)[0][1] == later, "it came anew"


def test_rates_are_bytes_a_second_and_never_negative():
    rates = _rates(traffic(a=100, b=900), traffic(a=400, b=0, c=30), 3.0)
    assert rates == {"camera/a": 100.0, "camera/b": 0.0, "camera/c": 10.0, "robot/r1": 0.0}
    assert _rates(None, traffic(a=1), 3.0) == {}


@pytest.mark.parametrize(
    ("kind", "data", "says"),
    [
        (
            "mission",
            {"id": "m", "what": "done", "target": "tv", "phase": "finished", "step": 3, "message": "found"},
            "mission m done  tv: finished, step 3, found",
        ),
        ("camera", {"id": "c1", "what": "offline", "floor": "0"}, "camera c1 offline  floor 0"),
        (
            "service",
            {"id": "fusion", "what": "restarted", "restarts": 2, "message": "SIGKILL"},
            "restarted  2 restarts, SIGKILL",
        ),
        (
            "object",
            {"id": "3", "what": "confirmed", "label": "bed", "floor": "1", "center_m": [1.0, None, 2.0]},
            "object 3 confirmed  bed on floor 1 at 1.0 m, , 2.0 m",
        ),
        (
            "reset",
            {"why": "the gateway was started anew"},
            "what came before isn't known: the gateway was started anew",
        ),
    ],
)
def test_an_event_is_a_line(kind, data, says):
    assert says in line_of(ServerEvent("1", kind, rest.Event.model_validate(data)))
