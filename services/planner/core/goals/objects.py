"""Which objects may be the target, and how likely each of them is."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator

from surveilnav.messages import ObjectRecord
from surveilnav.services.planner.core.config import PlannerConfig
from surveilnav.services.planner.core.memory.mission_state import MissionState

#: The object that the robot is heading for stays promising down to this share of ``promising_chance`` (hysteresis).
_CURRENT_SHARE = 0.6


def candidates(objects: Iterable[ObjectRecord], state: MissionState, config: PlannerConfig) -> list[ObjectRecord]:
    """Objects that may be the target, confirmed ones first, then by chance.

    Objects found not to be the target are left out, also under a new id at the same place, unless the robot itself sees
    the target there since, or the object is accepted as a last resort. Under the same id it has to be likely enough to stop, too,
    and comes back once at most after the robot looked at it from ``max_look_places``.
    """
    found = []
    for record, confirmed in possible_targets(objects, state.target):
        seen = robot_sees(record, state.target, config)
        likely = config.verification != "paper" and (confirmed or chance(record, state.target) >= config.accept_chance)
        may_return = seen and likely and len(state.here.looked_from.get(record.id, ())) <= config.max_look_places
        ruled_out = record.status == "rejected" or (record.id in state.here.dismissed and not may_return)
        ruled_out |= is_near_dismissed(record, state, config) and not seen
        if record.id == state.here.accepted_object or not ruled_out:
            found.append(record)
    return sorted(found, key=lambda o: (not is_confirmed(o, state.target), -chance(o, state.target)))


def promising(objects: Iterable[ObjectRecord], state: MissionState, config: PlannerConfig) -> list[ObjectRecord]:
    """The candidates that may interrupt exploring: confirmed ones, the accepted last resort, and those whose chance reaches
    ``promising_chance``."""
    return [o for o in candidates(objects, state, config) if _is_promising(o, state, config)]


def _is_promising(record: ObjectRecord, state: MissionState, config: PlannerConfig) -> bool:
    if record.id == state.here.accepted_object or is_confirmed(record, state.target):
        return True
    if config.promising_chance is None:
        return False
    is_current = state.waypoint is not None and state.waypoint.object_id == record.id
    return chance(record, state.target) >= config.promising_chance * (_CURRENT_SHARE if is_current else 1.0)


def last_resorts(objects: Iterable[ObjectRecord], state: MissionState, config: PlannerConfig) -> list[ObjectRecord]:
    """Objects of this floor that may be accepted as the target when nothing else is left, likeliest first.

    Their chance reaches ``last_resort_chance``, and they aren't ruled out or the robot itself takes them for the target all
    the same (detectors that see a couch from afar and a bed from near by make fusion reject what it is). Permanently
    blacklisted ones are left out. The one accepted before stays, whatever chance more views give it.
    """
    if config.last_resort_chance is None:
        return []
    found = []
    for record, confirmed in possible_targets(objects, state.target):
        is_accepted = record.id == state.here.accepted_object
        if not is_accepted and is_ruled_out(record, state, config) and record.label_robot != state.target:
            continue
        if state.here.blacklist.contains_permanently(*record.center_m[:2], config, confirmed=confirmed):
            continue
        likelihood = chance(record, state.target)
        if is_accepted or likelihood >= config.last_resort_chance:
            found.append((-likelihood, record.id, record))
    return [record for _, _, record in sorted(found, key=lambda f: f[:2])]


def possible_targets(objects: Iterable[ObjectRecord], target: str) -> Iterator[tuple[ObjectRecord, bool]]:
    """Objects that some view called the target and that aren't confirmed as something else; and whether each is confirmed."""
    for record in objects:
        confirmed = is_confirmed(record, target)
        if _was_called(record, target) and _is_finite(record) and (confirmed or record.status != "confirmed"):
            yield record, confirmed


def is_ruled_out(record: ObjectRecord, state: MissionState, config: PlannerConfig) -> bool:
    """Whether fusion rejected an object, or the robot dismissed it or another one at its place."""
    return record.status == "rejected" or record.id in state.here.dismissed or is_near_dismissed(record, state, config)


def is_near_dismissed(record: ObjectRecord, state: MissionState, config: PlannerConfig) -> bool:
    """Whether the robot dismissed an object at the same place."""
    return any(
        math.hypot(record.center_m[0] - d.x_m, record.center_m[1] - d.y_m) < config.same_place_m
        for d in state.here.dismissed.values()
    )


def is_confirmed(record: ObjectRecord, target: str) -> bool:
    """Whether fusion confirmed an object as the target."""
    return record.status == "confirmed" and record.label == target


def chance(record: ObjectRecord, target: str) -> float:
    """The chance that an object is the target, 0 to 1, by the joint map. Scores outside of 0 to 1 are ignored."""
    chances = record.label_scores.get(target, 0.0), record.confidence if record.label == target else 0.0
    return max(p if 0.0 <= p <= 1.0 else 0.0 for p in chances)


def robot_sees(record: ObjectRecord, target: str, config: PlannerConfig) -> bool:
    """Whether the robot's own views call an object the target with enough confidence."""
    return record.label_robot == target and record.confidence_robot >= config.verify_confidence_robot


def _was_called(record: ObjectRecord, target: str) -> bool:
    names = record.label, record.label_robot, record.label_surveillance
    return target in names or record.label_scores.get(target, 0.0) > 0.0


def _is_finite(record: ObjectRecord) -> bool:
    return all(math.isfinite(v) for v in (*record.center_m, *record.size_m))
