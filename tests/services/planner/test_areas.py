"""Keepout zones and passages: no waypoint and no route lies in one, whatever the robot searches for and wherever it begins."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from surveilnav.geometry import Grid
from surveilnav.messages import WaypointStatus
from surveilnav.services.planner.core import MissionState, PlannerConfig, step
from surveilnav.services.planner.core.motion.areas import Area, barred_cells, cells_in
from surveilnav.services.planner.core.motion.drive import _descent
from surveilnav.services.planner.core.motion.terrain import travel_time_m

ROOMS = """
##########################################
#            #                           #
#            #         TT                #
#                      TT           CC   #
#                                   CC   #
#            #                           #
#            #######  ########  ##########
#            #                           #
#            #                           #
#                                        #
#                                        #
#   R        #               SS          #
#            #               SS          #
##########################################
"""
ACTIONS, WAYPOINTS = PlannerConfig(), PlannerConfig(drive="waypoints", max_pitch_rad=0.0)


def zone(*corners, name="zone 'x'", kind="keepout", passage=""):
    return Area(name, kind, tuple(corners), passage)


def box(x, y, w, d, **more):
    return zone((x, y), (x + w, y), (x + w, y + d), (x, y + d), **more)


class Nav2:
    """Drives to each pose on the shortest way through what is free, and knows nothing of areas."""

    def __init__(self, world):
        self.world, self.status = world, None
        self.speed = np.where(world.clearance_m >= 0.2, np.clip(world.clearance_m, 0.2, 0.45), 0.0)

    def drive(self, decision):
        world, pose = self.world, decision.waypoint_pose
        goal = np.zeros(world.grid.shape, bool)
        goal[tuple(world.grid.cells_of((pose.x_m, pose.y_m)))] = True
        field = travel_time_m(np.maximum(self.speed, goal), goal, 0.05)
        here = tuple(world.grid.cells_of((world.x, world.y)))
        if not math.isfinite(field[here]):
            self.status = WaypointStatus(id=pose.id, state="failed", why="no path")
            return
        for x, y in world.grid.centres_of(_descent(field, *here)[:6]):
            if math.dist((x, y), (pose.x_m, pose.y_m)) < 0.1:
                break
            world.yaw = math.atan2(y - world.y, x - world.x)
            world.x, world.y = float(x), float(y)
            world.look()
            world.trace.append((world.x, world.y))
        reached = math.dist((pose.x_m, pose.y_m), (world.x, world.y)) <= 0.25
        world.yaw = pose.yaw_rad if reached else world.yaw
        self.status = WaypointStatus(id=pose.id, state="reached" if reached else "driving")
        world.look()


def play(world, areas, config, max_steps=300, until=lambda decision: False):
    """A search in a flat world. Yields (maps, robot, decision) of each step; the robot then does what it is told."""
    state, nav2 = MissionState("chair", max_steps=max_steps), Nav2(world)
    while True:
        maps = replace(world.maps(), areas=tuple(areas))
        robot = world.robot()
        if config.drive == "waypoints":
            robot = replace(robot, waypoint=nav2.status, last_action="drive_to", collided=False)
        state, decision = step(state, maps, robot, config)
        yield maps, robot, decision
        if decision.finished or decision.action is None:
            return
        nav2.drive(decision) if config.drive == "waypoints" else world.act(decision.action)
        world.seq += 1


# --- the mask -----------------------------------------------------------------------------------------------------


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10_000), st.floats(0.1, 0.6))
def test_a_robot_whose_cell_isnt_barred_stays_out_with_its_whole_body(seed, radius_m):
    rng = np.random.default_rng(seed)
    grid = Grid(-1.0, 2.0, 0.05, 60, 80)
    centre, angles = rng.uniform((-1.5, 1.5), (3.5, 5.5)), np.sort(rng.uniform(0.0, 2 * math.pi, 5))
    outline = [
        (centre[0] + r * math.cos(a), centre[1] + r * math.sin(a))
        for r, a in zip(rng.uniform(0.1, 1.5, 5), angles, strict=True)
    ]
    area = zone(*outline)
    barred = barred_cells(grid, (area,), radius_m)
    inside = np.zeros(grid.shape, bool) if barred is None else barred.inside
    near = np.zeros(grid.shape, bool) if barred is None else barred.near
    for row, col in rng.integers((0, 0), grid.shape, (60, 2)):
        x, y = grid.centres_of((row, col)) + rng.uniform(-0.025, 0.025, 2)
        assert inside[row, col] or not area.contains(x, y)
        if not near[row, col]:
            around = [
                (x + radius_m * 0.95 * math.cos(a), y + radius_m * 0.95 * math.sin(a)) for a in np.linspace(0, 6.28, 24)
            ]
            assert not any(area.contains(*p) for p in around)


def test_an_outline_between_two_cells_or_far_outside_is_no_mistake():
    grid = Grid(0.0, 0.0, 0.05, 40, 40)
    thin = box(1.012, 0.5, 0.001, 1.0)
    assert cells_in(grid, (thin,), "keepout")[20, 20]
    assert barred_cells(grid, (box(9_000.0, 9_000.0, 1.0, 1.0),), 0.2) is None
    everywhere = barred_cells(grid, (box(-9_000.0, -9_000.0, 18_000.0, 18_000.0),), 0.2)
    assert everywhere.inside.all()
    beside = barred_cells(grid, (box(-1.0, 0.0, 0.95, 2.0),), 0.2)  # ends 5 cm outside of the grid
    assert not beside.inside[:, 1:].any()
    assert beside.near[:, 1].all()


# --- searches ------------------------------------------------------------------------------------------------------


def random_areas(rng, world, n):
    found = []
    while len(found) < n:
        x, y, w, d = rng.uniform((0.5, 0.5, 0.1, 0.1), (9.5, 2.8, 2.5, 1.5))
        turned, c = rng.uniform(0.0, math.pi), np.array([x + w / 2, y + d / 2])
        corners = np.array([(-w, -d), (w, -d), (w, d), (-w, d)]) / 2
        rotation = np.array([[math.cos(turned), -math.sin(turned)], [math.sin(turned), math.cos(turned)]])
        area = zone(
            *map(tuple, corners @ rotation.T + c), name=f"zone {len(found)}", kind=rng.choice(["keepout", "closed"])
        )
        if not any(area.contains(world.x + dx, world.y + dy) for dx in (-0.4, 0.0, 0.4) for dy in (-0.4, 0.0, 0.4)):
            found.append(area)
    return found


@pytest.mark.parametrize("config", [ACTIONS, WAYPOINTS], ids=["actions", "waypoints"])
@pytest.mark.parametrize("seed", range(8))
def test_no_waypoint_and_no_route_of_a_search_lies_in_an_area(world, thing, config, seed):
    rng = np.random.default_rng(seed)
    w = world(ROOMS, {"C": thing("chair", looks_like="chair"), "T": thing("table"), "S": thing("sofa")})
    areas, messages = random_areas(rng, w, 4), []
    for _, robot, decision in play(w, areas, config, max_steps=200):
        pose = decision.waypoint_pose
        places = [(robot.x_m, robot.y_m), *decision.path, *([(pose.x_m, pose.y_m)] if pose else [])]
        assert not any(area.contains(*p) for area in areas for p in places)
        messages.append(decision.message)
    assert len(messages) > 5
    assert sum(message.startswith("leaving") for message in messages) <= 2, "it doesn't pace up and down at a rim"


@pytest.mark.parametrize("config", [ACTIONS, WAYPOINTS], ids=["actions", "waypoints"])
def test_a_robot_that_stands_in_a_zone_drives_out_of_it_first(world, thing, config):
    w = world(ROOMS, {"C": thing("chair", looks_like="chair"), "T": thing("table"), "S": thing("sofa")})
    area = box(w.x - 0.8, w.y - 0.4, 1.5, 1.4, name="keepout zone 'store'")
    inside, messages = [], []
    for _, robot, decision in play(w, [area], config):
        inside.append(area.contains(robot.x_m, robot.y_m))
        messages.append(decision.message)
    first_out = inside.index(False)
    assert first_out < 15
    assert not any(inside[first_out:]), "it never comes back"
    assert all(m == "leaving keepout zone 'store'" for m in messages[:first_out])
    assert decision.found


def test_a_robot_that_is_walled_into_a_zone_says_so(world, thing):
    w = world("#######\n#     #\n#  R  #\n#     #\n#######", {})
    decisions = [d for _, _, d in play(w, [box(0.0, 0.0, 2.0, 2.0, name="keepout zone 'store'")], ACTIONS)]
    assert decisions[-1].error == "stuck"
    assert "stands in keepout zone 'store', and no way leads out" in decisions[-1].message


KNOWN = {"label": "chair", "confidence": 0.9, "status": "confirmed"}


@pytest.mark.parametrize("config", [ACTIONS, WAYPOINTS], ids=["actions", "waypoints"])
def test_a_target_at_the_rim_of_a_zone_is_found_from_outside(world, thing, config):
    w = world(ROOMS, {"C": thing("chair", looks_like="chair", known=KNOWN), "T": thing("table"), "S": thing("sofa")})
    area = box(8.9, 2.2, 1.5, 1.0)
    *_, (_, robot, decision) = play(w, [area], config)
    assert decision.found
    assert area.contains(9.1, 2.4)
    assert not area.contains(robot.x_m, robot.y_m)


def test_a_target_deep_in_a_zone_ends_the_mission_with_the_zones_name(world, thing):
    w = world(ROOMS, {"C": thing("chair", looks_like="chair", known=KNOWN), "T": thing("table"), "S": thing("sofa")})
    *_, (_, _, decision) = play(
        w, [box(6.5, 0.9, 4.0, 3.0, name="keepout zone 'server room'")], WAYPOINTS, max_steps=500
    )
    assert decision.error == "unreachable"
    assert "the chair at (9.3, 2.5) stands in keepout zone 'server room'" in decision.message


def test_a_waypoint_that_comes_to_lie_in_a_zone_is_replaced_at_once(world, thing):
    w = world(ROOMS, {"C": thing("chair", looks_like="chair", known=KNOWN), "T": thing("table"), "S": thing("sofa")})
    state, nav2, config = MissionState("chair"), Nav2(w), WAYPOINTS
    sent = None
    for _ in range(40):
        robot = replace(w.robot(), waypoint=nav2.status, last_action="drive_to", collided=False)
        state, decision = step(state, w.maps(), robot, config)
        sent = decision.waypoint_pose
        if decision.phase == "approaching":
            break
        nav2.drive(decision)
    nav2.drive(decision)
    area = box(sent.x_m - 0.1, sent.y_m - 0.1, 0.2, 0.2)
    robot = replace(w.robot(), waypoint=nav2.status, last_action="drive_to", collided=False)
    _, decision = step(state, replace(w.maps(), areas=(area,)), robot, config)
    assert decision.waypoint_pose.id != sent.id
    assert not area.contains(decision.waypoint_pose.x_m, decision.waypoint_pose.y_m)


def test_navigation_that_knows_no_zones_is_sent_around_them_in_parts(world, thing):
    hall = "\n".join(
        ["#" * 24, *["#" + " " * 22 + "#"] * 9, "#  R              CC    #", *["#" + " " * 22 + "#"] * 9, "#" * 24]
    )
    area = box(2.0, 1.4, 1.0, 2.2)
    w = world(hall, {"C": thing("chair", looks_like="chair", known=KNOWN)})
    sent = [d.waypoint_pose for _, _, d in play(w, [area], WAYPOINTS) if d.phase == "approaching"]
    assert sent
    straight = np.linspace(0.0, 1.0, 50)[:, None]
    begin = (w.trace[0][0], w.trace[0][1])
    first = np.array(begin) + straight * (np.array([sent[0].x_m, sent[0].y_m]) - begin)
    assert not any(area.contains(*p) for p in first), "a straight way to the first part is clear of the zone"
    assert math.dist((sent[-1].x_m, sent[-1].y_m), (4.75, 2.6)) < 1.2, "the last one is at the chair"


# --- passages ------------------------------------------------------------------------------------------------------

#: The opening between the left room and the right one, above; the lower rooms are joined too unless that is closed as well.
UPPER = box(3.2, 1.9, 0.4, 0.8, name="door upper", kind="closed", passage="upper")
LOWER = box(3.2, 0.4, 0.4, 0.9, name="door lower", kind="closed", passage="lower")


def chair_behind_a_door(world, thing):
    drawing = ROOMS.replace("#                      TT           CC   #", "#            #         TT           CC   #")
    drawing = drawing.replace(
        "#                                        #", "#            D                           #"
    )
    things = {
        "C": thing("chair", looks_like="chair", known=KNOWN),
        "T": thing("table"),
        "S": thing("sofa"),
        "D": thing("door"),
    }
    w = world(drawing, things)
    w.occupancy[w.solid] = 1  # the cameras have seen it all, the door closed
    w.explored[20:-20, 20:-20] = 1
    return w


DOOR = zone((3.2, 0.4), (3.6, 0.4), (3.6, 2.3), (3.2, 2.3), name="door lobby", kind="closed", passage="lobby")


@pytest.mark.parametrize("config", [ACTIONS, WAYPOINTS], ids=["actions", "waypoints"])
def test_a_search_waits_by_name_for_the_door_that_its_target_is_behind_and_goes_on_when_it_opens(world, thing, config):
    w = chair_behind_a_door(world, thing)
    *_, (_, robot, decision) = play(w, [DOOR], config)
    assert decision.waits_for == ("lobby",)
    assert decision.action is None
    assert not decision.finished
    assert decision.message == "waits for door lobby, which is closed: chair 1 is behind it"
    assert not DOOR.contains(robot.x_m, robot.y_m)
    w.solid[w.mark == "D"] = False
    w.clearance_m = world_clearance(w)
    *_, (_, _, decision) = play(w, [replace(DOOR, kind="open")], config)
    assert decision.found, "the map still has the closed door, which is taken for old"
    assert w.gap_m("C") < 1.1


def world_clearance(world):
    import cv2

    return cv2.distanceTransform((~world.solid).astype(np.uint8), cv2.DIST_L2, 5) * 0.05


def test_without_anything_behind_it_a_closed_door_isnt_waited_for(world, thing):
    w = chair_behind_a_door(world, thing)
    w.things["C"].known = {}
    *_, (_, _, decision) = play(w, [DOOR], ACTIONS)
    assert decision.error == "not_found"


def test_a_closed_door_is_driven_around_where_there_is_another_way(world, thing):
    w = world(ROOMS, {"C": thing("chair", looks_like="chair", known=KNOWN), "T": thing("table"), "S": thing("sofa")})
    for closed in (UPPER, LOWER):
        places = [(r.x_m, r.y_m) for _, r, d in play(w, [closed], ACTIONS)]
        assert not any(closed.contains(*p) for p in places)


def test_of_several_closed_doors_the_one_is_named_that_leads_there(world, thing):
    w = chair_behind_a_door(world, thing)
    other = box(8.9, 0.5, 0.4, 0.4, name="door cupboard", kind="closed", passage="cupboard")
    *_, (_, _, decision) = play(w, [other, DOOR], ACTIONS)
    assert decision.waits_for == ("lobby",)
