"""A robot in a simulated building, with the building made here: 4 x 4 m of free floor."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest

from services.robot_node import core
from services.robot_node.bodies.simulated import SimulatedBody, start_state
from services.robot_node.config import RobotSettings
from surveilnav.errors import ConfigError


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
    scene = SimpleNamespace(name="home", truth_labels={5: "bed"})
    reach = SimpleNamespace(sentence="robots reach 16 of 20 m²")
    settings = SimpleNamespace(seed=3)

    def robot_view(self, T_world_camera, camera, depth_range_m, seq):
        shape = camera.height_px, camera.width_px
        return SimpleNamespace(
            rgb=np.full((*shape, 3), seq, np.uint8), depth_m=np.ones(shape, np.float32),
            instance_ids=np.full(shape, 5, np.uint16),
        )  # fmt: skip


def test_it_moves_by_the_core_and_sees_where_it_stands():
    body = SimulatedBody(Building(), core.RobotState(1.0, 1.0, 0.2, "0", 0.0))
    assert body.notes == ["robots reach 16 of 20 m²"]
    assert body.refusal("move_forward") == ""
    assert "no stair leads" in body.refusal("take_stairs", "1")
    body.act("move_forward")
    assert (body.state.x_m, body.state.path_m, body.state.last_action) == (1.25, 0.25, "move_forward")
    look = body.observe()
    assert look.state is body.state
    assert (look.rgb == 1).all(), "the noise of the picture belongs to the sequence number"
    assert (look.T_world_camera == core.camera_pose_of(body.state)).all()
    assert (look.camera, look.mounting_offset_m, look.depth_range_m) == (
        core.CAMERA, core.CAMERA_HEIGHT_M, core.DEPTH_RANGE_M,
    )  # fmt: skip
    assert (look.truth.ids == 5).all()
    assert look.truth.labels == {5: "bed"}
    assert (look.truth.T_world_camera == look.T_world_camera).all()
    body.begin_mission()
    assert (body.state.seq, body.state.path_m, body.state.last_action) == (1, 0.0, None)


def test_it_begins_where_it_is_told_or_anywhere_by_the_seed():
    told = start_state(Building(), RobotSettings(start="1.5, 2, 0, 90"))
    assert (told.p_world, told.floor, told.yaw_rad) == ((1.5, 2.0, 0.2), "0", pytest.approx(math.pi / 2))
    drawn = start_state(Building(), RobotSettings())
    assert drawn == start_state(Building(), RobotSettings())
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
        start_state(Building(), RobotSettings(start=start))
