from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from surveilnav.robot_body import STEP_M
from surveilnav.robot_state import RobotState
from surveilnav.simulator.world.geodesic import first_blocked
from surveilnav.simulator.world.navigation import Transit
from surveilnav.simulator.world.robot_motion import act, refusal, stairs_in

STAIR = Transit("0", "1", (2.0, 2.0, 0.0), (4.0, 4.0, 2.7), 3.1)


@dataclasses.dataclass(frozen=True)
class GridWorld:
    """10 x 10 m of 5 cm cells on two floors, a block from (5, 5) to (7, 7)."""

    transits: tuple[Transit, ...] = (STAIR,)

    @property
    def free(self) -> np.ndarray:
        free = np.ones((200, 200), dtype=np.bool_)
        free[100:140, 100:140] = False
        return free

    def is_navigable(self, p_world, floor: str) -> bool:
        row, col = math.floor(p_world[1] / 0.05), math.floor(p_world[0] / 0.05)
        return 0 <= row < 200 and 0 <= col < 200 and bool(self.free[row, col])

    def way_free(self, p_from, p_to, floor: str) -> float:
        scaled = (p_from[1] / 0.05, p_from[0] / 0.05, p_to[1] / 0.05, p_to[0] / 0.05)
        return min(1.0, first_blocked(self.free, *scaled))


WORLD = GridWorld()
AT = RobotState(2.0, 3.0, 0.0, "0", 0.0)


@pytest.mark.parametrize(
    ("action", "changes"),
    [
        ("move_forward", {"x_m": 2.25, "path_m": 0.25}),
        ("turn_left", {"yaw_rad": math.radians(30)}),
        ("turn_right", {"yaw_rad": math.radians(-30)}),
        ("look_up", {"pitch_rad": math.radians(30)}),
        ("look_down", {"pitch_rad": math.radians(-30)}),
        ("stop", {"stopped": True}),
    ],
)
def test_actions_by_table(action, changes) -> None:
    after = act(AT, action, WORLD)
    expected = dataclasses.replace(AT, seq=1, steps=1, last_action=action, **changes)
    assert dataclasses.asdict(after) == pytest.approx(dataclasses.asdict(expected))


def test_twelve_turns_come_round_and_yaw_stays_wrapped() -> None:
    state = AT
    for _ in range(12):
        state = act(state, "turn_left", WORLD)
        assert -math.pi < state.yaw_rad <= math.pi
    assert state.yaw_rad == pytest.approx(0.0, abs=1e-9)


def test_the_camera_tilts_at_most_sixty_degrees() -> None:
    state = AT
    for _ in range(4):
        state = act(state, "look_down", WORLD)
    assert math.degrees(state.pitch_rad) == pytest.approx(-60.0)
    for _ in range(9):
        state = act(state, "look_up", WORLD)
    assert math.degrees(state.pitch_rad) == pytest.approx(60.0)


def test_a_move_ends_at_the_contact_and_does_not_slide() -> None:
    before = dataclasses.replace(AT, x_m=4.9, y_m=6.0, yaw_rad=math.radians(30))
    after = act(before, "move_forward", WORLD)
    assert after.collided
    assert after.x_m == pytest.approx(5.0, abs=2e-3)
    assert after.x_m < 5.0
    assert after.y_m - 6.0 == pytest.approx((after.x_m - 4.9) * math.tan(math.radians(30)))
    assert after.path_m == pytest.approx(math.dist((after.x_m, after.y_m), (4.9, 6.0)))
    stuck = act(after, "move_forward", WORLD)
    assert stuck.collided
    assert stuck.path_m - after.path_m < 1e-3
    assert not act(stuck, "turn_left", WORLD).collided


@settings(max_examples=40, deadline=None)
@given(
    st.floats(0.1, 4.9),
    st.floats(0.1, 9.9),
    st.floats(-math.pi, math.pi),
    st.lists(st.sampled_from(["move_forward", "move_forward", "turn_left", "turn_right"]), max_size=40),
)
def test_it_never_leaves_the_free_cells_and_path_is_the_sum_of_displacements(x, y, yaw, actions) -> None:
    state, walked = RobotState(x, y, 0.0, "0", yaw), 0.0
    for n, action in enumerate(actions, start=1):
        after = act(state, action, WORLD)
        moved = math.dist(state.p_world, after.p_world)
        walked += moved
        assert WORLD.is_navigable(after.p_world, "0")
        assert after.seq == after.steps == n
        assert after.path_m == pytest.approx(walked)
        if action == "move_forward":
            assert after.collided == (moved < STEP_M - 1e-6)
        state = after


def test_stairs() -> None:
    near = dataclasses.replace(AT, x_m=2.3, y_m=2.4, yaw_rad=1.0, seq=7, steps=7, path_m=1.0)
    up = act(near, "take_stairs", WORLD, to_floor="1")
    assert up.p_world == (4.0, 4.0, 2.7)
    assert (up.floor, up.yaw_rad, up.seq) == ("1", 1.0, 8)
    assert up.path_m == pytest.approx(1.0 + 0.5 + 3.1)
    assert up.steps == 7 + 15, "3.6 m are 14.4 moves"
    down = act(up, "take_stairs", WORLD, to_floor="0")
    assert down.p_world == (2.0, 2.0, 0.0)
    assert down.path_m == pytest.approx(4.6 + 3.1)


@pytest.mark.parametrize(
    ("state", "action", "to_floor", "why"),
    [
        (AT, "take_stairs", "1", "within 0.5 m"),
        (AT, "take_stairs", "attic", r"no stair leads .* to 'attic'; stairs lead to \['1'\]"),
        (AT, "take_stairs", None, "no stair leads"),
        (dataclasses.replace(AT, x_m=2.0, y_m=2.0), "take_stairs", "0", "no stair leads"),
        (dataclasses.replace(AT, x_m=2.0, y_m=2.0, floor="1"), "take_stairs", "0", "within 0.5 m"),
        (AT, "fly", None, "unknown action 'fly'; there are move_forward"),
    ],
)
def test_refusals(state, action, to_floor, why) -> None:
    import re

    assert re.search(why, refusal(state, action, WORLD, to_floor))
    with pytest.raises(ValueError, match=why):
        act(state, action, WORLD, to_floor)


def test_no_stairs_through_a_wall() -> None:
    """The end of the stair is 0.3 m away, on the other side of a corner of the block."""
    world = GridWorld((Transit("0", "1", (4.9, 5.1, 0.0), (4.0, 4.0, 2.7), 3.0),))
    assert refusal(dataclasses.replace(AT, x_m=5.1, y_m=4.9), "take_stairs", world, "1") != ""
    assert refusal(dataclasses.replace(AT, x_m=4.8, y_m=4.9), "take_stairs", world, "1") == ""


def test_stairs_are_listed_in_both_directions():
    up, down = stairs_in(WORLD)
    assert (up.floor, up.to_floor, up.at_m, up.to_m) == ("0", "1", STAIR.lower_m, STAIR.upper_m)
    assert (down.floor, down.to_floor, down.at_m, down.to_m) == ("1", "0", STAIR.upper_m, STAIR.lower_m)
    assert up.length_m == down.length_m == STAIR.length_m
