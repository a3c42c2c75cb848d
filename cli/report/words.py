"""A run in plain words."""

from __future__ import annotations

from typing import Literal

from cli.report.record import RunRecord

_FAILURES = {
    "not_found": "everything reachable was searched and nothing passed for one",
    "unreachable": "there is no way to it",
    "out_of_steps": "the robot ran out of steps",
    "robot_lost": "the robot was lost",
    "perception_down": "perception was down",
    "fusion_down": "fusion was down",
    "stuck": "the robot was stuck",
    "bad_target": "this isn't a target that can be searched for",
}


def outcome(record: RunRecord) -> tuple[Literal["good", "half", "bad"], str]:
    """How the run ended, in one sentence."""
    steps, path, shortest = record.number("steps"), record.number("path_m"), record.number("shortest_path_m")
    effort = f" after {steps:.0f} steps and {path:.1f} m" if steps is not None and path is not None else ""
    if record.success:
        best = f" (the shortest way is {shortest:.1f} m)" if shortest is not None else ""
        return "good", f"Found the {record.target}: the robot stopped where it should{effort}{best}."
    if record.found:
        away = record.number("distance_to_viewpoint_m")
        how = f": it is {away:.1f} m from the nearest place that counts" if away is not None else ""
        return "half", f"Stopped for a {record.target}{effort}, but the simulator's check says no{how}."
    status = record.status
    if status is None:
        return "bad", f"The run ended before its mission for a {record.target} had a status."
    if status.state == "cancelled":
        return "bad", f"The search for a {record.target} was cancelled{effort}."
    if status.state not in ("failed", "done"):
        return "bad", f"The search for a {record.target} didn't end: it was {status.state} ({status.phase}){effort}."
    why = _FAILURES.get(status.error, status.error.replace("_", " ") or "no reason was given")
    return "bad", f"Didn't find a {record.target}{effort}: {why}."
