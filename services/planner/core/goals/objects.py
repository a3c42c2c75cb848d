"""Which objects may be the target, and how likely each is."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator

from surveilnav.messages import ObjectRecord
from surveilnav.services.planner.core import memory
from surveilnav.services.planner.core.config import PlannerConfig
from surveilnav.services.planner.core.state import MissionState

#: An object that the robot is on its way to stays promising down to this share of what made it so.
_HELD = 0.6


def candidates(objects: Iterable[ObjectRecord], state: MissionState, config: PlannerConfig) -> list[ObjectRecord]:
    """Objects that may be the target, confirmed ones first, then by chance.

    What was found not to be the target stays out, also under a new id at the same place, unless the robot
    itself has confirmed it since, or accepted it as a last resort.
    """
    found = []
    for record, _ in may_be(objects, state.target):
        ruled_out = record.status == "rejected" or record.id in state.here.dropped
        ruled_out |= near_dropped(record, state, config) and not robot_sees(record, state.target, config)
        if record.id == state.here.accepted_object or not ruled_out:
            found.append(record)
    return sorted(found, key=lambda o: (not is_confirmed(o, state.target), -chance(o, state.target)))


def promising(objects: Iterable[ObjectRecord], state: MissionState, config: PlannerConfig) -> list[ObjectRecord]:
    """The candidates that are worth leaving off exploring: confirmed ones, the accepted last resort, and those whose chance
    reaches ``promising_chance``."""
    return [o for o in candidates(objects, state, config) if _is_promising(o, state, config)]


def _is_promising(record: ObjectRecord, state: MissionState, config: PlannerConfig) -> bool:
    if record.id == state.here.accepted_object or is_confirmed(record, state.target):
        return True
    if config.promising_chance is None:
        return False
    held = state.waypoint is not None and state.waypoint.object_id == record.id
    return chance(record, state.target) >= config.promising_chance * (_HELD if held else 1.0)


def last_resorts(objects: Iterable[ObjectRecord], state: MissionState, config: PlannerConfig) -> list[ObjectRecord]:
    """What may be taken for the target when nothing else is left, likeliest first: objects of this floor with a chance of
    ``last_resort_chance`` that nobody ruled out yet, or that the robot itself takes for the target though they were rejected or
    dropped (detectors that see a couch from afar and a bed from near by make fusion reject what it is). What was given
    up for good stays so. The one accepted before stays, whatever more views say.
    """
    if config.last_resort_chance is None:
        return []
    found = []
    for record, confirmed in may_be(objects, state.target):
        held = record.id == state.here.accepted_object
        if not held and was_ruled_out(record, state, config) and record.label_robot != state.target:
            continue
        if memory.is_given_up(state, *record.center_m[:2], config, confirmed=confirmed):
            continue
        sure = chance(record, state.target)
        if held or sure >= config.last_resort_chance:
            found.append((-sure, record.id, record))
    return [record for _, _, record in sorted(found, key=lambda f: f[:2])]


def may_be(objects: Iterable[ObjectRecord], target: str) -> Iterator[tuple[ObjectRecord, bool]]:
    """Objects that some view called the target and that aren't surely something else; whether each is confirmed."""
    for record in objects:
        confirmed = is_confirmed(record, target)
        if _named(record, target) and _finite(record) and (confirmed or record.status != "confirmed"):
            yield record, confirmed


def was_ruled_out(record: ObjectRecord, state: MissionState, config: PlannerConfig) -> bool:
    """Whether fusion rejected an object, or the robot dropped it or another at its place."""
    return record.status == "rejected" or record.id in state.here.dropped or near_dropped(record, state, config)


def is_confirmed(record: ObjectRecord, target: str) -> bool:
    """Fusion calls it confirmed, and by the target's name."""
    return record.status == "confirmed" and record.label == target


def chance(record: ObjectRecord, target: str) -> float:
    """How likely the object is the target, 0-1, as the joint map says; what isn't a share says nothing."""
    chances = record.label_scores.get(target, 0.0), record.confidence if record.label == target else 0.0
    return max(p if 0.0 <= p <= 1.0 else 0.0 for p in chances)


def robot_sees(record: ObjectRecord, target: str, config: PlannerConfig) -> bool:
    """Whether the robot's own views call it the target, surely enough."""
    return record.label_robot == target and record.confidence_robot >= config.verify_confidence_robot


def _named(record: ObjectRecord, target: str) -> bool:
    names = record.label, record.label_robot, record.label_surveillance
    return target in names or record.label_scores.get(target, 0.0) > 0.0


def _finite(record: ObjectRecord) -> bool:
    return all(math.isfinite(v) for v in (*record.center_m, *record.size_m))


def near_dropped(record: ObjectRecord, state: MissionState, config: PlannerConfig) -> bool:
    """Whether the robot dropped an object at its place."""
    return any(
        math.hypot(record.center_m[0] - x, record.center_m[1] - y) < config.same_place_m
        for x, y, _ in state.here.dropped.values()
    )
