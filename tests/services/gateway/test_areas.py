"""Keepout zones, doors and lifts: as the planner tells of them, and without what can't be."""

from __future__ import annotations

import math

import pytest

from surveilnav import messages as m
from surveilnav.bus import Answer, clock_ns
from surveilnav.client import Client
from surveilnav.contract import FLOOR_AREAS
from surveilnav.services.gateway.core.areas import areas_from_message
from tests.waiting import until

SQUARE = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0)]
STORE = m.Area(name="store / server room", kind="keepout", outline_m=SQUARE)


def door(state="closed"):
    return m.Area(name="lobby", kind="door", outline_m=SQUARE, state=state)


def message(*areas, floor="0"):
    return m.FloorAreas(stamp_ns=clock_ns(), floor=floor, areas=list(areas))


@pytest.fixture
def tell(building):
    """``tell(*areas, floor)``: the planner has these areas from now on."""
    publishers, told = {}, {}

    def answers(_):
        return [Answer(row, ids={"floor": floor}) for floor, row in told.items()]

    def tell(*areas, floor="0"):
        told[floor] = message(*areas, floor=floor)
        if not publishers:
            building.planner.serve(FLOOR_AREAS, answers)
        if floor not in publishers:
            publishers[floor] = building.planner.publisher(FLOOR_AREAS, floor=floor)
        publishers[floor].put(told[floor])

    return tell


def listed(client, **params):
    return client.get("/api/v1/areas", params=params).json()["items"]


def test_areas_are_listed_by_floor_and_follow_their_doors(client, building, tell):
    assert listed(client) == []
    tell(STORE, door())
    tell(door("unknown"), floor="1")
    until(lambda: len(listed(client)) == 3, lambda: listed(client))
    zone, lobby = listed(client, floor="0")
    assert zone | {"last_seen": None} == {
        "id": "0/keepout/store / server room",
        "floor": "0",
        "name": "store / server room",
        "kind": "keepout",
        "state": None,
        "outline_m": [list(corner) for corner in SQUARE],
        "last_seen": None,
        "stale": False,
    }
    assert (lobby["id"], lobby["kind"], lobby["state"]) == ("0/door/lobby", "door", "closed")
    assert [a["state"] for a in listed(client, floor="1")] == ["unknown"]
    tell(STORE, door("open"))
    until(lambda: [a["state"] for a in listed(client, floor="0")] == [None, "open"])
    tell()  # the building file has none any more
    until(lambda: listed(client, floor="0") == [])
    assert listed(client, floor="nowhere") == []
    assert client.get("/api/v1/areas", params={"floor": "*"}).status_code == 422


@pytest.mark.parametrize(
    ("area", "why"),
    [
        (m.Area(name="", kind="keepout", outline_m=SQUARE), "expected a name of 1 to 100"),
        (m.Area(name="x" * 10**6, kind="keepout", outline_m=SQUARE), "expected a name of 1 to 100"),
        (m.Area(name="a line", kind="door", outline_m=SQUARE[:2]), "expected 3 to 100 corners, got 2"),
        (m.Area(name="a circle", kind="lift", outline_m=SQUARE * 50), "expected 3 to 100 corners, got 150"),
        (m.Area(name="nan", kind="keepout", outline_m=[*SQUARE, (0.0, math.nan)]), "expected finite corners"),
        (m.Area(name="far", kind="keepout", outline_m=[*SQUARE, (2e5, 0.0)]), "expected finite corners"),
        (STORE, "twice"),
    ],
)
def test_what_cant_be_is_left_out_by_name(area, why):
    found, (fault,) = areas_from_message(message(STORE, area, door()), 1, stale=False)
    assert [a.name for a in found] == [STORE.name, "lobby"]
    assert why in fault
    assert len(fault) < 300


def test_too_many_are_cut_off():
    many = [m.Area(name=str(i), kind="keepout", outline_m=SQUARE) for i in range(1000)]
    found, (fault,) = areas_from_message(message(*many), 1, stale=False)
    assert len(found) == 400
    assert "1000 areas" in fault


def test_each_fault_is_counted_once_a_message(client, served, tell):
    node = served[1].state.node
    before = node.traffic_report().rejected.get("floor_areas", 0)
    tell(STORE, m.Area(name="", kind="keepout", outline_m=SQUARE), floor="faulty")
    until(lambda: len(listed(client, floor="faulty")) == 1)
    for _ in range(3):
        listed(client)
    assert 1 <= node.traffic_report().rejected["floor_areas"] - before <= 2, "its answer to a query is another message"


def test_the_client_has_them(client, tell):
    tell(door(), floor="7")
    with Client(str(client.base_url)) as asked:
        (lobby,) = until(lambda: asked.areas("7"))
        assert (lobby.kind, lobby.state, lobby.outline_m) == ("door", "closed", SQUARE)


def test_they_are_stale_without_a_planner(client, building, tell):
    tell(STORE, floor="9")
    until(lambda: [a["stale"] for a in listed(client, floor="9")] == [False])
    building.planner.__exit__(None, None, None)  # the last test: the others need it
    until(lambda: [a["stale"] for a in listed(client, floor="9")] == [True])
