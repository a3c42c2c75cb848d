"""The commands of the running system, on a gateway with a building of fakes behind it: what people and programs read."""

from __future__ import annotations

import json
import threading

import msgspec
import numpy as np
import pytest
from typer.testing import CliRunner

from surveilnav.bus import clock_ns
from surveilnav.cli import main as cli_main
from surveilnav.cli.main import main
from tests.waiting import until

pytestmark = pytest.mark.usefixtures("log_apart_from_output")


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


@pytest.fixture
def mission(client, building):
    """The id of a mission under way."""
    told = client.post("/api/v1/missions", json={"target": "tv"}).json()
    until(lambda: client.get(f"/api/v1/missions/{told['id']}").status_code == 200)
    return told["id"]


@pytest.mark.parametrize(
    ("command", "path"),
    [
        (("missions",), "missions"),
        (("cameras",), "cameras"),
        (("objects", "--label", "couch"), "objects?label=couch"),
        (("objects", "--status", "rejected"), "objects?status=rejected"),
    ],
)
def test_a_list_is_the_gateways(typed, client, mission, command, path):
    code, out, err = typed(*command, "--json")
    assert (code, err) == (0, "")
    told, asked = json.loads(out), client.get(f"/api/v1/{path}").json()
    assert set(told) == {"items", "total"}
    assert told["total"] == asked["total"] == len(told["items"])
    assert [row["id"] for row in told["items"]] == [row["id"] for row in asked["items"]]
    assert [set(row) for row in told["items"]] == [set(row) for row in asked["items"]]


def test_a_mission_is_shown_paused_resumed_and_cancelled(typed, mission):
    code, out, _ = typed("missions")
    assert (code, mission in out) == (0, True)
    assert mission in typed("missions", "show", mission)[1]
    assert json.loads(typed("missions", "show", mission, "--json")[1])["id"] == mission
    assert json.loads(typed("missions", "why", mission, "--json")[1])["mission"] == mission
    assert typed("missions", "pause", mission, "--reason", "lunch")[:2] == (0, f"{mission}: paused\n")
    assert json.loads(typed("missions", "resume", mission, "--json")[1])["state"] == "active"
    assert typed("missions", "cancel", mission)[:2] == (0, f"{mission}: cancelled\n")


def test_past_pictures_are_deleted_and_each_keeper_says_so(typed, building):
    code, out, _ = typed("cameras", "delete-pictures")
    assert code == 0
    assert [line.partition(":")[0] for line in out.splitlines()] == ["gateway", "f1"]
    told = json.loads(typed("cameras", "delete-pictures", "--json")[1])
    assert [k["keeper"] for k in told["items"]] == ["gateway", "f1"]


def test_an_id_needs_only_its_beginning(typed, mission):
    assert json.loads(typed("missions", "show", mission[:-1], "--json")[1])["id"] == mission
    assert typed("cameras", "pause", "c")[:2] == (0, "c1: paused\n")
    assert typed("cameras", "resume", "c1")[:2] == (0, "c1: looks again\n")


@pytest.mark.parametrize(
    ("command", "name", "says"),
    [
        (("missions", "show", "nobody"), "unknown_mission", "`surveilnav missions` lists them"),
        (("cameras", "pause", "nobody"), "unknown_camera", "there are c1"),
        (("cameras", "remove", "c1"), "camera_present", ""),
        (("map", "heat"), "unknown_layer", "occupancy, explored, frontier, value"),
        (("map", "--floor", "9"), "unknown_floor", "9"),
        (("find", "unicorn"), "bad_target", ""),
    ],
)
def test_mistakes_say_what_to_do(typed, mission, command, name, says):
    code, out, err = typed(*command, "--json")
    assert (code, json.loads(out)["error"]["name"]) == (1, name)
    assert says in err
    assert "Traceback" not in err


def test_options_of_a_list_are_refused_before_a_command(typed):
    code, _, err = typed("missions", "--json", "show", "m")
    assert (code, "--json goes behind" in err) == (2, True)


def test_status_and_traffic_name_everybody(typed, client):
    code, out, _ = typed("status")
    assert (code, "c1" in out, "perception (1)" in out) == (0, True, True)
    told = json.loads(typed("status", "--json")[1])
    assert set(told) == {"services", "robots", "cameras", "perception", "missions", "removals"}
    code, out, _ = typed("traffic", "--nodes")
    assert (code, "gateway/" in out) == (0, True)
    assert set(json.loads(typed("traffic", "--json")[1])) == set(client.get("/api/v1/traffic").json())


def test_what_a_mission_costs_is_said(typed, client, building, mission):
    building.put_status(
        msgspec.structs.replace(building.missions[mission], stamp_ns=clock_ns(), state="active", step=1)
    )
    until(lambda: client.get(f"/api/v1/missions/{mission}/traffic").status_code == 200)
    told = json.loads(typed("traffic", "--mission", mission, "--json")[1])
    assert set(told) == set(client.get(f"/api/v1/missions/{mission}/traffic").json())
    code, out, _ = typed("traffic", "--mission", mission)
    assert (code, mission in out, "offered" in out) == (0, True, True)


def test_robots_are_stopped_and_released(typed):
    code, out, _ = typed("stop", "--reason", "smoke")
    assert (code, "r1  stopped" in out) == (0, True)
    told = json.loads(typed("release", "--json")[1])
    assert told["items"] == [{"robot": "r1", "halted": False, "stale": False}]


def test_objects_are_a_line_each(typed):
    code, out, _ = typed("objects", "--label", "couch")
    line = next(line for line in out.splitlines() if "couch" in line)
    assert (code, line.split()[:6]) == (0, ["couch", "0", "0", "1.0,", "2.0,", "0.4"])
    assert typed("objects", "--label", "nothing")[1] == "nothing is known of such objects yet\n"


def test_a_map_is_drawn_and_written(typed, tmp_path):
    code, out, _ = typed("map")
    assert code == 0
    assert "#" in out
    assert "north is up" in out
    for name in ("map.png", "map.npy"):
        code, out, err = typed("map", "value", "--target", "bed", "--out", str(tmp_path / name), "--json")
        assert (code, err) == (0, "")
        assert json.loads(out)["layer"] == "value"
    assert (tmp_path / "map.png").read_bytes().startswith(b"\x89PNG")
    assert np.load(tmp_path / "map.npy").shape == (json.loads(out)["rows"], json.loads(out)["cols"])
    code, _, err = typed("map", "--out", str(tmp_path / "map.bmp"))
    assert (code, ".png or .npy" in err) == (1, True)


def test_the_shell_is_offered_ids(client, building, mission, monkeypatch):
    monkeypatch.setenv("SURVEILNAV_URL", str(client.base_url))
    asked = {"_SURVEILNAV_COMPLETE": "complete_bash", "COMP_WORDS": "surveilnav missions show m", "COMP_CWORD": "3"}
    assert mission in CliRunner().invoke(cli_main.app, prog_name="surveilnav", env=asked).stdout.split()


def test_find_tells_how_it_went(typed, building):
    asked = len(building.goals)

    def end():
        until(lambda: len(building.goals) > asked)
        status = until(lambda: building.missions.get(building.goals[-1].mission))
        ended = {"stamp_ns": clock_ns(), "state": "failed", "error": "not_found", "message": "all was seen"}
        building.put_status(msgspec.structs.replace(status, **ended))

    ending = threading.Thread(target=end, daemon=True)
    ending.start()
    code, out, err = typed("find", "tv", "--robot", "r1", "--json")
    ending.join()
    assert (code, json.loads(out)["error"]) == (1, "not_found")
    assert "failed not_found: all was seen" in err
