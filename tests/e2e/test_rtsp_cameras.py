"""The whole way of real cameras: H.264 by RTSP, nodes that know no simulator, a mission, and what a lost stream does."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from surveilnav.contract import CAMERA_INFO, OBJECTS
from surveilnav.messages import FINISHED_STATES, CameraInfo, ObjectRecord
from surveilnav.simulator.simulation import SimulatedBuilding, SimulationSettings
from tests import rendered_streams, streams
from tests.e2e.conftest import System, starting
from tests.waiting import until

VIEWS = [("c0-1", 8), ("c0-1", 2)]


@dataclass
class Streamed:
    """A system whose cameras are RTSP streams, and the server of these."""

    system: System
    server: object


@pytest.fixture(scope="module")
def streamed(tmp_path_factory: pytest.TempPathFactory, home_cache: Path) -> Iterator[Streamed]:
    folder = tmp_path_factory.mktemp("rtsp")
    building = SimulatedBuilding(SimulationSettings(building="parametric_flat", cameras=1))
    building.prepare()
    rendered_streams.write_streams(building, VIEWS, folder)
    with (
        streams.rtsp_server(folder) as (address, server),
        starting(tmp_path_factory.mktemp("system"), home_cache) as start,
    ):
        file = folder / "cameras.yaml"
        file.write_text(rendered_streams.cameras_yaml(building, VIEWS, address))
        yield Streamed(start(cameras=1, perception="compact", cameras_file=file, lighting="baked"), server)


def _live(system: System, camera: str) -> CameraInfo | None:
    info: CameraInfo = system.node.ask(CAMERA_INFO, floor="0", camera=camera).message
    return info if info.stream.state == "live" else None


def objects(system: System, label: str) -> list[ObjectRecord]:
    return [o for o in system.node.ask(OBJECTS, floor="0").message.objects if o.label == label]


@pytest.mark.slow
def test_a_mission_over_streams_succeeds_and_a_camera_saw_the_target(streamed: Streamed) -> None:
    s = streamed.system
    for camera in ("c0-1v8", "c0-1v2"):
        info = until(lambda camera=camera: _live(s, camera), "its stream never came to life", timeout_s=30.0)
        assert info.tier == "jpeg"
    s.search("tv", mission="over-streams")
    ended = s.wait(lambda m: m.state in FINISHED_STATES, 240, "over-streams")
    assert (ended.state, ended.found) == ("done", True), ended
    tvs = [o for o in objects(s, "tv") if "camera/c0-1v8" in o.sources]
    assert tvs, "the camera's stream showed the tv, too"


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
