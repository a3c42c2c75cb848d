"""The robot node's body against a simulated robot with ROS 2 over a real router: drives, halts, and what goes wrong on its side.

What people read in each case stands in docs/results/real_robot.md, from here.
"""

from __future__ import annotations

import math
import os
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from typing import Any

import pytest

from surveilnav.bus.router import free_port, open_router
from surveilnav.messages import WaypointPose
from surveilnav.robot_file import RobotFile
from surveilnav.robot_frame import PlanarTransform
from surveilnav.ros2.session import RosSession
from surveilnav.services.robot_node.bodies.ros2 import waypoint as waypoint_module
from surveilnav.services.robot_node.bodies.ros2.body import Ros2Body
from surveilnav.simulator.hardware.config import RobotHardwareSettings
from surveilnav.simulator.hardware.ros2_robot import Ros2Robot, run
from surveilnav.simulator.simulation import SimulatedBuilding, SimulationSettings
from tests.waiting import until

T_BUILDING_MAP = PlanarTransform(3.0, -2.0, math.radians(120))
FRAME = {"x_m": 3.0, "y_m": -2.0, "yaw_deg": 120.0}
WAIT_S = 30.0


@pytest.fixture(scope="module")
def router() -> Iterator[str]:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with open_router(endpoint):
        yield endpoint


@pytest.fixture(scope="module")
def building(home_cache: Any) -> SimulatedBuilding:
    with pytest.MonkeyPatch.context() as environ:
        environ.setenv("SURVEILNAV_CACHE_DIR", str(home_cache))
        building = SimulatedBuilding(SimulationSettings(building="parametric_flat", lighting="flat", depth_noise=False))
        _ = building.renderer
        return building


class Rig:
    """A robot, its truth, and SurveilNav's body that is connected to it."""

    def __init__(self, robot: Ros2Robot, body: Ros2Body, die: Callable[[], object]) -> None:
        self.robot, self.body, self.die = robot, body, die

    def ready(self) -> Rig:
        until(
            lambda: not self.body.place.problem() and not self.body.camera_problem(),
            lambda: f"{self.body.place.problem()}; {self.body.camera_problem()}",
            WAIT_S,
        )
        return self

    @property
    def true(self) -> PlanarTransform:
        return self.robot.robot.pose

    def drive(self, dx_m: float, dy_m: float, id: str = "1") -> WaypointPose:
        """Sends it to a place that is so far from where it is."""
        pose = WaypointPose(id=id, x_m=self.true.x_m + dx_m, y_m=self.true.y_m + dy_m, yaw_rad=0.0)
        self.body.drive_to(pose)
        return pose

    def ended(self) -> tuple[str, str]:
        """How its waypoint ended, and why."""
        until(lambda: self.body.waypoint and self.body.waypoint.state != "driving", lambda: self.body.waypoint, WAIT_S)
        assert self.body.waypoint is not None
        return self.body.waypoint.state, self.body.waypoint.why

    def reads(self, timeout_s: float = WAIT_S) -> str:
        """The problem that a person reads."""
        until(lambda: self.body.problem, timeout_s=timeout_s)
        return self.body.problem


@pytest.fixture
def rig(router: str, building: SimulatedBuilding) -> Iterator[Callable[..., Rig]]:
    """``rig(file={...}, setting=...)``: a robot in a domain of its own, and the body of a robot file."""
    with ExitStack() as stack:

        def start(file: dict[str, Any] | None = None, **more: Any) -> Rig:
            domain = int.from_bytes(os.urandom(1), "big") % 200 + 1
            settings = RobotHardwareSettings(
                router=router,
                domain=domain,
                **{
                    "start": "5,4,0,0",
                    "map_x_m": T_BUILDING_MAP.x_m,
                    "map_y_m": T_BUILDING_MAP.y_m,
                    "map_yaw_deg": 120.0,
                    "camera_width_px": 80,
                    "camera_height_px": 60,
                    "fault_after_s": 1.0,
                    **more,
                },
            )
            hardware = stack.enter_context(RosSession("robot", router=router, domain=domain))
            robot, stop = Ros2Robot(hardware, building, settings), threading.Event()
            thread = threading.Thread(target=run, args=(robot, stop))
            thread.start()
            stack.callback(thread.join)
            stack.callback(stop.set)
            session = stack.enter_context(RosSession("surveilnav", router=router, domain=domain))
            facts = {"router": router, "domain": domain, "floor": "0", "T_building_map": FRAME} | (file or {})
            topics = {"tf": "tf", "tf_static": "tf_static"} | facts.pop("topics", {})
            body = Ros2Body(RobotFile.model_validate(facts | {"topics": topics}), session)
            stack.callback(body.close)
            return Rig(robot, body, lambda: (stop.set(), thread.join(), hardware.__exit__(None, None, None)))

        yield start


def test_it_drives_where_it_is_sent_and_sees_where_it_is(rig):
    r = rig().ready()
    wanted = r.drive(0.8, 0.3)
    r.drive(9.0, 9.0, id="1")  # the same id: nothing new
    assert r.ended() == ("reached", "")
    assert math.hypot(r.true.x_m - wanted.x_m, r.true.y_m - wanted.y_m) < 0.25
    seen = until(r.body.observe)
    assert math.dist(seen.state.p_world[:2], (r.true.x_m, r.true.y_m)) < 0.1
    assert seen.mounting_offset_m == pytest.approx(0.88, abs=0.01)
    assert seen.depth_m.shape == (60, 80)
    assert 0.2 < seen.state.path_m < 1.5


def test_a_new_waypoint_replaces_the_one_before(rig):
    r = rig().ready()
    r.drive(2.0, 0.0, id="1")
    until(lambda: r.robot.robot.speed_m_s > 0.1, timeout_s=WAIT_S)
    wanted = r.drive(-0.8, 0.0, id="2")
    assert r.ended() == ("reached", "")
    assert r.body.waypoint.id == "2"
    assert math.hypot(r.true.x_m - wanted.x_m, r.true.y_m - wanted.y_m) < 0.25


def test_a_halt_in_mid_drive_ends_with_a_robot_that_stands(rig):
    r = rig().ready()
    r.drive(2.5, 0.0)
    until(lambda: r.robot.robot.speed_m_s > 0.1, timeout_s=WAIT_S)
    r.body.halt()
    assert r.body.is_standing
    until(lambda: r.robot.robot.speed_m_s == 0.0)
    at = r.true
    time.sleep(0.5)
    assert r.true.difference(at)[0] < 0.02
    assert r.body.waypoint.state == "cancelled"


@pytest.mark.parametrize(
    ("fault", "dx_m", "why"),
    [
        ("goal_rejected", 1.0, "navigate_to_pose rejects the goal"),
        ("goal_aborted", 2.5, "a fault that was asked for"),
    ],
)
def test_a_goal_that_nav2_does_not_carry_out_fails_with_its_reason(rig, fault, dx_m, why):
    r = rig(faults=[fault]).ready()
    r.drive(dx_m, 0.0)
    state, told = r.ended()
    assert state == "failed"
    assert why in told


def test_a_place_that_no_way_leads_to_fails(rig):
    r = rig().ready()
    r.drive(50.0, 0.0)
    state, why = r.ended()
    assert state == "failed"
    assert "no path" in why


def test_feedback_that_stops_is_named_and_then_given_up(rig, monkeypatch):
    monkeypatch.setattr(waypoint_module, "_SILENT_S", 0.6)
    monkeypatch.setattr(waypoint_module, "_GIVEN_UP_S", 1.5)
    r = rig(faults=["feedback_stops"], fault_after_s=0.3, max_speed_m_s=0.1).ready()
    r.drive(2.5, 0.0)
    until(lambda: "Nav2 says nothing of the goal" in r.body.waypoint.why, timeout_s=WAIT_S)
    state, why = r.ended()
    assert state == "failed"
    assert "Nav2 said nothing of the goal" in why
    until(lambda: r.robot.robot.speed_m_s == 0.0, timeout_s=WAIT_S)


@pytest.mark.parametrize(
    ("fault", "says"),
    [
        ("no_depth", "no depth pictures came yet"),
        ("depth_mm_as_metres", "mistakes metres and millimetres"),
        ("no_tf", "no transform leads from"),
        ("tf_static_volatile", "tf_static is published as volatile"),
    ],
)
def test_what_is_missing_or_wrong_is_a_problem_by_name(rig, fault, says):
    r = rig(faults=[fault])
    for _ in range(20):
        assert r.body.observe() is None
        time.sleep(0.05)
    until(lambda: [r.body.observe()] and says in r.body.problem, lambda: r.body.problem, WAIT_S)


@pytest.mark.parametrize("clock", [{"clock_offset_s": -3600.0}, {"sim_time": True}])
def test_another_clock_does_no_harm(rig, clock):
    r = rig(**clock).ready()
    assert [note[:9] for note in r.body.notes] == ["its clock"]
    seen = until(r.body.observe, timeout_s=WAIT_S)
    assert math.dist(seen.state.p_world[:2], (r.true.x_m, r.true.y_m)) < 0.1


def test_a_localisation_that_jumps_is_noted(rig):
    r = rig(localisation_sigma_m=0.0).ready()
    until(r.body.observe)
    r.robot.robot.jump(0.5, 0.0)
    until(lambda: r.body.notes, timeout_s=WAIT_S)
    assert r.body.notes[0].startswith("its localisation moved it by 0.50 m")


def test_a_new_map_under_a_continuing_localisation_is_a_problem_until_a_person_has_looked(rig):
    r = rig(localisation_sigma_m=0.0).ready()
    until(r.body.observe)
    r.robot.robot.jump(3.0, 0.0)
    assert r.reads().startswith("its localisation moved it by 3.0")
    assert r.body.observe() is None
    r.robot.robot.jump(-3.0, 0.0)
    time.sleep(1.0)
    assert r.body.problem, "it doesn't pass by itself"
    r.body.place.set_frame(T_BUILDING_MAP)
    until(lambda: not r.body.problem, timeout_s=WAIT_S)
    until(r.body.observe, timeout_s=WAIT_S)


def test_a_robot_that_dies_in_mid_goal_is_named_and_its_goal_given_up(rig, monkeypatch):
    monkeypatch.setattr(waypoint_module, "_SILENT_S", 0.6)
    monkeypatch.setattr(waypoint_module, "_GIVEN_UP_S", 2.0)
    r = rig(max_speed_m_s=0.1).ready()
    r.drive(2.5, 0.0)
    until(lambda: r.robot.robot.speed_m_s > 0.05, timeout_s=WAIT_S)
    r.die()
    state, why = r.ended()
    assert state == "failed"
    assert why == "service /navigate_to_pose/_action/get_result was left without an answer: its node has gone"
    assert "no odometry came for" in r.reads()
    assert r.body.observe() is None


def test_its_battery_is_known_as_soon_as_it_says(rig):
    assert rig().ready().body.battery is None, "a topic that isn't in the robot file isn't listened to"
    r = rig(file={"topics": {"battery": "battery_state"}}).ready()
    assert 0.9 < until(lambda: r.body.battery, timeout_s=WAIT_S) <= 1.0


def test_after_a_new_map_nothing_is_seen_until_its_place_is_known(rig):
    """A robot without a localisation of its own: its map is its odometry's frame."""
    r = rig(file={"frames": {"map": "odom"}, "T_building_map": {"x_m": 5.0, "y_m": 4.0, "yaw_deg": 0.0}}).ready()
    until(r.body.observe)
    r.body.place.add_odometry(_odometry_at(9.0), b"another process")
    assert "its odometry began anew" in r.reads()
    assert r.body.observe() is None
    r.drive(0.5, 0.0)
    state, why = r.ended()
    assert state == "failed"
    assert "isn't known" in why
    r.body.place.set_frame(PlanarTransform(5.0, 4.0, 0.0))
    until(lambda: not r.body.problem, timeout_s=WAIT_S)
    until(r.body.observe, timeout_s=WAIT_S)


def _odometry_at(x_m: float) -> Any:
    from tests.services.robot_node.bodies.ros2.test_place import odometry

    return odometry(x_m, stamp_ns=time.time_ns())


def test_it_carries_out_actions_by_velocities(rig):
    r = rig(file={"drive": "actions"}, drift=0.0, yaw_drift_deg_per_m=0.0).ready()
    start = r.true
    for action in ("move_forward", "turn_left", "move_forward", "turn_right"):
        seq = r.body.state.seq
        r.body.act(action)
        assert r.body.state.seq == seq + 1
        assert not r.body.state.collided
    expected = start @ PlanarTransform(0.25, 0.0, math.pi / 6) @ PlanarTransform(0.25, 0.0, -math.pi / 6)
    off_m, off_rad = r.true.difference(expected)
    assert off_m < 0.08
    assert off_rad < math.radians(6)
    assert until(r.body.observe, timeout_s=WAIT_S).state.seq == 4
