"""The order of views of a recording: read from one, and played again."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import pytest
from mcap.writer import Writer

from benchmark.studies import live
from benchmark.studies.arrivals import Arrivals, RecordedCameras, arrivals_of
from services.recorder.core.line import bus_line
from services.recorder.reading import RecordingError
from surveilnav import messages as m
from surveilnav.contract import MAP_REVISION, MISSION_PLAN, VIEW_LOG

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


def view(number: int, source: str, index: int):
    logged = m.LoggedView(stamp_ns=1, number=number, newest=number, source=source, view=index, header=b"\xff")
    return bus_line(VIEW_LOG, "surveilnav/1/b/view_log", logged, b"", 1)


def revision(number: int, robots: dict[str, int], pending: int):
    said = m.Revision(
        stamp_ns=1, floor="0", revision=number, floor_z_m=0.0, robots=robots, cameras=[], pending_views=pending
    )
    return bus_line(MAP_REVISION, "surveilnav/1/b/map_revision/0", said, b"", 1)


def plan(seq: int, robot: str = "r1"):
    said = m.Plan(
        stamp_ns=1, mission="m", robot=robot, floor="0", step=seq + 1, seq=seq, action="stop", waypoint=None, path_m=[],
        candidates=[], why="",
    )  # fmt: skip
    return bus_line(MISSION_PLAN, "surveilnav/1/b/mission/m/plan", said, b"", 1)


def test_a_recording_says_what_came_when_and_what_the_planner_was_told_last(tmp_path):
    path = recording(
        tmp_path / "a.mcap", view(2, "robot/r1", 0), view(1, "camera/a", 3), revision(0, {}, 9), revision(2, {"r1": 0}, 7),
        plan(1, "other"), revision(3, {"r1": 0}, 6), plan(0), revision(5, {"r1": 0}, 4), revision(6, {"r1": 1, "other": 8}, 3),
    )  # fmt: skip
    found = arrivals_of(path, "r1")
    assert found.views == (("camera/a", 3), ("robot/r1", 0))
    assert found.told == {0: (3, 6), 1: (6, 3)}
    assert Arrivals.of_row(found.as_row()) == found


def test_what_is_no_recording_is_refused(tmp_path):
    (tmp_path / "a.mcap").write_text("no")
    with pytest.raises(RecordingError, match="expected a recording"):
        arrivals_of(tmp_path / "a.mcap", "r1")


def test_the_study_of_the_running_system_keeps_them_of_its_own_recording_alone(tmp_path, monkeypatch):
    folder = tmp_path / "recordings"
    folder.mkdir()
    recording(folder / "earlier.mcap", view(1, "camera/z", 0))

    def demo(command, **_):
        assert command[command.index("--runs") + 1] == str(tmp_path)
        recording(folder / "new.mcap", view(1, "robot/r1", 0), revision(1, {"r1": 0}, 2))
        return SimpleNamespace(stdout='{"success": true}')

    monkeypatch.setattr(live.subprocess, "run", demo)
    row = live.play(live.Search("a", 0, "tv", "on"), "oracle", tmp_path)
    assert Arrivals.of_row(row["arrivals"]) == Arrivals((ROBOT,), {0: (1, 2)})


class Joint:
    """Maps that count what they take."""

    def __init__(self, refused: int = -1) -> None:
        self.revision, self._refused = 0, refused

    def take(self, index: int) -> None:
        self.revision += index != self._refused


def steps_of(told: dict[int, tuple[int, int]], n: int, refused: int = -1) -> list[list[tuple[str, int]]]:
    """By step, the views that maps take; that with the number ``refused`` they leave out."""

    def named(source, index, seq=0):
        return SimpleNamespace(view=SimpleNamespace(source=source, view=index, seq=seq))

    sight = SimpleNamespace(camera=lambda name: [named(f"camera/{name}", i) for i in range(2)])
    cameras, joint, steps, index = RecordedCameras(sight, Arrivals(tuple(LOG), told)), Joint(refused), [], 0
    for seq in range(n):
        steps.append([])
        for seen in cameras.in_turn(joint, named(*ROBOT, seq), ()):
            steps[-1].append((seen.view.source, seen.view.view))
            joint.take(index)
            index += 1
        assert cameras.n_pending == told.get(seq, (0, 0))[1]
    return steps


@pytest.mark.parametrize(
    ("told", "lengths"),
    [
        ({0: (2, 4), 1: (5, 1)}, [2, 3]),  # what came after the robot's view comes at the next step
        ({0: (4, 2), 1: (5, 1)}, [4, 1]),  # what was in the maps when the planner was told comes at once
        ({0: (2, 4), 1: (6, 0)}, [2, 4]),
    ],
)
def test_views_come_in_the_order_of_the_log_as_far_as_the_maps_were(told, lengths):
    steps = steps_of(told, 2)
    assert [len(step) for step in steps] == lengths
    assert [view for step in steps for view in step] == LOG[: sum(lengths)]


def test_a_view_that_the_maps_left_out_counts_as_none():
    assert [len(step) for step in steps_of({0: (3, 2), 1: (5, 0)}, 2, refused=2)] == [4, 2]


def test_a_search_that_goes_on_beyond_the_recording_sees_with_the_robot_alone():
    assert steps_of({0: (2, 4), 1: (6, 0)}, 4)[2:] == [[ROBOT], [ROBOT]]
