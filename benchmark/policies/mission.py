"""The policy that all baselines are variants of: they differ in how they choose frontiers and in when they believe a detector.

A baseline is a ``FrontierRule``, a ``PlannerConfig`` and the maps' settings; scans, driving, stairs and ways out of
being stuck are ours for all of them. A paper that says nothing of these gets the better choice.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from surveilnav.benchmark.policies.policy import Task
from surveilnav.services.fusion.core import FusionConfig
from surveilnav.services.planner.core import Decision, FloorMaps, MissionState, PlannerConfig, RobotView, step
from surveilnav.services.planner.core.context import FrontierRule

#: A single detection of at least this score is believed by those who go to the first one. (VLFM asks .8 of YOLOv7;
#: the detectors here are less sure of themselves, and .5 is what SurveilNav's confirmation asks.)
FIRST_SIGHT_SCORE = 0.5


_STAYS: Mapping[str, Any] = {"floor_chance": 1.0}


class MissionPolicy:
    """A searcher that runs the planner's core, with a frontier rule and settings of its own.

    With ``summaries`` the robot may change floors by what the cameras of other floors report. Without, floors are searched one
    after the other: when nothing is left to explore on one, ``unsearched_floors`` sends the robot to the nearest floor that
    isn't searched yet, unless the task says that the first floor has a goal.
    """

    def __init__(
        self, task: Task, config: PlannerConfig, rule: FrontierRule | None = None, *, summaries: bool = False
    ) -> None:
        self._task, self._rule, self._summaries = task, rule, summaries
        self._config = config.changed(**({**_STAYS, **task.planning} if task.goal_on_floor else task.planning))
        self._state = MissionState(task.target, max_steps=task.max_steps)

    @property
    def steps(self) -> int:
        """Actions decided so far."""
        return self._state.step

    def act(self, maps: FloorMaps, robot: RobotView, summaries: Mapping[str, Mapping[str, float]]) -> Decision:
        reported = summaries if self._summaries else {}
        self._state, decision = step(self._state, maps, robot, self._config, self._task.driver, reported, self._rule)
        return decision


def first_sight(fusion: FusionConfig) -> FusionConfig:
    """Maps on which the first detection that is sure enough makes an object for good: nothing speaks against it."""
    threshold = {"min_confidence": FIRST_SIGHT_SCORE, "min_detections": 1, "flip_rejects": False}
    return fusion.changed(
        {
            "objects": {
                "points": {"min_score": FIRST_SIGHT_SCORE},
                "confirmation": {"rule": "paper", "paper": threshold},
                "false_positives": {"size_prior": False},
            }
        }
    )
