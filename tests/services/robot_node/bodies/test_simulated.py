"""A robot in a simulated building, with the building made here: 4 x 4 m of free floor."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest

from surveilnav.errors import ConfigError
from surveilnav.robot_body import CAMERA, CAMERA_HEIGHT_M, DEPTH_RANGE_M
from surveilnav.robot_state import RobotState
from surveilnav.services.robot_node.bodies.simulated import (
    SimulatedBody,
    SimulatedJudge,
    open_simulated_body,
)
from surveilnav.services.robot_node.bodies.state_file import _FORMAT
from surveilnav.services.robot_node.config import RobotSettings
from surveilnav.simulator.robot_start import start_state
from surveilnav.simulator.simulation import SimulatedBuilding, SimulationSettings
from surveilnav.simulator.world.goals import find_goals
from surveilnav.storage import write_parts


class Navigation:
    transits = ()
    floors = {"0": SimpleNamespace(z_m=0.2)}
    robot_area = {"0": np.ones((4, 4), bool)}

    def is_navigable(self, p_world, floor):
        return all(0 <= c <= 4 for c in p_world[:2])

    def way_free(self, p_from, p_to, floor):
        return 1.0

    def snap(self, p_world, floor):
        return (4.0, 4.0, 0.2)

    def random_point(self, rng, floor):
        return (*rng.uniform(0, 4, 2), 0.2)


class Building:
    navigation = Navigation()
    scene = SimpleNamespace(name="home", truth_labels={5: "bed"}, content_hash="abc")
    notes = ("robots reach 16 of 20 m²",)
    settings = SimpleNamespace(seed=3)

    def robot_view(self, T_world_camera, camera, depth_range_m, seq):
        shape = camera.height_px, camera.width_px
        return SimpleNamespace(
            rgb=np.full((*shape, 3), seq, np.uint8),
            depth_m=np.ones(shape, np.float32),
            instance_ids=np.full(shape, 5, np.uint16),
        )


def test_it_moves_by_the_rules_and_sees_where_it_stands():
    body = SimulatedBody(Building(), RobotState(1.0, 1.0, 0.2, "0", 0.0))
    assert body.notes == ["robots reach 16 of 20 m²"]
    assert body.refusal("move_forward") == ""
    assert "no stair leads" in body.refusal("take_stairs", "1")
    body.act("move_forward")
    assert (body.state.x_m, body.state.path_m, body.state.last_action) == (1.25, 0.25, "move_forward")
    observation = body.observe()
    assert observation.state is body.state
    assert (observation.rgb == 1).all(), "the noise of the picture belongs to the sequence number"
    assert (observation.T_world_camera == body.state.camera_pose()).all()
    assert (observation.camera, observation.mounting_offset_m, observation.depth_range_m) == (
        CAMERA,
        CAMERA_HEIGHT_M,
        DEPTH_RANGE_M,
    )
    truth = body.truth(1)
    assert (truth.ids == 5).all()
    assert truth.labels == {5: "bed"}
    assert (truth.T_world_camera == observation.T_world_camera).all()
    body.begin_mission("m1")
    assert (body.state.seq, body.state.path_m, body.state.last_action) == (1, 0.0, None)
    assert body.state.mission == "m1"


def test_it_knows_what_its_newest_views_show():
    body = SimulatedBody(Building(), RobotState(1.0, 1.0, 0.2, "0", 0.0))
    for _ in range(6):
        body.act("turn_left")
        body.observe()
        body.observe()
    assert [seq for seq in range(10) if body.truth(seq) is not None] == [3, 4, 5, 6]


def test_it_begins_where_it_is_told_or_anywhere_by_the_seed():
    told = start_state(Building(), "1.5, 2, 0, 90", "")
    assert (told.p_world, told.floor, told.yaw_rad) == ((1.5, 2.0, 0.2), "0", pytest.approx(math.pi / 2))
    drawn = start_state(Building(), "", "")
    assert drawn == start_state(Building(), "", "")
    assert Building.navigation.is_navigable(drawn.p_world, "0")


@pytest.mark.parametrize(
    ("start", "why"),
    [
        ("here", "a start is x,y,floor,yaw_deg such as 1.5,2.0,0,90, got 'here'"),
        ("1,1,attic,0", r"no floor 'attic' in home; it has \['0'\]"),
        ("9,9,0,0", r"can't stand at 9,9 on floor '0'; the nearest free place is \(4.0, 4.0, 0.2\)"),
    ],
)
def test_a_start_that_is_none_is_explained(start, why):
    with pytest.raises(ConfigError, match=why):
        start_state(Building(), start, "")


@pytest.fixture
def settings(tmp_path):
    """``settings(start)``: those of a robot that keeps where it stands."""
    return lambda start="1, 1, 0, 0": RobotSettings(start=start, store=str(tmp_path / "state" / "robot.state"))


def test_a_robot_that_died_stands_where_it_stood(settings):
    body = open_simulated_body(Building(), settings())
    body.act("turn_left")
    body.begin_mission("m1")
    body.act("move_forward")
    body.act("look_up")
    again = open_simulated_body(Building(), settings())
    assert again.state == body.state
    assert (again.state.seq, again.state.mission, again.state.path_m) == (3, "m1", 0.25)
    assert again.state != open_simulated_body(Building(), RobotSettings(start="1, 1, 0, 0")).state


def test_a_full_disk_stops_no_robot_and_is_told_until_there_is_room(settings, tmp_path, monkeypatch):
    def full(path, kind, parts):
        raise OSError(28, "No space left on device")

    body = open_simulated_body(Building(), settings())
    notes = list(body.notes)
    with monkeypatch.context() as disk:
        disk.setattr("surveilnav.services.robot_node.bodies.state_file.write_parts", full)
        body.act("turn_left")
        assert body.state.seq == 1
        assert [*notes, "where it stands can't be saved: [Errno 28] No space left on device"] == list(body.notes)
    body.act("turn_left")
    assert list(body.notes) == notes
    assert open_simulated_body(Building(), settings()).state == body.state


def test_what_was_told_was_kept_before(settings, monkeypatch):
    body, seen = open_simulated_body(Building(), settings()), []
    save = body._file.save
    monkeypatch.setattr(body._file, "save", lambda state: (save(state), seen.append(body.state)))
    body.act("move_forward")
    assert seen[0].seq == 0, "nobody could have asked for a state that a kill would undo"
    assert body.state.seq == 1


def _other_start(path, settings):
    return open_simulated_body(Building(), settings("3, 3, 0, 0"))


def _other_building(path, settings):
    other = Building()
    other.scene = SimpleNamespace(name="home", truth_labels={}, content_hash="def")
    return open_simulated_body(other, settings())


def _damaged(path, settings):
    path.write_bytes(path.read_bytes()[:-3] + b"abc")
    return open_simulated_body(Building(), settings())


def _other_format(path, settings):
    write_parts(path, _FORMAT, [b"\x81\xa3odd\x01"])
    return open_simulated_body(Building(), settings())


def _now_a_wall(path, settings):
    other = Building()
    other.navigation = Navigation()
    other.navigation.is_navigable = lambda p_world, floor: p_world[0] <= 1.0
    return open_simulated_body(other, settings())


@pytest.mark.parametrize("make", [_other_start, _other_building, _damaged, _other_format, _now_a_wall])
def test_a_place_that_belongs_elsewhere_is_not_taken_up(tmp_path, settings, make):
    body = open_simulated_body(Building(), settings())
    body.act("move_forward")
    path = tmp_path / "state" / "robot.state"
    assert open_simulated_body(Building(), settings()).state.seq == 1
    assert make(path, settings).state.seq == 0


def test_a_disk_that_takes_nothing_stops_no_robot(tmp_path, settings):
    (tmp_path / "state").write_text("no folder")
    body = open_simulated_body(Building(), settings())
    body.act("move_forward")
    assert body.state.seq == 1


def test_numbers_of_numpy_can_be_kept(settings):
    body = open_simulated_body(Building(), settings())
    body._enter(RobotState(np.float64(1.5), 1.0, np.float64(0.2), "0", np.float64(0.1), collided=np.True_))
    assert open_simulated_body(Building(), settings()).state.x_m == 1.5


def test_a_stop_is_judged_by_the_benchmarks_rules(home_cache, monkeypatch):
    monkeypatch.setenv("SURVEILNAV_CACHE_DIR", str(home_cache))
    building = SimulatedBuilding(SimulationSettings(building="parametric_flat"))
    judged, goals = SimulatedJudge(building), find_goals(building.scene, building.navigation, "tv")
    x_m, y_m = map(float, goals.viewpoints["0"][0])
    there = RobotState(x_m, y_m, 0.0, "0", 0.0, stopped=True)
    success, distance_m = judged("tv", there)
    assert (success, distance_m) == (True, pytest.approx(0.0, abs=0.05))
    far = max(
        np.argwhere(building.navigation.robot_area["0"]), key=lambda cell: goals.field.distance_m["0"][tuple(cell)]
    )
    x_m, y_m = building.navigation.floors["0"].grid.centres_of(far)
    success, distance_m = judged("tv", RobotState(float(x_m), float(y_m), 0.0, "0", 0.0, stopped=True))
    assert success is False
    assert distance_m > 2.0
    assert judged("something that nobody labelled", there) is None
