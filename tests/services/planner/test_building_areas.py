"""The building file and what is said of doors, over real Zenoh: zones are read again, and missions wait at closed doors."""

from __future__ import annotations

import math

import pytest

from surveilnav.bus import Refused, clock_ns
from surveilnav.contract import FLOOR_AREAS, PASSAGE_STATE
from surveilnav.errors import ConfigError
from surveilnav.messages import PassageState
from surveilnav.services.planner.areas import BuildingAreas, MissionAreas
from surveilnav.services.planner.pausing import Pauses
from tests.services.planner.test_service import (  # noqa: F401
    QUICK,
    Fakes,
    begin,
    client,
    end_of,
    pause,
    planner,
    stands_still,
    status_of,
    submit,
)
from tests.services.planner.test_store import saved
from tests.waiting import repeat_until, until

#: A room in two halves, joined by an opening of 1.25 m. The cameras have seen all of it.
HALVES = """
####################
#        #         #
#        #    CC   #
#   R         CC   #
#                  #
#                  #
#        #         #
#        #         #
####################
"""
BUILDING = """building: test
floors:
  floor-r1:
    passages:
      lobby: {kind: door, outline_m: [[2.2, 0.3], [2.6, 0.3], [2.6, 2.1], [2.2, 2.1]]}
    keepout:
      store: [[0.3, 0.3], [1.0, 0.3], [1.0, 0.6], [0.3, 0.6]]
"""


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "building.yaml"
    path.write_text(BUILDING)
    return path


@pytest.fixture
def robot(make_node, world, thing):
    make_node("perception", "p1")
    known = {"label": "chair", "confidence": 0.9, "status": "confirmed"}
    room = world(HALVES, {"C": thing("chair", looks_like="chair", known=known)}, yaw_rad=math.pi)
    room.occupancy[room.solid] = 1
    room.explored[20:-20, 20:-20] = 1
    return Fakes(make_node, {"floor-r1": room})


@pytest.fixture
def door(make_node):
    node = make_node("test", "door", alive=False)
    publisher = node.publisher(PASSAGE_STATE, floor="floor-r1", passage="lobby")
    return lambda state: publisher.put(PassageState(stamp_ns=clock_ns(), state=state))


def waits(client, door):  # noqa: F811
    """The mission's status once it waits at the closed door, which says again and again that it is closed."""

    def waiting():
        door("closed")
        return status if (status := status_of(client)).state == "paused" else None

    return until(waiting, lambda: status_of(client), 20.0)


def begin_at_closed_door(planner, client, door, file):  # noqa: F811
    service = planner(QUICK.model_copy(update={"building_file": file}))
    repeat_until(lambda: door("closed"), lambda: service._missions._areas.state_of("floor-r1", "lobby") == "closed")
    submit(client)
    return waits(client, door)


def test_a_mission_waits_for_the_door_by_name_and_goes_on_by_itself(robot, planner, client, door, file):  # noqa: F811
    status = begin_at_closed_door(planner, client, door, file)
    assert status.message == "waits for door lobby, which is closed: chair 1 is behind it"
    assert status.phase == "paused"
    assert stands_still(robot)
    door("open")
    assert end_of(client).found
    assert robot.world.x > 2.6


def test_a_person_has_it_go_on_although_the_door_is_said_to_be_closed(robot, planner, client, door, file):  # noqa: F811
    begin_at_closed_door(planner, client, door, file)
    assert pause(client, paused=False).accepted
    door("closed")
    assert end_of(client).found


@pytest.fixture
def restarted(make_node, begin, file, tmp_path):  # noqa: F811
    """``restarted(settings)``: a planner with the same store as the one before, which has ended."""
    running = []

    def start(settings=QUICK):
        for node in running:
            node.__exit__(None, None, None)
        running[:] = [make_node("planner", f"planner-{len(running)}")]
        update = {"building_file": file, "store": str(tmp_path / "missions.db")}
        return begin(running[0], settings.model_copy(update=update))

    return start


def test_a_mission_still_waits_at_the_door_after_a_restart_of_the_planner(robot, restarted, client, door, file):  # noqa: F811
    why = begin_at_closed_door(restarted, client, door, file).message
    restarted()
    until(lambda: status_of(client).state == "paused", timeout_s=5.0)
    assert stands_still(robot), "nothing was said of the door yet"
    door("closed")
    assert stands_still(robot)
    assert (status_of(client).state, status_of(client).message) == ("paused", why)
    assert robot.world.x < 2.2
    door("open")
    assert end_of(client).found


def test_a_person_vouches_for_a_door_that_a_mission_has_waited_for_since_before_a_restart(
    robot,
    restarted,
    client,  # noqa: F811
    door,
    file,
):
    begin_at_closed_door(restarted, client, door, file)
    restarted()
    until(lambda: status_of(client).state == "paused", timeout_s=5.0)
    assert pause(client, paused=False).accepted
    door("closed")
    assert end_of(client).found


def test_what_a_person_said_of_a_door_outlives_the_planner(robot, restarted, client, door, file):  # noqa: F811
    begin_at_closed_door(restarted, client, door, file)
    robot.slow_s = 0.05
    assert pause(client, paused=False).accepted
    assert robot.world.x < 2.2, "it has yet to drive through"
    restarted()

    def ended():
        door("closed")
        status = status_of(client)
        assert status.state != "paused", status.message
        return status if status.finished_ns else None

    assert until(ended, timeout_s=30.0).found


def test_what_was_closed_before_a_restart_counts_until_something_is_said(make_node, door, file, monkeypatch):
    areas = BuildingAreas(make_node("planner", "planner"), file)
    areas.remember_closed("floor-r1", ("lobby",))
    assert areas.state_of("floor-r1", "lobby") == "closed"
    assert areas.state_of("floor-r1", "entrance") == "unknown"
    repeat_until(lambda: door("open"), lambda: areas.state_of("floor-r1", "lobby") == "open")
    later = BuildingAreas(make_node("planner", "later"), file)
    monkeypatch.setattr("surveilnav.services.planner.areas._MAX_AGE_S", 0.0)
    later.remember_closed("floor-r1", ("lobby",))
    assert later.state_of("floor-r1", "lobby") == "unknown", "for as long as a message would"


def test_a_door_of_which_nothing_is_said_is_driven_through(robot, planner, client, file):  # noqa: F811
    planner(QUICK.model_copy(update={"building_file": file}))
    submit(client)
    assert end_of(client).found


def test_others_are_told_of_zones_and_doors_and_of_each_change(planner, client, door, file):  # noqa: F811
    heard = client.table(FLOOR_AREAS)
    service = planner(QUICK.model_copy(update={"building_file": file}))

    def told(state):
        door(state)
        service.step()
        rows = [row.message for row in heard.rows()]
        return next((r for r in rows if [a.state for a in r.areas] == ["", state]), None)

    (store, lobby) = until(lambda: told("closed"), lambda: heard.rows()).areas
    assert (store.name, store.kind, store.outline_m[1]) == ("store", "keepout", (1.0, 0.3))
    assert (lobby.name, lobby.kind) == ("lobby", "door")
    until(lambda: told("open"), lambda: heard.rows())
    assert [a.state for row in client.ask_all(FLOOR_AREAS, timeout_s=1) for a in row.message.areas] == ["", "open"]
    with pytest.raises(Refused, match="no areas of floor 'attic'"):
        client.ask(FLOOR_AREAS, floor="attic")
    file.write_text("building: test")
    repeat_until(service.step, lambda: [r.message.areas for r in heard.rows()] == [[]], lambda: heard.rows())


def test_what_nobody_says_any_more_is_unknown(make_node, door, file, monkeypatch):
    node = make_node("planner", "planner")
    areas = BuildingAreas(node, file)
    repeat_until(lambda: door("closed"), lambda: areas.state_of("floor-r1", "lobby") == "closed")
    assert [a.kind for a in areas.on_floor("floor-r1")] == ["keepout", "closed"]
    monkeypatch.setattr("surveilnav.services.planner.areas._MAX_AGE_S", -1.0)
    assert [a.kind for a in areas.on_floor("floor-r1")] == ["keepout"]
    assert areas.on_floor("elsewhere") == ()


def test_what_a_person_said_holds_until_the_door_opens(make_node, door, file):
    areas = BuildingAreas(make_node("planner", "planner"), file)
    mission = MissionAreas(areas)
    pauses = Pauses(mission, saved())

    def say(state):
        repeat_until(lambda: door(state), lambda: areas.state_of("floor-r1", "lobby") == state)
        vouched = mission.vouched
        mission.on_floor("floor-r1")
        assert mission.vouched == vouched, "asking changes nothing"
        mission.drop_outdated_vouches()
        return [a.kind for a in mission.on_floor("floor-r1")]

    assert say("closed") == ["keepout", "closed"]
    pauses.begin("lunch")
    pauses.resume()
    assert say("closed") == ["keepout", "closed"], "it didn't wait there"
    assert pauses.for_passages("why", "floor-r1", ("lobby",))
    assert not mission.vouched
    pauses.resume()
    assert pauses.reason is None
    assert say("closed") == ["keepout"]
    assert say("open") == ["keepout", "open"]
    assert say("closed") == ["keepout", "closed"]


def test_a_changed_file_is_read_again_and_a_wrong_one_keeps_the_former_zones(make_node, file, monkeypatch):
    monkeypatch.setattr("surveilnav.services.planner.areas._LOOK_S", 0.0)
    node = make_node("planner", "planner")
    areas = BuildingAreas(node, file)
    assert [a.name for a in areas.on_floor("floor-r1")] == ["keepout zone 'store'"]
    file.write_text(BUILDING.replace("store:", "server room:"))
    areas.refresh()
    assert [a.name for a in areas.on_floor("floor-r1")] == ["keepout zone 'server room'"]
    for wrong in ("building: [", BUILDING.replace("[1.0, 0.6]", "[.nan, 0.6]")):
        file.write_text(wrong)
        areas.refresh()
        assert [a.name for a in areas.on_floor("floor-r1")] == ["keepout zone 'server room'"]
        assert "the former keepout zones stay" in node.traffic_report().problems["building_file"]
    file.unlink()
    areas.refresh()
    assert [a.name for a in areas.on_floor("floor-r1")] == ["keepout zone 'server room'"]
    file.write_text(BUILDING)
    areas.refresh()
    assert [a.name for a in areas.on_floor("floor-r1")] == ["keepout zone 'store'"]
    assert not node.traffic_report().problems


def test_without_a_file_that_can_be_read_the_planner_doesnt_start(make_node, tmp_path):
    with pytest.raises(ConfigError, match="building file"):
        BuildingAreas(make_node("planner", "planner"), tmp_path / "building.yaml")
