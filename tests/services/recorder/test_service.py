"""The recorder on a real bus, beside a fusion and a planner that are fakes: what it records, and what it never asks for."""

from __future__ import annotations

from collections.abc import Iterator

import msgspec
import pytest

from surveilnav import contract
from surveilnav import messages as m
from surveilnav.bus import Answer, BusSettings, Node, Refused, Request, clock_ns
from surveilnav.bus.router import free_port, open_router
from surveilnav.contract import VIEW_LOG
from surveilnav.messages import MissionStatus
from surveilnav.services.recorder.file import RecordingFile
from surveilnav.services.recorder.recorded import (
    RecordedEnd,
    RecordedMaps,
    RecordedMessage,
    RecordedStart,
    read_recording,
)
from surveilnav.services.recorder.service import RecorderService
from tests.waiting import until


class Fakes:
    """Fusion with a log of views, and a planner, on one bus."""

    def __init__(self, router: str, tools) -> None:
        self.bus, self.tools = BusSettings(router=router), tools
        self.fusion, self.planner, self.camera = (Node(k, k, self.bus) for k in ("fusion", "planner", "camera"))
        self.log: list[int] = []
        self.snapshot, self.held, self.asked, self.told = b"the maps", True, 0, 0
        self.mapped, self.removals = True, 0

    def __enter__(self) -> Fakes:
        for node in (self.fusion, self.planner, self.camera):
            node.__enter__()
        self.fusion.serve(contract.VIEW_LOG, self._view)
        self.fusion.serve(contract.MAP_SNAPSHOT, self._snapshot)
        self.revision = self.fusion.publisher(contract.MAP_REVISION, floor="0")
        self.frames = self.camera.publisher(contract.CAMERA_FRAME, floor="0", camera="c1", view=0)
        self.statuses = {}
        return self

    def __exit__(self, *_: object) -> None:
        for node in (self.fusion, self.planner, self.camera):
            node.__exit__(None, None, None)

    def _view(self, request: Request) -> Answer:
        if not self.held:
            raise Refused("store_down", "no disk")
        after = int(request.parameters["after"])
        newest = max(self.log, default=0)
        later = [n for n in self.log if n > after]
        if not later:
            return Answer(m.LoggedView(stamp_ns=1, number=0, newest=newest, removals=self.removals))
        view, payload = self.tools.logged(later[0])
        self.told += 1
        return Answer(msgspec.structs.replace(view, newest=newest, removals=self.removals), payload)

    def _snapshot(self, request: Request) -> Answer:
        self.asked += 1
        if not self.mapped:
            raise Refused("too_large", "maps that no message holds")
        number, said = max(self.log, default=0), request.parameters
        digest = f"digest-{number}" + (f"-{self.removals}" if self.removals else "")
        header = m.MapSnapshot(
            stamp_ns=1, number=number, revision=number, digest=digest, config="{}", removals=self.removals
        )
        if said.get("only") == "digest":
            return Answer(header)
        offset = int(said.get("offset", "0"))
        header = msgspec.structs.replace(header, offset=offset, n_bytes=len(self.snapshot))
        return Answer(header, self.snapshot[offset : offset + 5])

    def put_revision(self) -> None:
        self.revision.put(
            m.Revision(
                stamp_ns=clock_ns(),
                floor="0",
                revision=len(self.log),
                floor_z_m=0.0,
                robots={},
                cameras=[],
                pending_views=0,
            )
        )

    def put_status(self, mission: str, state: str, step: int = 0) -> None:
        if mission not in self.statuses:
            self.statuses[mission] = self.planner.publisher(contract.MISSION_STATUS, mission=mission)
        status = MissionStatus(
            stamp_ns=clock_ns(),
            mission=mission,
            target="tv",
            robot="r1",
            state=state,
            phase="exploring",
            step=step,
            max_steps=9,
            path_m=1.0,
            started_ns=1,
        )
        self.statuses[mission].put(status)


@pytest.fixture
def bus(tools) -> Iterator[Fakes]:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with open_router(endpoint), Fakes(endpoint, tools) as fakes:
        yield fakes


class Running:
    """A recorder whose loop the test turns."""

    def __init__(self, fakes: Fakes, folder, tools, **more) -> None:
        self.folder, self.tools = folder, tools
        self.node = Node("recorder", "recorder", fakes.bus)
        self.node.__enter__()
        self.service = RecorderService(self.node, tools.settings(folder, flush_s=0.05, **more))

    def turn_until(self, condition) -> None:
        def met() -> bool:
            self.service.step()
            return bool(condition())

        until(met)

    def close(self) -> None:
        self.service.close()
        self.node.__exit__(None, None, None)

    def states(self) -> dict[str, str]:
        return {r.mission: r.state for r in self.service._folder.recordings()}

    def items(self) -> list[object]:
        (path,) = self.folder.glob("*.mcap")
        return list(read_recording(path))

    def views(self) -> list[int]:
        return [t.message.number for t in self.items() if isinstance(t, RecordedMessage) and t.stream is VIEW_LOG]


@pytest.fixture
def recorder(bus, tmp_path, tools) -> Iterator[Running]:
    running = Running(bus, tmp_path, tools)
    yield running
    running.close()


def test_missions_that_begin_together_have_fusion_write_its_maps_once(bus, recorder):
    bus.log = [1, 2, 3]
    bus.snapshot = b"maps"  # one part
    bus.put_status("m1", "active")
    bus.put_status("m2", "active")
    heard = recorder.service._tables[contract.MISSION_STATUS]
    until(lambda: len(heard.rows()) == 2)  # before the loop turns
    recorder.turn_until(lambda: len(recorder.states()) == 2 and bus.asked)
    bus.log += [4]
    bus.put_status("m1", "done", step=3)
    bus.put_status("m2", "done", step=3)
    asked = bus.asked
    recorder.turn_until(lambda: recorder.states() == {"m1": "complete", "m2": "complete"})
    maps = [t for path in recorder.folder.glob("*.mcap") for t in read_recording(path) if isinstance(t, RecordedMaps)]
    assert (asked, [t.snapshot for t in maps]) == (1, [b"maps"] * 2)


def test_it_says_how_it_is_while_fusion_keeps_it_waiting(bus, recorder):
    statuses = bus.planner.table(contract.RECORDER_STATUS)
    bus.put_status("m1", "active")
    recorder.turn_until(lambda: bus.asked)
    before = clock_ns()  # from here on nobody turns the loop
    until(lambda: any(row.message.stamp_ns > before for row in statuses.rows()))


def test_a_mission_is_recorded_from_its_maps_to_its_end(bus, recorder):
    bus.log = [1, 2, 3]
    bus.put_status("m1", "queued")
    bus.put_status("m1", "active")
    recorder.turn_until(lambda: recorder.states() == {"m1": "recording"} and bus.asked >= 2)
    bus.log += [4, 5, 6]
    bus.put_revision()
    recorder.turn_until(lambda: recorder.views() == [4, 5, 6])
    bus.put_status("m2", "done")  # another's end
    bus.log += [7]
    bus.put_status("m1", "done", step=3)
    recorder.turn_until(lambda: recorder.states() == {"m1": "complete"})
    begin, end = recorder.items()[0], recorder.items()[-1]
    assert isinstance(begin, RecordedStart)
    assert (begin.facts["mission"], begin.facts["target"], begin.facts["building"]) == ("m1", "tv", "building")
    assert isinstance(end, RecordedEnd)
    assert end.facts == {"state": "done", "found": "false", "number": "7", "revision": "7", "digest": "digest-7"}
    assert [(t.number, t.snapshot) for t in recorder.items() if isinstance(t, RecordedMaps)] == [(3, b"the maps")]
    assert recorder.views() == [4, 5, 6, 7]
    statuses = [
        t.message for t in recorder.items() if isinstance(t, RecordedMessage) and t.stream is contract.MISSION_STATUS
    ]
    assert [s.state for s in statuses] == ["active", "done"]


def test_no_camera_has_a_listener_more(bus, recorder):
    bus.put_status("m1", "active")
    recorder.turn_until(lambda: recorder.states() == {"m1": "recording"})
    bus.log = [1]
    bus.put_revision()
    recorder.turn_until(lambda: recorder.views() == [1])
    assert not bus.frames.matched
    assert not bus.camera.publisher(contract.ROBOT_OBSERVATION, robot="r1").matched


def test_what_is_put_is_there_as_it_was_put(bus, recorder, tools):
    status = tools.status_message(4).message
    bus.camera.publisher(contract.ROBOT_STATUS, robot="r1").put(status)
    bus.put_status("m1", "active")
    recorder.turn_until(lambda: recorder.states() == {"m1": "recording"})
    later = msgspec.structs.replace(status, seq=5)
    bus.camera.publisher(contract.ROBOT_STATUS, robot="r1").put(later)

    def heard():
        return [
            t.message for t in recorder.items() if isinstance(t, RecordedMessage) and t.stream is contract.ROBOT_STATUS
        ]

    recorder.turn_until(lambda: later in heard())
    assert heard()[0] == status, "what was put before the mission began"


def test_views_that_are_lost_are_made_good_by_new_maps(bus, recorder):
    bus.put_status("m1", "active")
    recorder.turn_until(lambda: recorder.states() == {"m1": "recording"} and bus.asked >= 2)
    bus.log = [7, 8]  # 1 to 6 went while nobody asked
    recorder.turn_until(lambda: len([t for t in recorder.items() if isinstance(t, RecordedMaps)]) == 2)
    bus.log += [9]
    recorder.turn_until(lambda: recorder.views() == [9])
    bus.log = [1]  # fusion began anew
    recorder.turn_until(lambda: len([t for t in recorder.items() if isinstance(t, RecordedMaps)]) == 3)


@pytest.mark.parametrize("when", ["in between", "at the end"])
def test_after_a_source_was_taken_out_of_the_maps_a_recording_goes_on_from_the_new_maps(bus, recorder, when):
    bus.log = [1, 2]
    bus.put_status("m1", "active")
    recorder.turn_until(lambda: bus.asked >= 1)
    bus.log += [3]
    recorder.turn_until(lambda: bus.told == 1)
    bus.removals = 1
    if when == "in between":
        recorder.turn_until(lambda: bus.asked >= 2)
        bus.log += [4]
        recorder.turn_until(lambda: bus.told == 2)
    bus.put_status("m1", "done")
    recorder.turn_until(lambda: recorder.states() == {"m1": "complete"})
    number = max(bus.log)
    assert [t.number for t in recorder.items() if isinstance(t, RecordedMaps)] == [2, 3]
    (end,) = [t for t in recorder.items() if isinstance(t, RecordedEnd)]
    assert end.facts["digest"] == f"digest-{number}-1"


def test_while_fusion_is_away_all_else_is_recorded_and_it_is_said(bus, recorder):
    bus.log = [1]
    bus.put_status("m1", "active")
    recorder.turn_until(lambda: recorder.states() == {"m1": "recording"} and bus.asked >= 2)
    bus.held, bus.log = False, [1, 2]
    recorder.turn_until(lambda: "no disk" in recorder.service.status.status().problem)
    bus.put_status("m1", "active", step=4)
    recorder.turn_until(lambda: any(getattr(getattr(t, "message", None), "step", 0) == 4 for t in recorder.items()))
    bus.held = True
    recorder.turn_until(lambda: recorder.views() == [2])
    assert recorder.service.status.status().problem == ""


def test_maps_that_cant_be_had_for_a_new_recording_cost_no_other_its_views(bus, recorder):
    bus.log = [1]
    bus.put_status("m1", "active")
    recorder.turn_until(lambda: recorder.states() == {"m1": "recording"} and bus.asked >= 2)
    bus.mapped = False
    bus.put_status("m2", "active")
    recorder.turn_until(lambda: "no message holds" in recorder.service.status.status().problem)
    bus.log = [1, 2]
    (path,) = recorder.folder.glob("*_m1.mcap")
    recorder.turn_until(
        lambda: any(isinstance(t, RecordedMessage) and t.stream is VIEW_LOG for t in read_recording(path))
    )


def test_two_missions_at_once_have_a_file_each(bus, recorder):
    for mission in ("m1", "m2"):
        bus.put_status(mission, "active")
    recorder.turn_until(lambda: recorder.states() == {"m1": "recording", "m2": "recording"})
    bus.log = [1]
    bus.put_status("m1", "cancelled")
    recorder.turn_until(lambda: recorder.states() == {"m1": "complete", "m2": "recording"})
    missions = {}
    for path in recorder.folder.glob("*.mcap"):
        heard = [t for t in read_recording(path) if isinstance(t, RecordedMessage)]
        assert [t.message.number for t in heard if t.stream is VIEW_LOG] == [1]
        missions[path.stem[-2:]] = {t.ids["mission"] for t in heard if "mission" in t.ids}
    assert missions == {"m1": {"m1"}, "m2": {"m2"}}


def test_the_bus_hands_out_recordings_and_deletes_them(bus, recorder, tools):
    bus.put_status("m1", "active")
    recorder.turn_until(lambda: recorder.states() == {"m1": "recording"})
    ask = bus.planner.ask
    told = ask(contract.RECORDINGS, recorder="recorder").message.recordings
    assert [(r.mission, r.state, r.target) for r in told] == [("m1", "recording", "tv")]
    removal = m.RecordingRemoval(stamp_ns=1, id=told[0].id)
    with pytest.raises(Refused, match="being written"):
        ask(contract.RECORDING_DELETE, removal, recorder="recorder")
    bus.put_status("m1", "done")
    recorder.turn_until(lambda: recorder.states() == {"m1": "complete"})
    (path,) = recorder.folder.glob("*.mcap")
    part = ask(
        contract.RECORDING_READ, m.RecordingPart(stamp_ns=1, id=path.stem, offset=3, n_bytes=20), recorder="recorder"
    )
    assert part.payload == path.read_bytes()[3:23]
    assert (part.message.n_bytes, part.message.total_bytes) == (20, path.stat().st_size)
    with pytest.raises(Refused, match="recording's id"):
        ask(contract.RECORDING_READ, m.RecordingPart(stamp_ns=1, id="../../etc/passwd", n_bytes=9), recorder="recorder")
    size = path.stat().st_size
    recorder.turn_until(lambda: ask(contract.RECORDER_STATUS, recorder="recorder").message.n_bytes == size)
    ask(contract.RECORDING_DELETE, removal, recorder="recorder")
    assert list(recorder.folder.glob("*.mcap")) == []


def test_a_recording_that_the_disk_refuses_asks_for_nothing_more_and_the_next_is_made(bus, recorder, monkeypatch):
    monkeypatch.setattr(RecordingFile, "flush", lambda self: (_ for _ in ()).throw(OSError("the disk is full")))
    bus.put_status("m1", "active")
    recorder.turn_until(lambda: "disk is full" in recorder.service.status.status().problem)
    monkeypatch.undo()
    asked, bus.log = bus.asked, [1, 2]
    bus.put_revision()
    bus.put_status("m1", "done")
    recorder.turn_until(lambda: recorder.service.status.status().problem == "" and not recorder.service._recorded)
    assert bus.asked == asked
    assert bus.told == 0
    bus.put_status("m2", "active")
    recorder.turn_until(lambda: recorder.states().get("m2") == "recording")
