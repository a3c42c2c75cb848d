"""Every number of the planner's core. Lengths in metres, angles in radians."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from surveilnav import robot_body


class PlannerConfig(BaseModel):
    """Settings of the planner's core, by what they decide.

    Raises:
        pydantic.ValidationError: a setting that doesn't exist, or a value that can't be.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    strategy: Literal["greedy", "object", "region"] = Field(
        "region",
        description="what ranks frontiers, the paper's three: the nearest, the relevance of objects near by, the value map",
    )
    verification: Literal["two_level", "paper"] = Field(
        "two_level",
        description="two_level stops only at what is confirmed and the robot itself sees, or at what is likely enough after it "
        "looked from near by; paper stops at whatever fusion calls confirmed",
    )

    # --- the robot ---
    robot_radius_m: float = Field(
        robot_body.RADIUS_M, description="its footprint is a disc of this radius (Habitat's ObjectNav robot)"
    )
    step_m: float = Field(robot_body.STEP_M, description="how far move_forward goes")
    turn_rad: float = Field(robot_body.TURN_RAD, description="how far turn_left and turn_right turn")
    half_fov_rad: float = Field(0.66, description="what lies within this of its heading is well in its camera's view")
    camera_height_m: float = Field(robot_body.CAMERA_HEIGHT_M, description="of its camera above the floor")

    # --- terrain ---
    comfort_m: float = Field(0.45, description="farther than this from obstacles it drives at full speed")
    wall_speed: float = Field(0.3, description="speed right at its radius from an obstacle, as a share of full speed")
    spare_m: float = Field(
        0.075,
        ge=0,
        description="where there is no other way: mapped obstacles are thicker than walls by so much, a cell and its corner",
    )
    tight_speed: float = Field(0.05, description="speed nearer to an obstacle than its radius")
    unknown_speed: float = Field(0.5, description="speed through unexplored space; 0 forbids it")
    visited_radius_m: float = Field(
        0.15, description="so near to where it stood the ground is free whatever the map says"
    )
    escape_radius_m: float = Field(0.30, description="so near to the robot the ground is free whatever the map says")
    crop_margin_m: float = Field(1.0, description="unknown space around everything known that is planned through")
    turn_cost_m: float = Field(0.015, description="what a turn costs when sequences of steps are compared")

    # --- frontiers ---
    frontier_min_cells: int = Field(8, description="smaller clusters of frontier cells are left out")
    frontier_piece_m: float = Field(2.0, description="longer frontiers are cut into pieces of at most this")
    frontier_wide_m: float = Field(1.0, description="a frontier this wide hides as much as any; a slit half of it")
    frontier_score: Literal["worth", "value"] = Field(
        "worth",
        description="worth: chance per metre of way and exploring; value: the highest value whatever the way, else the nearest",
    )
    value_radius_m: float = Field(
        0.5, description="a frontier's value is the best of the value map so near to its middle"
    )
    object_radius_m: float = Field(3.0, description="strategy object: objects so near to a frontier count")
    value_gain: float = Field(1.0, description="what the highest value adds to a frontier's chance, as a share of it")
    exploit: Literal["adaptive", "always"] = Field(
        "adaptive",
        description="adaptive: values decide only where they differ enough (ApexNav's rule, arXiv 2504.14478)",
    )
    exploit_min_std: float = Field(0.015, description="adaptive: least standard deviation of the values")
    exploit_min_ratio: float = Field(1.10, description="adaptive: least ratio of their highest to their mean")
    distance_weight_per_m: float = Field(
        0.05, description="second look: what a metre of way takes from a place's value"
    )
    explore_m: float = Field(3.0, description="what exploring beyond a frontier costs, beside the way to it")
    explore_chance: float = Field(0.12, description="how likely exploring one frontier finds the target")
    objects_first: bool = Field(False, description="any promising object comes before exploring, however far it is")
    reached_m: float = Field(0.45, description="so near to a frontier or a place to look from the robot has arrived")

    # --- waypoints ---
    same_place_m: float = Field(0.5, description="places so near to each other are one")
    switch_ratio: float = Field(
        1.3, description="the waypoint on the way to is left for one that is worth so much more"
    )
    patience_steps: int = Field(
        20, description="a waypoint that the robot gets no nearer to for so long is blacklisted"
    )
    blacklist_steps: int = Field(60, description="for so long a place is left alone that the robot failed to reach")
    detour_m: float = Field(0.5, description="a way that grows by this is another way, and gets patience of its own")
    max_detours: int = Field(4, description="how often a way may turn out longer before the waypoint is blacklisted")
    hard_way_m: float = Field(
        4.0,
        description="a waypoint that only tight places lead to, on a way longer by this than twice its distance, is left for "
        "the end unless a confirmed target is there: such gaps are mostly the map's",
    )
    steps_per_m: float = Field(
        7.0, description="what a metre of way costs in steps, turns included, with some to spare"
    )
    scan_turns: int = Field(12, description="turns of a full look around")
    scan_unless_m: float = Field(3.0, description="no first look around where the likely target is so near")
    second_look_m: float | None = Field(
        2.0,
        gt=0,
        description="when all is explored in vain, the robot looks around again until every place lies so near to a full look "
        "around: a detector needs more than a glance from afar. None: never",
    )

    # --- objects ---
    promising_chance: float | None = Field(
        0.1, description="less likely objects aren't gone to before all is explored. None: none but confirmed ones are"
    )
    confirmed_first: bool = Field(False, description="a confirmed target comes before all else, whatever the way")
    verify_m: float = Field(2.0, gt=0, description="what looking at an object costs, beside the way to it")
    standoff_m: float = Field(0.75, description="where to stand before an object, if a way leads so near")
    stop_m: float = Field(0.85, description="where to stand before an object if no way leads to ``standoff_m``")
    farthest_stop_m: float = Field(1.50, description="the farthest place from which an object counts as reached")
    inspect_m: float = Field(2.0, description="so near on its way the robot turns to an object that isn't verified")
    verify_confidence_robot: float = Field(0.25, description="the robot's own confidence that verifies or contradicts")
    accept_chance: float = Field(
        0.70, description="from which an object is accepted that was looked at from near by and isn't confirmed"
    )
    max_looks: int = Field(4, description="looks from other directions at an object before it is dropped")
    last_resort_chance: float | None = Field(
        0.30,
        description="when nothing is left to explore, or no steps are, the likeliest object is accepted after all if it has this "
        "chance, also one that was rejected if the robot itself takes it for the target. None: never",
    )

    # --- floors ---
    stairs_known: Literal["seen", "plan"] = Field(
        "seen",
        description="which stairs may be headed for: those explored (any, once nothing else is left), or all of the plan",
    )
    floor_confidence: float = Field(
        0.2, description="another floor is gone to if its cameras saw what is the target with this chance"
    )
    floor_margin: float = Field(
        0.15, description="another floor is gone to only if its evidence beats this floor's by this"
    )
    floor_m: float = Field(12.0, description="about how far the target is from the stairs")
    floor_chance: float = Field(
        0.7, description="how often a floor has a target that its cameras don't see; 1: surely, the robot never leaves"
    )
    stairs_reach_m: float = Field(
        0.45, description="so near to its end a stair can be taken; halved with every refusal"
    )
    stairs_tries: int = Field(3, description="a stair that failed so often is barred")
    floor_visits: int = Field(3, description="how often the robot comes to a floor at most")

    # --- getting stuck ---
    stuck_steps: int = Field(24, description="without any way gained for so long, the robot is stuck")
    max_escapes: int = Field(3, description="ways out of that before the mission fails")

    def changed(self, **changes: Any) -> PlannerConfig:
        """The same with some settings changed. Raises pydantic.ValidationError."""
        return PlannerConfig(**{**self.model_dump(), **changes})
