"""Every number of the planner's core."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal


@dataclass(frozen=True, slots=True)
class PlannerConfig:
    """Settings of the planner's core; lengths in metres, angles in radians.

    Attributes:
        strategy: what ranks frontiers: ``greedy`` (nearest), ``object`` (relevance of objects near by),
            ``region`` (the value map): the paper's three.
        verification: ``two_level`` stops only at what the robot itself confirmed (or very strong surveillance
            evidence that it doesn't contradict); ``paper`` stops at whatever fusion calls confirmed.
        sweep_m: when all is explored and the target wasn't seen, the robot looks around again until every place it can
            get to lies this near to a full look around: a detector needs more than a glance from
            afar. 0: never.
        settle_chance: when nothing is left to explore, or no steps are, the object that has the best chance to be the
            target, if it is this, is accepted after all, also one dropped or rejected that the robot itself takes for
            the target. Above 1: never.
        tight_m, tight_speed: nearer to a mapped obstacle than the robot's radius, down to ``tight_m``, it may go
            at this speed where there is no other way: maps are thicker than walls by a cell or so.
        unknown_speed: how fast the front runs through unknown space, relative to known free space; 0 forbids it.
        hard_way_m: a waypoint that only tight places lead to, on a way that takes so much longer [m of free space] than
            twice its distance, is left for the end unless a confirmed target is there: such gaps are mostly the map's.
        stairs_known: which stairs the robot may head for: ``seen``, those whose end on its floor is explored in the joint
            map (and any when nothing else is left to explore), or ``plan``, all of the building.
        promising_chance: below it, an object isn't gone to before all is explored.
        even_relevance, even_relevances, single_shift, other_shift, relevance_scale, confirmed_chance: the chance that an
            object is the target is even at this relevance (of the target's class), or so much higher for a single
            detection and for what looks more like something else; logistic around it, and at least that much for a
            confirmed one. Fitted to objects of searches in training buildings (chairs mostly are what they look
            like, beds are not).
        verify_m, explore_m, explore_chance: waypoints compare by their chance per metre: the way to an object and what
            looking at it costs; the way to a frontier and what exploring beyond it costs, for this chance.
        explore_chances: the same for targets of which there are more. Without cameras, searches of training buildings
            find one every 9 m of exploring (chair), 12 (potted plant), 23 (bed), 27 to 33 (tv, toilet, couch).
        objects_first: any promising object comes before exploring, however far it is.
        value_gain: what the highest value of a frontier adds to its chance, as a share of it, where values decide.
        frontier_wide_m: a frontier this wide hides as much as any; a narrow one half of it.
        switch_ratio: the waypoint that the robot is on its way to is left for one that is worth so much more.
        floor_confidence: another floor whose cameras saw the target this surely is gone to, if it beats this floor's
            cameras by ``floor_margin``, nothing confirmed or promising is known here, and exploring here isn't worth
            more; ``floor_m`` is about how far the target is from the stairs.
        floor_chance, floor_chances: how often a floor has the target although its cameras don't see it (by class: the
            floors of training buildings, before ``floor_chance``), before the robot explored any of it. 1: surely, it
            never leaves its floor.
        stairs_reach_m: so near to a stair's end it can be taken; halved with every refusal, ``stairs_tries`` in all.
        floor_visits: how often the robot comes to a floor at most.
        patience_steps: a waypoint that the robot gets no nearer to for so long is given up for ``dormant_steps``.
        steps_per_m: what a metre of way costs, turns included, with some to spare.
        scan_turns, scan_unless_m: the robot first looks around on a floor, unless what is most likely a target is so near.
        detour_m, max_detours: a way that grows by this beyond its shortest, because the map shows that another one is
            needed, is given new patience, so often.
        exploit_min_std, exploit_min_ratio: frontier values decide only if their standard deviation and their
            max/mean reach these (ApexNav's adaptive rule, arXiv 2504.14478); otherwise they count for nothing.
    """

    strategy: Literal["greedy", "object", "region"] = "region"
    verification: Literal["two_level", "paper"] = "two_level"

    # the robot
    robot_radius_m: float = 0.18
    step_m: float = 0.25
    turn_rad: float = 0.5235987755982988
    half_fov_rad: float = 0.66
    camera_height_m: float = 0.88

    # terrain
    comfort_m: float = 0.45
    wall_speed: float = 0.3
    tight_m: float = 0.10
    tight_speed: float = 0.05
    unknown_speed: float = 0.5
    visited_radius_m: float = 0.15
    escape_radius_m: float = 0.30
    crop_margin_m: float = 1.0
    turn_cost_m: float = 0.015

    # frontiers
    frontier_min_cells: int = 8
    frontier_piece_m: float = 2.0
    value_radius_m: float = 0.5
    object_radius_m: float = 3.0
    exploit_min_std: float = 0.015
    exploit_min_ratio: float = 1.10
    distance_weight_per_m: float = 0.05
    value_gain: float = 1.0
    frontier_wide_m: float = 1.0
    objects_first: bool = False
    explore_chance: float = 0.08
    explore_chances: Mapping[str, float] = field(default_factory=lambda: {"chair": 0.27, "potted plant": 0.2})
    explore_m: float = 3.0
    hard_way_m: float = 4.0
    reached_m: float = 0.45
    same_place_m: float = 0.5
    dormant_steps: int = 60
    patience_steps: int = 20
    steps_per_m: float = 7.0
    detour_m: float = 0.5
    max_detours: int = 4
    scan_turns: int = 12
    scan_unless_m: float = 3.0
    sweep_m: float = 2.0

    # objects
    promising_chance: float = 0.25
    even_relevance: float = 0.30
    even_relevances: Mapping[str, float] = field(
        default_factory=lambda: {
            "bed": 0.40, "chair": 0.15, "couch": 0.15, "potted plant": 0.19, "toilet": 0.32, "tv": 0.32,
        }
    )  # fmt: skip
    single_shift: float = 0.095
    other_shift: float = 0.15
    relevance_scale: float = 0.126
    confirmed_chance: float = 0.9
    verify_m: float = 2.0
    switch_ratio: float = 1.3
    standoff_m: float = 0.75
    stop_m: float = 0.85
    farthest_stop_m: float = 1.50
    inspect_m: float = 2.0
    verify_confidence_robot: float = 0.25
    strong_confidence_surveillance: float = 0.80
    strong_detections: int = 3
    max_looks: int = 4
    settle_chance: float = 0.30

    # floors
    stairs_known: Literal["seen", "plan"] = "seen"
    floor_confidence: float = 0.4
    floor_margin: float = 0.15
    floor_m: float = 12.0
    floor_chance: float = 0.8
    floor_chances: Mapping[str, float] = field(
        default_factory=lambda: {
            "bed": 0.6, "chair": 0.5, "couch": 0.55, "potted plant": 0.95, "toilet": 0.95, "tv": 0.75,
        }
    )  # fmt: skip
    stairs_reach_m: float = 0.45
    stairs_tries: int = 3
    floor_visits: int = 3

    # getting stuck
    stuck_steps: int = 24
    max_escapes: int = 3
