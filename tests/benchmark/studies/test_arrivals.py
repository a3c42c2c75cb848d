"""The order of views of a recording: read from one, and played again."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import pytest
from mcap.writer import Writer

from surveilnav import messages as m
from surveilnav.benchmark.studies import live
from surveilnav.benchmark.studies.arrivals import Arrivals, MapsState, RecordedCameras, arrivals_of
from surveilnav.contract import MISSION_PLAN, VIEW_LOG
from surveilnav.services.recorder.core.bus_message import BusMessage
from surveilnav.services.recorder.core.mcap_message import encode_bus_message
from surveilnav.services.recorder.reading import RecordingError

ROBOT = "robot/r1", 0
LOG = [("camera/a", 0), ROBOT, ("camera/a", 1), ("camera/b", 0), ROBOT, ("camera/b", 1)]


def recording(path: Path, *lines) -> Path:
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        for i, line in enumerate(lines):
            schema = writer.register_schema(line.schema.name, "", b"")
            writer.add_message(writer.register_channel(line.topic, line.encoding, schema), i, line.data, i)
        writer.finish()
    return path


def view(number: int, source: str, index: int, fault: str = ""):
    logged = m.LoggedView(
        stamp_ns=1, number=number, newest=number, source=source, view=index, header=b"\xff", fault=fault
    )
    return encode_bus_message(BusMessage(VIEW_LOG, "surveilnav/1/b/view_log", logged, b"", 1))


def plan(seq: int, revision: int, pending: int):
    said = m.Plan(
        stamp_ns=1,
        mission="m",
        robot="r1",
        floor="0",
        step=seq + 1,
        seq=seq,
        action="stop",
        waypoint=None,
        path_m=[],
        candidates=[],
        revision=revision,
        pending_views=pending,
    )
    return encode_bus_message(BusMessage(MISSION_PLAN, "surveilnav/1/b/mission/m/plan", said, b"", 1))


def test_a_recording_says_what_came_when_and_on_what_was_decided(tmp_path):
    path = recording(
        tmp_path / "a.mcap",
        view(2, "robot/r1", 0),
        view(1, "camera/a", 3),
        plan(0, 2, 7),
        view(3, "camera/a", 4, fault="torn"),
        plan(1, 2, 6),
        plan(1, 5, 3),
    )
    found = arrivals_of(path)
    assert found.views == (("camera/a", 3), ("robot/r1", 0))
    assert found.decided_on == {0: MapsState(2, 7), 1: MapsState(5, 3)}  # asked again, the planner looked again
    assert Arrivals.from_row(found.to_row()) == found


@pytest.mark.parametrize(
    "lines",
    [
        [view(2, "robot/r1", 0), plan(0, 1, 0)],
        [view(1, "robot/r1", 0)],
        [plan(0, 1, 0), view(1, "a", 0), view(3, "a", 1)],
    ],
)
def test_a_recording_that_lacks_views_or_decisions_is_refused(tmp_path, lines):
    with pytest.raises(RecordingError, match="expected all views from the first on"):
        arrivals_of(recording(tmp_path / "a.mcap", *lines))


def test_what_is_no_recording_is_refused(tmp_path):
    (tmp_path / "a.mcap").write_text("no")
    with pytest.raises(RecordingError, match="expected a recording"):
        arrivals_of(tmp_path / "a.mcap")


@pytest.mark.parametrize("whole", [True, False])
def test_the_study_of_the_running_system_keeps_them_of_its_own_recording_alone(tmp_path, monkeypatch, whole):
    folder = tmp_path / "recordings"
    folder.mkdir()
    recording(folder / "earlier.mcap", view(1, "camera/z", 0), plan(0, 9, 9))

    def demo(command, **_):
        assert command[command.index("--runs") + 1] == str(tmp_path)
        recording(folder / "new.mcap", view(1 if whole else 2, "robot/r1", 0), plan(0, 1, 2))
        return SimpleNamespace(stdout='{"success": true}')

    monkeypatch.setattr(live.subprocess, "run", demo)
    row = live.play(live.Search("a", 0, "tv", "on"), "oracle", tmp_path)
    assert row.get("arrivals") == (Arrivals((ROBOT,), {0: MapsState(1, 2)}).to_row() if whole else None)


class Joint:
    """Maps that count what they take."""

    def __init__(self, refused: int = -1) -> None:
        self.revision, self._refused = 0, refused

    def take(self, index: int) -> None:
        self.revision += index != self._refused


def steps_of(decided_on: dict[int, tuple[int, int]], n: int, refused: int = -1) -> list[list[tuple[str, int]]]:
    """By step, the views that maps take; that with the number ``refused`` they leave out."""

    def named(source, index, seq=0):
        return SimpleNamespace(view=SimpleNamespace(source=source, view=index, seq=seq))

    states = {seq: MapsState(*state) for seq, state in decided_on.items()}
    sight = SimpleNamespace(camera=lambda name: [named(f"camera/{name}", i) for i in range(2)])
    cameras, joint, steps, index = RecordedCameras(sight, Arrivals(tuple(LOG), states)), Joint(refused), [], 0
    for seq in range(n):
        steps.append([])
        for seen in cameras.in_turn(joint, named(*ROBOT, seq), ()):
            steps[-1].append((seen.view.source, seen.view.view))
            joint.take(index)
            index += 1
        assert cameras.n_pending == decided_on.get(seq, (0, 0))[1]
    return steps


@pytest.mark.parametrize(
    ("decided_on", "lengths"),
    [
        ({0: (2, 4), 1: (5, 1)}, [2, 3]),  # what came after the robot's view comes at the next step
        ({0: (4, 2), 1: (5, 1)}, [4, 1]),  # what was in the maps when the planner was told comes at once
        ({0: (2, 4), 1: (6, 0)}, [2, 4]),
    ],
)
def test_views_come_in_the_order_of_the_log_as_far_as_the_maps_were(decided_on, lengths):
    steps = steps_of(decided_on, 2)
    assert [len(step) for step in steps] == lengths
    assert [view for step in steps for view in step] == LOG[: sum(lengths)]


def test_a_view_that_the_maps_left_out_counts_as_none():
    assert [len(step) for step in steps_of({0: (3, 2), 1: (5, 0)}, 2, refused=2)] == [4, 2]


def test_a_search_that_goes_on_beyond_the_recording_sees_with_the_robot_alone():
    assert steps_of({0: (2, 4), 1: (6, 0)}, 4)[2:] == [[ROBOT], [ROBOT]]


def test_an_observation_that_the_robot_says_again_takes_no_view_of_the_next_step():
    sight = SimpleNamespace(camera=lambda name: [])
    robot = SimpleNamespace(view=SimpleNamespace(source=ROBOT[0], view=0, seq=0))
    cameras = RecordedCameras(sight, Arrivals((ROBOT, ROBOT, ROBOT), {}))
    for seq in (0, 1, 1, 2):
        robot.view.seq = seq
        assert list(cameras.in_turn(Joint(), robot, ())) == [robot]
        assert len(cameras._log) == 2 - seq
