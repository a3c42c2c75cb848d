"""Taking a camera or a robot out of the maps, over REST and from the command line."""

from __future__ import annotations

import json
import threading
from datetime import UTC, datetime

import msgspec
import pytest

from surveilnav.bus import Answer, Node, Refused, Request, clock_ns
from surveilnav.cli.main import main
from surveilnav.client import Client
from surveilnav.contract import MAP_REMOVALS, MAP_REVISION, REMOVE_FROM_MAPS
from surveilnav.messages import MapRemoval, MapRemovals, Revision
from tests.waiting import until

pytestmark = pytest.mark.usefixtures("log_apart_from_output")

REMOVALS = "/api/v1/removals"


@pytest.fixture
def typed(client, monkeypatch, capsys):
    """``typed(*arguments)``: exit status, stdout, stderr of `surveilnav ...` asking that gateway."""
    monkeypatch.setattr("surveilnav.cli.main.signal.signal", lambda *_: None)
    monkeypatch.setenv("SURVEILNAV_URL", str(client.base_url))

    def run(*arguments):
        monkeypatch.setattr("sys.argv", ["surveilnav", *arguments])
        with pytest.raises(SystemExit) as ended:
            main()
        return int(ended.value.code or 0), *capsys.readouterr()

    return run


@pytest.fixture(autouse=True)
def nothing_runs(building):
    yield
    if building.removals and building.removals[-1].state == "running":
        building.finish_removal()


def finish_soon(building, state: str = "done") -> None:
    """Ends the next removal once it runs."""
    known = len(building.removals)

    def end() -> None:
        until(lambda: len(building.removals) > known)
        building.finish_removal(state)

    threading.Thread(target=end, daemon=True).start()


def test_a_removal_is_begun_followed_and_listed(client, building):
    since = "2026-01-31T10:00:00.000001+01:00"
    answer = client.post(REMOVALS, json={"source": "camera/c1", "since": since})
    begun = answer.json()
    assert (answer.status_code, begun["state"], begun["way"]) == (202, "running", "replay")
    assert building.removals[-1].since_ns == 1_769_850_000_000_001_000
    assert datetime.fromisoformat(begun["since"]) == datetime.fromisoformat(since)
    assert (begun["until"], begun["views_done"], begun["views_total"]) == (None, 3, 12)
    again = client.post(REMOVALS, json={"source": "robot/r1"})
    assert (again.status_code, again.json()["type"]) == (503, "urn:surveilnav:problem:busy")
    building.finish_removal()
    until(lambda: client.get(f"{REMOVALS}/{begun['id']}").json()["state"] == "done")
    assert client.get(REMOVALS).json()["items"][0]["id"] == begun["id"]
    assert client.get(f"{REMOVALS}/999").status_code == 404


@pytest.mark.parametrize(
    ("body", "says"),
    [
        ({"source": "c1"}, "source"),
        ({"source": "camera/../x"}, "source"),
        ({}, "source"),
        ({"source": "camera/c1", "since": "2026-01-31T10:00:00"}, "timezone"),
        ({"source": "camera/c1", "since": "2026-01-31T10:00:00Z", "until": "2026-01-31T09:00:00Z"}, "before until"),
        ({"source": "camera/c1", "floor": "0"}, "floor"),
        ({"source": "camera/nobody"}, "no views of camera/nobody"),
    ],
)
def test_what_cannot_be_removed_is_refused(client, body, says):
    answer = client.post(REMOVALS, json=body)
    assert answer.status_code == 422
    assert says in answer.json()["detail"]


def test_its_end_is_an_event_and_answers_about_the_maps_of_before_are_forgotten(client, gateway, building):
    with Client(str(client.base_url)) as asked:
        events = asked.events()
        assert next(events).kind == "reset"
        upstairs = building.fusion.publisher(MAP_REVISION, floor="upstairs")
        revision = Revision(
            stamp_ns=clock_ns(),
            floor="upstairs",
            revision=1,
            floor_z_m=9.0,
            robots={},
            cameras=[],
            pending_views=0,
        )
        upstairs.put(revision)
        until(lambda: "upstairs" in [f.id for f in asked.floors()])
        assert client.get("/api/v1/floors/0/layers/occupancy.png").status_code == 200
        asked_before = len(building.layers_asked)
        asked.remove_from_maps("camera/c1", until=datetime(2030, 1, 1, tzinfo=UTC))
        begun = next(e for e in events if e.kind == "removal").data
        building.finish_removal()
        ended = next(e for e in events if e.kind == "removal").data
        assert [(e.what, e.source) for e in (begun, ended)] == [("running", "camera/c1"), ("done", "camera/c1")]
        until(lambda: [f.id for f in asked.floors()] == ["0"])
        assert client.get("/api/v1/floors/0/layers/occupancy.png").status_code == 200
        assert len(building.layers_asked) > asked_before
        assert asked.removal(asked.removals()[0].id).until == datetime(2030, 1, 1, tzinfo=UTC)


def test_the_command_waits_and_says_what_was_done(typed, building):
    finish_soon(building)
    code, out, err = typed("cameras", "remove", "c", "--from-maps", "--since", "2026-01-31T10:00:00")
    assert (code, out) == (
        0,
        "camera/c1 since 2026-01-31 10:00:00: taken out of the maps by replay: the maps were computed again\n",
    )
    assert "c1 goes on looking" in err
    finish_soon(building)
    code, out, _ = typed("robots", "remove", "r1", "--from-maps", "--json")
    assert (code, json.loads(out)["source"], json.loads(out)["state"]) == (0, "robot/r1", "done")
    finish_soon(building, "failed")
    code, out, _ = typed("robots", "remove", "r1", "--from-maps")
    assert (code, out) == (1, "robot/r1: still in the maps: the log can't be replayed\n")
    assert "robot/r1: still in the maps" in typed("status")[1]
    assert json.loads(typed("robots", "--json")[1])["items"][0]["id"] == "r1"


def test_a_camera_that_is_not_listed_any_more_can_be_removed_from_the_maps(typed):
    code, out, _ = typed("cameras", "remove", "lobby", "--from-maps", "--json")
    assert (code, json.loads(out)["error"]["name"]) == (1, "unknown_source")


@pytest.mark.parametrize(
    ("command", "says"),
    [
        (("cameras", "remove", "c1", "--since", "2026-01-31"), "add --from-maps"),
        (("robots", "remove", "r1"), "add --from-maps"),
        (("cameras", "remove", "c1", "--from-maps", "--since", "soon"), "datetime"),
    ],
)
def test_mistyped(typed, command, says):
    code, _, err = typed(*command)
    assert code == 2
    assert says in " ".join(err.replace("│", "").split())


def test_a_paused_camera_brings_no_warning(typed, building):
    building.info = msgspec.structs.replace(building.info, stamp_ns=clock_ns(), paused=True)
    building._info.put(building.info)
    until(lambda: "paused" in typed("cameras")[1])
    finish_soon(building)
    assert "goes on looking" not in typed("cameras", "remove", "c1", "--from-maps")[2]


def test_a_robot_is_removed_from_the_maps_of_every_fusion_service_that_knows_it(client, gateway, building):
    told: list[MapRemoval] = []

    def remove(request: Request) -> Answer:
        wanted = request.message
        if wanted.source != "robot/r1":
            raise Refused("unknown_source", f"the maps hold no views of {wanted.source}")
        removal = MapRemoval(
            stamp_ns=clock_ns(), id=1, source=wanted.source, way="replay", state="done", finished_ns=clock_ns()
        )
        told.append(removal)
        return Answer(removal)

    with Node("fusion", "f2", building.settings) as node:
        node.serve(REMOVE_FROM_MAPS, remove, fusion="f2")
        node.serve(MAP_REMOVALS, lambda _: Answer(MapRemovals(stamp_ns=clock_ns(), removals=told)), fusion="f2")
        until(lambda: gateway.state.node.alive("fusion") == {"f1", "f2"})
        begun = client.post(REMOVALS, json={"source": "robot/r1"}).json()
        building.finish_removal()
        ids = [item["id"] for item in client.get(REMOVALS).json()["items"]]
        assert {begun["id"], "f2-1"} <= set(ids)
        assert client.get(f"{REMOVALS}/f2-1").json()["state"] == "done"
        only_below = client.post(REMOVALS, json={"source": "camera/c1"})
        assert (only_below.status_code, only_below.json()["id"].partition("-")[0]) == (202, "f1")
        building.finish_removal()
        assert client.post(REMOVALS, json={"source": "camera/nobody"}).status_code == 422
