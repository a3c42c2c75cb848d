"""The whole way of real cameras: H.264 by RTSP, nodes that know no simulator, a mission, and what a lost stream does."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
import yaml

from surveilnav.bus.router import free_port
from surveilnav.client import Client
from surveilnav.contract import CAMERA_INFO, MAP_LAYER, OBJECTS
from surveilnav.errors import GatewayError
from surveilnav.messages import FINISHED_STATES, CameraInfo, ObjectRecord
from surveilnav.sensing.packing import unpack_array
from tests import rendered_streams
from tests.e2e.conftest import System, starting
from tests.waiting import until


@dataclass
class Streamed:
    """A system whose cameras are RTSP streams, and the server of these."""

    system: System
    server: object
    file: Path


@pytest.fixture(scope="module")
def streamed(tmp_path_factory: pytest.TempPathFactory, home_cache: Path) -> Iterator[Streamed]:
    folder = tmp_path_factory.mktemp("rtsp")
    with (
        rendered_streams.served(folder) as streams,
        starting(tmp_path_factory.mktemp("system"), home_cache) as start,
    ):
        file = folder / "cameras.yaml"
        file.write_text(streams.cameras_yaml())
        yield Streamed(
            start(cameras=1, perception="compact", cameras_file=file, lighting="baked", gateway_port=free_port()),
            streams.server,
            file,
        )


def _live(system: System, camera: str) -> CameraInfo | None:
    info: CameraInfo = system.node.ask(CAMERA_INFO, floor="0", camera=camera).message
    return info if info.stream.state == "live" else None


def objects_of_cameras(system: System) -> list[ObjectRecord]:
    found = system.node.ask(OBJECTS, floor="0").message.objects
    return [o for o in found if any(source.startswith("camera/") for source in o.sources)]


def explored_by_estimate(system: System) -> int:
    """Cells near the camera, where the robot never was, that are explored."""
    camera = system.building.plan.camera("c0-1")
    assert camera is not None
    layer = system.node.ask(MAP_LAYER, floor="0", layer="explored")
    explored = unpack_array(layer.payload, layer.message.dtype, layer.message.shape)
    rows, cols = np.nonzero(explored)
    centres = layer.message.grid.centres_of(np.stack([rows, cols], axis=-1))
    return int((np.linalg.norm(centres - camera.position_m[:2], axis=1) < 2.5).sum())


@pytest.mark.slow
def test_the_cameras_alone_say_where_something_is(streamed: Streamed) -> None:
    """This test comes before the mission: nobody but the cameras has seen anything yet."""
    s = streamed.system
    for camera in ("c0-1v8", "c0-1v2"):
        info = until(lambda camera=camera: _live(s, camera), "its stream never came to life", timeout_s=30.0)
        assert info.tier == "jpeg+depth"
    client = Client(f"http://127.0.0.1:{s.gateway_port}")
    found = client.where("television")
    assert found.target == "tv"
    assert found.complete, found
    assert {c.id: (c.views, c.lacking) for c in found.cameras} == {"c0-1v8": (1, ""), "c0-1v2": (1, "")}
    assert found.sightings
    best = found.sightings[0]
    (tv,) = s.building.scene.labelled("tv")
    tv_m = (np.asarray(tv.p_min) + np.asarray(tv.p_max)) / 2
    assert (best.label, best.room) == ("tv", "Living room")
    assert math.dist(best.position_m[:2], tv_m[:2]) < 0.6 + 2 * best.position_sigma_m
    assert best.picture is not None
    assert client.object_picture(best.floor, best.object, int(best.picture.split("/")[-1].split(".")[0])).startswith(
        b"\xff\xd8"
    )
    in_view = {room.name: room.in_view for room in found.rooms}
    assert in_view["Living room"] > 0.05
    assert in_view["Study"] == in_view["Kitchen"] == 0.0, "nobody looks there"
    with pytest.raises(GatewayError, match="no camera has announced itself on floor"):
        client.where("couch", floor="nowhere")


@pytest.mark.slow
def test_a_mission_over_streams_succeeds_and_a_camera_adds_to_its_maps(streamed: Streamed) -> None:
    s = streamed.system
    s.search("tv", mission="over-streams")
    ended = s.wait(lambda m: m.state in FINISHED_STATES, 240, "over-streams")
    assert (ended.state, ended.found) == ("done", True), ended
    until(lambda: objects_of_cameras(s), "no camera's stream gave an object", timeout_s=30.0)
    assert explored_by_estimate(s) > 100


@pytest.mark.slow
def test_the_file_of_cameras_is_edited_while_a_mission_runs(streamed: Streamed) -> None:
    """Broken, a camera turned, one removed and added again: the mission goes on, and every edit has its effect."""
    s, written, mission = streamed.system, streamed.file.read_text(), "edited"
    described = yaml.safe_load(written)
    s.search("bed", mission=mission)
    s.wait(lambda m: m.step >= 2 or m.state in FINISHED_STATES, 120, mission)

    streamed.file.write_text("cameras: [")
    until(lambda: "isn't used" in s.stack.log_of("camera-c0-1v2").read_text(), timeout_s=20.0)
    assert _live(s, "c0-1v2")
    before = s.node.ask(CAMERA_INFO, floor="0", camera="c0-1v2").message.views[0]
    described["cameras"][1]["yaw_deg"] += 10.0
    removed = described["cameras"].pop(0)
    streamed.file.write_text(yaml.safe_dump(described))
    until(lambda: (i := _live(s, "c0-1v2")) and i.views[0] != before, "it wasn't turned", timeout_s=30.0)
    process = s.stack.processes["camera-c0-1v8"]
    until(lambda: process.poll() == 1, "its camera was removed, and it runs on", timeout_s=30.0)
    assert "no camera 'c0-1v8' in" in s.stack.log_of("camera-c0-1v8").read_text()
    assert s.node.alive("camera") == {"c0-1v2"}
    described["cameras"].insert(0, removed)
    streamed.file.write_text(yaml.safe_dump(described))
    s.stack.start("camera-c0-1v8")
    until(lambda: _live(s, "c0-1v8"), "it didn't come back", timeout_s=30.0)

    ended = s.wait(lambda m: m.state in FINISHED_STATES, 240, mission)
    assert (ended.state, ended.found) == ("done", True), ended


@pytest.mark.slow
def test_a_stream_that_is_lost_is_named(streamed: Streamed) -> None:
    s = streamed.system
    streamed.server.kill()  # type: ignore[attr-defined]
    info = until(
        lambda: (
            i if (i := s.node.ask(CAMERA_INFO, floor="0", camera="c0-1v2").message).stream.state == "failed" else None
        ),
        timeout_s=60.0,
    )
    assert "refuses connections" in info.stream.reason or "ended" in info.stream.reason
