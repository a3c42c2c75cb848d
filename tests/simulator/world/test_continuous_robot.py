from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from surveilnav.robot_frame import PlanarTransform
from surveilnav.robot_state import RobotState
from surveilnav.simulator.world.continuous_robot import ContinuousRobot, MotionLimits
from surveilnav.simulator.world.localisation import LocalisationSettings
from surveilnav.simulator.world.navigation import NavigationMap

DT_S = 0.05
#: Reaches each velocity at once, so that a movement is a single arc.
AT_ONCE = MotionLimits(acceleration_m_s2=math.inf, turn_acceleration_rad_s2=math.inf, command_timeout_s=math.inf)
START = RobotState(2.0, 3.0, 0.0, "0", 0.5)
ELSEWHERE = PlanarTransform(3.0, -2.0, 2.0)


@pytest.fixture(scope="module")
def navigation(boxes, room) -> NavigationMap:
    """A room of 8 x 6 m with a cupboard in its middle."""
    return NavigationMap.build(boxes([*room(8.0, 6.0), ("cupboard", "0", (4.0, 2.5, 0.0), (5.0, 3.5, 2.0))]))


def drive(robot: ContinuousRobot, speed: float, turn_rate: float, seconds: float, dt_s: float = DT_S) -> None:
    for _ in range(round(seconds / dt_s)):
        robot.command(speed, turn_rate)
        robot.advance(dt_s)


def integrated(start: RobotState, speed: float, turn_rate: float, seconds: float) -> tuple[float, float, float]:
    """The end of an arc, by 200,000 small straight steps (midpoint rule)."""
    n = 200_000
    yaw = start.yaw_rad + turn_rate * seconds * (np.arange(n) + 0.5) / n
    length = speed * seconds / n
    end_yaw = math.remainder(start.yaw_rad + turn_rate * seconds, 2 * math.pi)
    return start.x_m + float(np.cos(yaw).sum()) * length, start.y_m + float(np.sin(yaw).sum()) * length, end_yaw


@pytest.mark.parametrize(
    ("speed", "turn_rate"), [(0.4, 0.0), (0.3, 0.8), (-0.3, 0.5), (0.5, -1.2), (0.0, 1.0), (0.4, 1e-7)]
)
def test_arcs_are_those_of_small_steps_whatever_the_time_step(navigation, speed, turn_rate):
    for dt_s in (0.05, 0.5, 1.5):
        robot = ContinuousRobot(navigation, START, limits=AT_ONCE)
        drive(robot, speed, turn_rate, 1.5, dt_s)
        assert (robot.state.x_m, robot.state.y_m, robot.state.yaw_rad) == pytest.approx(
            integrated(START, speed, turn_rate, 1.5), abs=1e-9
        )
        assert robot.state.path_m == pytest.approx(abs(speed) * 1.5)
        assert robot.time_s == pytest.approx(1.5)


def test_it_keeps_within_its_limits_and_brakes_without_commands(navigation):
    limits = MotionLimits(acceleration_m_s2=1.0, turn_acceleration_rad_s2=4.0)
    robot = ContinuousRobot(navigation, dataclasses.replace(START, yaw_rad=0.0), limits=limits)
    robot.command(9.0, -9.0)
    robot.advance(DT_S)
    assert (robot.speed_m_s, robot.turn_rate_rad_s) == pytest.approx((0.05, -0.2))
    drive(robot, 9.0, -9.0, 1.0)
    assert (robot.speed_m_s, robot.turn_rate_rad_s) == (0.5, -1.2)
    for _ in range(10):  # the last command counts half a second
        robot.advance(DT_S)
    assert robot.speed_m_s == 0.5
    for _ in range(10):
        robot.advance(DT_S)
    assert (robot.speed_m_s, robot.turn_rate_rad_s) == (0.0, 0.0)


def test_an_override_takes_precedence_until_it_is_old(navigation):
    robot = ContinuousRobot(navigation, START)
    robot.override(0.0, 0.0)
    drive(robot, 0.5, 0.0, 0.5)
    assert robot.state.path_m == 0.0
    drive(robot, 0.5, 0.0, 1.0)
    assert robot.speed_m_s == 0.5


def test_contact_ends_the_movement_but_not_a_turn(navigation):
    robot = ContinuousRobot(navigation, dataclasses.replace(START, yaw_rad=0.0), limits=AT_ONCE)
    drive(robot, 0.5, 0.0, 6.0)
    assert robot.collided
    assert robot.state.collided
    assert robot.state.x_m == pytest.approx(4.0 - 0.18, abs=0.051)  # the cupboard, the radius, a cell
    before = robot.state
    drive(robot, 0.5, 1.0, 0.5)
    assert robot.state.yaw_rad == pytest.approx(0.5)
    assert math.hypot(robot.state.x_m - before.x_m, robot.state.y_m - before.y_m) < 0.05
    drive(robot, -0.3, 0.0, 1.0)
    assert not robot.collided
    assert robot.state.path_m - before.path_m == pytest.approx(0.3, abs=0.06)


def test_a_held_robot_stands(navigation):
    robot = ContinuousRobot(navigation, START)
    robot.held = True
    drive(robot, 0.5, 1.0, 1.0)
    assert robot.state == START


@settings(max_examples=60)
@given(
    st.floats(0.3, 7.7),
    st.floats(0.3, 5.7),
    st.floats(-math.pi, math.pi),
    st.lists(
        st.tuples(st.floats(-0.6, 0.6), st.floats(-1.5, 1.5), st.sampled_from([0.05, 0.05, 0.3, 2.0])), max_size=40
    ),
)
def test_it_never_leaves_free_ground_and_its_path_is_no_shorter_than_the_displacement(navigation, x, y, yaw, moves):
    if not navigation.is_navigable((x, y), "0"):
        return
    robot = ContinuousRobot(navigation, RobotState(x, y, 0.0, "0", yaw))
    for speed, turn_rate, dt_s in moves:
        before = robot.state
        robot.command(speed, turn_rate)
        robot.advance(dt_s)
        after = robot.state
        assert navigation.is_navigable(after.p_world, "0")
        displacement = math.hypot(after.x_m - before.x_m, after.y_m - before.y_m)
        assert displacement <= after.path_m - before.path_m + 1e-9
        assert robot.collided or after.path_m - before.path_m == pytest.approx(abs(robot.speed_m_s) * dt_s)


# --- where it believes it is --------------------------------------------------------------------------------------


def wander(robot: ContinuousRobot, seconds: float = 20.0) -> None:
    rng = np.random.default_rng(5)
    for _ in range(round(seconds)):
        drive(robot, float(rng.uniform(0.1, 0.5)), float(rng.uniform(-1, 1)), 1.0)


def test_without_drift_and_noise_it_knows_where_it_is_in_its_own_map(navigation):
    robot = ContinuousRobot(navigation, START, localisation=LocalisationSettings(ELSEWHERE))
    wander(robot)
    estimate = ELSEWHERE @ robot.localisation.pose
    assert estimate.difference(robot.pose) == pytest.approx((0.0, 0.0), abs=1e-9)
    assert robot.localisation.T_building_map.difference(ELSEWHERE) == pytest.approx((0.0, 0.0), abs=1e-9)
    wheels = ContinuousRobot(navigation, START)
    assert wheels.localisation.T_odom_base == PlanarTransform()
    wander(wheels)
    start = PlanarTransform(START.x_m, START.y_m, START.yaw_rad)
    assert (start @ wheels.localisation.T_odom_base).difference(wheels.pose) == pytest.approx((0, 0), abs=1e-9)


def test_odometry_drifts_by_its_share_of_the_way_to_either_side(navigation):
    errors = []
    for seed in range(40):
        noisy = LocalisationSettings(drift=0.02, yaw_drift_rad_per_m=0.01)
        robot = ContinuousRobot(
            navigation, dataclasses.replace(START, x_m=1.0, y_m=1.0, yaw_rad=0.0), localisation=noisy, seed=seed
        )
        drive(robot, 0.5, 0.0, 10.0)
        odometry = robot.localisation.T_odom_base
        errors.append(
            (math.hypot(odometry.x_m, odometry.y_m) / robot.state.path_m - 1.0, odometry.yaw_rad / robot.state.path_m)
        )
    assert np.abs(errors) == pytest.approx(np.full((40, 2), (0.02, 0.01)), rel=0.02)
    assert 10 <= sum(drift > 0 for drift, _ in errors) <= 30
    assert 10 <= sum(yaw > 0 for _, yaw in errors) <= 30


def test_corrections_keep_the_estimate_near_and_noisy_as_set(navigation):
    noisy = LocalisationSettings(ELSEWHERE, 0.01, 0.01, sigma_m=0.03, sigma_yaw_rad=0.02, period_s=0.2)
    robot = ContinuousRobot(navigation, START, localisation=noisy, seed=3)
    errors = []
    for _ in range(600):
        drive(robot, 0.3, 0.6, 0.2)
        true = ELSEWHERE.inverse() @ robot.pose
        believed = robot.localisation.pose
        errors.append(
            (
                believed.x_m - true.x_m,
                believed.y_m - true.y_m,
                math.remainder(believed.yaw_rad - true.yaw_rad, 2 * math.pi),
            )
        )
    assert np.std(errors, axis=0) == pytest.approx((0.03, 0.03, 0.02), rel=0.12)
    assert np.mean(errors, axis=0) == pytest.approx((0, 0, 0), abs=0.005)
    standing = robot.localisation.pose
    drive(robot, 0.0, 0.0, 2.0)
    at_rest = robot.localisation.pose
    assert at_rest.difference(standing)[0] < 0.2
    drive(robot, 0.0, 0.0, 5.0)
    assert robot.localisation.pose == at_rest  # who stands sees nothing new


def test_a_lost_robot_drifts_until_it_is_found(navigation):
    robot = ContinuousRobot(navigation, START, localisation=LocalisationSettings(drift=0.1))
    robot.localisation.lost = True
    drive(robot, 0.4, 1.0, 12.0)
    assert robot.localisation.pose.difference(robot.pose)[0] > 0.01
    robot.localisation.lost = False
    drive(robot, 0.4, 1.0, 1.0)
    assert robot.localisation.pose.difference(robot.pose)[0] < 0.05


def test_a_jump_stays_and_odometry_does_not_notice(navigation):
    robot = ContinuousRobot(navigation, START)
    odometry = robot.localisation.T_odom_base
    robot.jump(0.5, 0.0)
    drive(robot, 0.3, 0.3, 3.0)
    assert robot.localisation.T_odom_base != odometry
    assert robot.localisation.pose.difference(robot.pose) == pytest.approx((0.5, 0.0), abs=1e-9)
    robot.jump(-0.5, 0.0)
    assert robot.localisation.pose.difference(robot.pose) == pytest.approx((0.0, 0.0), abs=1e-9)


def test_odometry_begins_anew_in_the_same_map_or_in_a_new_one(navigation):
    robot = ContinuousRobot(navigation, START, localisation=LocalisationSettings(ELSEWHERE))
    drive(robot, 0.3, 0.3, 3.0)
    robot.restart_odometry(new_map=False)
    assert robot.localisation.T_odom_base == PlanarTransform()
    assert (ELSEWHERE @ robot.localisation.pose).difference(robot.pose)[0] < 1e-9
    robot.restart_odometry(new_map=True)
    assert robot.localisation.pose.difference(PlanarTransform()) == pytest.approx((0, 0), abs=1e-9)
    assert robot.localisation.T_building_map.difference(robot.pose) == pytest.approx((0, 0), abs=1e-9)


def test_carried_it_is_found_where_it_was_put(navigation):
    robot = ContinuousRobot(navigation, START)
    drive(robot, 0.3, 0.0, 1.0)
    path_m, odometry = robot.state.path_m, robot.localisation.T_odom_base
    robot.carry_to(RobotState(6.0, 5.0, 0.0, "0", 1.0))
    assert (robot.state.x_m, robot.state.path_m) == (6.0, path_m)
    assert robot.localisation.T_odom_base == odometry
    drive(robot, 0.1, 0.0, 1.1)
    assert robot.localisation.pose.difference(robot.pose)[0] < 0.03
    with pytest.raises(ValueError, match=r"can't stand at \(3\.95, 3\.00\)"):
        robot.carry_to(RobotState(3.95, 3.0, 0.0, "0", 0.0))


def test_the_same_seed_gives_the_same_robot(navigation):
    noisy = LocalisationSettings(ELSEWHERE, 0.01, 0.01, 0.02, 0.02, 0.5)
    one, same, other = (ContinuousRobot(navigation, START, localisation=noisy, seed=seed) for seed in (1, 1, 2))
    for robot in (one, same, other):
        wander(robot)
    assert one.localisation.pose == same.localisation.pose
    assert one.localisation.pose != other.localisation.pose
    assert one.state == same.state == other.state
