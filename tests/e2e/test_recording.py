"""A search is recorded, survives the recorder's death, and comes out of its file again: the same maps, bit for bit."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from surveilnav.bus.router import free_port
from surveilnav.cli.replay.check import check
from surveilnav.contract import RECORDINGS, VIEW_LOG
from surveilnav.messages import FINISHED_STATES
from surveilnav.services.recorder.recorded import RecordedMessage, read_recording
from tests.e2e.conftest import System, frame_bytes, starting
from tests.waiting import until

pytestmark = pytest.mark.slow
_LAYERS = ("occupancy", "explored", "frontier", "value")


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory, home_cache: Path) -> Iterator[System]:
    """A flat with a camera, a recorder and a gateway."""
    with starting(tmp_path_factory.mktemp("recorded"), home_cache) as start:
        yield start(cameras=1, perception="simulated", gateway_port=free_port(), recorder=True)


def files(s: System, mission: str) -> dict[Path, str]:
    """A mission's recordings and their states, the oldest first."""
    folder = Path(s.stack.environment["SURVEILNAV_RECORDER__FOLDER"])
    rows = [r for told in s.node.ask_all(RECORDINGS) for r in told.message.recordings if r.mission == mission]
    return {folder / f"{r.id}.mcap": r.state for r in sorted(rows, key=lambda r: r.id)}


def steps_in(path: Path) -> int:
    """The last step that a recording knows of."""
    heard = (t for t in read_recording(path) if isinstance(t, RecordedMessage) and t.stream.name == "mission_status")
    return max((t.message.step for t in heard), default=0)


def layers_of(port: int) -> dict[str, bytes]:
    url = f"http://127.0.0.1:{port}/api/v1/floors/0/layers"
    return {name: httpx.get(f"{url}/{name}.npy?target=tv", timeout=20).raise_for_status().content for name in _LAYERS}


@pytest.fixture(scope="module")
def searched(recorded: System) -> Path:
    """The recording of a search that ended."""
    recorded.search("tv", mission="whole", max_steps=60)
    recorded.wait(lambda m: m.state in FINISHED_STATES, 200, "whole")
    until(lambda: list(files(recorded, "whole").values()) == ["complete"], lambda: files(recorded, "whole"), 40.0)
    return next(iter(files(recorded, "whole")))


def test_a_reader_of_mcap_has_all_channels(searched):
    with searched.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
        summary = reader.get_summary()
        counts = {c.topic: summary.statistics.channel_message_counts.get(c.id, 0) for c in summary.channels.values()}
        drawn = [t for t in counts if t.startswith("/")]
        decoded = {channel.topic for _, channel, _, _ in reader.iter_decoded_messages(topics=drawn)}
    assert all(counts.values())
    assert decoded == set(drawn)
    assert {
        "/tf",
        "/robot/r1/picture",
        "/robot/r1/calibration",
        "/robot/r1/pose",
        "/camera/c0-1/view_0/picture",
        "/cameras",
        "/objects/0",
        "/plan",
        "/decisions",
        "/map/0/occupancy",
        "/map/0/explored",
        "/map/0/frontier",
        "/map/0/value",
        "/map/0/cloud",
    } <= set(drawn)
    ours = {t.removeprefix("surveilnav/1/parametric_flat/") for t in counts if not t.startswith("/")}
    assert {
        "view_log",
        "map_revision/0",
        "0/camera/c0-1/info",
        "robot/r1/status",
        "mission/whole/status",
        "mission/whole/plan",
        "perception/perception-1/load",
        "perception/perception-1/text",
        "traffic/fusion-fusion",
    } <= ours


def test_its_maps_come_out_again_bit_for_bit(searched):
    outcome = check(searched)
    assert outcome.views > 20
    assert outcome.recorded
    assert outcome.same


def test_the_camera_sent_each_view_once_to_fusion_alone(recorded, searched):
    report = recorded.traffic("camera", "c0-1")
    frames = {row.key: row.messages for row in report.rows if "/frame/" in row.key and row.direction == "offered"}
    views = {
        f"{t.message.source}/{t.message.view}"
        for t in read_recording(searched)
        if isinstance(t, RecordedMessage) and t.stream is VIEW_LOG
    }
    assert set(frames.values()) == {1}
    assert len(frames) == len([v for v in views if v.startswith("camera/")]) == 13
    assert frame_bytes(report)
    heard = recorded.traffic("recorder", "recorder").rows
    assert not [row.key for row in heard if "/frame/" in row.key or row.key.endswith("/observation")]


def test_what_was_put_is_in_it_as_often_as_it_was_put(searched):
    heard = [t for t in read_recording(searched) if isinstance(t, RecordedMessage)]
    numbers = [t.message.number for t in heard if t.stream is VIEW_LOG]
    assert numbers == list(range(numbers[0], numbers[0] + len(numbers)))
    steps = [t.message.step for t in heard if t.stream.name == "mission_plan"]
    assert steps == sorted(set(steps))
    assert len(steps) >= 5


def _goes_back_and_forth(port: int, end: dict[str, bytes]) -> None:
    """A replay at its end is taken to its middle, where less was known, and to its end again."""
    url = f"http://127.0.0.1:{port}/api/v1"
    whole_s = httpx.get(f"{url}/replay").json()["duration_s"]

    def go_to(moment_s: float) -> None:
        httpx.patch(f"{url}/replay", json={"at_s": moment_s, "playing": False}, timeout=20).raise_for_status()

    def mission() -> str:
        return next((str(m["state"]) for m in httpx.get(f"{url}/missions").json()["items"]), "none")

    go_to(whole_s / 2)
    until(lambda: mission() == "active", mission, 60.0)
    until(lambda: layers_of(port)["explored"] != end["explored"], "the maps know their future", 60.0)
    assert httpx.get(f"{url}/replay").json()["at_s"] == pytest.approx(whole_s / 2)
    go_to(whole_s)
    until(lambda: mission() in FINISHED_STATES, mission, 60.0)
    until(lambda: layers_of(port) == end, "the maps aren't the same", 60.0)


def test_it_is_shown_again_by_the_gateway_with_the_same_maps(recorded, searched):
    before = layers_of(recorded.gateway_port)
    port = free_port()
    command = [
        sys.executable,
        "-m",
        "surveilnav.cli.main",
        "replay",
        str(searched),
        "--speed",
        "20",
        "--port",
        str(port),
    ]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True, env=os.environ | {"PYTHONPATH": os.getcwd()})
    try:
        url = f"http://127.0.0.1:{port}/api/v1"

        def ended() -> bool:
            assert process.poll() is None, process.stderr.read()
            try:
                missions = httpx.get(f"{url}/missions").json()["items"]
            except httpx.HTTPError:
                return False
            return bool(missions) and missions[0]["state"] in FINISHED_STATES

        until(ended, "the replay never came to its end", 90.0)
        until(lambda: layers_of(port) == before, "the maps aren't the same", 60.0)
        assert httpx.get(f"http://127.0.0.1:{port}/readyz").status_code == 200
        assert httpx.get(f"{url}/robots").json()["items"][0]["id"] == "r1"
        assert httpx.get(f"{url}/cameras/c0-1/latest.jpg").content[:2] == b"\xff\xd8"
        for path, body in (("missions", {"target": "bed"}), ("robots/stop", {"reason": ""})):
            refused = httpx.post(f"{url}/{path}", json=body)
            assert (refused.status_code, refused.json()["type"].rpartition(":")[2]) == (409, "replay"), path
        _goes_back_and_forth(port, before)
    finally:
        process.send_signal(signal.SIGINT)
        assert process.wait(20) == 0


def test_the_recorder_may_be_killed_at_any_moment(recorded):
    s = recorded
    s.search("bed", mission="killed", max_steps=40)
    s.wait(lambda m: m.step >= 4, 120, "killed")
    until(lambda: steps_in(next(iter(files(s, "killed")))) >= 3, "what happened isn't on the disk", 30.0)
    s.kill("recorder")
    at = s.wait(lambda m: True, 10, "killed").step
    s.wait(lambda m: m.step >= at + 2 or m.state in FINISHED_STATES, 60, "killed")
    s.stack.start("recorder")
    s.wait(lambda m: m.state in FINISHED_STATES, 200, "killed")
    until(lambda: "complete" in files(s, "killed").values(), lambda: files(s, "killed"), 40.0)
    (first, second), states = files(s, "killed"), list(files(s, "killed").values())
    assert states == ["interrupted", "complete"]
    assert steps_in(first) >= 3
    cut_off = check(first)
    assert (cut_off.recorded, cut_off.same) == ("", False)
    assert check(second).same


def test_fusion_may_be_killed_and_the_recording_stays_whole(recorded):
    s = recorded
    s.search("toilet", mission="fusion-dies", max_steps=30)
    s.wait(lambda m: m.step >= 4, 120, "fusion-dies")
    s.kill("fusion")
    s.stack.start("fusion")
    s.wait(lambda m: m.state in FINISHED_STATES, 200, "fusion-dies")
    until(
        lambda: list(files(s, "fusion-dies").values()) == ["complete"], lambda: files(s, "fusion-dies"), timeout_s=40.0
    )
    outcome = check(next(iter(files(s, "fusion-dies"))))
    assert outcome.recorded
    assert outcome.same
