"""Where cameras see something: the answer of fusion, as a resource, with the rooms of cameras.yaml."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from surveilnav import contract
from surveilnav import messages as m
from surveilnav.bus import Answer, Node, Refused, Request, clock_ns
from surveilnav.rest import SightingsRequest
from surveilnav.services.gateway.rooms import Rooms
from surveilnav.services.gateway.sightings import CameraSightings
from tests.waiting import until

FILE = """\
floors:
  "0":
    z_m: 0.0
    rooms:
      lounge: [[0, 0], [4, 0], [4, 3], [0, 3]]
      store: [[4, 0], [6, 0], [6, 3], [4, 3]]
  "1": {z_m: 3.0, rooms: {attic: [[0, 0], [4, 0], [4, 3]]}}
cameras: []
"""


@pytest.fixture(scope="module")
def asked(building) -> list[m.CameraSearch]:
    """What fusion was asked. It answers that a camera sees half of every room whose name begins with l."""
    asked: list[m.CameraSearch] = []

    def search(request: Request) -> Answer:
        wanted: m.CameraSearch = request.message
        asked.append(wanted)
        if wanted.target == "unicorn":
            raise Refused("bad_target", "nobody can look for a unicorn")
        rooms = [
            m.RoomInView(floor=r.floor, name=r.name, share=0.5 * r.name.startswith("l"), cameras=["c1"])
            for r in wanted.rooms
        ]
        report = m.CameraSearchReport(
            stamp_ns=clock_ns(),
            target=wanted.target,
            cameras=[m.CameraUse("c1", 2, 13)],
            lacking={"c1": "its views didn't come in time"},
            complete=False,
            rooms=rooms,
        )
        return Answer(report)

    building.fusion.serve(contract.CAMERA_SEARCH, search, fusion="f1")
    return asked


def test_the_answer_lists_what_was_found_and_what_is_lacking(client, asked) -> None:
    answer = client.post("/api/v1/sightings", json={"target": "couch", "floor": "0", "max_s": 2})
    assert answer.status_code == 200, answer.text
    found = answer.json()
    assert [(s["label"], s["room"], s["position_m"]) for s in found["sightings"]] == [("couch", "", [1.0, 2.0, 0.4])]
    assert found["cameras"] == [
        {"id": "c1", "views": 13, "views_processed": 2, "lacking": "its views didn't come in time"}
    ]
    assert (found["rooms"], found["complete"]) == ([], False)
    picture = client.get(found["sightings"][0]["picture"])
    assert picture.content.startswith(b"\xff\xd8")


def test_a_refusal_is_passed_on(client, asked) -> None:
    answer = client.post("/api/v1/sightings", json={"target": "unicorn"})
    assert answer.status_code >= 400
    assert "nobody can look for a unicorn" in answer.text


def test_rooms_are_asked_about_and_named(gateway, asked, tmp_path: Path) -> None:
    file = tmp_path / "cameras.yaml"
    file.write_text(FILE)
    sightings = CameraSightings(gateway.state, gateway.objects, file)
    found = sightings.search(SightingsRequest(target="couch", floor="0", max_s=2.0))
    assert [room.name for room in asked[-1].rooms] == ["lounge", "store"]
    assert [(r.name, r.in_view, r.cameras) for r in found.rooms] == [("lounge", 0.5, ["c1"]), ("store", 0.0, ["c1"])]
    assert [s.room for s in found.sightings] == ["lounge"]
    sightings.search(SightingsRequest(target="couch", max_s=2.0))
    assert [room.name for room in asked[-1].rooms] == ["lounge", "store", "attic"]


def test_a_changed_file_is_read_again_and_a_broken_one_keeps_the_rooms(gateway, tmp_path: Path) -> None:
    file = tmp_path / "cameras.yaml"
    rooms = Rooms(gateway.state.node, file)
    assert rooms.all() == []
    file.write_text(FILE)
    assert rooms.name_at("0", 5.0, 1.0) == "store"
    assert rooms.name_at("0", 9.0, 1.0) == ""
    assert rooms.name_at("1", 5.0, 1.0) == ""
    file.write_text("floors: 3")
    assert rooms.name_at("0", 5.0, 1.0) == "store"
    file.write_text(FILE.replace("store", "larder"))
    os.utime(file, ns=(1, 1))
    assert rooms.name_at("0", 5.0, 1.0) == "larder"
    assert Rooms(gateway.state.node, None).all() == []


@pytest.fixture
def upstairs(building, asked) -> Iterator[list[m.CameraSearch]]:
    """What a second fusion service was asked, which maps floor 1. It is silent about other floors."""
    asked_upstairs: list[m.CameraSearch] = []

    def search(request: Request) -> Answer | list[Answer]:
        wanted: m.CameraSearch = request.message
        asked_upstairs.append(wanted)
        if wanted.floor not in ("", "1"):
            return []
        if wanted.target == "bed":
            raise Refused("no_camera", "no camera has announced itself on any floor")
        report = m.CameraSearchReport(
            stamp_ns=clock_ns(), target=wanted.target, cameras=[m.CameraUse("c9", 3, 3)], lacking={}, complete=True
        )
        return Answer(report)

    with Node("fusion", "f2", building.settings) as node:
        node.serve(contract.CAMERA_SEARCH, search, fusion="f2")
        until(lambda: building.planner.alive("fusion") == {"f1", "f2"})
        yield asked_upstairs


def test_a_search_on_all_floors_is_one_of_all_fusion_services(client, gateway, upstairs) -> None:
    until(lambda: gateway.state.node.alive("fusion") == {"f1", "f2"})
    found = client.post("/api/v1/sightings", json={"target": "couch", "max_s": 2}).json()
    assert [camera["id"] for camera in found["cameras"]] == ["c1", "c9"]
    assert not found["complete"], "one of the two is lacking views"
    assert client.post("/api/v1/sightings", json={"target": "unicorn"}).status_code >= 400
    without = client.post("/api/v1/sightings", json={"target": "bed", "max_s": 2}).json()
    assert [camera["id"] for camera in without["cameras"]] == ["c1"], "that no camera is upstairs is no failure"
    below = client.post("/api/v1/sightings", json={"target": "couch", "floor": "0", "max_s": 2}).json()
    assert [camera["id"] for camera in below["cameras"]] == ["c1"]
