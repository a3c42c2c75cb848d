"""When the robot leaves a floor, in rooms of which everything is known: a table for each rule."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from surveilnav.geometry import Grid
from surveilnav.messages import Stair
from surveilnav.services.planner.core import FloorMaps, FloorMemory, MissionState, PlannerConfig, RobotView, step
from surveilnav.services.planner.core.memory.floor_memory import DismissedObject
from surveilnav.services.planner.core.motion.areas import Area

CONFIG = PlannerConfig(second_look_m=None)
GRID = Grid(0.0, 0.0, 0.05, 300, 400)
SCANNED = FloorMemory(scan_turns_left=0, scan_places=[(2.5, 2.5)])


def maps(objects=(), *, room=None, frontier=False, areas=()):
    """All is explored: the whole grid, or a room (x0, y0, x1, y1) [m] of it with walls and a door in the east."""
    explored, occupancy, edge = (np.zeros(GRID.shape, np.uint8) for _ in range(3))
    if room is None:
        explored[:] = 1
    else:
        col0, row0, col1, row1 = (round(v / GRID.resolution_m) for v in room)
        explored[row0:row1, col0:col1] = occupancy[row0:row1, col0:col1] = 1
        occupancy[row0 + 2 : row1 - 2, col0 + 2 : col1 - 2] = 0
        occupancy[(row0 + row1) // 2 - 10 : (row0 + row1) // 2 + 10, col0:col1] = 0
        occupancy[row0:row1, col0 : col0 + 2] = 1
    if frontier:
        explored[:, 300:], edge[2:-2, 299] = 0, 1
    value = np.full(GRID.shape, np.nan, np.float32)
    return FloorMaps("0", 0.0, GRID, occupancy, explored, edge, value, list(objects), 1, areas=areas)


def robot(x_m, y_m, stairs_at):
    stairs = Stair(floor="0", at_m=(*stairs_at, 0.0), to_floor="1", to_m=(*stairs_at, 3.0), length_m=4.0)
    return RobotView(0, x_m, y_m, 0.0, 0.0, "0", False, None, 0.0, (stairs,))


def test_a_floor_isnt_left_before_the_robot_has_looked_around_on_it():
    """Cameras saw all of it, and not the chair; nothing is left to explore. The robot looks around before it goes upstairs."""
    decision = step(MissionState("chair", floor="0"), maps(), robot(2.0, 2.0, (4.0, 2.0)), CONFIG)[1]
    assert decision.phase == "scanning"
    left = step(MissionState("chair", floor="0", floors={"0": SCANNED}), maps(), robot(2.0, 2.0, (4.0, 2.0)), CONFIG)
    assert left[1].phase == "changing floor"
    assert left[0].here.is_searched


@pytest.mark.parametrize("closed", [True, False])
def test_stairs_that_nobody_saw_are_behind_a_closed_door(closed):
    """A small room; the stairs are 8 m beyond what is known."""
    door = Area("door d", "closed", ((3.95, 1.9), (4.2, 1.9), (4.2, 3.1), (3.95, 3.1)), "d")
    state = MissionState("chair", floor="0", floors={"0": SCANNED})
    known = maps(room=(0.9, 0.9, 4.1, 4.1), areas=(door,) if closed else ())
    decision = step(state, known, robot(2.5, 2.5, (12.0, 2.5)), CONFIG)[1]
    if closed:
        assert (decision.phase, decision.waits_for) == ("waiting", ("d",))
        assert "the way to floor 1" in decision.message
    else:
        assert decision.phase == "changing floor"


@pytest.mark.parametrize("walked_m", [0, 30, 60, 100])
@pytest.mark.parametrize(
    ("status", "confidence", "away_m"), [("confirmed", 0.7, 12.0), ("confirmed", 0.55, 3.0), ("candidate", 0.4, 7.0)]
)
def test_stairs_never_come_before_a_confirmed_target_nor_at_first_before_a_promising_one(
    make_record, walked_m, status, confidence, away_m
):
    """However long the robot has searched here in vain, and whatever the cameras of the other floor say."""
    record = make_record(at=(2.0 + away_m, 2.0), status=status, confidence=confidence, n_detections=3)
    visited = [(2.0 + 0.25 * (i % 2), 2.0) for i in range(4 * walked_m)]
    memory = FloorMemory(scan_turns_left=0, visited=visited)
    state, here = MissionState("chair", floor="0", floors={"0": memory}), robot(2.0, 2.0, (2.0, 6.0))
    for _ in range(3):
        summaries = {"0": {"chair": confidence}, "1": {"chair": 0.95}}
        state, decision = step(state, maps([record], frontier=True), here, PlannerConfig(), summaries=summaries)
        assert decision.object_id == record.id


@pytest.mark.parametrize(("chance_here", "goes"), [(0.6, False), (0.32, True)])
def test_the_last_resort_is_the_likeliest_of_all_floors(make_record, chance_here, goes):
    """On floor 1 an object of .35 is left; here one that the robot looked at and dismissed, though it takes it for the target."""
    record = make_record(at=(3.5, 2.5), confidence=chance_here, label_robot="chair", n_detections=6)
    here = replace(SCANNED, visits=1, dismissed={record.id: DismissedObject(3.5, 2.5, "not confirmed")})
    above = FloorMemory(scan_turns_left=0, visits=1, is_searched=True, best_remaining_chance=0.35)
    state = MissionState("chair", floor="0", floors={"0": here, "1": above})
    after, decision = step(state, maps([record]), robot(2.5, 2.5, (0.7, 0.7)), CONFIG)
    assert (decision.phase == "changing floor") == goes
    assert (after.here.accepted_object == record.id) != goes
