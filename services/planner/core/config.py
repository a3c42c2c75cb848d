"""All settings of the planner's core. Lengths are in metres, angles in radians."""

from __future__ import annotations

import math
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from surveilnav import robot_body
from surveilnav.messages import RobotDescription

#: Which settings a robot's own description replaces.
_OF_ROBOT = {
    "drive": "drive",
    "robot_radius_m": "radius_m",
    "camera_height_m": "camera_height_m",
    "half_fov_rad": "hfov_rad",
    "max_pitch_rad": "max_pitch_rad",
}
#: So far inside the edge of its picture an object is well in view.
_FOV_MARGIN_RAD = 0.03


class PlannerConfig(BaseModel):
    """Settings of the planner's core, grouped by what they decide.

    Raises:
        pydantic.ValidationError: a setting doesn't exist, or its value isn't allowed.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    strategy: Literal["greedy", "object", "region", "places"] = Field(
        "places",
        description="what ranks frontiers. places: a learned model of what lies beyond them. The paper's three: greedy knows "
        "their width and the way only, object adds the relevance of objects near the frontier, region the value map",
    )
    choice: Literal["utility", "sequence", "paper"] = Field(
        "utility",
        description="utility: of all options the one of the highest chance per metre; sequence: the first of the order with the "
        "shortest expected way until the target is found; paper: a confirmed target, else a "
        "promising candidate, else the best frontier, however far they are",
    )
    verification: Literal["two_level", "paper"] = Field(
        "two_level",
        description="two_level stops only at an object that is confirmed and that the robot itself sees, or that is likely "
        "enough after the robot looked at it from near by; paper stops at whatever fusion calls confirmed",
    )

    # --- the robot ---
    drive: Literal["actions", "waypoints"] = Field(
        "actions",
        description="actions: the robot moves by one discrete action at a time; waypoints: it drives to places by itself. A "
        "robot's description says which",
    )
    robot_radius_m: float = Field(
        robot_body.RADIUS_M,
        gt=0,
        le=2,
        description="the robot's footprint is a disc of this radius (Habitat's ObjectNav robot)",
    )
    step_m: float = Field(robot_body.STEP_M, description="how far move_forward goes")
    turn_rad: float = Field(robot_body.TURN_RAD, description="how far turn_left and turn_right turn")
    half_fov_rad: float = Field(
        0.66,
        gt=0,
        le=math.pi,
        description="an object within this angle of the robot's heading is well inside its camera's view",
    )
    camera_height_m: float = Field(
        robot_body.CAMERA_HEIGHT_M, gt=0, le=4, description="height of its camera above the floor"
    )
    max_pitch_rad: float = Field(
        robot_body.MAX_PITCH_RAD, ge=0, description="how far its camera tilts; 0: it doesn't tilt"
    )
    waypoint_tolerance_m: float = Field(
        0.25,
        ge=0,
        description="a robot that drives by itself stops within this distance of a waypoint (Nav2's default)",
    )

    # --- terrain ---
    comfort_clearance_m: float = Field(0.45, description="farther than this from obstacles it drives at full speed")
    wall_speed: float = Field(
        0.3, description="speed where its body just fits beside an obstacle, as a share of full speed"
    )
    obstacle_excess_m: float = Field(
        0.075,
        ge=0,
        description="mapped obstacles are assumed to be this much thicker than the real ones (a cell and its corner): where "
        "there is no other way, the robot tries gaps that are too narrow by up to this",
    )
    constrained_speed: float = Field(
        0.05, description="speed where an obstacle is mapped nearer than the robot's radius, as a share of full speed"
    )
    unknown_speed: float = Field(
        0.5, description="factor on the speed through unexplored space; 0 forbids driving through it"
    )
    estimated_obstacle_speed: float = Field(
        0.2,
        gt=0,
        le=1,
        description="factor on the speed within the robot's radius of an obstacle that is only estimated",
    )
    visited_free_radius_m: float = Field(
        0.15, description="within this distance of places where the robot stood, the ground counts as free"
    )
    robot_free_radius_m: float = Field(
        0.30, description="within this distance of the robot, the ground counts as free whatever the map says"
    )
    crop_margin_m: float = Field(
        1.0, description="planning covers everything known and this much unknown space around it"
    )
    turn_cost_m: float = Field(0.015, description="cost of a turn when sequences of steps are compared")

    # --- frontiers ---
    frontier_min_cells: int = Field(8, description="smaller clusters of frontier cells are ignored")
    frontier_piece_m: float = Field(2.0, description="longer frontiers are cut into pieces of at most this length")
    frontier_wide_m: float = Field(
        1.0, description="a frontier of at least this width is expected to hide the most; a slit half as much"
    )
    frontier_score: Literal["utility", "value"] = Field(
        "utility",
        description="utility: expected chance per metre of travel and exploring; value: the highest value whatever the "
        "distance, the nearest if none is known",
    )
    value_radius_m: float = Field(
        0.5, description="a frontier's value is the highest of the value map within this distance of its middle"
    )
    object_radius_m: float = Field(
        3.0, description="strategy object: objects within this distance of a frontier count for it"
    )
    value_gain: float = Field(
        1.0,
        description="the frontier of the highest value has (1 + value_gain) times the chance of the one of the lowest",
    )
    exploit: Literal["adaptive", "always"] = Field(
        "adaptive",
        description="adaptive: values decide only where they differ enough (ApexNav's rule, arXiv 2504.14478)",
    )
    exploit_min_std: float = Field(0.015, description="adaptive: least standard deviation of the frontiers' values")
    exploit_min_ratio: float = Field(1.10, description="adaptive: least ratio of the highest value to the mean")
    distance_weight_per_m: float = Field(
        0.05, description="second look: how much a metre of travel takes off a place's value"
    )
    explore_cost_m: float = Field(3.0, description="cost of exploring beyond a frontier, in addition to the way to it")
    explore_chance: float = Field(0.12, description="chance that exploring one frontier finds the target")
    places_certainty: float = Field(
        0.2,
        gt=0,
        le=1,
        description="strategy places: a frontier counts like an object of this chance at the end of the way that is expected",
    )
    reached_m: float = Field(
        0.45, description="the robot has reached a frontier, or a place to look around from, within this distance"
    )

    # --- waypoints ---
    same_place_m: float = Field(0.5, description="places within this distance of each other count as the same place")
    switch_ratio: float = Field(
        1.3,
        description="the robot leaves its current waypoint only for one with this many times its utility (hysteresis)",
    )
    sequence_options: int = Field(6, ge=2, le=10, description="choice sequence: so many options are put in an order")
    sequence_margin_m: float = Field(
        1.0, ge=0, description="choice sequence: the current option is left only for an order that is shorter by this"
    )
    patience_steps: int = Field(
        20, description="a waypoint that the robot gets no nearer to for this many steps is blacklisted"
    )
    blacklist_steps: int = Field(
        60,
        description="how long a place is left alone after the robot failed to reach it, unless nothing else of its kind is left",
    )
    detour_m: float = Field(
        0.5, description="a way that becomes longer by this is a new way, for which patience begins anew"
    )
    max_detours: int = Field(
        4, description="how often the way may turn out to be longer before the waypoint is blacklisted"
    )
    constrained_detour_m: float = Field(
        4.0,
        description="a waypoint that only narrow gaps lead to, on a way that is longer than twice its distance by more than "
        "this, is left for the end unless a confirmed target is there: such gaps are mostly errors of the map",
    )
    steps_per_m: float = Field(7.0, description="steps that a metre of travel takes, turns included, on the safe side")
    scan_turns: int = Field(12, description="turns of a full look around")
    skip_scan_within_m: float = Field(
        3.0, description="there is no initial scan where an object within this distance is likely the target"
    )
    second_look_m: float | None = Field(
        2.0,
        gt=0,
        description="when all is explored in vain, the robot looks around again until every place is within this distance of "
        "a full look around, because a detector needs more than a glance from afar. None: never",
    )

    # --- objects ---
    promising_chance: float | None = Field(
        0.1,
        description="unconfirmed objects with a lower chance wait until all is explored. None: all unconfirmed ones wait",
    )
    verify_cost_m: float = Field(2.0, gt=0, description="cost of looking at an object, in addition to the way to it")
    standoff_m: float = Field(0.75, description="preferred distance from an object to stop at")
    stop_m: float = Field(
        0.95,
        description="an object in sight counts as reached within this distance, also on the way to within standoff_m",
    )
    farthest_stop_m: float = Field(1.50, description="the farthest distance at which an object counts as reached")
    inspect_m: float = Field(
        2.0, description="on its way, the robot turns to an unverified object once it is within this distance"
    )
    verify_confidence_robot: float = Field(
        0.25, description="least confidence of the robot's own views that verifies or contradicts an object"
    )
    accept_chance: float = Field(
        0.70,
        description="an unconfirmed object that the robot looked at from near by is accepted from this chance on",
    )
    max_look_places: int = Field(
        2,
        ge=1,
        description="an object that the robot doesn't see from near by, or sees vaguely, is looked at from so many places before "
        "it is believed or dismissed for good",
    )
    max_extra_looks: int = Field(
        4, description="looks in other directions at an object that isn't verified, before the robot dismisses it"
    )
    last_resort_chance: float | None = Field(
        0.30,
        description="when nothing is left to explore, or hardly any steps are, the likeliest object is accepted if it has at "
        "least this chance; also a rejected one, if the robot itself takes it for the target. None: never",
    )

    # --- floors ---
    stairs_known: Literal["seen", "plan"] = Field(
        "seen",
        description="which stairs the robot may head for: seen, those explored (any, once nothing else is left); plan, all "
        "of the building's plan",
    )
    floor_confidence: float = Field(
        0.2, description="the robot goes to another floor if its cameras saw the target with at least this confidence"
    )
    floor_margin: float = Field(
        0.15, description="and only if that is higher than the evidence on this floor by at least this"
    )
    floor_search_m: float = Field(12.0, description="expected distance from the stairs to a target on another floor")
    floor_chance: float = Field(
        0.7,
        description="chance that a floor has a target that its cameras don't see; 1: it surely has, the robot never leaves",
    )
    stairs_radius_m: float = Field(
        0.45, description="stairs can be taken within this distance of their end; halved after every failure"
    )
    max_stairs_failures: int = Field(3, description="stairs that failed this often aren't tried again")
    max_floor_visits: int = Field(3, description="how often the robot may come to the same floor")

    # --- being stuck ---
    stuck_steps: int = Field(24, description="without getting anywhere for this many steps, the robot is stuck")
    max_recoveries: int = Field(3, description="attempts to get a stuck robot moving before the mission fails")

    def for_robot(self, robot: RobotDescription) -> PlannerConfig:
        """These settings with a robot's own size, camera and way of driving, where it differs from Habitat's robot.

        Raises pydantic.ValidationError: the description holds what no robot can be.
        """
        usual = RobotDescription()
        changes: dict[str, Any] = {}
        for setting, field in _OF_ROBOT.items():
            if (value := getattr(robot, field)) != getattr(usual, field):
                changes[setting] = value
        if "half_fov_rad" in changes:
            changes["half_fov_rad"] = changes["half_fov_rad"] / 2 - _FOV_MARGIN_RAD
        return self.changed(**changes)

    def changed(self, **changes: Any) -> PlannerConfig:
        """A copy with some settings changed. Raises pydantic.ValidationError."""
        return PlannerConfig(**{**self.model_dump(), **changes})
